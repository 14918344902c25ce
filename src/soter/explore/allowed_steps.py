"""Which steps docs/testing.md allows next, and when: the calendar of one execution.

Purpose: releases, windows, times, lost releases and overruns, as a replay follows them step by
step. Written from the page alone: it shares nothing with the engine whose traces it judges.
Non-goals: what a step does (`verify/counterexample.py`), enumerating executions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.trace import BEGIN, EFFECT, LOST, START
from soter.language.elaborate.time_grid import quantum_of
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from soter.explore.trace import Step
    from soter.language.model.system import System, TestPlan


INPUT = "input."


class NotAllowedError(Exception):
    """A step that is no step of any execution at this place; the message says why."""


@dataclass(frozen=True, kw_only=True)
class ScheduledActor:
    """A component, or an `input t every d;`: releases at phase + k * period up to the horizon.

    A step happens in [r, r + window]; `skips` releases in a row may be lost (0: none);
    publications may take effect from `least` (> 0: a step always lasts) up to `overrun` after the
    start (0: at once). Times in ns.
    """

    name: str
    role: str
    component: int | None
    drive: int | None
    period_ns: int
    phase_ns: int
    window_ns: int = 0
    skips: int = 0
    overrun_ns: int = 0
    least_ns: int = 0


def actors_of(system: System) -> tuple[ScheduledActor, ...]:
    """The actors of a test: its components in their order, then its inputs."""
    plan = plan_of(system)
    actors = []
    for c in system.components:
        faults = [f for f in plan.faults if f.component == c.index]
        late = sum(f.by_ns for f in faults if f.kind == "late")
        actors.append(
            ScheduledActor(
                name=c.name,
                role=c.role,
                component=c.index,
                drive=None,
                period_ns=c.period_ns,
                phase_ns=c.phase_ns,
                window_ns=0 if c.role == "plant" else plan.skew_ns + late,
                skips=max((f.at_most for f in faults if f.kind == "skip"), default=0),
                overrun_ns=sum(f.by_ns for f in faults if f.kind == "overrun"),
                least_ns=sum(f.least_ns for f in faults if f.kind == "overrun"),
            )
        )
    for i, drive in enumerate(system.inputs):
        name = INPUT + system.topics[drive.topic].name
        actors.append(
            ScheduledActor(
                name=name,
                role="input",
                component=None,
                drive=i,
                period_ns=drive.every_ns,
                phase_ns=0,
            )
        )
    return tuple(actors)


def plan_of(system: System) -> TestPlan:
    """The test that the system was flattened for."""
    assert system.test is not None, f"{system.name} is no test"
    return system.test


class ExecutionCalendar:
    """The place of one execution in its calendar; `take` moves on by a step that is allowed."""

    def __init__(self, system: System) -> None:
        self.actors = actors_of(system)
        self.number = {a.name: i for i, a in enumerate(self.actors)}
        self.horizon_ns = plan_of(system).horizon_ns
        self.quantum_ns = quantum_of(system)
        self.ordered = plan_of(system).ordered
        self.now = -1
        self._born = False
        self.done = [0] * len(self.actors)
        self._lost = [0] * len(self.actors)
        self._running: dict[int, int] = {}
        """Overrunning actors and the times at which they began."""

    # ------------------------------------------------------------ what is to come

    def window(self, i: int) -> tuple[int, int] | None:
        """[lo, hi] of the next step of an actor; None where it has none up to the horizon.

        Of an actor that still runs, that is what it published taking effect.
        """
        actor = self.actors[i]
        if i in self._running:
            return self._running[i] + actor.least_ns, self._running[i] + actor.overrun_ns
        release = self.actors[i].phase_ns + self.done[i] * self.actors[i].period_ns
        return None if release > self.horizon_ns else (release, release + actor.window_ns)

    @property
    def is_observable(self) -> bool:
        """Whether time may pass: no step that has not happened has its hi by now."""
        return all(hi > self.now for _, hi in self._pending())

    @property
    def is_over(self) -> bool:
        """Whether every step has happened."""
        return not self._pending()

    def _pending(self) -> list[tuple[int, int]]:
        windows = (self.window(i) for i in range(len(self.actors)))
        return [w for w in windows if w is not None]

    # ------------------------------------------------------------ moving on

    def take(self, step: Step) -> int | None:
        """Check a step and move on; the actor's number, None for the start.

        NotAllowedError for a step that the schedule has not there.
        """
        if step.kind == START:
            if self._born or self.now != -1 or any(self.done):
                raise NotAllowedError("the start comes first, and once")
            self._born = True
            return None
        i = self.number.get(step.actor)
        if i is None:
            raise NotAllowedError(f"there is no actor `{step.actor}`")
        window = self.window(i)
        if window is None:
            raise NotAllowedError(f"`{step.actor}` has no release left up to the horizon")
        self._check_kind(step, i, window)
        self._check_time(step, i, window)
        self._move(step, i)
        return i

    def _check_kind(self, step: Step, i: int, window: tuple[int, int]) -> None:
        actor, runs = self.actors[i], i in self._running
        if step.kind == EFFECT:
            if not runs:
                raise NotAllowedError(f"`{actor.name}` does not run: nothing can take effect")
            return
        if runs:
            raise NotAllowedError(f"`{actor.name}` still runs")
        if step.release_ns != window[0]:
            message = f"the next release of `{actor.name}` is at {show_ns(window[0])}"
            raise NotAllowedError(f"{message}, not {show_ns(step.release_ns)}")
        if step.kind == BEGIN and not actor.overrun_ns:
            raise NotAllowedError(f"the test does not let `{actor.name}` overrun")
        if step.kind == LOST and self._lost[i] >= actor.skips:
            many = f"more than {actor.skips} in a row" if actor.skips else "any"
            raise NotAllowedError(f"the test does not let `{actor.name}` skip {many}")

    def _place(self, i: int) -> tuple[bool, int]:
        """Where an actor stands in the deployed order: inputs come before components."""
        return self.actors[i].drive is None, i

    def _check_time(self, step: Step, i: int, window: tuple[int, int]) -> None:
        lo, hi = window
        early = max(lo, self.now)
        if not early <= step.time_ns <= hi:
            message = f"it can happen from {show_ns(early)} to {show_ns(hi)}"
            message += f", not at {show_ns(step.time_ns)}"
            raise NotAllowedError(message)
        if step.time_ns != early and step.time_ns % self.quantum_ns:
            message = f"{show_ns(step.time_ns)} is not on the grid of {show_ns(self.quantum_ns)}"
            raise NotAllowedError(message)
        if step.kind == LOST and step.time_ns != early:
            raise NotAllowedError("a lost release has its place as early as possible")
        for j, actor in enumerate(self.actors):
            other = self.window(j)
            if other is None:
                continue
            if self.ordered and other[0] <= step.time_ns and self._place(j) < self._place(i):
                message = f"`{actor.name}` steps before it in the deployed order"
                raise NotAllowedError(message)
            if other[1] < step.time_ns:
                raise NotAllowedError(f"`{actor.name}` has to step before, by {show_ns(other[1])}")

    def _move(self, step: Step, i: int) -> None:
        self.now = step.time_ns
        if step.kind == EFFECT:
            del self._running[i]
            actor = self.actors[i]
            busy = self.now - (1 if actor.least_ns else 0)  # who says so may step again at once
            released = (busy - actor.phase_ns) // actor.period_ns + 1
            self.done[i] = max(self.done[i], released)  # it still ran: these are lost
            return
        self.done[i] += 1
        self._lost[i] = self._lost[i] + 1 if step.kind == LOST else 0
        if step.kind == BEGIN:
            self._running[i] = step.time_ns
