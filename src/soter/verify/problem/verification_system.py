"""The system in which a module is proved, also with its fail-safe law in the place of SC.

Purpose: `place` makes, from a flat system and one of its modules, a system of that module and its
verification plants, and nothing else (docs/verification.md, section 1). `under_law` puts the
fail-safe law in the place of SC: of that system the core K_fs is computed (docs/proof.md, "When the
trusted part stops"). The law is a constant for each output, so SC reads nothing there.
Non-goals: quantities and ranges (`extract.py`); the sets (`verify/claims/product_sets.py`), the
lease (`schedule.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.elaborate import derived_systems
from soter.language.elaborate.views_for_proofs import moved_by_others
from soter.language.model import typed
from soter.language.model.system import holder_of
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import DURATION

if TYPE_CHECKING:
    from soter.language.elaborate.views_for_proofs import Influence
    from soter.language.model.system import Component, Module, System


@dataclass(frozen=True, eq=False)
class VerificationSystem:
    """A verification system; its only module is `module`, `plants` are its plants."""

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
    """What others publish that moves the plants: any values of the declared sets."""

    @property
    def sc(self) -> Component:
        """The safe controller."""
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

    def flying(self, topic: typed.TopicSymbol) -> int:
        """The index in the flying system of a topic that the module reads; -1: it has none."""
        home = self.home
        for scope in (home.scope, *(self.flat.components[i].scope for i in (home.sc, home.ac))):
            if topic in scope.topics:
                return scope.topics[topic]
        return -1

    def declared(self, c: Component, what: str) -> typed.TypedExpr | None:
        """The declared `late` or `response` of a node of the flying system; None: not declared.

        The module names nodes as its own system does, without that system's name. A node that
        declares how long its steps take has that as its response.
        """
        if what == "response" and c.takes_ns is not None:
            return typed.Literal(DURATION, c.span, c.takes_ns[1])
        times: dict[str, typed.TypedExpr] = getattr(self.module.symbol.verify, f"{what}_of")
        return times.get(c.name.removeprefix(self.around))

    def shown_by(self, index: int) -> str:
        """The name of the flying plant that a driven topic has to show."""
        plant = self.driven[index]
        if not self.abstract:
            return plant.name
        links = self.module.symbol.verify.abstracts
        return self.around + next(n.instance for n in links if n.name == plant.name)

    @property
    def around(self) -> str:
        """The name of the sub-system that holds the module, with a dot, or nothing."""
        outer = holder_of(self.flat, self.home)
        return outer + "." if outer else ""


def place(flat: System, module: Module) -> VerificationSystem:
    """The verification system of a module of `flat`; `SoterError` where there is none."""
    abstract = bool(module.symbol.verify.abstracts)
    apart = _abstract(flat, module) if abstract else _reduced(flat, module)
    system, influences = moved_by_others(apart, apart.modules[0])
    plants = tuple(c for c in system.components if c.role == "plant")
    prefix = "" if abstract else holder_of(flat, module)
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


def sc_reads(node: typed.NodeSymbol) -> list[typed.TopicSymbol]:
    """The topics that the step of a controller reads; all it subscribes to where it is unknown."""
    if node.extern:
        return [s.topic for s in node.subscribes]
    return list(topic_reads(*node.step))


def read_by_module(module: typed.ModuleSymbol, sc: typed.NodeSymbol) -> list[typed.TopicSymbol]:
    """Every topic that SC, a predicate or an axis of the module reads."""
    axes = [a.topic for g in module.verify.groups for a in g.axes if a.topic is not None]
    reads = [*sc_reads(sc), *topic_reads(*module.predicates), *axes]
    return list(dict.fromkeys(reads))


def whole(at: VerificationSystem) -> System:
    """The verification system of a view with all predicates of the module that flies."""
    assert at.home.whole is not None
    return _abstract(
        at.flat, replace(at.home, symbol=replace(at.home.whole, verify=at.home.symbol.verify))
    )


def _abstract(flat: System, module: Module) -> System:
    """The module beside the plants that `abstracts` names."""
    links = module.symbol.verify.abstracts
    plants = [typed.InstanceSymbol(n.name, n.plant, {}, {}, n.span) for n in links]
    return derived_systems.with_plants(flat, module, plants)


def _reduced(flat: System, module: Module) -> System:
    """The module's own system without the parts that the proof does not look at."""
    scope = {
        **flat.components[module.sc].scope.topics,
        **flat.components[module.ac].scope.topics,
        **module.scope.topics,
    }
    sc = flat.components[module.sc].node
    assert sc is not None
    wanted = {scope[t] for t in read_by_module(module.symbol, sc) if t in scope}
    home = holder_of(flat, module)
    named = {a.instance for g in module.symbol.verify.groups for a in g.axes if a.instance}
    named = {f"{home}.{n}" if home else n for n in named}
    plants = [
        c
        for c in flat.components
        if c.plant is not None
        and (any(c.scope.topics[t] in wanted for t, _ in c.plant.drives) or c.name in named)
    ]
    return derived_systems.module_alone(flat, module, plants)


def under_law(flat: System, module: Module) -> tuple[System, Module]:
    """The flying system with the law in the place of SC, and the module there; it has no law.

    Periods, phases, lateness and latencies stay those of SC.
    """
    sc = flat.components[module.sc]
    made = derived_systems.with_components(flat, [_lawful(sc, module)])
    itself = replace(module, symbol=_ruled(module.symbol, made.components[module.sc]), law={})
    if module.whole is not None:
        itself.whole = _ruled(module.whole, made.components[module.sc])
    return derived_systems.with_module(made, itself), itself


def behind(flat: System, module: Module) -> str:
    """Why actuators do not hold the law that the module publishes; "": they do.

    A node that reads the module's outputs stops with the trusted part, so nobody holds what it
    would have made of the law.
    """
    outputs = set(module.outputs)
    for c in flat.components:
        if c.node is None or c.index in (module.ac, module.sc):
            continue
        read = {*c.reads}
        if outputs & (read | {flat.topics[i].queue_of for i in read}):
            return f"`{c.name}` reads what the module publishes: it would stop, too"
    return ""


def _lawful(sc: Component, module: Module) -> Component:
    assert sc.node is not None
    step = tuple(typed.TypedPublish(e.span, t, e) for t, e in module.symbol.failsafe.items())
    node = replace(sc.node.doing(step), takes=None)
    return replace(sc, node=node, initial=(), failsafe={}, binding=None)


def _ruled(symbol: typed.ModuleSymbol, sc: Component) -> typed.ModuleSymbol:
    assert sc.node is not None
    return replace(symbol, sc=sc.node, failsafe={})
