"""The thread of the trusted part of a system: whether it keeps its calendar, response times.

Purpose: `timing_of` a flat system says which components run in the thread, and from their releases,
order, jitter and execution times the latest start and end of every step over all executions, or
what is missing to say so. `report_miss` makes a diagnostic of a missed deadline, with an execution
that misses it.
Non-goals: measured times (`measure/`); nodes in processes of their own.

The thread works in order: all that is due at an instant, in the deployed order, then what is due
at the next. A step that is released at t starts when everything before it has ended and its own
release has come, at most J after t, and needs at most C of the processor. So

    end(k) = max(end(k - 1), t_k + J_k) + C_k

bounds the end of step k, and is reached where every release is as late and every step as long as
they may be, since no step gets earlier when another gets later. That one schedule is gone through,
from time 0 over the first releases and then hyperperiod by hyperperiod, until the work left over at
the end of one is no more than at its beginning: from there on nothing is worse than what was seen.

A deployed system has no plants. All that is Soter code runs in one thread: decision modules, safe
controllers, then ACs and other nodes, those that `takes` time, too. Only extern nodes run
elsewhere, in processes of their own, unless the system says `inline`; what they need of a processor
is no part of the thread.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, System


RELEASES_MAX = 500_000
"""Steps of a hyperperiod that are gone through; with more, only a bound is computed."""
POINTS_MAX = 1_000_000
"""How many lengths of time the bound looks at, at most."""
SHOWN = 24
"""How many steps are kept of a schedule that misses a deadline: the last ones."""


@dataclass(frozen=True)
class Task:
    """A task of the thread, released at phase + k period, up to `jitter` late; all in ns.

    `wcet`: how long it takes at most; `deadline`: by when it has to end, from its release.
    """

    name: str
    period: int
    phase: int
    wcet: int
    jitter: int
    deadline: int


@dataclass(frozen=True)
class ScheduledStep:
    """A step of the task with index `task`, for its release with this `number`; times in ns."""

    task: int
    number: int
    release: int
    start: int
    end: int


@dataclass(frozen=True)
class Miss:
    """A step that ends after its deadline, in the schedule with the greatest lateness everywhere.

    `steps`: the steps before it, then the step itself. `left_out`: how many earlier steps, since
    the thread last had nothing to do, are not among them.
    """

    steps: tuple[ScheduledStep, ...]
    left_out: int
    deadline: int

    @property
    def step(self) -> ScheduledStep:
        """The step that misses its deadline."""
        return self.steps[-1]


@dataclass(frozen=True)
class WorstResponse:
    """The latest start and end of one task over all executions, in ns from its release.

    `at`: the release time of the step that ends latest.
    """

    start: int
    end: int
    at: int


@dataclass(frozen=True)
class Analysis:
    """The latest start and end of each task of the thread, or the first miss of a deadline.

    `worst`: an entry for each task, in order: exact if `exact`, else an upper bound; () if unknown.
    With a `miss`: the values up to it, None for tasks not released. The thread is busy for at most
    `work` ns in each `hyperperiod` ns. Neither exact nor a miss nor in time means undecided.
    """

    worst: tuple[WorstResponse | None, ...]
    miss: Miss | None
    exact: bool
    work: int
    hyperperiod: int


def analyse_thread(
    tasks: Sequence[Task], watch: Callable[[ScheduledStep], None] | None = None
) -> Analysis:
    """The latest start and end of every task; `tasks` in the order in which an instant runs them.

    `watch` is called with each step of the schedule in which all is as late as it may be, as far as
    that is followed. Every later step starts and ends no later after its release than a step of the
    same task that was passed on. If the result is not exact, `watch` is not called.
    """
    if not tasks:
        return Analysis((), None, exact=True, work=0, hyperperiod=1)
    hyperperiod = lcm(*(t.period for t in tasks))
    work = sum(hyperperiod // t.period * t.wcet for t in tasks)
    first = max(t.phase for t in tasks)
    steps = sum(hyperperiod // t.period for t in tasks)
    if steps + sum(first // t.period + 1 for t in tasks) > RELEASES_MAX:
        return _first_miss(tasks, work, hyperperiod) or _bound_responses(tasks, work, hyperperiod)
    thread = _Thread(tasks, watch)
    thread.run_releases(0, _releases_between(tasks, 0, first))
    window = _releases_between(tasks, first, first + hyperperiod)
    base, left = first, thread.work_left(first)
    while thread.miss is None:
        thread.run_releases(base - first, window)
        base += hyperperiod
        before, left = left, thread.work_left(base)
        if left <= before:
            break
        if work > hyperperiod and thread.miss is None and left - before == work - hyperperiod:
            base += _skip_hyperperiods(
                thread, tasks, window, base - first - hyperperiod, work - hyperperiod
            )
            left = thread.work_left(base)
    worst = tuple(thread.latest)
    return Analysis(worst, thread.miss, exact=True, work=work, hyperperiod=hyperperiod)


def _releases_between(tasks: Sequence[Task], low: int, high: int) -> list[tuple[int, int]]:
    """All releases in [low, high), as (time, task), in the order in which the thread works."""
    releases = []
    for i, t in enumerate(tasks):
        at = max(t.phase, low + (t.phase - low) % t.period)
        releases += [(r, i) for r in range(at, high, t.period)]
    return sorted(releases)


class _Thread:
    """The state of the thread in the schedule in which everything is as late as possible."""

    def __init__(
        self, tasks: Sequence[Task], watch: Callable[[ScheduledStep], None] | None
    ) -> None:
        self.tasks = tasks
        self.watch = watch
        self.free = 0
        self.latest: list[WorstResponse | None] = [None] * len(tasks)
        self.miss: Miss | None = None
        self.busy: deque[ScheduledStep] = deque(maxlen=SHOWN)
        self.since = 0

    def work_left(self, at: int) -> int:
        """The work, in ns, that the thread still has to do at the time `at`."""
        return max(0, self.free - at)

    def run_releases(self, shift: int, releases: Iterable[tuple[int, int]]) -> None:
        """Runs these releases, shifted by `shift` ns, until a step misses its deadline."""
        for at, i in releases:
            task, release = self.tasks[i], at + shift
            ready = release + task.jitter
            if ready > self.free:  # the thread waits: what was before has no part in what comes
                self.busy.clear()
                self.since = 0
            start = max(self.free, ready)
            self.free = start + task.wcet
            number = (release - task.phase) // task.period
            step = ScheduledStep(i, number, release, start, self.free)
            self.busy.append(step)
            self.since += 1
            if self.watch is not None:
                self.watch(step)
            seen = self.latest[i]
            if seen is None or self.free - release > seen.end:
                self.latest[i] = WorstResponse(start - release, self.free - release, release)
            if self.free - release > task.deadline:
                left_out = self.since - len(self.busy)
                self.miss = Miss(tuple(self.busy), left_out, release + task.deadline)
                return


def _skip_hyperperiods(
    thread: _Thread, tasks: Sequence[Task], window: list[tuple[int, int]], shift: int, more: int
) -> int:
    """Skips hyperperiods in which no deadline is missed yet; returns their length in ns.

    In the last hyperperiod, which began at the instants of `window` plus `shift`, the remaining
    work grew by `more`, the excess of its work over its length. So the thread was never idle, and
    every end was the sum of the work before it. This stays true: in each hyperperiod everything
    ends `more` later.
    """
    slacks, end = [], thread.free
    for t, i in reversed(window):
        slacks.append(t + shift + tasks[i].deadline - end)
        end -= tasks[i].wcet
    windows = min(slacks) // more
    hyperperiod = lcm(*(t.period for t in tasks))
    thread.free += windows * (hyperperiod + more)
    thread.since += windows * len(window)
    thread.busy.clear()
    return windows * hyperperiod


def _first_miss(tasks: Sequence[Task], work: int, hyperperiod: int) -> Analysis | None:
    """The first missed deadline among the first RELEASES_MAX steps; None without a miss."""
    horizon = int(RELEASES_MAX / sum(Fraction(1, t.period) for t in tasks))
    thread = _Thread(tasks, None)
    thread.run_releases(0, _releases_between(tasks, 0, horizon))
    if thread.miss is None:
        return None
    worst = tuple(thread.latest)
    return Analysis(worst, thread.miss, exact=True, work=work, hyperperiod=hyperperiod)


def _bound_responses(tasks: Sequence[Task], work: int, hyperperiod: int) -> Analysis:
    """Bounds the responses if a hyperperiod has too many steps for an exact analysis.

    With the greatest lateness everywhere, a step of release t ends at some t - l + J + the work of
    a run of steps released in [t - l, t], for some l >= 0 and the jitter J of the first of them. In
    a time of length l a task has at most l // T + 1 releases, ends included. So the step ends at
    most B after t, the maximum of J + sum (l // T + 1) C - l over all l, with J the greatest
    jitter. It starts when the step before it has ended, or at its release.
    """
    unknown = Analysis((), None, exact=False, work=work, hyperperiod=hyperperiod)
    if work >= hyperperiod:
        return unknown
    jitter, once = max(t.jitter for t in tasks), sum(t.wcet for t in tasks)
    use = sum(Fraction(t.wcet, t.period) for t in tasks)
    longest = int(once / (1 - use))  # beyond it the demand is less than at l = 0
    if sum(longest // t.period for t in tasks) > POINTS_MAX:
        return unknown
    points = {k * t.period for t in tasks for k in range(longest // t.period + 1)}
    bound = jitter + max(sum((p // t.period + 1) * t.wcet for t in tasks) - p for p in points)
    worst = tuple(WorstResponse(max(t.jitter, bound - t.wcet), bound, 0) for t in tasks)
    return Analysis(worst, None, exact=False, work=work, hyperperiod=hyperperiod)


FITS, MISSES, UNDECIDED = "fits", "misses", "undecided"
TOLD = 8
"""How many steps of a schedule a diagnostic shows."""


@dataclass(frozen=True)
class ThreadComponent:
    """A component of the thread.

    `worst`: its latest start and end, which are only bounds if the analysis is not exact.
    """

    component: Component
    task: Task
    worst: WorstResponse | None

    @property
    def slack(self) -> int | None:
        """The time from the latest end to the deadline, in ns; negative if it is missed."""
        return None if self.worst is None else self.task.deadline - self.worst.end


@dataclass(frozen=True)
class Timing:
    """The analysis of a system with its declared execution times.

    `missing`: components of the thread without a `wcet`. They count as if they took no time: a miss
    is certain nevertheless, but nothing else is decided. `elsewhere`: nodes in separate processes.
    The thread is busy for at most `work` ns in each `hyperperiod` ns.
    """

    system: str
    rows: tuple[ThreadComponent, ...]
    elsewhere: tuple[Component, ...]
    missing: tuple[Component, ...]
    miss: Miss | None
    exact: bool
    work: int
    hyperperiod: int

    @property
    def verdict(self) -> str:
        """The verdict FITS, MISSES or UNDECIDED."""
        if self.miss is not None:
            return MISSES
        slacks = [r.slack for r in self.rows]
        if self.missing or any(s is None or s < 0 for s in slacks):
            return UNDECIDED
        return FITS

    def row(self, component: Component) -> ThreadComponent | None:
        """The row of a component, by its name; None if it does not run in the thread."""
        return next((r for r in self.rows if r.component.name == component.name), None)


def _component_task(c: Component) -> Task:
    return Task(
        name=c.name,
        period=c.period_ns,
        phase=c.phase_ns,
        wcet=c.wcet_ns or 0,
        jitter=c.jitter_ns,
        deadline=c.period_ns,
    )


def timing_of(
    system: System, watch: Callable[[Component, ScheduledStep], None] | None = None
) -> Timing | None:
    """Analyses a flat system; None if it declares neither execution times nor jitter.

    A component without `wcet` counts as if it took no time. A deadline is the next release. `watch`
    is called with each step and its component, as `analyse_thread` calls it.
    """
    mine = [c for c in system.components if c.in_thread]
    if all(c.wcet_ns is None and not c.jitter_ns for c in mine):
        return None
    tasks = [_component_task(c) for c in mine]
    analysis = analyse_thread(tasks, None if watch is None else lambda s: watch(mine[s.task], s))
    worst: list[WorstResponse | None] = [*analysis.worst] or [None] * len(tasks)
    return Timing(
        system=system.name,
        rows=tuple(ThreadComponent(c, t, w) for c, t, w in zip(mine, tasks, worst, strict=True)),
        elsewhere=tuple(c for c in system.components if c.plant is None and not c.in_thread),
        missing=tuple(c for c in mine if c.wcet_ns is None),
        miss=analysis.miss,
        exact=analysis.exact,
        work=analysis.work,
        hyperperiod=analysis.hyperperiod,
    )


def schedule_lines(timing: Timing) -> list[str]:
    """Lines of text for the last steps before a miss and for the step that misses."""
    if timing.miss is None:
        return []
    steps = timing.miss.steps[-TOLD:]
    left_out = timing.miss.left_out + len(timing.miss.steps) - len(steps)
    lines = [f"{left_out} steps before these, without a pause"] if left_out else []
    for s in steps:
        row = timing.rows[s.task]
        lines.append(
            f"{row.task.name}: release {s.number} at {show_ns(s.release)}, "
            f"starts at {show_ns(s.start)}, ends at {show_ns(s.end)}"
        )
    return lines


def report_miss(timing: Timing, diagnostics: Diagnostics) -> None:
    """Reports R034 with the schedule if a deadline is missed."""
    miss = timing.miss
    if miss is None:
        return
    row = timing.rows[miss.step.task]
    late = miss.step.end - miss.deadline
    over = timing.work > timing.hyperperiod
    also = "" if timing.missing == () else "; and of others no `wcet` is said"
    diagnostics.error(
        "R034",
        f"`{row.task.name}` may end {show_ns(late)} after its next release "
        f"in system `{timing.system}`",
        row.component.span,
        f"every {show_ns(row.task.period)}, for up to {show_ns(row.task.wcet)}",
        notes=(
            *schedule_lines(timing),
            f"everything as late and as long as declared{also}",
            *(
                (f"{show_ns(timing.work)} of work in {show_ns(timing.hyperperiod)}",)
                if over
                else ()
            ),
        ),
        helps=("shorter steps, longer periods, or phases that keep them apart",),
    )
