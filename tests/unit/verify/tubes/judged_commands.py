"""All executions of a module whose gate judges each command of AC, on whole numbers.

Purpose: `JudgedExecutions`: as `executions.py`, but that AC publishes commands, any of U at every
tick before or after DM and SC, if they are good with all that may still act; they act between L_min
and L later. `Judge` says "good with V" by going through all fall-back runs as docs/proof-flight.md,
"Commands judged when they are published", defines them.
Non-goals: several components, maps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from unit.verify.tubes.executions import Executions, Mode, Step, published, released

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from unit.verify.tubes.executions import Configuration, Flying
    from unit.verify.tubes.fallback_runs import Check, Past

Told = tuple[tuple[int, int], ...]
"""What was published, the first first: ticks since, and the command."""


@dataclass(frozen=True)
class Judge:
    """What the gate asks of a command. `any_for`: W."""

    check: Check
    any_for: int
    earliest: int = 0
    """Of a naive one: it takes SC to act no earlier."""

    def good(self, estimate: int, values: frozenset[int]) -> bool:
        """Commands of V until some t_1, then any for W at most, until an output is complete."""
        key = ("judged", self.any_for, self.earliest, estimate, values)
        known = self.check.known
        if key not in known:
            known[key] = all(self._settles(estimate - e, values) for e in self.check.errors)
        return known[key]

    def _settles(self, x: int, values: frozenset[int]) -> bool:
        c = self.check
        pasts: set[Past] = {(x,)}
        for t_1 in range(c.horizon + 1):
            later = pasts
            for tick in range(t_1, min(t_1 + self.any_for, c.horizon) + 1):
                if any(p[-1] not in c.safe for p in later):
                    return False
                windows = range(c.jitter + 1) if tick >= self.earliest else ()
                if not all(c.output(p, w, c.holds) for p in later for w in windows):
                    return False
                later = {c.later(p, u, w) for p in later for u in c.commands for w in c.wind}
            pasts = {c.later(p, (v,), w) for p in pasts for v in values for w in c.wind}
        return True


@dataclass(frozen=True)
class JudgedExecutions(Executions):
    """Those of one module with a gate."""

    judge: Judge | None = None
    forgets: bool = False
    """Of a naive gate: it looks at the command alone, not at those that still act."""
    looks_only: bool = False
    """Of a naive one: commands are judged at looks of the DM alone."""

    def first_of(self, start: Configuration) -> Configuration:
        """A default acts."""
        default = self.checks[0].commands[0]
        return start._replace(acting=default, published=((0, default[0]),))

    def values(self, told: Told, age: int) -> frozenset[int]:
        """V of a state that is `age` ticks old."""
        if self.forgets:
            return frozenset({told[-1][1]})
        old = [u for n, u in told if n >= age + self.times.most]
        return frozenset({*old[-1:], *(u for n, u in told if n < age + self.times.most)})

    def tick(self, here: Configuration, now: int) -> Iterator[Configuration]:
        """AC, DM and SC, AC again; what acts, the plant."""
        errors, t = self.checks[0].errors, self.times
        oldest = min(t.age_sc, len(here.past) - 1, now - self.first)
        for n in range(min(here.age + 1, oldest) + 1):
            mine = {here.past[-1 - n] + e for e in errors}
            reads = mine if n <= t.age else set[int]()
            for flying, told in self.proposed(here.flying[0], here.published, here.mode, reads, n):
                seen = {(y, self.values(told, n)) for y in reads}
                before = here._replace(flying=(flying,))
                for dm, mode, sc, (out,), local in self.instant(before, seen, mine, now):  # type: ignore[arg-type]
                    of_sc = told if out == flying else (*told, (0, out[-1][0]))
                    for last, then in self.proposed(out, of_sc, mode, reads, n):
                        kept = self.kept(then)
                        for acting, rest in self.act(here.acting[0], last):
                            for p in self.move(here.past, (acting,)):
                                yield here._replace(
                                    past=p, age=n, own=n, dm=dm, sc=sc, local=local, mode=mode,
                                    acting=(acting,), flying=(rest,), published=kept,
                                )  # fmt: skip

    def proposed(
        self, flying: Flying, told: Told, mode: Mode, reads: set[int], age: int
    ) -> Iterator[tuple[Flying, Told]]:
        """AC publishes nothing, or what is good."""
        yield flying, told
        if not mode.ac:
            return
        assert self.judge is not None
        for (u,) in self.checks[0].commands:
            new = (*told, (0, u))
            v = self.values(new, age)
            if self.looks_only or any(self.judge.good(y, v) for y in reads):
                yield published((flying,), (u,))[0], new

    def kept(self, told: Told) -> Told:
        """A tick later, without what no look asks for any more."""
        most = self.times.age + self.times.most + 1
        old = [(most, u) for n, u in told if n + 1 >= most]
        return (*old[-1:], *((n + 1, u) for n, u in told if n + 1 < most))

    def decide(
        self, dm: Step | None, mode: Mode, reads: set[Any], now: int
    ) -> Iterator[tuple[Step | None, Mode]]:
        """In mode AC commands are judged, in mode SC any may follow."""
        if mode.ac and (dm is not None or released(self.times.dm, now)):
            assert self.judge is not None
            good = {y for y, v in reads if self.judge.good(y, v)}
        else:
            good = {y for y, _ in reads if self.checks[0].good(y)}
        yield from self._said(dm, mode, Mode(True) if good else None, now)

    def _said(
        self, dm: Step | None, mode: Mode, good: Mode | None, now: int
    ) -> Iterator[tuple[Step | None, Mode]]:
        _, _, late, response = self.times.dm
        if dm is not None and dm.runs:
            if dm.ticks < response:
                yield dm._replace(ticks=dm.ticks + 1), mode
            mode, dm = dm.mode, None
        dm = Step() if released(self.times.dm, now) else dm
        if dm is None:
            yield None, mode
            return
        if dm.ticks < late:
            yield dm._replace(ticks=dm.ticks + 1), mode
        for says in {Mode(False)} | ({good} if good is not None else set()):
            yield None, says
            if response:
                yield Step(runs=True, ticks=1, mode=says), mode
