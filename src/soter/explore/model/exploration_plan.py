"""The plan of exploring a tested system: its actors and their calendars, parts that share nothing.

Purpose: `make_plan` makes it from a system that was flattened for a test, and its Core: windows,
faults, dependence, visibility, what of a configuration can matter. `find_parts` puts actors that
depend on each other, directly or through a property that reads both, into one part. An execution of
the system is one of every part, interleaved, and a property sees one part only: the system violates
it iff that part does (docs/testing.md, "Parts"). All parts share time, so where a property has a
deadline or reads the time there is one part only. Where nothing is late, `find_joined_parts` allows
a property to read several parts ("Joined parts").
Non-goals: which steps depend on each other (`footprints.py`), C (`explorer_model.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.model.footprints import TIME, Footprints, is_sampled, may_fault
from soter.language.elaborate.time_grid import quantum_of, times_read

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from soter.core import core
    from soter.core.core import CoreSystem
    from soter.diagnostics.diagnostic import Span
    from soter.explore.model.footprints import Effects, Label
    from soter.language.elaborate.time_grid import TimesRead
    from soter.language.model.system import System, TestPlan


@dataclass(frozen=True, kw_only=True)
class PlannedActor:
    """A component or an input of a tested system (docs/testing.md). Times in ns.

    Exactly one of `component` and `input` is set. `dependent`: bit i is set iff steps of actor i
    may not be swapped with steps of this actor; `outputs`: topics, in the order of the step's
    outputs. `reads`: the resources (`footprints.py`) on which the result of a step depends;
    `writes`: those that it may change.
    """

    name: str
    component: int | None
    input: int | None
    period_ns: int
    phase_ns: int
    window_ns: int
    overrun_ns: int
    least_ns: int
    skips: int
    dependent: int
    visible: bool
    outputs: tuple[int, ...]
    reads: frozenset[Label]
    writes: frozenset[Label]


@dataclass(frozen=True)
class TimeChoices:
    """The grid on which steps that may be late choose their times.

    If the test declares no grid: `open`: places of the program that read the time in a way that no
    grid covers; `crowded`: places that compare more times than this grid distinguishes.
    """

    quantum_ns: int
    open: tuple[Span, ...]
    crowded: tuple[Span, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ExplorationPlan:
    """The actors and times of a search, and the parts of a configuration that can matter.

    `read`: topics that anything reads; `aged`: topics whose age is read; `limited`: module inputs
    whose `max_age` decides; `may_fault`: components whose step may fault; `times`: None where no
    step has a choice; `repeats`: whether nothing reads the time, so that the future depends on the
    configuration and the place in the calendar alone.
    """

    actors: tuple[PlannedActor, ...]
    timely: bool
    sampled: bool
    repeats: bool
    tick_ns: int
    quantum_ns: int
    times: TimeChoices | None
    horizon_ns: int
    read: frozenset[int]
    aged: frozenset[int]
    limited: frozenset[int]
    may_fault: frozenset[int]
    observed: frozenset[Label]
    """The resources that properties of configurations read."""

    @property
    def unheard_actors(self) -> frozenset[str]:
        """The names of actors whose writes no other actor and no property reads."""
        alone = [
            a.name
            for a in self.actors
            if not a.visible and not any(a.writes & b.reads for b in self.actors if b is not a)
        ]
        return frozenset(alone)


@dataclass
class _Calendar:
    component: int | None
    input: int | None
    name: str
    period_ns: int
    phase_ns: int
    window_ns: int = 0
    overrun_ns: int = 0
    least_ns: int = 0
    skips: int = 0


def make_plan(system: System, lowered: core.CoreSystem) -> ExplorationPlan:
    """The plan of exploring a system; inputs come first, then components in deployed order."""
    assert system.test is not None
    footprints = Footprints(system, lowered)
    calendars = list(_calendars(system, system.test))
    effects = [footprints.actor_effects(x.component, x.input) for x in calendars]
    seen = footprints.all_property_reads()
    actors = tuple(
        PlannedActor(
            **vars(x),
            dependent=_dependent_mask(i, effects),
            visible=bool(effect.writes & seen),
            outputs=footprints.output_topics(x.component, x.input),
            reads=frozenset(
                effect.reads | (effect.writes if effect.keeps else set()) | _clock_labels(i, effect)
            ),
            writes=frozenset(effect.writes),
        )
        for i, (x, effect) in enumerate(zip(calendars, effects, strict=True))
    )
    times = times_read(system)
    quantum, tick = _time_grid(system, system.test, calendars, quantum_of(system, times))
    overrun = any(x.overrun_ns for x in calendars)
    spread = overrun or any(x.window_ns for x in calendars)
    timely = overrun or (spread and footprints.time_matters())
    return ExplorationPlan(
        actors=actors,
        timely=timely,
        sampled=is_sampled(system, lowered),
        repeats=_ignores_time(system, footprints),
        tick_ns=tick,
        quantum_ns=quantum,
        times=_time_choices(system.test, quantum, times) if timely else None,
        horizon_ns=system.test.horizon_ns,
        read=_topics_read(system, seen.union(*(e.reads for e in effects))),
        aged=frozenset(footprints.aged_topics()),
        limited=frozenset(footprints.limited_inputs()),
        may_fault=frozenset(
            i for i in range(len(system.components)) if may_fault(system, lowered, i)
        ),
        observed=frozenset(seen),
    )


def _dependent_mask(actor: int, effects: Sequence[Effects]) -> int:
    effect = effects[actor]
    return sum(1 << j for j, e in enumerate(effects) if j == actor or effect.conflicts_with(e))


def _topics_read(system: System, read: Iterable[Label]) -> frozenset[int]:
    queues = {t.index for t in system.topics if t.queue_of is not None}
    return frozenset(queues | {r[1] for r in read if r[0] == "topic"})


def _ignores_time(system: System, footprints: Footprints) -> bool:
    return not any(f.fact == "time" for f in footprints.facts) and not any(
        d.hold_ns for c in system.components for d in c.disturbances
    )


def _time_choices(test: TestPlan, quantum: int, read: TimesRead) -> TimeChoices:
    """The grid of times, and the places that it does not cover; () if the test declares a grid."""
    return (
        TimeChoices(quantum, (), ())
        if test.quantum_ns
        else TimeChoices(quantum, read.open, read.crowded)
    )


def _clock_labels(actor: int, effect: Effects) -> set[Label]:
    """The resources that give the time of an actor's step, if the step reads the time."""
    return {TIME, ("done", actor)} if effect.timed else set()


def _calendars(system: System, test: TestPlan) -> Iterator[_Calendar]:
    for number, drive in enumerate(system.inputs):
        name = f"input.{system.topics[drive.topic].name}"
        yield _Calendar(None, number, name, drive.every_ns, 0)
    for component in system.components:
        calendar = _Calendar(
            component.index, None, component.name, component.period_ns, component.phase_ns
        )
        late = 0
        for fault in test.faults:
            if fault.component != component.index:
                continue
            if fault.kind == "late":
                late = max(late, fault.by_ns)
            elif fault.kind == "overrun":
                calendar.overrun_ns = max(calendar.overrun_ns, fault.by_ns)
                calendar.least_ns = max(calendar.least_ns, fault.least_ns)
            else:
                calendar.skips = max(calendar.skips, fault.at_most)
        if component.plant is None:
            calendar.window_ns = test.skew_ns + late
        yield calendar


def _time_grid(
    system: System, test: TestPlan, calendars: list[_Calendar], quantum: int
) -> tuple[int, int]:
    """The quantum and the tick in ns: lateness is a multiple of the quantum, a time of the tick."""
    times = [test.skew_ns, *(t for f in test.faults for t in (f.by_ns, f.least_ns))]
    for calendar in calendars:
        times += [calendar.period_ns, calendar.phase_ns]
    spans = [t.within_ns for t in test.timed]
    spans += [2 * system.modules[t.module].period_ns for t in test.timed if t.module is not None]
    return quantum, math.gcd(quantum, *times, *spans)


MASK_BITS = 64
"""The most actors, properties or timed properties that a bit mask can name."""


@dataclass(frozen=True)
class IndependentPart:
    """A part as bit masks: its actors, and the properties and timed properties judged on it."""

    actors: int
    properties: int
    timeds: int


@dataclass(frozen=True)
class SharedProperty:
    """A property, judged at ends of instants, that reads several parts; `parts`: their numbers."""

    property: int
    parts: tuple[int, ...]


@dataclass(frozen=True)
class IndependentParts:
    """Parts that share no resource; `joints`: the properties judged on several of these parts."""

    parts: tuple[IndependentPart, ...]
    joints: tuple[SharedProperty, ...]


def find_joined_parts(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> IndependentParts | None:
    """The parts that only properties join; None without such parts, or if a step may be late."""
    properties = _property_reads(system, lowered, plan)
    if properties is None or any(a.window_ns or a.overrun_ns for a in plan.actors):
        return None
    groups = _dependency_groups(plan)
    roots = groups.roots()
    homes = [
        sorted({groups.root_of(i) for i in _actors_writing(plan, reads)}) for reads in properties
    ]
    joined = {prop: home for prop, home in enumerate(homes) if len(home) > 1}
    if not joined or any(system.properties[prop].component is not None for prop in joined):
        return None
    roots_of = {prop: (*home, roots[0])[0] for prop, home in enumerate(homes) if prop not in joined}
    shared = [SharedProperty(prop, tuple(map(roots.index, home))) for prop, home in joined.items()]
    return IndependentParts(groups.parts_with_properties(roots_of), tuple(shared))


def find_parts(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> tuple[IndependentPart, ...]:
    """The parts that share nothing, in order of their first actors; a single part if unclear."""
    properties = _property_reads(system, lowered, plan)
    if properties is None or (  # a step may happen when another part's did, off the grid
        plan.timely
        and any(t % plan.quantum_ns for a in plan.actors for t in (a.period_ns, a.phase_ns))
    ):
        return (IndependentPart(0, 0, 0),)
    groups = _dependency_groups(plan)
    writers_by_property = [_actors_writing(plan, reads) for reads in properties]
    for writers in writers_by_property:
        groups.join(writers)
    roots = [groups.root_of(writers[0] if writers else 0) for writers in writers_by_property]
    return groups.parts_with_properties(dict(enumerate(roots)))


def _property_reads(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> list[set[Label]] | None:
    """The resources each property reads; None if one reads the time or masks are too narrow."""
    assert system.test is not None
    footprints = Footprints(system, lowered)
    if system.test.timed or TIME in footprints.all_property_reads():
        return None
    properties = [footprints.property_reads(p) for p in range(len(system.properties))]
    return None if max(len(plan.actors), len(properties)) > MASK_BITS else properties


def _dependency_groups(plan: ExplorationPlan) -> _Groups:
    """The groups of actors that depend on each other, directly or through others."""
    groups = _Groups(len(plan.actors))
    for i, actor in enumerate(plan.actors):
        groups.join([i, *(j for j in range(len(plan.actors)) if actor.dependent >> j & 1)])
    return groups


def _actors_writing(plan: ExplorationPlan, reads: set[Label]) -> list[int]:
    """The actors whose steps may change what a property reads."""
    return [i for i, actor in enumerate(plan.actors) if actor.writes & reads]


def _bit_mask(bits: Iterable[int]) -> int:
    return sum(1 << b for b in bits)


class _Groups:
    """Disjoint sets of actors, which can be joined; the least member stands for the set."""

    def __init__(self, count: int) -> None:
        self._root = list(range(count))

    def root_of(self, member: int) -> int:
        """The least member of the set that has this member."""
        while self._root[member] != member:
            member = self._root[member]
        return member

    def join(self, members: list[int]) -> None:
        """Joins the sets of all these members into one set."""
        roots = sorted({self.root_of(i) for i in members})
        for r in roots[1:]:
            self._root[r] = roots[0]

    def roots(self) -> list[int]:
        """The least member of each set."""
        return [i for i, root in enumerate(self._root) if i == root]

    def parts_with_properties(self, judged_by: Mapping[int, int]) -> tuple[IndependentPart, ...]:
        """A part for each set of actors; `judged_by`: the set on which each property is judged."""
        members = range(len(self._root))
        return tuple(
            IndependentPart(
                _bit_mask(i for i in members if self.root_of(i) == root),
                _bit_mask(p for p, judge in judged_by.items() if judge == root),
                0,
            )
            for root in self.roots()
        )
