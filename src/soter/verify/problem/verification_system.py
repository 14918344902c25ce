"""Makes the system in which a module is proved from the system that flies.

Purpose: `verification_system_of` makes, from a flat system and one of its modules, a system of that
module and its verification plants, and nothing else (docs/verification.md, section 1).
`system_with_mode_topics` replaces `mode(M)` of another module, and `margin(M)` of any, in SC,
`ttf` and `safer` by a topic that nobody publishes, which may have any value at any read. It also
says for which modules P2b waits, and whether these wait in turn (docs/proof-modules.md,
"Coordinated switching"). `system_under_law` puts the fail-safe law, a constant for each output, in
the place of SC; the core K_fs is computed of it (docs/proof.md, "When the trusted part stops").
Non-goals: quantities and ranges (`extract.py`); one's own mode; the sets
(`verify/claims/product_sets.py`); the re-checker, which reads `mode` by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from soter.language.elaborate import derived_systems
from soter.language.elaborate.views_for_proofs import with_influences_drawn
from soter.language.model import typed
from soter.language.model.system import Bound, Topic, name_of_subsystem
from soter.language.model.tree_walk import nodes, rewritten, topic_reads
from soter.language.model.types import DURATION, FLOAT, MODE
from soter.verify.problem.problem import NO_MODES, Modes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.elaborate.views_for_proofs import Influence
    from soter.language.model.system import Component, Module, Scope, System

    Read = tuple[str, typed.ModuleSymbol | str]
    Names = tuple[tuple[Read, typed.TopicSymbol], ...]


@dataclass(frozen=True, eq=False)
class VerificationSystem:
    """A verification system with its only module and its plants; `flat` is the flying system."""

    system: System
    module: Module
    plants: tuple[Component, ...]
    abstract: bool
    """Whether the plants are abstractions of the ones that fly."""
    prefix: str
    """The prefix of the names of instances beside the module: `d.`, or nothing."""
    flat: System
    """The flying system, which holds the module as `home`."""
    home: Module
    influences: tuple[Influence, ...] = ()
    """The topics by which others move the plants, with any values of their declared sets."""

    @property
    def sc(self) -> Component:
        """The component that is the safe controller."""
        return self.system.components[self.module.sc]

    @property
    def driven(self) -> dict[int, Component]:
        """The verification plant that drives each topic, by topic index."""
        driver_by_topic = {}
        for c in self.plants:
            assert c.plant is not None
            for topic, _ in c.plant.drives:
                driver_by_topic[c.scope.topics[topic]] = c
        return driver_by_topic

    def flying_index(self, topic: typed.TopicSymbol) -> int:
        """The index in the flying system of a topic that the module reads; -1 if it has none."""
        home = self.home
        for scope in (home.scope, *(self.flat.components[i].scope for i in (home.sc, home.ac))):
            if topic in scope.topics:
                return scope.topics[topic]
        return -1

    def declared_time(self, c: Component, kind: str) -> typed.TypedExpr | None:
        """The declared `late` or `response` (`kind`) of a flying node; None if none is declared.

        The module names nodes without the name of the sub-system that holds them. For a node that
        declares how long its steps take, this duration is the response.
        """
        if kind == "response" and c.takes_ns is not None:
            return typed.Literal(DURATION, c.span, c.takes_ns[1])
        times: dict[str, typed.TypedExpr] = getattr(self.module.symbol.verify, f"{kind}_of")
        return times.get(c.name.removeprefix(self.home_prefix))

    def plant_shown_by(self, index: int) -> str:
        """The name of the flying plant whose state the topic with this index has to show."""
        plant = self.driven[index]
        if not self.abstract:
            return plant.name
        links = self.module.symbol.verify.abstracts
        return self.home_prefix + next(n.instance for n in links if n.name == plant.name)

    @property
    def home_prefix(self) -> str:
        """The name of the module's sub-system, with a dot; "" if the module is in no sub-system."""
        outer = name_of_subsystem(self.home)
        return outer + "." if outer else ""


def verification_system_of(flat: System, module: Module) -> VerificationSystem:
    """The verification system of a module of `flat`; raises `SoterError` if it has none."""
    abstract = bool(module.symbol.verify.abstracts)
    apart = (
        _system_with_abstractions(flat, module)
        if abstract
        else _system_with_flying_plants(flat, module)
    )
    system, influences = with_influences_drawn(apart, apart.modules[0])
    plants = tuple(c for c in system.components if c.role == "plant")
    prefix = "" if abstract else name_of_subsystem(module)
    prefix = prefix + "." if prefix else ""
    return VerificationSystem(
        system=system,
        module=system.modules[0],
        plants=plants,
        abstract=abstract,
        prefix=prefix,
        flat=flat,
        home=module,
        influences=influences,
    )


def topics_read_in_step(node: typed.NodeSymbol) -> list[typed.TopicSymbol]:
    """The topics that a controller's step reads; for an extern all topics that it subscribes to."""
    if node.extern:
        return [s.topic for s in node.subscribes]
    return list(topic_reads(*node.step))


def topics_read_by_module(
    module: typed.ModuleSymbol, sc: typed.NodeSymbol
) -> list[typed.TopicSymbol]:
    """Every topic that SC or a predicate of the module reads, or that names an axis."""
    axes = [a.topic for g in module.verify.groups for a in g.axes if a.topic is not None]
    reads = [*topics_read_in_step(sc), *topic_reads(*module.predicates), *axes]
    return list(dict.fromkeys(reads))


def read_by_dm(place: VerificationSystem) -> dict[int, None]:
    """The driven topics that the DM's predicates read; if computed, the topics of the axes."""
    symbol, module = place.module.symbol, place.module
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    topics = list(topic_reads(*predicates))
    if not predicates:
        topics = [a.topic for g in symbol.verify.groups for a in g.axes if a.topic is not None]
    scope = {**place.sc.scope.topics, **module.scope.topics}
    topics = topics or list(scope)  # computed predicates without a `grid` line read all of them
    return {scope[t]: None for t in topics if t in scope and scope[t] in place.driven}


def read_by_sc(place: VerificationSystem) -> dict[int, None]:
    """The driven topics that SC reads."""
    assert place.sc.node is not None
    topics = [place.sc.scope.topics[t] for t in topics_read_in_step(place.sc.node)]
    return {t: None for t in topics if t in place.driven}


def system_with_all_predicates(at: VerificationSystem) -> System:
    """The verification system of a view, but with all predicates of the flying module."""
    assert at.home.whole is not None
    return _system_with_abstractions(
        at.flat, replace(at.home, symbol=replace(at.home.whole, verify=at.home.symbol.verify))
    )


def _system_with_abstractions(flat: System, module: Module) -> System:
    """The system of the module and the plants that `abstracts` names."""
    links = module.symbol.verify.abstracts
    plants = [typed.InstanceSymbol(n.name, n.plant, {}, {}, n.span) for n in links]
    return derived_systems.proof_system(flat, module, plants)


def _system_with_flying_plants(flat: System, module: Module) -> System:
    """A system of the module alone, with the plants that it reads or that an axis names."""
    scope = {
        **flat.components[module.sc].scope.topics,
        **flat.components[module.ac].scope.topics,
        **module.scope.topics,
    }
    sc = flat.components[module.sc].node
    assert sc is not None
    topics_wanted = {scope[t] for t in topics_read_by_module(module.symbol, sc) if t in scope}
    home = name_of_subsystem(module)
    named = {a.instance for g in module.symbol.verify.groups for a in g.axes if a.instance}
    named = {f"{home}.{n}" if home else n for n in named}
    plants = [
        c
        for c in flat.components
        if c.plant is not None
        and (any(c.scope.topics[t] in topics_wanted for t, _ in c.plant.drives) or c.name in named)
    ]
    return derived_systems.module_alone(flat, module, plants)


def system_under_law(flat: System, module: Module) -> tuple[System, Module]:
    """The flying system with SC replaced by a node that publishes the fail-safe law.

    It also gives the module, which then declares no law. The times of SC are kept.
    """
    sc = flat.components[module.sc]
    made = derived_systems.with_components(flat, [_node_of_law(sc, module)])
    itself = replace(
        module, symbol=_module_under_law(module.symbol, made.components[module.sc]), law={}
    )
    if module.whole is not None:
        itself.whole = _module_under_law(module.whole, made.components[module.sc])
    return derived_systems.with_module(made, itself), itself


def why_law_not_held(flat: System, module: Module) -> str:
    """Why actuators do not hold the law that the module publishes; "" if they hold it.

    A node that reads the module's outputs stops with the trusted part, so no actuator gets the
    command that this node would have made of the law.
    """
    outputs = set(module.outputs)
    for c in flat.components:
        if c.node is None or c.index in (module.ac, module.sc):
            continue
        read = {*c.reads}
        if outputs & (read | {flat.topics[i].queue_of for i in read}):
            return f"`{c.name}` reads what the module publishes: it would stop, too"
    return ""


def _node_of_law(sc: Component, module: Module) -> Component:
    assert sc.node is not None
    step = tuple(typed.TypedPublish(e.span, t, e) for t, e in module.symbol.failsafe.items())
    node = replace(sc.node.node_with_step(step), takes=None)
    return replace(sc, node=node, initial=(), failsafe={}, binding=None)


def _module_under_law(symbol: typed.ModuleSymbol, sc: Component) -> typed.ModuleSymbol:
    assert sc.node is not None
    return replace(symbol, sc=sc.node, failsafe={})


READS: dict[type, str] = {typed.ModeRead: "mode", typed.MarginRead: "margin"}
"""The word for each kind of read of a module."""
SC, AC = MODE.members.index("SC"), MODE.members.index("AC")


def system_with_mode_topics(flat: System, module: Module) -> tuple[System, Module, Modes]:
    """A system with a topic for each other mode and each margin that a module reads.

    SC, `ttf` and `safer` read these topics instead, and nobody publishes the topics. It also gives
    the changed module, and the modes. Without such reads system and module stay the same.
    """
    sc = flat.components[module.sc]
    modules_read = _modules_by_read(flat, module, sc)
    if not modules_read:
        return flat, module, NO_MODES
    names: Names = tuple(
        (read, _cached_topic_symbol(read[0], m.name, m.symbol)) for read, m in modules_read.items()
    )
    kinds = {topic: (read[0], modules_read[read]) for read, topic in names}
    index_by_topic = {t: len(flat.topics) + k for k, t in enumerate(kinds)}
    mode_topics = [_topic_of_module(index, t, *kinds[t]) for t, index in index_by_topic.items()]
    symbol = _module_with_topics(module.symbol, names)
    derived_module = derived_systems.with_more_inputs(
        module,
        [index for t, index in index_by_topic.items() if t in symbol.topics_read],
        symbol=symbol,
        scope=_scope_with_topics(module.scope, index_by_topic),
        whole=None if module.whole is None else _module_with_topics(module.whole, names),
    )
    dm = replace(flat.components[module.dm], scope=derived_module.scope)
    assert sc.node is not None
    sc_scope = _scope_with_topics(sc.scope, index_by_topic)
    controller = replace(sc, node=_node_with_topics(sc.node, names), scope=sc_scope)
    system = derived_systems.with_module(
        derived_systems.with_topics(flat, mode_topics), derived_module
    )
    system = derived_systems.with_components(system, [dm, controller])
    waits = _modes_read_in(module, "safer")
    modes = Modes(
        {t: m.name for t, (kind, m) in kinds.items() if kind == "mode"},
        {
            t: f"margin({m.name}): 0 to {_margin_bound_s(m):g} s, anew at every read"
            for t, (kind, m) in kinds.items()
            if kind == "margin"
        },
        tuple(flat.modules[i].name for i in waits),
        _why_never_in_ac(flat, module, waits),
    )
    return system, derived_module, modes


def _topic_of_module(index: int, symbol: typed.TopicSymbol, kind: str, of: Module) -> Topic:
    """The topic that stands for the mode, or for the margin, of the module `of`."""
    is_mode = kind == "mode"
    return Topic(
        index=index,
        name=symbol.name,
        symbol=symbol,
        type=MODE if is_mode else FLOAT,
        bounds=(None if is_mode else Bound(0.0, _margin_bound_s(of)),),
        set_declared=True,
        default=SC if is_mode else 0.0,
        max_age_ns=None,
        driver=of.name,
    )


def _margin_bound_s(of: Module) -> float:
    """An upper bound of a module's margin, in s."""
    return max(of.levels - 1, 1) * of.period_ns / 1e9


def expression_with_others_in_ac(e: typed.TypedExpr, modes: Modes) -> typed.TypedExpr:
    """A copy of the expression in which the modes of all other modules are AC."""

    def mode_or_same(part: typed.TypedExpr) -> typed.TypedExpr:
        if isinstance(part, typed.TopicRead) and part.topic in modes.topics:
            return typed.Literal(MODE, part.span, AC)
        return part

    expression: typed.TypedExpr = rewritten(e, mode_or_same)
    return expression


def _modules_by_read(flat: System, module: Module, sc: Component) -> dict[Read, Module]:
    """The module that each read of a mode or margin names, except reads of its own mode."""
    known = {**sc.scope.modules, **module.scope.modules}
    return {
        (kind, s): flat.modules[known[s]]
        for kind, s in _reads_of_modules(module, sc)
        if s in known and (kind == "margin" or known[s] != module.index)
    }


def _reads_of_modules(module: Module, sc: Component) -> list[Read]:
    """The reads of modes and margins in SC, `ttf` and `safer`, as ("mode" or "margin", module)."""
    symbol, node = module.symbol, sc.node
    assert node is not None
    code = () if node.extern else (*node.step, *(node.takeover or ()))
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    reads: dict[Read, None] = {}
    for n in nodes((*code, *predicates)):
        if isinstance(n, (typed.ModeRead, typed.MarginRead)):
            reads[READS[type(n)], n.module] = None
    return list(reads)


def _modes_read_in(module: Module, *predicates: str) -> list[int]:
    """The indices of the other modules whose modes these predicates of a module read."""
    symbol = module.symbol if module.whole is None else module.whole
    declared = [e for e in (getattr(symbol, p) for p in predicates) if e is not None]
    read = [n.module for n in nodes(declared) if isinstance(n, typed.ModeRead)]
    indices = [module.scope.modules.get(s, module.index) for s in read]
    return [i for i in dict.fromkeys(indices) if i != module.index]


def _why_never_in_ac(flat: System, module: Module, waits: list[int]) -> str:
    """Why the modules that `module` waits for may never all be in AC; "" if no reason is known.

    A reason is that one is forced to SC, or that its decision depends, directly or through other
    modes, on this module, which is in SC while it waits.
    """
    for i in waits:
        awaited = flat.modules[i]
        if awaited.forced == "sc":
            return f"{awaited.name} is forced to SC"
        seen, todo = {i}, [i]
        while todo:
            decided_by = flat.modules[todo.pop()]
            for k in _modes_read_in(decided_by, "ttf", "safer"):
                if k == module.index:
                    return (
                        f"{module.name} waits for {awaited.name} to be in AC, whose DM goes by "
                        f"the mode of {module.name}: each may wait for the other for ever"
                    )
                todo += [k] if k not in seen else []
                seen.add(k)
    return ""


@lru_cache(maxsize=256)
def _cached_topic_symbol(kind: str, name: str, module: typed.ModuleSymbol) -> typed.TopicSymbol:
    """The topic symbol for a mode or margin, cached because symbols are compared by identity."""
    if kind == "mode":
        return typed.TopicSymbol(f"{name}.mode", module.span, MODE, False, {}, None, None)
    return typed.TopicSymbol(f"{name}.any_margin", module.span, FLOAT, False, {}, None, None)


@lru_cache(maxsize=256)
def _module_with_topics(symbol: typed.ModuleSymbol, names: Names) -> typed.ModuleSymbol:
    ttf, safer = (
        None if e is None else _code_with_topics_for_reads(e, names)
        for e in (symbol.ttf, symbol.safer)
    )
    read = topic_reads(*(e for e in (ttf, safer) if e is not None))
    more = dict.fromkeys(t for t in dict(names).values() if t in read)
    return replace(symbol, ttf=ttf, safer=safer, topics_read=(*symbol.topics_read, *more))


@lru_cache(maxsize=256)
def _node_with_topics(node: typed.NodeSymbol, names: Names) -> typed.NodeSymbol:
    if node.extern:
        return node
    step = _code_with_topics_for_reads(node.step, names)
    takeover = None if node.takeover is None else _code_with_topics_for_reads(node.takeover, names)
    read = topic_reads(*step, *(takeover or ()))
    heard = dict.fromkeys(t for _, t in names if t in read)
    more = tuple(typed.Subscribed(t, None, "", node.span) for t in heard)
    return replace(node, step=step, takeover=takeover, subscribes=(*node.subscribes, *more))


def _code_with_topics_for_reads(code: Any, names: Names) -> Any:  # noqa: ANN401 - any part of a tree
    topic_by_read = dict(names)

    def topic_or_same(part: Any) -> Any:  # noqa: ANN401 - any part of a tree
        kind = READS.get(type(part), "")
        if kind and (kind, part.module) in topic_by_read:
            return typed.TopicRead(part.type, part.span, topic_by_read[kind, part.module])
        return part

    return rewritten(code, topic_or_same)


def _scope_with_topics(scope: Scope, topics: Mapping[typed.TopicSymbol, int]) -> Scope:
    return replace(scope, topics={**scope.topics, **topics})
