"""The thread of the trusted part of a system, and whether it keeps its calendar.

Purpose: who runs in it, from a flat system; `timing_of`: the latest start and end of every step of
theirs, or what is missing to say so; a deadline that is missed, as a diagnostic.
Non-goals: the analysis (`response_times.py`), whether a proof's times hold
(`verify/time/problem_times.py`).

A deployed system has no plants. All that is Soter code runs in one thread: decision modules, safe
controllers, then ACs and other nodes, those that `takes` time, too. Only extern nodes run
elsewhere, in processes of their own, unless the system says `inline`; what they need of a processor
is no part of the thread.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns
from soter.timing.response_times import Miss, ScheduledStep, Task, WorstResponse, analyse

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, System

FITS, MISSES, UNDECIDED = "fits", "misses", "undecided"
TOLD = 8
"""Steps of a schedule that a diagnostic shows."""


@dataclass(frozen=True)
class ThreadComponent:
    """A component of the thread.

    `worst`: its latest start and end; of an analysis that is not exact they are bounds.
    """

    component: Component
    task: Task
    worst: WorstResponse | None

    @property
    def slack(self) -> int | None:
        """From its latest end to its deadline, in ns; negative where that is missed."""
        return None if self.worst is None else self.task.deadline - self.worst.end


@dataclass(frozen=True)
class Timing:
    """What the declared execution times of a system come to.

    `missing`: components of the thread without a `wcet`: they were counted as if they needed no
    time, so that a miss is one all the same, and nothing else is decided. `elsewhere`: nodes that
    run in processes of their own. `work` of `hyperperiod` ns the thread is busy at most.
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
        """`fits`, `misses` or `undecided`."""
        if self.miss is not None:
            return MISSES
        slacks = [r.slack for r in self.rows]
        if self.missing or any(s is None or s < 0 for s in slacks):
            return UNDECIDED
        return FITS

    def row(self, component: Component) -> ThreadComponent | None:
        """Of a component, by its name; None where it is not in the thread."""
        return next((r for r in self.rows if r.component.name == component.name), None)


def in_thread(c: Component) -> bool:
    """Whether a component runs in the thread of the trusted part."""
    return c.plant is None and (c.inline or not c.extern)


def _task(c: Component) -> Task:
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
    """The analysis of a flat system; None where it declares no time for its thread.

    A `jitter` alone is one: who says no `wcet` counts as if it needed no time.

    A deadline is the next release. `watch`: told the steps as `analyse` does.
    """
    mine = [c for c in system.components if in_thread(c)]
    if all(c.wcet_ns is None and not c.jitter_ns for c in mine):
        return None
    tasks = [_task(c) for c in mine]
    analysis = analyse(tasks, None if watch is None else lambda s: watch(mine[s.task], s))
    worst: list[WorstResponse | None] = [*analysis.worst] or [None] * len(tasks)
    return Timing(
        system=system.name,
        rows=tuple(ThreadComponent(c, t, w) for c, t, w in zip(mine, tasks, worst, strict=True)),
        elsewhere=tuple(c for c in system.components if c.plant is None and not in_thread(c)),
        missing=tuple(c for c in mine if c.wcet_ns is None),
        miss=analysis.miss,
        exact=analysis.exact,
        work=analysis.work,
        hyperperiod=analysis.hyperperiod,
    )


def schedule_lines(timing: Timing, shown: int = TOLD) -> list[str]:
    """The steps before a miss, one a line, itself the last."""
    if timing.miss is None:
        return []
    steps = timing.miss.steps[-shown:]
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
    """R034 where the calendar cannot be kept, with the schedule that misses."""
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
