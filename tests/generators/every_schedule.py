"""Every schedule of a system on the grid of times, and the worst that each one allows.

Purpose: the judge of the model of time. Each release of each node may start at every instant of
its lateness and publish at every instant of its response; a reader sees what was published last;
where two things happen at one instant and their order is open, both orders are taken. The answers
are sets (of ages, of starts, of instants at which a command acts), and a quantity is the largest
element. No greatest common divisor, no closed form; written from the definitions alone, and it
uses nothing of `soter.verify.problem.schedule` but the fields of the description of a system.
Non-goals: speed, large periods; making systems and comparing (`schedule_systems.py`).

What a schedule consists of, and why sets of parts suffice: every release chooses its start and its
publication for itself (late + response <= period, so that no choice of one release restricts
another), and nothing that is read changes when somebody runs. A read therefore depends on one
chain of choices: the step whose publication is seen, the one before which the next publication of
the same node has not come, and what that step itself had read when it started. Two reads of one
reader depend on two such chains, followed in step (`_pairs`). SC and DM share choices (SC waits for
verdicts), so that these are enumerated together.

Time has no beginning here except in `first_act`: every age, wait or window of a run that started
at 0 involves finitely many releases, and moved by a multiple of all periods it is one of the run
without a beginning, and the other way round. So one common multiple of the periods is all of it.

Readings of what the definitions leave open (always the one with more schedules):
- a publication at the very instant of a read is seen or not, by any reader; only what a path
  node does within that instant itself (start and publication) is never seen by DM or SC;
- an actuator node may find the output of SC as long as it is the last one that *passed*; the
  next one may be dropped at the gate, so the first start at or after the publication finds it;
- what acts first counts: a node that publishes the same value again changes nothing;
- a sensor that is silent skips releases; publications that follow each other are at most
  period + silence apart. Only stamps of SC are asked for without silence;
- with an enforced age a read of DM may be any age from the least to (greatest age of a
  publication) + (enforced age): the publications after the one that is read were lost.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import lcm
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.verify.problem.schedule import Releases, SensorPath

QUANTITIES = (
    "age_dm",
    "age_sc",
    "stamp_age_sc",
    "latest_start_of_sc",
    "h_star",
    "delay",
    "jitter",
    "start",
    "longest_to_decision",
    "longest_between_states",
    "published_age",
    "available_from",
)
"""The names of `Schedule`; of `SensorPath` the last two (P and F): the greatest of all paths."""


class Event(NamedTuple):
    """What happened, how long before what it led to, and what led to it: a linked timeline."""

    before: int
    what: str
    cause: Event | None


class Step(NamedTuple):
    """One release of a node with its choices."""

    release: int
    start: int
    published: int


class Seen(NamedTuple):
    """One possible read: how old the state is, how old the stamp, and a schedule that does it."""

    age: int
    stamp: int
    why: Event


class Worst:
    """The largest value of a quantity so far, with the timeline that led to it."""

    def __init__(self) -> None:
        self.value: int | None = None
        self.why: tuple[tuple[int, str], ...] = ()

    def below(self, value: int) -> bool:
        """Whether this is worse than all before; it is kept then."""
        if self.value is not None and value <= self.value:
            return False
        self.value = value
        return True

    def keep(self, lines: list[tuple[int, str]]) -> None:
        """The timeline of the value that was just kept."""
        self.why = tuple(sorted(lines, key=lambda x: x[0]))


def releases(x: Releases, first: int, last: int) -> range:
    """All instants in [first, last] at which x is due, time having no beginning."""
    return range(first + (x.phase - first) % x.period, last + 1, x.period)


def steps(x: Releases, release: int) -> Iterator[Step]:
    """All choices of one release."""
    for start in range(release, release + x.late + 1):
        for published in range(start, start + x.response + 1):
            yield Step(release, start, published)


def steps_seen(x: Releases, at: int, *, by_module: bool) -> Iterator[Step]:
    """The steps of x whose publication can be the latest that a reader sees at an instant.

    A release two periods back has been replaced: late + response <= period.
    """
    for release in releases(x, at - 2 * x.period, at):
        if not any(follower.published >= at for follower in steps(x, release + x.period)):
            continue
        for step in steps(x, release):
            if can_see(step, at, by_module=by_module):
                yield step


def can_see(step: Step, at: int, *, by_module: bool) -> bool:
    """Whether a reader at that instant can see the publication of a step.

    At one and the same instant DM and SC come before all path nodes: what starts at that instant
    comes after them; what started earlier may come before.
    """
    if step.published == at:
        return step.start < at or not by_module
    return step.published < at


def publications(sensor: Releases, silence: int, at: int) -> Iterator[int]:
    """The instants whose state can be the latest that a sensor has published."""
    for release in releases(sensor, at - sensor.period - silence, at):
        following = releases(sensor, release + 1, release + sensor.period + silence)
        if any(again > at for again in following):
            yield release


@dataclass
class Reads:
    """Everything that can be read at the end of a path."""

    path: SensorPath
    silence: int
    name: str
    multiple: int = 1
    _seen: dict[tuple[int, int, bool], tuple[Seen, ...]] = field(default_factory=dict)
    _pairs: dict[tuple[int, int, int, bool], frozenset[tuple[int, int]]] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        self.multiple = lcm(self.path.sensor.period, *(n.period for n in self.path.nodes))

    def at(self, instant: int) -> tuple[Seen, ...]:
        """What DM or SC can read at an instant."""
        return self.seen(len(self.path.nodes), instant % self.multiple, by_module=True)

    def seen(self, level: int, at: int, *, by_module: bool) -> tuple[Seen, ...]:
        """What can be read after so many nodes of the path; one of each age and stamp."""
        key = (level, at % self.multiple, by_module)
        if key not in self._seen:
            distinct_reads: dict[tuple[int, int], Seen] = {}
            for seen in self._all_seen(level, at, by_module=by_module):
                distinct_reads.setdefault((seen.age, seen.stamp), seen)
            self._seen[key] = tuple(distinct_reads.values())
        return self._seen[key]

    def _all_seen(self, level: int, at: int, *, by_module: bool) -> Iterator[Seen]:
        if level == 0:
            for x in publications(self.path.sensor, self.silence, at):
                yield Seen(at - x, at - x, Event(at - x, f"{self.name}: sensor publishes", None))
            return
        node = self.path.nodes[level - 1]
        name = f"{self.name}: node {level}"
        for step in steps_seen(node, at, by_module=by_module):
            for age, why in self.ages(level - 1, step.start):
                start = Event(step.published - step.start, f"{name} starts, reads age {age}", why)
                shown = Event(at - step.published, f"{name} publishes", start)
                yield Seen(at - step.start + age, at - step.published, shown)

    def ages(self, level: int, at: int) -> list[tuple[int, Event]]:
        """The ages that a path node can read, each with one timeline."""
        event_by_age: dict[int, Event] = {}
        for seen in self.seen(level, at, by_module=False):
            event_by_age.setdefault(seen.age, seen.why)
        return list(event_by_age.items())

    def age_of_publication(self) -> int:
        """P: the greatest age that the state of a publication can have when it is published."""
        if not self.path.nodes:
            return 0
        node, level = self.path.nodes[-1], len(self.path.nodes)
        return max(
            step.published - step.start + age
            for release in releases(node, 0, self.multiple - 1)
            for step in steps(node, release)
            for age, _ in self.ages(level - 1, step.start)
        )

    def pairs(self, at: int, then: int) -> frozenset[tuple[int, int]]:
        """What DM can read at two of its steps, as (age at the first, by how much newer then)."""
        if self.path.max_age is None:
            return self._two(len(self.path.nodes), at, then, by_module=True)
        least = min(seen.age for seen in self.at(at))
        oldest = self.age_of_publication() + self.path.max_age
        return frozenset(
            (age, then - seen.age - (at - age))
            for age in range(least, oldest + 1)
            for seen in self.at(then)
            if seen.stamp <= self.path.max_age and then - seen.age >= at - age
        )

    def _two(
        self, level: int, at: int, then: int, *, by_module: bool
    ) -> frozenset[tuple[int, int]]:
        key = (level, at % self.multiple, then - at, by_module)
        if key not in self._pairs:
            self._pairs[key] = frozenset(self._all_two(level, at, then, by_module=by_module))
        return self._pairs[key]

    def _all_two(
        self, level: int, at: int, then: int, *, by_module: bool
    ) -> Iterator[tuple[int, int]]:
        """Both reads find one publication, or the second finds a later one, still to come at `at`.

        Of the publications between the two steps that are read nothing is asked but that the
        first of them comes at `at` or after; the others come later by themselves.
        """
        if level == 0:
            for x in publications(self.path.sensor, self.silence, at):
                for y in publications(self.path.sensor, self.silence, then):
                    if y == x or y > at:
                        yield at - x, y - x
            return
        node = self.path.nodes[level - 1]
        for first, second in self._two_steps(node, at, then, by_module=by_module):
            for age, newer in self._two(level - 1, first, second, by_module=False):
                yield at - first + age, newer

    @staticmethod
    def _two_steps(node: Releases, at: int, then: int, *, by_module: bool) -> set[tuple[int, int]]:
        pairs = set()
        for first in steps_seen(node, at, by_module=by_module):
            for second in steps_seen(node, then, by_module=by_module):
                if second == first:
                    pairs.add((first.start, first.start))
                elif second.release > first.release and second.published >= at:
                    pairs.add((first.start, second.start))
        return pairs
