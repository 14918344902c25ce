"""All executions of a module whose DM decides by fall-back runs, on whole numbers, for all times.

Purpose: DM, SC, gate and actuators as "The model of time" of docs/proof.md and docs/semantics.md
define them: late, slow, SC that waits for the DM, both orders of an instant, "not AC" at any look,
any command of U from AC at every tick, outputs in flight, components that begin to act one after
the other; several maps, any at any look.
Non-goals: what the DM asks (`fallback_runs.py`); nodes on the ways.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from itertools import product
from math import lcm
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from unit.verify.tubes.fallback_runs import Command, Past

if TYPE_CHECKING:
    from collections.abc import Iterator

    from unit.verify.tubes.fallback_runs import Check, Times

Control: TypeAlias = Callable[[Hashable, int, bool], list[tuple[Command, Hashable]]]
"""A step of SC: its locals, a read, whether it has control -> commands and new locals."""
Flying: TypeAlias = tuple[tuple[int, int], ...]
"""Of one component, what SC published and does not act yet, the first first: value, ticks since."""


class Mode(NamedTuple):
    """Who has control, and the map of the last verdict "AC"."""

    ac: bool
    seen: int = 0


class Step(NamedTuple):
    """A step of DM or SC that was released and is not out."""

    runs: bool = False
    ticks: int = 0
    """For which it has waited, or run."""
    blocked: bool = False
    """SC: the DM of before has not given its verdict."""
    command: Command = ()
    mode: Mode = Mode(False)


class Configuration(NamedTuple):
    """What the future depends on, but for the time."""

    past: Past
    age: int
    """Of what was read last, in ticks; `own`: of what SC read of a topic of its own."""
    own: int
    dm: Step | None
    sc: Step | None
    local: Hashable
    mode: Mode
    acting: tuple[int | None, ...]
    """Of each component; None: AC's, so any of U at every tick."""
    flying: tuple[Flying, ...]
    published: tuple[tuple[int, int], ...] = ()
    """Where commands are judged: what was published, and how many ticks ago."""


@dataclass(frozen=True)
class Executions:
    """Those of one module. `checks`: what the DM asks, one for each map that a look may read."""

    times: Times
    checks: tuple[Check, ...]
    step: Control | None = None
    local: Hashable = None
    first: int = 0
    """Nothing is published before; SC reads a default, 0, until then."""
    own: bool = False
    """SC reads a topic that the DM does not read."""

    def violated(self, starts: set[int]) -> tuple[bool, set[Mode]]:
        """Whether one leaves C of the map of the last "AC", and the modes that were seen."""
        t, again = self.times, lcm(self.times.dm[0], self.times.sc[0])
        warm = t.dm[1] + t.sc[1] + t.age_sc + self.first
        sizes = len(self.checks[0].commands[0])
        start = Configuration(
            (), 0, 0, None, None, self.local, Mode(False), (None,) * sizes, ((),) * sizes
        )
        start = self.first_of(start)
        todo = [(0, start._replace(past=(x,))) for x in starts]
        told, modes = set(todo), {Mode(False)}
        while todo:
            now, here = todo.pop()
            later = now + 1 if now < warm else warm + (now + 1 - warm) % again
            for after in self.tick(here, now):
                if after.past[-1] not in self.checks[after.mode.seen].safe:
                    return True, modes
                modes.add(after.mode)
                if (later, after) not in told:
                    told.add((later, after))
                    todo.append((later, after))
        return False, modes

    def first_of(self, start: Configuration) -> Configuration:
        """What an execution begins with."""
        return start

    def tick(self, here: Configuration, now: int) -> Iterator[Configuration]:
        """What is read, DM, SC, what acts, the plant. Both orders within an instant."""
        errors = self.checks[0].errors
        oldest = min(self.times.age_sc, len(here.past) - 1, now - self.first)
        spoken = now >= self.first
        for n in range(min(here.age + 1, oldest) + 1) if spoken else (0,):
            reads = {here.past[-1 - n] + e for e in errors} if spoken else {0}
            fresh = reads if spoken and n <= self.times.age else set[int]()
            for m in range(min(here.own + 1, oldest) + 1) if self.own and spoken else (n,):
                mine = {here.past[-1 - m] + e for e in errors} if spoken else {0}
                for dm, mode, sc, out, local in self.instant(here, fresh, mine, now):
                    of_ac = mode.ac or here.mode.ac
                    each = (
                        list(self.act(None if of_ac else old, () if mode.ac else f))
                        for old, f in zip(here.acting, out, strict=True)
                    )
                    for both in product(*each):
                        acting, flying = (tuple(x) for x in zip(*both, strict=True))
                        for p in self.move(here.past, acting):
                            yield Configuration(p, n, m, dm, sc, local, mode, acting, flying)

    def instant(
        self, here: Configuration, fresh: set[int], mine: set[int], now: int
    ) -> Iterator[tuple[Step | None, Mode, Step | None, tuple[Flying, ...], Hashable]]:
        """The DM and then SC; and the other way round, where SC does not wait for it."""
        sc = here.sc
        for dm, mode in self.decide(here.dm, here.mode, fresh, now):
            for then in self.control(here, dm, mode, mine, now):
                yield dm, mode, *then
        waits = sc is not None and not sc.runs and sc.blocked and here.dm is not None
        if sc is not None and not waits and not released(self.times.sc, now):
            for then in self.control(here, here.dm, here.mode, mine, now):
                for dm, mode in self.decide(here.dm, here.mode, fresh, now):
                    yield dm, mode, *then

    def move(self, past: Past, acting: tuple[int | None, ...]) -> set[Past]:
        c, keep = self.checks[0], self.times.age_sc + 1
        each = zip(acting, zip(*c.commands, strict=True), strict=True)
        us = product(*(set(of_u) if a is None else {a} for a, of_u in each))
        return {(*past, c.plant(past[-1], sum(v), w))[-keep:] for v in us for w in c.wind}

    def decide(
        self, dm: Step | None, mode: Mode, reads: set[int], now: int
    ) -> Iterator[tuple[Step | None, Mode]]:
        """The DM of this tick: itself, and the mode after it. "Not AC" may always be said."""
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
        good = {Mode(True, m) for y in reads for m, c in enumerate(self.checks) if c.good(y)}
        for says in {Mode(False, mode.seen)} | good:
            yield None, says
            if response:
                yield Step(runs=True, ticks=1, mode=says), mode

    def control(
        self, here: Configuration, dm: Step | None, mode: Mode, reads: set[int], now: int
    ) -> Iterator[tuple[Step | None, tuple[Flying, ...], Hashable]]:
        """SC of this tick: itself, what of it is on its way to the plant, its locals."""
        _, _, late, response = self.times.sc
        sc, flying, local = here.sc, here.flying, here.local
        if sc is not None and sc.runs:
            if sc.ticks < response:
                yield sc._replace(ticks=sc.ticks + 1), flying, local
            flying = flying if mode.ac else published(flying, sc.command)
            sc = None
        sc = Step(blocked=dm is not None) if released(self.times.sc, now) else sc
        if sc is None:
            yield None, flying, local
            return
        blocked = sc.blocked and dm is not None
        if blocked or sc.ticks < late:
            yield sc._replace(ticks=sc.ticks + 1, blocked=blocked), flying, local
        if blocked:
            return
        for u, kept in (pair for y in reads for pair in self.answers(local, y, not mode.ac)):
            yield None, flying if mode.ac else published(flying, u), kept
            if response:
                yield Step(runs=True, ticks=1, command=u), flying, kept

    def answers(self, local: Hashable, y: int, control: bool) -> list[tuple[Command, Hashable]]:
        if self.step is not None:
            return self.step(local, y, control)
        return [(u, local) for u in self.checks[0].law(y) if u is not None]

    def act(self, acting: int | None, flying: Flying) -> Iterator[tuple[int | None, Flying]]:
        """Of what is on its way the first may act between L_min and L after it was published."""
        if flying and flying[0][1] >= self.times.least:
            yield from self.act(flying[0][0], flying[1:])
        if not flying or flying[0][1] < self.times.most:
            yield acting, tuple((v, n + 1) for v, n in flying)


def published(flying: tuple[Flying, ...], command: Command) -> tuple[Flying, ...]:
    return tuple((*f, (u, 0)) for f, u in zip(flying, command, strict=True))


def released(who: tuple[int, int, int, int], now: int) -> bool:
    period, phase, _, _ = who
    return now >= phase and (now - phase) % period == 0
