"""Systems made of systems: parts left out, replaced, or answered and driven from outside.

Purpose: the one place that takes a flat system apart. Proofs, attacks, environments, tests and
targets look at the same system "without its plants", "with this node replaced", "with these topics
driven from outside", and say so in these words. The given system stays as it is.
Non-goals: what the text says (`elaborator.py`), where a `replace` of a system or a test is judged
(`instantiate.py`); the re-checker derives its own systems, on purpose.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.elaborator import Elaborator
from soter.language.elaborate.step_times import waiting
from soter.language.model import typed
from soter.language.model.system import InputDrive, Scope
from soter.language.model.tree_walk import mode_reads

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from soter.language.model.system import (
        Component,
        Fault,
        Module,
        Property,
        Shield,
        System,
        TestPlan,
        Topic,
    )

OUTSIDE = "input"
"""`Topic.driver` of a topic that somebody outside of the system publishes."""


# ---------------------------------------------------------------- parts left out


def only(system: System, kept: Collection[int]) -> System:
    """The system of these components (indices), in their order, numbered anew.

    The three parts of a module stay or go together. Properties stay that speak only of what stays;
    topics stay, also those that nobody drives any more, and so do their draws. A node that reads
    the mode of a module that went is answered from outside; a DM whose predicates read one cannot
    be run or proved (R007). `hyperperiod_ns` stays a multiple of what is left. A test plan goes: it
    is about the whole.
    """
    at = {old: new for new, old in enumerate(sorted(kept))}
    modules = [m for m in system.modules if {m.dm, m.ac, m.sc} <= at.keys()]
    placed = {m.index: i for i, m in enumerate(modules)}

    def seen(scope: Scope) -> Scope:
        plants = {n: at[i] for n, i in scope.plants.items() if i in at}
        beside = {m: placed[i] for m, i in scope.modules.items() if i in placed}
        return Scope(dict(scope.topics), scope.params, plants, beside)

    def of(place: Mapping[int, int], index: int | None) -> int | None:
        return None if index is None else place[index]

    components = []
    for old, new in at.items():
        c = system.components[old]
        own = replace(c, index=new, module=of(placed, c.module), scope=seen(c.scope))
        components.append(_that_can_run(own))
    left = [p for p in system.properties if _can_be_judged(p, at, placed)]
    faults = [
        replace(f, component=at[f.component], on=of(at, f.on))
        for f in system.faults
        if f.component in at and (f.on is None or f.on in at)
    ]
    return replace(
        system,
        components=tuple(components),
        modules=tuple(
            replace(
                m,
                index=i,
                dm=at[m.dm],
                ac=at[m.ac],
                sc=at[m.sc],
                scope=seen(m.scope),
                over=of(placed, m.over),
            )
            for i, m in enumerate(modules)
        ),
        properties=tuple(
            replace(p, index=i, scope=seen(p.scope), component=of(at, p.component))
            for i, p in enumerate(left)
        ),
        faults=tuple(faults),
        measures=(),
        test=None,
    )


def undriven(system: System, kept: Collection[int]) -> System:
    """These components (indices): no properties, no draws, no end."""
    return replace(only(system, kept), properties=(), inputs=(), measures=(), until_ns=None)


def module_alone(system: System, module: Module, plants: Sequence[Component] = ()) -> System:
    """A module and these plants: no properties, no draws, no end; `modules[0]` is the module.

    Above another module it has that one's AC for its own.
    """
    if module.over is not None:
        ac = replace(system.components[module.ac], module=module.index)
        system = with_components(with_module(system, replace(module, over=None)), [ac])
    kept = [c.index for c in plants]
    return undriven(system, [*kept, module.dm, module.sc, module.ac])


def beside(flat: System, module: Module, plants: Sequence[typed.InstanceSymbol]) -> System:
    """A module of `flat` beside other plants than those that fly, with the values of `flat`.

    Topics are as they are where the module stands, and the plants see the parameters of the module.
    Raises `SoterError` where the two do not go together.
    """
    symbol = module.symbol
    ac, sc = (flat.components[i].node for i in (module.ac, module.sc))
    assert ac is not None
    assert sc is not None
    itself = replace(symbol, ac=ac, sc=sc, over=None)
    instances = (*plants, typed.InstanceSymbol(symbol.name, itself, {}, {}, symbol.span))
    made = typed.SystemSymbol(
        name=f"{symbol.name}.verify",
        span=symbol.verify.span or symbol.span,
        default=False,
        instances=instances,
        sets=tuple(own_of(module, instances)),
    )
    diagnostics = Diagnostics()
    around = {p.name: v for p, v in module.around.items()}
    elaborator = Elaborator(flat.program, made, around, diagnostics)
    elaborator.partial = True  # nobody drives what AC alone reads
    system = elaborator.run()
    if system is None or diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    system.params = flat.params
    return at_once(only(system, range(len(system.components))))


def own_of(module: Module, instances: Sequence[typed.InstanceSymbol]) -> Iterator[typed.SetSymbol]:
    """Settings that give each of these instances the parameters that a module has of its own."""
    for param, value in module.scope.params.items():
        if repr(value) != repr(module.around[param]):
            for instance in instances:
                yield typed.SetSymbol(instance.name, param, value, instance.span)


# ---------------------------------------------------------------- parts replaced


def with_components(system: System, changed: Iterable[Component]) -> System:
    """With these components in the place of those that have their indices."""
    components = list(system.components)
    for c in changed:
        components[c.index] = c
    return replace(system, components=tuple(components))


def with_node(
    component: Component, node: typed.NodeSymbol, topics: Mapping[typed.TopicSymbol, int]
) -> Component:
    """The component with another node without locals, which may read and publish `topics` too."""
    assert not node.locals
    scope = replace(component.scope, topics={**component.scope.topics, **topics})
    return replace(component, node=node, scope=scope, initial=(), binding=None)


def answered_outside(system: System, indices: Collection[int]) -> System:
    """With these components (nodes or plants) as unbound externs."""
    return with_components(system, (_as_extern(system.components[i]) for i in indices))


def unbound(system: System) -> System:
    """With no extern bound; nothing that is put into a module or a scope reaches the original."""
    return only(
        with_components(system, [replace(c, binding=None) for c in system.components]),
        range(len(system.components)),
    )


def with_module(system: System, module: Module) -> System:
    """With this module in the place of the one that has its index."""
    modules = [module if m.index == module.index else m for m in system.modules]
    return replace(system, modules=tuple(modules))


def forced(system: System, module: int, who: str) -> System:
    """With a module whose mode is always `who`, "ac" or "sc"."""
    modules = [replace(m, forced=who) if m.index == module else m for m in system.modules]
    return replace(system, modules=tuple(modules))


# ---------------------------------------------------------------- topics


def reading(module: Module, more: Sequence[int], **changes: Any) -> Module:  # noqa: ANN401 - fields
    """A module that reads more topics, with `changes`."""
    return replace(module, inputs=(*module.inputs, *more), **changes)


def with_changed_topics(system: System, changed: Iterable[Topic]) -> System:
    """With these topics in the place of those that have their indices."""
    topics = list(system.topics)
    for t in changed:
        topics[t.index] = t
    return replace(system, topics=tuple(topics))


def with_topics(system: System, made: Sequence[Topic]) -> System:
    """With more topics behind those that there are."""
    return replace(system, topics=(*system.topics, *made))


def with_topic(
    system: System, like: Topic, symbol: typed.TopicSymbol, name: str, **changes: object
) -> tuple[System, Topic]:
    """With one more topic, as `like` but for its symbol and `changes`; its names are made new.

    Nobody reads it in a queue yet: those of `like` collect what is published on `like`.
    """
    taken = {t.name for t in system.topics} | {t.symbol.name for t in system.topics}
    symbol = replace(symbol, name=_fresh(symbol.name, taken))
    index = len(system.topics)
    name = _fresh(name, taken)
    new = {"queues": (), **changes}
    made = replace(like, index=index, name=name, symbol=symbol, **new)  # type: ignore[arg-type]
    return replace(system, topics=(*system.topics, made)), made


def drawn(system: System, topic: int, every_ns: int) -> System:
    """With the values of a topic drawn from its set, as those of an input."""
    return replace(system, inputs=(*system.inputs, InputDrive(topic, every_ns)))


def driven_outside(system: System, topics: Collection[int]) -> System:
    """With these topics published from outside: nobody draws or drives them. Queues follow."""
    inside = {c.scope.topics[t] for c in system.components for t in c.published}
    assert inside.isdisjoint(topics)
    return replace(
        system,
        topics=tuple(
            replace(t, driver=OUTSIDE) if {t.index, t.queue_of} & set(topics) else t
            for t in system.topics
        ),
        inputs=drawn_where(system, lambda topic: topic not in topics).inputs,
    )


def drawn_where(system: System, wanted: Callable[[int], bool]) -> System:
    """With the draws of these topics only."""
    return replace(system, inputs=tuple(i for i in system.inputs if wanted(i.topic)))


def at_once(system: System) -> System:
    """With nothing held: what steps that take time publish counts as they happen.

    For those who count with `Component.takes_ns` themselves: proofs and tests.
    """
    gone = {c.held for c in system.components}
    kept = [t for t in system.topics if t.index not in gone]
    assert [t.index for t in kept] == list(range(len(kept))), "what is held comes last"
    return replace(
        system,
        topics=tuple(kept),
        components=tuple(replace(c, held=None) for c in system.components),
    )


def unlatched(system: System) -> System:
    """With DMs that give control back without being acknowledged: what P2b is about."""
    modules = tuple(replace(m, latch=None, acknowledgement=None) for m in system.modules)
    return replace(system, modules=modules)


# ---------------------------------------------------------------- what goes wrong


def _hidden(components: Sequence[Component], modules: Sequence[Module]) -> set[int | None]:
    """The topics that no program declares: what is held, and those of modules and shields."""
    own = {c.held for c in components} | {i for m in modules for i in (m.looked, m.latch)}
    shields = [m.shield for m in modules if m.shield is not None]
    return own | {i for s in shields for i in (s.topic, s.proposed)}


def _moved(shield: Shield, place: dict[int | None, int]) -> Shield:
    """The same, its topics elsewhere."""
    return replace(shield, topic=place[shield.topic], proposed=place.get(shield.proposed))


def faultless(system: System) -> System:
    """Nothing goes wrong, and nodes step in the deployed order: what proofs are about."""
    if not system.faults and not system.shuffled:
        return system
    components = tuple(replace(c, held=c.held if c.takes_ns else None) for c in system.components)
    kept = _hidden(components, system.modules)
    left = [t for t in system.topics if not t.held or t.index in kept]
    place: dict[int | None, int] = {t.index: k for k, t in enumerate(left)}
    # what is held comes last: only it moves
    return replace(
        system,
        topics=tuple(replace(t, index=k) if t.index != k else t for k, t in enumerate(left)),
        modules=tuple(
            replace(
                m,
                looked=place.get(m.looked),
                latch=place.get(m.latch),
                shield=m.shield and _moved(m.shield, place),
            )
            for m in system.modules
        ),
        components=tuple(
            c if c.held is None else replace(c, held=place[c.held]) for c in components
        ),
        faults=(),
        shuffled=False,
    )


def without_faults(system: System, gone: Collection[str], *, shuffled: bool) -> System:
    """Without these faults, as they were written; `shuffled`: in an order that is drawn."""
    left = [f for f in system.faults if f.text not in gone]
    faults = waiting(system.modules, left, shuffled=shuffled)
    return replace(system, faults=faults, shuffled=shuffled)


def only_inside(system: System) -> System:
    """Without the faults, as they were written, that are outside of what proofs assume for anybody.

    Nodes step in the deployed order.
    """
    gone = {f.text for f in system.faults if f.inside is None}
    return without_faults(system, gone, shuffled=False)


def with_faults(system: System, more: Sequence[Fault], *, shuffled: bool = False) -> System:
    """With more that goes wrong; `shuffled`: in an order that is drawn."""
    any_order = system.shuffled or shuffled
    faults = waiting(system.modules, (*system.faults, *more), shuffled=any_order)
    return replace(system, faults=faults, shuffled=any_order)


# ---------------------------------------------------------------- what is asked


def with_properties(system: System, properties: Sequence[Property]) -> System:
    """With these properties and no others."""
    return replace(system, properties=tuple(properties))


def with_test(system: System, plan: TestPlan) -> System:
    """With what a test adds to it."""
    return replace(system, test=plan)


# ---------------------------------------------------------------- shared


def _that_can_run(c: Component) -> Component:
    """Answered from outside where it reads the mode of a module that is not there."""
    if c.node is None or c.node.extern:
        return c
    read = mode_reads(*c.node.step, *(c.node.takeover or ()))
    return c if read.keys() <= c.scope.modules.keys() else _as_extern(c)


def _as_extern(c: Component) -> Component:
    """Its declaration without code: an extern has states or outputs, and no locals."""
    if c.plant is not None:
        return replace(c, plant=replace(c.plant, extern=True), binding=None)
    assert c.node is not None
    node = replace(c.node, extern=True, locals=(), initial=(), takeover=None, step=())
    return with_node(c, node, {})


def _can_be_judged(p: Property, at: Mapping[int, int], placed: Mapping[int, int]) -> bool:
    """Whether everything that a property reads, and whose contract it is, is left."""
    seen = [*p.scope.plants.values(), *([] if p.component is None else [p.component])]
    read = mode_reads(p.condition)
    there = {m for m, i in p.scope.modules.items() if i in placed}
    return all(i in at for i in seen) and read.keys() <= there


def _fresh(name: str, taken: Collection[str]) -> str:
    while name in taken:
        name += "_"
    return name
