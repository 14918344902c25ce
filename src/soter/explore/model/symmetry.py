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
from soter.explore.model.symbolic_terms import (
    InternedTerms,
    exact,
    of_predicate,
    of_step,
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

    def read(self, what: core.Cell | core.Fact) -> Hashable:
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
        of = {
            **dict.fromkeys(("done", "lost", "held"), self.actors),
            **dict.fromkeys(("mode", "gate", "verdict"), self.modules),
            **dict.fromkeys(("topic", "stamp"), self.topics),
            **dict.fromkeys(("latched", "control"), self.components),
            "due": self.timeds,
        }
        return kind, of[kind].get(index, index) if kind in of else index


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
        self._reads = {x.index: self._read_by(x) for x in system.components}

    def accepts(self, r: Renaming) -> bool:
        """Whether everything is the same after a renaming; fills in what follows from the rest."""
        try:
            return (
                all(self._topic(t, r) == self._topic(self.system.topics[r.topic(t.index)])
                    for t in self.system.topics)
                and all(self._fits(x, r) for x in self.system.components)
                and all(self._module(m, r) == self._module(self._renamed_module(m, r))
                        for m in self.system.modules)
                and self._plan(r)
                and self._calendars(r)
                and self._judged(r)
                and all(self.widths[x] == self.widths.get(r.label(x)) for x in self.widths)
            )  # fmt: skip
        except TooManyStatementsError:
            return False

    def _renamed_module(self, m: Module, r: Renaming) -> Module:
        return self.system.modules[r.modules.get(m.index, m.index)]

    # ------------------------------------------------------------ topics and components

    def _topic(self, t: Topic, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
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
        if self._numbers(x, r) != self._numbers(y):
            return False
        if x is y and self._names_nothing_renamed(x, r):
            return True
        if self._computed(x, r) == self._of(y):
            return True
        return x is y and any(self._with_locals(x, r, some) for some in _own_swaps(x))

    def _with_locals(self, x: Component, r: Renaming, some: dict[str, str]) -> bool:
        """Whether a component computes the same with some locals swapped; if so it keeps these."""
        own = {(x.index, a): b for a, b in some.items()}
        r.locals |= own
        if self._computed(x, r) == self._of(x):
            return True
        for key in own:
            del r.locals[key]
        return False

    def _numbers(self, x: Component, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
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

    def _of(self, x: Component) -> Computed:
        if x.index not in self._own:
            self._own[x.index] = self._computed(x, IDENTITY)
        return self._own[x.index]

    def _computed(self, x: Component, r: Renaming) -> Computed:
        """What a step computes, a decision included."""
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        computation: Computed = ()
        if step is not None:
            computation = of_step(self.terms, step, r.read, r.topics)
        if x.role == "dm":
            assert x.module is not None
            d = self.core.decisions[x.module]
            for p in (d.ttf, d.safer):
                computation = (*computation, of_predicate(self.terms, p, r.read))
        return computation

    def _module(self, m: Module, r: Renaming = IDENTITY) -> tuple[Hashable, ...]:
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
            r.module(m.over),
            *(None if t is None else r.topic(t) for t in (m.latch, m.acknowledgement)),
        )

    # ------------------------------------------------------------ the test

    def _plan(self, r: Renaming) -> bool:
        """Whether the plan packs as much of each topic and component as of what stands for it."""
        p = self.plan
        topics = all({r.topic(t) for t in some} == some for some in (p.read, p.aged, p.limited))
        return topics and {r.component(x) for x in p.may_fault} == p.may_fault

    def _calendars(self, r: Renaming) -> bool:
        """Whether actors have the calendars, inputs the values, and nodes the faults."""
        assert self.system.test is not None
        inputs = self.system.inputs
        given = {(d.topic, d.every_ns, exact(d.values)): i for i, d in enumerate(inputs)}
        number = {(a.component, a.input): i for i, a in enumerate(self.plan.actors)}
        for i, a in enumerate(self.plan.actors):
            drive = a.input
            if a.input is not None:
                d = inputs[a.input]
                drive = given.get((r.topic(d.topic), d.every_ns, exact(d.values)))
            j = number.get((r.component(a.component), drive))
            if j is None:
                return False
            r.actors[i] = j
            b = self.plan.actors[j]
            if _times_of(a) != _times_of(b):
                return False
            if a.overrun_ns and tuple([r.topic(t) for t in a.outputs]) != b.outputs:
                return False  # what is held has the order of the outputs
        faults = self.system.test.faults
        return Counter((f.kind, r.component(f.component), f.by_ns, f.at_most) for f in faults) == (
            Counter((f.kind, f.component, f.by_ns, f.at_most) for f in faults)
        )

    def _judged(self, r: Renaming) -> bool:
        """Whether the same is judged of the test after the renaming."""
        system, timed = self.system, self.core.timed
        assert system.test is not None
        terms = self.terms

        def of_property(i: int, r: Renaming) -> Hashable:
            p = system.properties[i]
            told = of_predicate(terms, self.core.properties[i], r.read)
            return p.kind, r.component(p.component), told

        def of_timed(i: int, r: Renaming) -> Hashable:
            assert system.test is not None
            t = system.test.timed[i]
            told = [of_predicate(terms, p, r.read) for p in (timed[i].premise, timed[i].condition)]
            return t.kind, t.within_ns, r.module(t.module), tuple(told)

        for count, of, into in (
            (len(system.properties), of_property, r.properties),
            (len(timed), of_timed, r.timeds),
        ):
            before: dict[Hashable, list[int]] = {}
            after: dict[Hashable, list[int]] = {}
            for i in range(count):
                before.setdefault(of(i, IDENTITY), []).append(i)
                after.setdefault(of(i, r), []).append(i)
            for key, some in after.items():
                if len(before.get(key, ())) != len(some):
                    return False
                into.update(zip(some, before[key], strict=True))
        return True

    # ------------------------------------------------------------ what is touched

    def reads(self, x: Component) -> tuple[tuple[str, int], ...]:
        """The topics and modules that a component's code names, in that order."""
        return self._reads[x.index]

    def _read_by(self, x: Component) -> tuple[tuple[str, int], ...]:
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        texts, topics = _texts(step), list[int]()
        if x.role == "dm":
            assert x.module is not None
            d, m = self.core.decisions[x.module], self.system.modules[x.module]
            texts += [d.ttf.body, d.ttf.value, d.safer.body, d.safer.value]
            topics += (*m.reads, *m.outputs, *(() if m.latch is None else (m.latch,)))
        topics += [o.topic for o in (step.outputs if step else ())]
        topics += x.failsafe
        if x.plant is not None or x.node is not None:
            topics += x.reads
        resources = [("topic", t) for t in topics]
        return (*resources, *_resources_read(texts))

    def _names_nothing_renamed(self, x: Component, r: Renaming) -> bool:
        """Whether a component's code names nothing that is renamed."""
        of = {"topic": r.topics, "module": r.modules}
        return all(of[kind].get(i, i) == i for kind, i in self._reads[x.index])


def _texts(step: core.NodeStep | core.PlantStep | None) -> list[object]:
    if isinstance(step, core.NodeStep):
        return [step.takeover, step.body, step.shield.body if step.shield else ()]
    return [] if step is None else [step.choose, step.integrate, step.publish]


def _is_apart(x: Component) -> bool:
    """Whether a component's name matters, since its answers or draws depend on it."""
    return x.extern or any(d.hold_ns for d in x.disturbances)


def _own_swaps(x: Component) -> Iterator[dict[str, str]]:
    """Ways to swap a component's locals or states in pairs, with equal types and first values."""
    variables = x.node.locals if x.node else x.plant.states if x.plant else ()
    if len(x.initial) != len(variables):
        return iter(())
    kinds: dict[Hashable, list[str]] = {}
    for i, v in enumerate(variables):
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


def _times_of(a: PlannedActor) -> tuple[int, ...]:
    return a.period_ns, a.phase_ns, a.window_ns, a.overrun_ns, a.least_ns, a.skips


def _resources_read(texts: Iterable[object]) -> Iterator[tuple[str, int]]:
    """The topics and modules that code reads."""
    for n in walk(tuple(texts)):
        if isinstance(n, core.Get) and n.cell.kind == "topic":
            yield "topic", n.cell.owner
        elif isinstance(n, core.Fact) and n.fact in ("mode", "age"):
            yield ("module" if n.fact == "mode" else "topic"), n.index
