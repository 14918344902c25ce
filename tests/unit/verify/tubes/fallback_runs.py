"""Fall-back runs and rest runs of docs/proof.md, "Decisions by tubes", on whole numbers.

Purpose: `Check` says "good" by going through all fall-back runs of an estimate as they are defined;
`Times` has the times of that section. One state, one command; a unit of time is one tick, in which
the plant makes x + u + w of x. Nothing of the prover is used.
Non-goals: executions (`executions.py`); intervals and rounding: every set is a set of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import gcd
from typing import Any, TypeAlias

Past: TypeAlias = tuple[int, ...]
"""The states at the last ticks, the present one at the end: as many as a read reaches back."""
Law: TypeAlias = Callable[[int], tuple[int | None, ...]]
"""What SC may answer to a read, whatever its locals are; None is a step fault."""
Hold: TypeAlias = tuple[Past, int | None, int, int]
"""A past, what SC commands from now on, ticks since the window of its next output began (below 0:
until it does), and how many outputs may follow."""


@dataclass(frozen=True)
class Times:
    """Of "The model of time", in ticks: period, phase, lateness and response of DM and of SC."""

    dm: tuple[int, int, int, int]
    sc: tuple[int, int, int, int]
    least: int = 0
    most: int = 0
    age: int = 0
    age_sc: int = 0

    def derived(self) -> dict[str, Any]:
        """alpha, H, d, j, the period of SC and h_0."""
        (period, phase, late, response), (delta, phase_sc, late_sc, response_sc) = self.dm, self.sc
        common = gcd(period, delta)
        near = (phase_sc - phase) % common
        far = delta - common + near
        jitter = max(late_sc, late + response - near) + response_sc + self.most - self.least
        horizon = max(late + response, far + late_sc) + self.age + period + response_sc + self.most
        since = (phase_sc - phase) % period  # from the DM's last release to SC's first one
        first = max(late_sc, late + response - since) if phase <= phase_sc else late_sc
        return {
            # in whole ticks: an output is complete in the last delta + j before s + H
            "alpha": max(period - late + self.least, horizon - delta - jitter + 1),
            "horizon": horizon,
            "delay": self.age_sc + response_sc + self.most,
            "jitter": jitter,
            "delta": delta,
            "start": phase_sc + first + response_sc + self.most,
        }


def moved(x: int, u: int, w: int) -> int:
    return x + u + w


@dataclass(frozen=True)
class Check:
    """What the DM asks of an estimate; of schedules it knows its six times only."""

    law: Law
    safe: frozenset[int]
    rest: frozenset[int]
    commands: tuple[int, ...]
    wind: tuple[int, ...]
    errors: tuple[int, ...]
    holds: int
    alpha: int
    horizon: int
    delay: int
    jitter: int
    delta: int
    start: int
    plant: Callable[[int, int, int], int] = moved
    known: dict[tuple[object, ...], bool] = field(default_factory=dict, init=False, compare=False)
    kept: set[Hold] = field(default_factory=set, init=False, compare=False)

    def good(self, estimate: int) -> bool:
        """Condition 5: every fall-back run of the estimate comes to rest, in C all the way."""
        if (estimate,) not in self.known:
            self.known[estimate,] = all(
                self.comes_to_rest(estimate - e, self.alpha, self.horizon) for e in self.errors
            )
        return self.known[estimate,]

    def starts_well(self, x: int, late: int = 0) -> bool:
        """Condition 6, where the first read is at tick `late`: the same with h_0 for H."""
        horizon = self.start + late
        return self.comes_to_rest(x, max(0, horizon - self.delta - self.jitter + 1), horizon)

    def comes_to_rest(self, x: int, alpha: int, horizon: int) -> bool:
        """Any command, until an output of SC is complete at some instant of the window."""
        pasts: set[Past] = {(x,)}
        for tick in range(horizon + 1):
            if any(past[-1] not in self.safe for past in pasts):
                return False
            windows = range(self.jitter + 1) if tick >= alpha else ()
            if not all(self.output(past, c, self.holds) for past in pasts for c in windows):
                return False
            pasts = {self.later(p, u, w) for p in pasts for u in self.commands for w in self.wind}
        return True

    def later(self, past: Past, u: int, w: int) -> Past:
        """The past one tick later."""
        return (*past, self.plant(past[-1], u, w))[-self.delay - 1 :]

    def answers(self, past: Past) -> set[int | None]:
        """What an output of SC may be that acts now: its read is up to d old."""
        return {u for x in past for e in self.errors for u in self.law(x + e)}

    def output(self, past: Past, c: int, left: int) -> bool:
        """An output acts now, c ticks after its window began: rest, or SC goes on."""
        if past[-1] in self.rest:
            return True
        key = (past, c, left)
        if key not in self.known:
            after = ((past, u, c - self.delta, left - 1) for u in self.answers(past))
            self.known[key] = left > 0 and all(map(self.hold, after))
        return self.known[key]

    def hold(self, key: Hold) -> bool:
        """The command acts for this tick, and then on until the next output acts."""
        past, u, c, left = key
        if u is None:
            return False
        if key not in self.known:
            self.known[key] = all(
                p[-1] in self.safe
                and (c + 1 < 0 or self.output(p, c + 1, left))
                and (c + 1 >= self.jitter or self.hold((p, u, c + 1, left)))
                for p in (self.later(past, u, w) for w in self.wind)
            )
        return self.known[key]

    def keeps(self, x: int, past_in: frozenset[int] | None = None) -> bool:
        """Condition 4: every rest run from x stays in C. `past_in`: only of pasts within it."""
        pasts: set[Past] = {(x,)}
        for _ in range(self.delay):
            pasts = {
                (z, *p)
                for p in pasts
                for z in (range(p[0] - 9, p[0] + 10) if past_in is None else past_in)
                if any(self.plant(z, u, w) == p[0] for u in self.commands for w in self.wind)
            }
        todo = [
            (p, u, c - self.delta, 0)
            for p in pasts
            for c in range(self.jitter + 1)
            for u in self.answers(p)
        ]
        seen = set[Hold](todo)
        while todo:
            past, u, c, _ = todo.pop()
            if u is None:
                return False
            for p in (self.later(past, u, w) for w in self.wind):
                if p[-1] not in self.safe:
                    return False
                after = set[Hold]({(p, u, c + 1, 0)} if c + 1 < self.jitter else ())
                if c + 1 >= 0:
                    after |= {(p, v, c + 1 - self.delta, 0) for v in self.answers(p)}
                after -= seen | self.kept
                todo += after
                seen |= after
        self.kept.update(seen)
        return True
