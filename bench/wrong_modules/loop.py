"""A simulation of a module's loop that knows lateness: what no run in virtual time shows.

Purpose: `Loop`, `worst`: plant, sensor, DM, SC and AC on a clock of 1 ms, one thread in which SC
waits for every DM that is due, the gate, and latencies; written from the definitions, nothing here
comes from `soter`.
Non-goals: finding the worst lateness by search: a handful of patterns and starts is tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

State = tuple[float, ...]
Pattern = "Callable[[int], int]"


@dataclass(frozen=True)
class Loop:
    """Times are whole milliseconds. `late` and its like give those of release k."""

    move: Callable[[State, float], State]
    """The plant over 1 ms under a command."""
    safe: Callable[[State], bool]
    law: Callable[[State], float]
    ttf: Callable[[State], bool]
    safer: Callable[[State], bool]
    push: Callable[[State, int], float]
    """AC, which sees everything; it publishes at every instant, and acts at once."""
    start: State
    first: float = 0.0
    """The command before anything was published."""
    dm: int = 50
    sc: int = 50
    phase_sc: int = 0
    sensor: int = 10
    late_dm: Callable[[int], int] = field(default=lambda _: 0)
    response_dm: Callable[[int], int] = field(default=lambda _: 0)
    late_sc: Callable[[int], int] = field(default=lambda _: 0)
    response_sc: Callable[[int], int] = field(default=lambda _: 0)
    acts: Callable[[int], int] = field(default=lambda _: 0)
    max_age: int = 20
    until: int = 10_000

    def run(self) -> float | None:
        """When it leaves C, in s."""
        return _Running(self).run()


class _Running:
    """One run: what is due when."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.x = loop.start
        self.u = loop.first
        self.seen = loop.start
        self.stamp = 0
        self.ac = False
        self.busy = 0
        """Until then the thread of the DM is not free."""
        self.decisions: dict[int, list[int]] = {}
        self.verdicts: list[tuple[int, bool]] = []
        self.steps: dict[int, list[int]] = {}
        self.outputs: list[tuple[int, float, int]] = []
        self.effects: list[tuple[int, float]] = []
        self.waiting: list[tuple[int, int]] = []

    def run(self) -> float | None:
        loop = self.loop
        for t in range(loop.until):
            if t % loop.sensor == 0:
                self.seen, self.stamp = self.x, t
            self._decide(t)
            self._control(t)
            self.x = loop.move(self.x, self.u)
            if not loop.safe(self.x):
                return (t + 1) / 1000.0
        return None

    def _decide(self, t: int) -> None:
        loop = self.loop
        if t % loop.dm == 0:
            k = t // loop.dm
            begins = max(t + loop.late_dm(k), self.busy)
            self.busy = begins + loop.response_dm(k)
            self.decisions.setdefault(begins, []).append(k)
        for k in self.decisions.pop(t, ()):
            fresh = t - self.stamp <= loop.max_age
            fine = not loop.ttf(self.seen) if self._latest() else loop.safer(self.seen)
            self.verdicts.append((t + loop.response_dm(k), fine and fresh))
        while self.verdicts and self.verdicts[0][0] <= t:
            self.ac = self.verdicts.pop(0)[1]

    def _latest(self) -> bool:
        return self.verdicts[-1][1] if self.verdicts else self.ac

    def _control(self, t: int) -> None:
        loop = self.loop
        if t >= loop.phase_sc and (t - loop.phase_sc) % loop.sc == 0:
            k = (t - loop.phase_sc) // loop.sc
            self.waiting.append((max(t + loop.late_sc(k), self.busy), k))
        for begins, k in [w for w in self.waiting if w[0] <= t]:
            self.waiting.remove((begins, k))
            self.outputs.append((t + loop.response_sc(k), loop.law(self.seen), k))
        for at, u, k in [o for o in self.outputs if o[0] <= t]:
            self.outputs.remove((at, u, k))
            if not self.ac:
                self.effects.append((t + loop.acts(k), u))
        if self.ac:
            self.effects = []
            self.u = loop.push(self.x, t)
        while self.effects and self.effects[0][0] <= t:
            self.u = self.effects.pop(0)[1]


PATTERNS: tuple[Callable[[int], Callable[[int], int]], ...] = (
    lambda most: lambda _: most,
    lambda most: lambda k: most if k % 2 == 0 else 0,
    lambda most: lambda k: most if k % 2 == 1 else 0,
    lambda most: lambda k: most if (k * 2654435761 >> 7) % 3 == 0 else 0,
)
"""Always late, every other time, now and then."""


def variants(
    loop: Loop, late_dm: int, response_dm: int, late_sc: int, response_sc: int, acts: int
) -> Iterator[Loop]:
    """The loop with its times at their bounds, in a few patterns."""
    for make in PATTERNS:
        yield replace(
            loop,
            late_dm=make(late_dm),
            response_dm=make(response_dm),
            late_sc=make(late_sc),
            response_sc=make(response_sc),
            acts=make(acts),
        )


def line(x: State, u: float) -> State:
    """X' = u."""
    return (x[0] + 0.001 * u,)


def mode(omega: float) -> Callable[[State, float], State]:
    """y1' = omega y2, y2' = -omega y1 + u: exactly."""
    c, s = math.cos(0.001 * omega), math.sin(0.001 * omega)
    b1, b2 = (1.0 - c) / omega, s / omega

    def move(y: State, u: float) -> State:
        return (c * y[0] + s * y[1] + b1 * u, -s * y[0] + c * y[1] + b2 * u)

    return move
