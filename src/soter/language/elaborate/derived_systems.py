"""Makes systems from systems: with parts left out or replaced, or run outside of Soter.

Purpose: the one place that takes a flat system apart. Proofs, attacks, environments, tests and
targets need a system without its plants, with another node, or with nodes as unbound externs;
each such change is a function here that returns a new system and leaves the given one as it is.
Non-goals: what the text says (`flatten_system.py`), where a `replace` of a system or a test is
judged (`replace_parts.py`); the re-checker derives its own systems, on purpose.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.flatten_system import flatten
from soter.language.elaborate.passes.flattening import Flattening
from soter.language.elaborate.passes.step_times import with_wait_faults
from soter.language.model import typed
from soter.language.model.system import InputDrive, Scope
from soter.language.model.tree_walk import mode_reads

if TYPE_CHECKING:
    from collections.abc import (
        Callable,
        Collection,
        Container,
        Iterable,
        Iterator,
        Mapping,
        Sequence,
    )

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
"""The value of `Topic.driver` for a topic that something outside of the system publishes."""


# ---------------------------------------------------------------- parts left out


def with_only(system: System, kept: Collection[int]) -> System:
    """Gives the system of the components with these indices, in the same order, with new indices.

    `kept` has all three parts of a module or none. A property stays if everything that it reads
    stays. All topics and their draws stay, even without a driver. A node that reads the mode of a
    removed module becomes an extern; a DM whose predicates read such a mode cannot be run or proved
    (R007). `hyperperiod_ns` remains a multiple of the periods left. A test plan is removed.
    """
    at = {old: new for new, old in enumerate(sorted(kept))}
    modules = [m for m in system.modules if {m.dm, m.ac, m.sc} <= at.keys()]
    placed = {m.index: i for i, m in enumerate(modules)}

    def renumbered(scope: Scope) -> Scope:
        plants = {n: at[i] for n, i in scope.plants.items() if i in at}
        beside = {m: placed[i] for m, i in scope.modules.items() if i in placed}
        return Scope(dict(scope.topics), scope.params, plants, beside)

    def new_index(place: Mapping[int, int], index: int | None) -> int | None:
        return None if index is None else place[index]

    components = [
        _as_runnable(
            replace(c, index=new, module=new_index(placed, c.module), scope=renumbered(c.scope))
        )
        for old, new in at.items()
        for c in (system.components[old],)
    ]
    left = [p for p in system.properties if _reads_only_remaining(p, at, placed)]
    faults = [
        replace(f, component=at[f.component], on=new_index(at, f.on))
        for f in system.faults
        if f.component in at and (f.on is None or f.on in at)
    ]
    return replace(
        system,
        components=tuple(components),
        modules=tuple(
            replace(m, index=i, dm=at[m.dm], ac=at[m.ac], sc=at[m.sc], scope=renumbered(m.scope))
            for i, m in enumerate(modules)
        ),
        properties=tuple(
            replace(p, index=i, scope=renumbered(p.scope), component=new_index(at, p.component))
            for i, p in enumerate(left)
        ),
        faults=tuple(faults),
        measures=(),
        test=None,
    )


def bare_system(system: System, kept: Collection[int]) -> System:
    """Gives the system of the components `kept`, without properties, draws and `until`."""
    return replace(with_only(system, kept), properties=(), inputs=(), measures=(), until_ns=None)


def module_alone(system: System, module: Module, plants: Sequence[Component] = ()) -> System:
    """Gives the system of one module and these plants, without properties, draws and `until`."""
    kept = [c.index for c in plants]
    return bare_system(system, [*kept, module.dm, module.sc, module.ac])


def proof_system(flat: System, module: Module, plants: Sequence[typed.InstanceSymbol]) -> System:
    """Gives the system of a module and the plants of its proof, with the values of `flat`.

    Its topics are those that the module sees, and the plants get the parameters of the module.
    Raises SoterError if module and plants do not fit together.
    """
    symbol = module.symbol
    ac, sc = (flat.components[i].node for i in (module.ac, module.sc))
    assert ac is not None
    assert sc is not None
    itself = replace(symbol, ac=ac, sc=sc)
    instances = (*plants, typed.InstanceSymbol(symbol.name, itself, {}, {}, symbol.span))
    made = typed.SystemSymbol(
        name=f"{symbol.name}.verify",
        span=symbol.verify.span or symbol.span,
        default=False,
        instances=instances,
        sets=tuple(settings_of_instances(module, instances)),
    )
    diagnostics = Diagnostics()
    around = {p.name: v for p, v in module.around.items()}
    flattening = Flattening(flat.program, made, around, diagnostics)
    flattening.partial = True  # nothing drives topics that only AC reads
    system = flatten(flattening)
    if system is None or diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    system.params = flat.params
    return without_held_topics(with_only(system, range(len(system.components))))


def settings_of_instances(
    module: Module, instances: Sequence[typed.InstanceSymbol]
) -> Iterator[typed.SetSymbol]:
    """Yields settings that give each of these instances the parameter values of the module."""
    for param, value in module.scope.params.items():
        if repr(value) != repr(module.around[param]):
            for instance in instances:
                yield typed.SetSymbol(instance.name, param, value, instance.span)


# ---------------------------------------------------------------- parts replaced


def with_components(system: System, changed: Iterable[Component]) -> System:
    """Gives the system in which these components replace those with the same indices."""
    new = {c.index: c for c in changed}
    return replace(system, components=tuple(new.get(c.index, c) for c in system.components))


def with_node(
    component: Component, node: typed.NodeSymbol, topics: Mapping[typed.TopicSymbol, int]
) -> Component:
    """Gives the component with another node, without locals, whose scope also has `topics`."""
    assert not node.locals
    scope = replace(component.scope, topics={**component.scope.topics, **topics})
    return replace(component, node=node, scope=scope, initial=(), binding=None)


def with_unbound_externs(system: System, indices: Collection[int]) -> System:
    """Gives the system with the nodes or plants at these indices as externs without a binding."""
    return with_components(system, (_as_extern(system.components[i]) for i in indices))


def without_bindings(system: System) -> System:
    """Gives the system without bindings of externs; modules and scopes are copies."""
    return with_only(
        with_components(system, [replace(c, binding=None) for c in system.components]),
        range(len(system.components)),
    )


def with_module(system: System, module: Module) -> System:
    """Gives the system in which this module replaces the one with the same index."""
    modules = [module if m.index == module.index else m for m in system.modules]
    return replace(system, modules=tuple(modules))


def with_forced_mode(system: System, module: int, who: str) -> System:
    """Gives the system with a module whose mode is always `who`, "ac" or "sc"."""
    return with_module(system, replace(system.modules[module], forced=who))


def systems_by_plan(system: System, module: Module) -> Iterator[tuple[System, Module]]:
    """Yields the system and the module once for each plan, with that plan as the only SC."""
    sc = system.components[module.sc]
    for node in module.symbol.plans if module.plan is not None else ():
        symbol = replace(module.symbol, sc=node, plans=(), plan=None)
        alone = replace(module, symbol=symbol, plan=None)
        made = with_components(system, [replace(sc, node=node)])
        yield with_module(made, alone), alone


# ---------------------------------------------------------------- topics


def with_more_inputs(module: Module, more: Sequence[int], **changes: Any) -> Module:  # noqa: ANN401 - fields
    """Gives the module with more topics in `inputs`; `changes` are new values of other fields."""
    return replace(module, inputs=(*module.inputs, *more), **changes)


def with_changed_topics(system: System, changed: Iterable[Topic]) -> System:
    """Gives the system in which these topics replace those with the same indices."""
    new = {t.index: t for t in changed}
    return replace(system, topics=tuple(new.get(t.index, t) for t in system.topics))


def with_topics(system: System, made: Sequence[Topic]) -> System:
    """Gives the system with these topics added at the end."""
    return replace(system, topics=(*system.topics, *made))


def with_topic(
    system: System, like: Topic, symbol: typed.TopicSymbol, name: str, **changes: object
) -> tuple[System, Topic]:
    """Gives the system with one more topic, and this topic; `changes` are fields unlike `like`.

    The new topic has no queues, as the queues of `like` collect only values published on `like`.
    """
    taken = {t.name for t in system.topics} | {t.symbol.name for t in system.topics}
    symbol = replace(symbol, name=unused_name(symbol.name, taken))
    index = len(system.topics)
    name = unused_name(name, taken)
    new = {"queues": (), **changes}
    made = replace(like, index=index, name=name, symbol=symbol, **new)  # type: ignore[arg-type]
    return replace(system, topics=(*system.topics, made)), made


def with_drawn_topic(system: System, topic: int, every_ns: int) -> System:
    """Gives the system with a topic drawn from its set every `every_ns` ns, like an input."""
    return replace(system, inputs=(*system.inputs, InputDrive(topic, every_ns)))


def with_draws(system: System, wanted: Callable[[int], bool]) -> System:
    """Gives the system with only those draws whose topic `wanted` accepts."""
    return replace(system, inputs=tuple(i for i in system.inputs if wanted(i.topic)))


def without_held_topics(system: System) -> System:
    """Gives the system without held topics: outputs of steps that take time take effect at once.

    It is for proofs and tests, which handle `Component.takes_ns` themselves.
    """
    gone = {c.held for c in system.components}
    kept = [t for t in system.topics if t.index not in gone]
    assert [t.index for t in kept] == list(range(len(kept))), "what is held comes last"
    return replace(
        system,
        topics=tuple(kept),
        components=tuple(replace(c, held=None) for c in system.components),
    )


def without_latches(system: System) -> System:
    """Gives the system with DMs that give control back without acknowledgement, as P2b assumes."""
    modules = tuple(replace(m, latch=None, acknowledgement=None) for m in system.modules)
    return replace(system, modules=modules)


# ---------------------------------------------------------------- faults


def _hidden_topics(components: Sequence[Component], modules: Sequence[Module]) -> set[int | None]:
    """Gives the indices of topics that steps, modules and shields add to those of the program."""
    ids = {c.held for c in components} | {i for m in modules for i in (m.looked, m.latch, m.plan)}
    shields = [m.shield for m in modules if m.shield is not None]
    return ids | {i for s in shields for i in (s.topic, s.proposed)}


def _moved_shield(shield: Shield, place: dict[int | None, int]) -> Shield:
    return replace(shield, topic=place[shield.topic], proposed=place.get(shield.proposed))


def faultless(system: System) -> System:
    """Gives the system without faults, with nodes in the deployed order, as proofs assume."""
    if not system.faults and not system.shuffled:
        return system
    components = tuple(replace(c, held=c.held if c.takes_ns else None) for c in system.components)
    kept = _hidden_topics(components, system.modules)
    left = [t for t in system.topics if not t.held or t.index in kept]
    place: dict[int | None, int] = {t.index: k for k, t in enumerate(left)}
    # held topics are the last ones, so only they get new indices
    return replace(
        system,
        topics=tuple(replace(t, index=k) if t.index != k else t for k, t in enumerate(left)),
        modules=tuple(
            replace(
                m,
                looked=place.get(m.looked),
                latch=place.get(m.latch),
                plan=place.get(m.plan),
                shield=m.shield and _moved_shield(m.shield, place),
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
    """Gives the system without the faults whose `text` is in `gone`; `shuffled`: random order."""
    left = [f for f in system.faults if f.text not in gone]
    faults = with_wait_faults(system.modules, left, shuffled=shuffled)
    return replace(system, faults=faults, shuffled=shuffled)


def without_outside_faults(system: System) -> System:
    """Gives the system, in the deployed order, without faults that break assumptions of proofs."""
    gone = {f.text for f in system.faults if f.inside is None}
    return without_faults(system, gone, shuffled=False)


def with_faults(system: System, more: Sequence[Fault], *, shuffled: bool = False) -> System:
    """Gives the system with more faults; `shuffled` makes the order of steps random."""
    any_order = system.shuffled or shuffled
    faults = with_wait_faults(system.modules, (*system.faults, *more), shuffled=any_order)
    return replace(system, faults=faults, shuffled=any_order)


# ---------------------------------------------------------------- properties and tests


def with_properties(system: System, properties: Sequence[Property]) -> System:
    """Gives the system with `properties` in place of its properties."""
    return replace(system, properties=tuple(properties))


def with_test(system: System, plan: TestPlan) -> System:
    """Gives the system with `plan` as its test plan."""
    return replace(system, test=plan)


# ---------------------------------------------------------------- helpers


def _as_runnable(c: Component) -> Component:
    """Gives the component, as an extern if it reads the mode of a module that was removed."""
    if c.node is None or c.node.extern:
        return c
    read = mode_reads(*c.node.step, *(c.node.takeover or ()))
    return c if read.keys() <= c.scope.modules.keys() else _as_extern(c)


def _as_extern(c: Component) -> Component:
    """Gives the component as an extern, whose declaration has no code and no locals."""
    if c.plant is not None:
        return replace(c, plant=replace(c.plant, extern=True), binding=None)
    assert c.node is not None
    node = replace(c.node, extern=True, locals=(), initial=(), takeover=None, step=())
    return with_node(c, node, {})


def _reads_only_remaining(p: Property, at: Mapping[int, int], placed: Mapping[int, int]) -> bool:
    """Whether the parts and modules that a property reads remain, and a contract's component."""
    seen = [*p.scope.plants.values(), *([] if p.component is None else [p.component])]
    read = mode_reads(p.condition)
    present = {m for m, i in p.scope.modules.items() if i in placed}
    return all(i in at for i in seen) and read.keys() <= present


def unused_name(name: str, taken: Container[str]) -> str:
    """The name with underscores appended until it is not taken, or not in a taken text."""
    while name in taken:
        name += "_"
    return name
