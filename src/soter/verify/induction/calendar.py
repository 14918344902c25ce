"""When steps may run: the steps in a span of time, and in which orders they may come.

Purpose: `calendar_steps` turns releases of components into steps with windows, and tells the solver
their order. A step reads at its start, at most `late` after its release; what it does is out at
most `response` after that; within one instant every order is possible.
Non-goals: what a step does (`transition_relation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import lcm
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.induction.solver_terms import SolverTerms, Term


@dataclass(frozen=True)
class ComponentCalendar:
    """The period, phase, lateness and response of one component, in ns."""

    component: int
    period: int
    phase: int
    late: int = 0
    response: int = 0


@dataclass(eq=False)
class Point:
    """An instant at which a step reads or writes: `at`, in [earliest, latest], in ns.

    Of several at one time the one with the lower `place` comes first.
    """

    earliest: int
    latest: int
    at: Term
    place: Term


@dataclass(eq=False)
class CalendarStep:
    """The step of one release: it reads at `start`, and others see its results from `effect` on.

    `begun`: it was released before the span of time, and what it read is not known.
    """

    component: int
    release: int
    start: Point
    effect: Point
    begun: bool = False


def hyperperiod_ns(clocks: Sequence[ComponentCalendar]) -> int:
    """The hyperperiod in ns, after which the releases of all components repeat."""
    return lcm(*(c.period for c in clocks))


def start_of_periodic_releases(clocks: Sequence[ComponentCalendar]) -> int:
    """The first multiple of the hyperperiod, in ns, from which on releases are periodic."""
    whole = hyperperiod_ns(clocks)
    return -(-max(c.phase for c in clocks) // whole) * whole


def releases_until(clock: ComponentCalendar, end: int, *, first: bool) -> list[int]:
    """Releases in [0, end), from the start of a run (`first`) or of any later hyperperiod.

    In a later hyperperiod also the release before 0, if its step may last until then.
    """
    begin = clock.phase if first else clock.phase % clock.period
    instants = list(range(begin, end, clock.period))
    before = begin - clock.period
    if not first and before + clock.late + clock.response >= 0:
        instants.insert(0, before)
    return instants


def calendar_steps(
    terms: SolverTerms, clocks: Sequence[ComponentCalendar], end: int, *, first: bool
) -> list[CalendarStep]:
    """All steps in [0, end); their known order is stated as facts of `terms`."""
    steps: list[CalendarStep] = []
    for clock in clocks:
        own = [_calendar_step(terms, clock, r) for r in releases_until(clock, end, first=first)]
        for a, b in pairwise(own):
            terms.state(is_before(terms, a.effect, b.start))
        steps += own
    for group in groups_apart_in_time(steps):
        points = [p for s in group for p in {s.start: 0, s.effect: 0}]
        if len(points) > 1:
            terms.state(terms.z3.Distinct(*[p.place for p in points]))
    return steps


def _calendar_step(terms: SolverTerms, clock: ComponentCalendar, release: int) -> CalendarStep:
    begun = release < 0
    start = _new_point(terms, max(release, 0), max(release + clock.late, 0))
    last = release + clock.late + clock.response
    if begun:
        effect = _new_point(terms, 0, last)
        return CalendarStep(clock.component, release, effect, effect, begun=True)
    if not clock.response:
        return CalendarStep(clock.component, release, start, start)
    effect = _new_point(terms, release, last)
    terms.state(effect.at <= start.at + clock.response)
    terms.state(is_before(terms, start, effect))
    return CalendarStep(clock.component, release, start, effect)


def _new_point(terms: SolverTerms, earliest: int, latest: int) -> Point:
    place = terms.unknown_int("place")
    if earliest == latest:
        return Point(earliest, latest, earliest, place)
    at = terms.unknown_int("at")
    terms.state(terms.all_of(earliest <= at, at <= latest))
    return Point(earliest, latest, at, place)


def is_before(terms: SolverTerms, a: Point, b: Point) -> Term:
    """The condition that `a` comes before `b`."""
    if a is b or a.earliest > b.latest:
        return False
    if a.latest < b.earliest:
        return True
    first = a.place < b.place
    if isinstance(a.at, int) and isinstance(b.at, int):
        return first  # both at one instant
    return terms.any_of(a.at < b.at, terms.all_of(a.at == b.at, first))


def groups_apart_in_time(steps: Sequence[CalendarStep]) -> list[list[CalendarStep]]:
    """The steps in groups, each of which is over before the next one begins."""
    groups: list[list[CalendarStep]] = []
    latest = -1
    for step in sorted(steps, key=lambda s: (s.start.earliest, s.release)):
        if step.start.earliest > latest or not groups:
            groups.append([])
        groups[-1].append(step)
        latest = max(latest, step.effect.latest)
    return groups
