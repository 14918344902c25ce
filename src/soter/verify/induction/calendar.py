"""Lists the steps in a span of time, and the orders in which they may run.

Purpose: `calendar_steps` turns releases of components into steps with windows, and tells the solver
their order. A step reads at its start, at most `late` after its release. Its effect is there at
most `response` after the start. Within one instant every order is possible.
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
    """The instant `at`, in [earliest, latest] in ns, at which a step reads or writes.

    Of several points at one time the point with the lower `place` comes first.
    """

    earliest: int
    latest: int
    at: Term
    place: Term


@dataclass(eq=False)
class CalendarStep:
    """The step of one release; it reads at `start`, and others see its results from `effect` on.

    With `begun` it was released before the span of time, and its reads are not known.
    """

    component: int
    release: int
    start: Point
    effect: Point
    begun: bool = False


def hyperperiod_ns(calendars: Sequence[ComponentCalendar]) -> int:
    """The hyperperiod in ns, after which the releases of all components repeat."""
    return lcm(*(c.period for c in calendars))


def start_of_periodic_releases(calendars: Sequence[ComponentCalendar]) -> int:
    """The first multiple of the hyperperiod, in ns, from which on releases are periodic."""
    hyperperiod = hyperperiod_ns(calendars)
    return -(-max(c.phase for c in calendars) // hyperperiod) * hyperperiod


def releases_until(calendar: ComponentCalendar, end: int, *, first: bool) -> list[int]:
    """The releases in [0, end) from the start of a run (`first`), or of any later hyperperiod.

    A later hyperperiod also has the release before 0, if the step of this release may last until 0.
    """
    begin = calendar.phase if first else calendar.phase % calendar.period
    instants = list(range(begin, end, calendar.period))
    before = begin - calendar.period
    if not first and before + calendar.late + calendar.response >= 0:
        instants.insert(0, before)
    return instants


def calendar_steps(
    terms: SolverTerms, calendars: Sequence[ComponentCalendar], end: int, *, first: bool
) -> list[CalendarStep]:
    """All steps in [0, end); the known order of these steps is added to `terms` as facts."""
    steps: list[CalendarStep] = []
    for calendar in calendars:
        steps_of_component = [
            _calendar_step(terms, calendar, r) for r in releases_until(calendar, end, first=first)
        ]
        for a, b in pairwise(steps_of_component):
            terms.state(is_before(terms, a.effect, b.start))
        steps += steps_of_component
    for group in groups_apart_in_time(steps):
        points = [p for s in group for p in {s.start: 0, s.effect: 0}]
        if len(points) > 1:
            terms.state(terms.z3.Distinct(*[p.place for p in points]))
    return steps


def _calendar_step(terms: SolverTerms, calendar: ComponentCalendar, release: int) -> CalendarStep:
    begun = release < 0
    start = _new_point(terms, max(release, 0), max(release + calendar.late, 0))
    last = release + calendar.late + calendar.response
    if begun:
        effect = _new_point(terms, 0, last)
        return CalendarStep(calendar.component, release, effect, effect, begun=True)
    if not calendar.response:
        return CalendarStep(calendar.component, release, start, start)
    effect = _new_point(terms, release, last)
    terms.state(effect.at <= start.at + calendar.response)
    terms.state(is_before(terms, start, effect))
    return CalendarStep(calendar.component, release, start, effect)


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
    """Divides the steps into groups; each group ends before the next group begins."""
    groups: list[list[CalendarStep]] = []
    latest = -1
    for step in sorted(steps, key=lambda s: (s.start.earliest, s.release)):
        if step.start.earliest > latest or not groups:
            groups.append([])
        groups[-1].append(step)
        latest = max(latest, step.effect.latest)
    return groups
