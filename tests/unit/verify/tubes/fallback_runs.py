"""Fall-back runs and rest runs of docs/proof-flight.md, "Decisions by tubes", on whole numbers.

Purpose: `Check` says "good" by going through all fall-back runs of an estimate as they are defined;
`Times` has the times of that section. A unit of time is one tick, in which the plant makes x + u +
w of x, u the sum of all components of the command. Nothing of the prover is used.
Non-goals: executions (`executions.py`); intervals and rounding: every set is a set of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from math import gcd
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator

Past: TypeAlias = tuple[int, ...]
"""The states at the last ticks, the present one at the end: as many as a read reaches back."""
Command: TypeAlias = tuple[int, ...]
"""A number for each component."""
Law: TypeAlias = Callable[[int], tuple[Command | None, ...]]
"""What SC may answer to a read, whatever its locals are; None is a step fault."""


class Begun(NamedTuple):
    """An output of SC some of whose components act."""

    command: Command
    acts: tuple[bool, ...]
    age: int
    """Of its read."""


class Hold(NamedTuple):
    """SC has control, and nothing but its outputs acts."""

    past: Past
    acting: Command
    since: int
    """Ticks since the window of the next output began; below 0: until it does."""
    left: int
    """How many outputs may follow."""
    begun: Begun | None = None


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
    """The plant, where nothing else is said."""
    return x + u + w


@dataclass(frozen=True)
class Check:
    """What the DM asks of an estimate; of schedules it knows its six times only."""

    law: Law
    safe: frozenset[int]
    rest: frozenset[int]
    commands: tuple[Command, ...]
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

    def later(self, past: Past, u: Command, w: int) -> Past:
        """The past one tick later."""
        return (*past, self.plant(past[-1], sum(u), w))[-self.delay - 1 :]

    def output(self, past: Past, c: int, left: int) -> bool:
        """Output 0 is complete now, c ticks after its window began: rest, or SC goes on."""
        if past[-1] in self.rest:
            return True
        key = (past, c, left)
        if key not in self.known:
            self.known[key] = left > 0 and all(
                u is not None and self.hold(Hold(past, u, c - self.delta, left - 1))
                for u, _ in self.reads(past)
            )
        return self.known[key]

    def hold(self, now: Hold) -> bool:
        """What acts does so for this tick, and then on until components of the next output do."""
        if now not in self.known:
            self.known[now] = all(
                (complete and p[-1] in self.rest)
                or (after is not None and after.left >= 0 and self.hold(after))
                for p in (self.later(now.past, now.acting, w) for w in self.wind)
                for after, complete in self.instants(now, p)
            )
        return self.known[now]

    def instants(self, now: Hold, p: Past) -> Iterator[tuple[Hold | None, bool]]:
        """What may begin to act at p, a tick later, and whether the next output is complete then.

        None: there is no output, but a fault, or x is not in C.
        """
        if p[-1] not in self.safe:
            yield None, False
            return
        c, begun = now.since + 1, now.begun
        begun = begun and begun._replace(age=begun.age + 1)
        if c < self.jitter:
            yield Hold(p, now.acting, c, now.left, begun), False
        for begins in product((False, True), repeat=len(now.acting)) if c >= 0 else ():
            acts = begun.acts if begun else (False,) * len(begins)
            on = tuple(a or b for a, b in zip(acts, begins, strict=True))
            complete = all(on)
            if sum(on) == sum(acts) or (c >= self.jitter and not complete):
                continue
            for u, age in [(begun.command, begun.age)] if begun else self.reads(p):
                if u is None:
                    yield None, complete
                elif age <= self.delay:
                    new = zip(acts, on, u, now.acting, strict=True)
                    acting = tuple(v if b and not a else old for a, b, v, old in new)
                    if complete:
                        yield Hold(p, acting, c - self.delta, now.left - 1), True
                    else:
                        yield Hold(p, acting, c, now.left, Begun(u, on, age)), False

    def reads(self, past: Past) -> set[tuple[Command | None, int]]:
        """What SC may have answered to reads of the past, and how old they are."""
        aged = enumerate(reversed(past))
        return {(u, n) for n, x in aged for e in self.errors for u in self.law(x + e)}

    def keeps(self, x: int, past_in: frozenset[int] | None = None) -> bool:
        """Condition 4: every rest run from x stays in C. `past_in`: only of pasts within it."""
        assert self.plant is moved  # as what was before x is asked
        before = {sum(u) + w for u in self.commands for w in self.wind}
        pasts: set[Past] = {(x,)}
        for _ in range(self.delay):
            pasts = {
                (p[0] - by, *p)
                for p in pasts
                for by in before
                if past_in is None or p[0] - by in past_in
            }
        seen, todo = set[Hold](), list[Hold]()

        def add(after: Hold) -> None:
            if after not in seen and after not in self.kept:
                seen.add(after)
                todo.append(after)

        for p in pasts:
            for (u, _), c in product(self.reads(p), range(self.jitter + 1)):
                if u is None:
                    return False
                add(Hold(p, u, c - self.delta, 0))
        while todo:
            now = todo.pop()
            for p in (self.later(now.past, now.acting, w) for w in self.wind):
                for after, _ in self.instants(now, p):
                    if after is None:
                        return False
                    add(after._replace(left=0))
        self.kept.update(seen)
        return True
