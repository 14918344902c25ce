"""Checks whether a renaming of instances maps a test to itself, so that they behave alike.

Purpose: `RenamingCheck` accepts a renaming of components, topics, modules and locals if everything
that a search of the test looks at is the same after it: calendars, first values, sets, faults, what
every step and decision computes (`symbolic_terms.py`), what is judged, and the fields of a packed
configuration. Names do not matter. docs/testing.md says why configurations that differ by
such a renaming alone behave alike ("Equal instances").
Non-goals: finding renamings that may be accepted (`symmetric_blocks.py`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import TooManyStatementsError, walk
from soter.explore.model.footprints import step_code
from soter.explore.model.symbolic_terms import (
    InternedTerms,
    exact,
    predicate_terms,
    step_terms,
)

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator

    from soter.explore.model.exploration_plan import ExplorationPlan, PlannedActor
    from soter.explore.model.footprints import Label
    from soter.explore.model.symbolic_terms import Computed
    from soter.language.model.system import Component, Module, System, Topic

    Field = tuple[Label, int, int]

LOCALS_TRIED = 100
"""In how many ways the locals of one component are swapped, at most, until one fits."""


@dataclass(eq=False)
class Renaming:
    """What stands for what, by numbers of the system; what is not named stands for itself.

    `locals`: for (component, local) the local that stands for it, in a component that stands for
    itself. `inputs`, `actors`, `properties` and `timeds` follow from the rest, once accepted.
    """

    components: dict[int, int] = field(default_factory=dict)
    topics: dict[int, int] = field(default_factory=dict)
    modules: dict[int, int] = field(default_factory=dict)
    locals: dict[tuple[int, str], str] = field(default_factory=dict)
    actors: dict[int, int] = field(default_factory=dict)
    properties: dict[int, int] = field(default_factory=dict)
    timeds: dict[int, int] = field(default_factory=dict)

    def component(self, i: int | None) -> int | None:
        """The component that stands for a component."""
        return None if i is None else self.components.get(i, i)

    def topic(self, i: int) -> int:
        """The topic that stands for a topic."""
        return self.topics.get(i, i)

    def module(self, i: int | None) -> int | None:
        """The module that stands for a module."""
        return None if i is None else self.modules.get(i, i)

    def local(self, component: int, name: str) -> str:
        """The name of the local or state that stands for one, in what stands for its component."""
        return self.locals.get((component, name), name)

    def resource_key(self, what: core.Cell | core.Fact) -> Hashable:
        """The key of a cell or a fact after the renaming."""
        if isinstance(what, core.Fact):
            if what.fact == "age":
                return "age", self.topic(what.index)
            return what.fact, self.module(what.index) if what.fact == "mode" else 0
        if what.kind == "topic":
            return "topic", self.topic(what.owner)
        return what.kind, self.component(what.owner), self.local(what.owner, what.name)

    def label(self, label: Label) -> Label:
        """What stands for a piece of a configuration (`footprints.py`)."""
        kind, index = label[0], label[1]
        if kind == "cell":
            return kind, self.components.get(index, index), self.local(index, label[-1])  # type: ignore[arg-type]
        renamed = {
            **dict.fromkeys(("done", "lost", "held"), self.actors),
            **dict.fromkeys(("mode", "gate", "verdict"), self.modules),
            **dict.fromkeys(("topic", "stamp"), self.topics),
            **dict.fromkeys(("latched", "control"), self.components),
            "due": self.timeds,
        }
        return kind, renamed[kind].get(index, index) if kind in renamed else index


IDENTITY = Renaming()


class RenamingCheck:
    """Accepts renamings of one test."""

    def __init__(
        self,
        system: System,
        lowered: core.CoreSystem,
        plan: ExplorationPlan,
        fields: tuple[Field, ...],
    ) -> None:
        self.system = system
        self.core = lowered
        self.plan = plan
        self.terms = InternedTerms(lowered.functions)
        self.widths: dict[Label, list[int]] = {}
        for label, _, width in fields:
            self.widths.setdefault(label, []).append(width)
        self._own: dict[int, Computed] = {}
        self._reads = {
            component.index: self._named_resources(component) for component in system.components
        }

    def accepts(self, r: Renaming) -> bool:
        """Whether everything is the same after a renaming; fills in what follows from the rest."""
        try:
            return (
                all(self._topic_key(t, r) == self._topic_key(self.system.topics[r.topic(t.index)])
                    for t in self.system.topics)
                and all(self._fits(x, r) for x in self.system.components)
                and all(self._module_key(m, r) == self._module_key(self._renamed_module(m, r))
                        for m in self.system.modules)
                and self._keeps_plan(r)
                and self._keeps_calendars(r)
                and self._keeps_judgements(r)
                and all(self.widths[x] == self.widths.get(r.label(x)) for x in self.widths)
            )  # fmt: skip
        except TooManyStatementsError:
            return False

    def _renamed_module(self, m: Module, r: Renaming) -> Module:
        return self.system.modules[r.modules.get(m.index, m.index)]

    # ------------------------------------------------------------ topics and components

    def _topic_key(self, t: Topic, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
        return (
            t.type,
            t.bounds,
            exact(t.default),
            t.max_age_ns,
            t.policy,
            None if t.queue_of is None else r.topic(t.queue_of),
            frozenset([r.topic(q) for q in t.queues]),
        )

    def _fits(self, x: Component, r: Renaming) -> bool:
        """Whether what stands for a component is like it and computes the same."""
        y = self.system.components[r.components.get(x.index, x.index)]
        if x is not y and (x.node is not y.node or x.plant is not y.plant or _is_apart(x)):
            return False
        if self._component_key(x, r) != self._component_key(y):
            return False
        if x is y and self._names_nothing_renamed(x, r):
            return True
        if self._computation(x, r) == self._own_computation(y):
            return True
        return x is y and any(self._fits_with_locals(x, r, some) for some in _own_swaps(x))

    def _fits_with_locals(self, x: Component, r: Renaming, some: dict[str, str]) -> bool:
        """Whether a component computes the same with some locals swapped; if so it keeps these."""
        own = {(x.index, a): b for a, b in some.items()}
        r.locals |= own
        if self._computation(x, r) == self._own_computation(x):
            return True
        for key in own:
            del r.locals[key]
        return False

    def _component_key(self, x: Component, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
        """All numbers of a component that must be equal, without its code; locals: `_own_swaps`."""
        return (
            x.role,
            x.period_ns,
            x.phase_ns,
            r.module(x.module),
            exact(x.initial),
            x.initial_range,
            frozenset([(r.topic(t), exact(v)) for t, v in x.failsafe.items()]),
            tuple([(d.low, d.high, d.hold_ns) for d in x.disturbances]),
            frozenset([(r.topic(m.topic), m.leaf, m.bound) for m in x.measured]),
            x.substeps,
            x.binding,
        )

    def _own_computation(self, x: Component) -> Computed:
        if x.index not in self._own:
            self._own[x.index] = self._computation(x, IDENTITY)
        return self._own[x.index]

    def _computation(self, x: Component, r: Renaming) -> Computed:
        """What a step computes, a decision included."""
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        computation: Computed = ()
        if step is not None:
            computation = step_terms(self.terms, step, r.resource_key, r.topics)
        if x.role == "dm":
            assert x.module is not None
            d = self.core.decisions[x.module]
            for p in (d.ttf, d.safer):
                computation = (*computation, predicate_terms(self.terms, p, r.resource_key))
        return computation

    def _module_key(self, m: Module, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
        return (
            m.symbol.name,
            r.component(m.dm),
            r.component(m.ac),
            r.component(m.sc),
            m.period_ns,
            m.clean,
            frozenset([r.topic(t) for t in m.inputs]),
            frozenset([r.topic(t) for t in m.outputs]),
            m.forced,
            *(None if t is None else r.topic(t) for t in (m.latch, m.acknowledgement)),
        )

    # ------------------------------------------------------------ the test

    def _keeps_plan(self, r: Renaming) -> bool:
        """Whether the plan packs as much of each topic and component as of what stands for it."""
        p = self.plan
        topics = all({r.topic(t) for t in some} == some for some in (p.read, p.aged, p.limited))
        return topics and {r.component(x) for x in p.may_fault} == p.may_fault

    def _keeps_calendars(self, renaming: Renaming) -> bool:
        """Whether actors have the calendars, inputs the values, and nodes the faults."""
        assert self.system.test is not None
        inputs = self.system.inputs
        given = {
            (drive_.topic, drive_.every_ns, exact(drive_.values)): i
            for i, drive_ in enumerate(inputs)
        }
        number = {(actor.component, actor.input): i for i, actor in enumerate(self.plan.actors)}
        for i, actor in enumerate(self.plan.actors):
            drive = actor.input
            if actor.input is not None:
                drive_ = inputs[actor.input]
                drive = given.get(
                    (renaming.topic(drive_.topic), drive_.every_ns, exact(drive_.values))
                )
            j = number.get((renaming.component(actor.component), drive))
            if j is None:
                return False
            renaming.actors[i] = j
            other = self.plan.actors[j]
            if _calendar_times(actor) != _calendar_times(other):
                return False
            if (
                actor.overrun_ns
                and tuple([renaming.topic(topic) for topic in actor.outputs]) != other.outputs
            ):
                return False  # what is held has the order of the outputs
        faults = self.system.test.faults
        return Counter(
            (fault.kind, renaming.component(fault.component), fault.by_ns, fault.at_most)
            for fault in faults
        ) == (
            Counter((fault.kind, fault.component, fault.by_ns, fault.at_most) for fault in faults)
        )

    def _keeps_judgements(self, renaming: Renaming) -> bool:
        """Whether the same is judged of the test after the renaming."""
        system, timed = self.system, self.core.timed
        assert system.test is not None
        terms = self.terms

        def of_property(i: int, renaming: Renaming) -> Hashable:
            p = system.properties[i]
            told = predicate_terms(terms, self.core.properties[i], renaming.resource_key)
            return p.kind, renaming.component(p.component), told

        def of_timed(i: int, renaming: Renaming) -> Hashable:
            assert system.test is not None
            t = system.test.timed[i]
            told = [
                predicate_terms(terms, p, renaming.resource_key)
                for p in (timed[i].premise, timed[i].condition)
            ]
            return t.kind, t.within_ns, renaming.module(t.module), tuple(told)

        for count, of, into in (
            (len(system.properties), of_property, renaming.properties),
            (len(timed), of_timed, renaming.timeds),
        ):
            before: dict[Hashable, list[int]] = {}
            after: dict[Hashable, list[int]] = {}
            for i in range(count):
                before.setdefault(of(i, IDENTITY), []).append(i)
                after.setdefault(of(i, renaming), []).append(i)
            for key, some in after.items():
                if len(before.get(key, ())) != len(some):
                    return False
                into.update(zip(some, before[key], strict=True))
        return True

    # ------------------------------------------------------------ what is touched

    def reads(self, x: Component) -> tuple[tuple[str, int], ...]:
        """The topics and modules that a component's code names, in that order."""
        return self._reads[x.index]

    def _named_resources(self, component: Component) -> tuple[tuple[str, int], ...]:
        step = self.core.nodes.get(component.index) or self.core.plants.get(component.index)
        code = [] if step is None else list[object](step_code(step))
        topics = list[int]()
        if component.role == "dm":
            assert component.module is not None
            d, m = self.core.decisions[component.module], self.system.modules[component.module]
            code += [d.ttf.body, d.ttf.value, d.safer.body, d.safer.value]
            topics += (*m.reads, *m.outputs, *(() if m.latch is None else (m.latch,)))
        topics += [o.topic for o in (step.outputs if step else ())]
        topics += component.failsafe
        if component.plant is not None or component.node is not None:
            topics += component.reads
        resources = [("topic", t) for t in topics]
        return (*resources, *_resources_read(code))

    def _names_nothing_renamed(self, x: Component, r: Renaming) -> bool:
        """Whether a component's code names nothing that is renamed."""
        of = {"topic": r.topics, "module": r.modules}
        return all(of[kind].get(i, i) == i for kind, i in self._reads[x.index])


def _is_apart(x: Component) -> bool:
    """Whether a component's name matters, since its answers or draws depend on it."""
    return x.extern or any(d.hold_ns for d in x.disturbances)


def _own_swaps(x: Component) -> Iterator[dict[str, str]]:
    """Ways to swap a component's locals or states in pairs, with equal types and first values."""
    if len(x.initial) != len(x.variables):
        return iter(())
    kinds: dict[Hashable, list[str]] = {}
    for i, v in enumerate(x.variables):
        span = x.initial_range[i] if x.initial_range else None
        kinds.setdefault((v.type, exact(x.initial[i]), span), []).append(v.name)
    pairings = _pairings([some for some in kinds.values() if len(some) > 1])
    return islice((pairs for pairs in pairings if pairs), LOCALS_TRIED)


def _pairings(kinds: list[list[str]]) -> Iterator[dict[str, str]]:
    """All ways to put some of each kind into pairs."""
    if not kinds:
        yield {}
        return
    (first, *others), *rest = kinds
    smaller = [others, *rest] if len(others) > 1 else rest
    yield from _pairings(smaller)
    for k, other in enumerate(others):
        left = others[:k] + others[k + 1 :]
        for more in _pairings([left, *rest] if len(left) > 1 else rest):
            yield {first: other, other: first, **more}


def _calendar_times(a: PlannedActor) -> tuple[int, ...]:
    return a.period_ns, a.phase_ns, a.window_ns, a.overrun_ns, a.least_ns, a.skips


def _resources_read(code: Iterable[object]) -> Iterator[tuple[str, int]]:
    """The topics and modules that code reads."""
    for n in walk(tuple(code)):
        if isinstance(n, core.Get) and n.cell.kind == "topic":
            yield "topic", n.cell.owner
        elif isinstance(n, core.Fact) and n.fact in ("mode", "age"):
            yield ("module" if n.fact == "mode" else "topic"), n.index
