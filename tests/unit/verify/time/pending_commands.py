"""Commands on their way to a plant, with adversarial latenesses: what acts, and what it answers.

Purpose: one drawn run of DM, AC, SC and actuators on a grid of times, from the definitions alone:
releases start late, wait for verdicts and answer late; each component of an output waits in a queue
until it acts, between `least` and `most` after its publication and never before an earlier output.
Measured: how old the state is that the acting command of SC answers, at every instant; and how
long after the state behind the last "AC" some command of AC still acts.
Non-goals: the worst run (extremes are drawn often), nodes on the way, sets of states.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath

if TYPE_CHECKING:
    import random

LONGEST = 160


def late_system(draw: random.Random) -> Schedule:
    """A module whose commands act up to several periods late; SC is done with each step in time."""
    while True:
        period = draw.randrange(2, 9)
        dm_period = period * draw.choice((1, 1, 2, 3)) + draw.choice((0, 0, 1))
        sensor = Releases(draw.randrange(1, 7), draw.randrange(8))
        dm = Releases(dm_period, draw.randrange(dm_period), draw.randrange(3), draw.randrange(3))
        sc = Releases(period, draw.randrange(period), draw.randrange(3), draw.randrange(3))
        least = draw.choice((0, 0, draw.randrange(20)))
        most = least + draw.choice((period // 2 + 1, draw.randrange(4 * period + 1)))
        outputs = tuple(ActuationPath(least, most) for _ in range(draw.choice((1, 2))))
        system = Schedule(dm, sc, (SensorPath(sensor),), (SensorPath(sensor),), outputs)
        if (
            dm.latest <= dm.period
            and system.latest_output <= sc.period
            and not system.are_windows_short
        ):
            return system


@dataclass(frozen=True)
class Command:
    """What one component was told, of a state of when; from when on it acts.

    `of_run`: by SC, and AC has no control from then on.
    """

    of_run: bool
    state: int
    acts: int


@dataclass
class PendingCommands:
    """One run; `ac_until`: the last release of the DM that says "AC" (SC steps all the time)."""

    system: Schedule
    draw: random.Random
    ac_until: int = -1
    greed: float = 0.8
    """How often a choice is an end of its range."""
    oldest_answered: int = 0
    """D: of what SC answered, of all that acted at some instant."""
    last_of_ac: int = 0
    """Until when a command acted that was not SC's, from the state behind the last "AC"."""
    last_state: int = 0
    _verdicts: dict[int, int] = field(default_factory=dict)
    _ac_from: int = LONGEST
    _sc_from: int = LONGEST
    """From when to when AC has control; SC has before and after."""

    def run(self) -> PendingCommands:
        """Until `LONGEST`."""
        s = self.system
        for release in range(s.dm.phase, LONGEST, s.dm.period):
            start = release + self._of(s.dm.late)
            self._verdicts[release] = start + self._of(s.dm.response)
            if release <= self.ac_until:
                self.last_state = self._seen(start)
                self._ac_from = min(self._ac_from, self._verdicts[release])
            else:
                self._sc_from = min(self._sc_from, self._verdicts[release])
        queues: list[deque[Command]] = [deque() for _ in s.outputs]
        for of_run, state, published in sorted(self._published(), key=lambda c: c[2]):
            for queue, output in zip(queues, s.outputs, strict=True):
                earliest = published + output.least
                acts = earliest + self._of(output.most - output.least)
                before = queue[-1].acts if queue else 0
                queue.append(Command(of_run, state, max(acts, before)))
        for queue in queues:
            self._act(queue)
        return self

    def _of(self, most: int) -> int:
        if self.draw.random() < self.greed:
            return self.draw.choice((0, most))
        return self.draw.randint(0, most)

    def _seen(self, at: int) -> int:
        """The state that a sensor, never late, has published last."""
        (path,) = self.system.read_by_sc
        return at - (at - path.sensor.phase) % path.sensor.period

    def _published(self) -> list[tuple[bool, int, int]]:
        """(of SC's run, state, instant) of all that passes the gate."""
        s = self.system
        passed = []
        for release in range(s.sc.phase, LONGEST, s.sc.period):
            waits = [out for due, out in self._verdicts.items() if release - 40 < due <= release]
            start = max([release + self._of(s.sc.late), *waits])
            published = start + self._of(s.sc.response)
            if not self._ac_from <= published < self._sc_from:
                of_run = published >= self._sc_from
                passed.append((of_run, self._seen(start), published))
        by_ac = [at for at in range(self._ac_from, self._sc_from) if self.draw.random() < 0.5]
        return [*passed, *((False, at, at) for at in by_ac)]

    def _act(self, queue: deque[Command]) -> None:
        """At each instant the last command acts that has begun to; it does until the next one."""
        acting: Command | None = None
        for now in range(LONGEST):
            if acting is not None:
                if acting.of_run:  # `now` included: it acted until then
                    self.oldest_answered = max(self.oldest_answered, now - acting.state)
                elif now > self.last_state and self._ac_from < LONGEST:
                    self.last_of_ac = max(self.last_of_ac, now - self.last_state)
            while queue and queue[0].acts <= now:
                acting = queue.popleft()
