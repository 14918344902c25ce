"""Thirteen ways in which a naive version of "Decisions by tubes" (docs/proof-flight.md) is wrong.

Purpose: `VARIANTS`, a function each. It gives what happens in the naive version, and by the
conditions of the page: SAFE or VIOLATED (all executions were gone through, or the one schedule that
matters was played), or REFUSED: a condition does not hold, or no estimate of C is good.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any, TypeAlias

from unit.verify.tubes.executions import Executions, Mode
from unit.verify.tubes.fallback_runs import Check, Command, Law, Times

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable

SAFE, VIOLATED, REFUSED = "safe", "violated", "refused"
Found = tuple[str, str]
OfOne: TypeAlias = "Callable[[int], tuple[int | None, ...]]"
"""The law of an SC with one command of one component."""


def check(
    times: Times,
    law: OfOne,
    safe: Iterable[int],
    rest: Iterable[int],
    commands: tuple[int, ...],
    holds: int = 9,
    **more: Any,
) -> Check:
    """One with the times of the page; no wind and no errors where nothing is said."""
    given = {"wind": (0,), "errors": (0,), **times.derived(), **more}
    us = tuple((u,) for u in commands)
    return Check(one(law), frozenset(safe), frozenset(rest), us, holds=holds, **given)


def one(law: OfOne) -> Law:
    return lambda y: tuple(None if u is None else (u,) for u in law(y))


def flown(times: Times, c: Check, starts: set[int], **more: Any) -> str:
    """Every execution in which the DM goes by that check, from starts that it calls good."""
    assert all(map(c.starts_well, starts))
    unsafe, modes = Executions(times, (c,), **more).violated(starts)
    assert unsafe or modes == {Mode(False), Mode(True)}  # else nothing was looked at
    return VIOLATED if unsafe else SAFE


def flies(c: Check) -> str:
    return SAFE if any(map(c.good, c.safe)) else REFUSED


def sign(x: int) -> int:
    return (x > 0) - (x < 0)


def fault_in_the_background() -> Found:
    """SC's step faults on 2, which no run from a takeover reads; SC steps while AC flies, too."""
    times, cells = Times((4, 0, 0, 0), (1, 0, 0, 0)), range(26)

    def law(y: int) -> tuple[int | None, ...]:
        return (None,) if y == 2 else right(y)

    def right(y: int) -> tuple[int, ...]:
        return (1,) if y in {1, 19} else (0,)

    def step(latched: Hashable, y: int, _control: bool) -> list[tuple[Command, Hashable]]:
        return [((0,), True) if latched or law(y) == (None,) else (right(y), False)]

    def plant(x: int, u: int, _w: int) -> int:
        return min(25, x + 1 + u)  # a cart that only goes on; it has to jump over 20

    c = check(times, law, {*cells} - {20}, range(21, 26), (0, 1), 30, plant=plant)
    assert flown(times, replace(c, law=one(right)), {0}) == SAFE
    asked = REFUSED if any(None in law(y) for y in cells) else SAFE
    return flown(times, c, {0}, step=step, local=False), asked


def takeover_block_that_does_not_run() -> Found:
    """SC latched a side at a takeover, and no step of it was out while AC flew to the other one."""
    times = Times((5, 0, 0, 0), (5, 4, 2, 0))

    def goes(y: int, right: object) -> int:
        return sign(15 - y) if right and y >= 0 else -1 if right else sign(-15 - y)

    def step(local: Any, y: int, control: bool) -> list[tuple[Command, Hashable]]:
        right, had_control = local
        right = y >= 0 if control and not had_control else right
        return [((goes(y, right),), (right, control))]

    rest = {*range(-20, -9), *range(10, 21)}
    latched = check(times, lambda y: (goes(y, y >= 0),), range(-30, 31), rest, (-1, 0, 1))
    any_local = replace(latched, law=one(lambda y: (goes(y, False), goes(y, True))))
    return flown(times, latched, {1}, step=step, local=(True, False)), flies(any_local)


def back(y: int) -> tuple[int, ...]:
    """An SC that drives back to 3 and stands there."""
    return (-1,) if y >= 4 else (0,)


def expected(acted: tuple[int, ...], law: OfOne = back, most: int = 1) -> Found:
    """A check that expects 0 to act says good of 4, `acted` acts; a check that expects all of U."""
    times, safe, commands = Times((5, 0, 0, 0), (1, 0, 0, 0)), range(1, 9), (-most, 0, most)
    c = check(times, law, safe, {y for y in safe if law(y) == (0,)}, (0,))
    assert {*acted} <= {*commands}
    assert c.good(4)
    out = set(accumulate(acted, initial=4)) - c.safe
    return VIOLATED if out else SAFE, flies(replace(c, commands=tuple((u,) for u in commands)))


def held_after_a_return() -> Found:
    """The gate dropped AC's 0, and AC falls silent after the return: SC's -1 is held."""
    return expected((-1,) * 5)


def command_after_the_look() -> Found:
    """The DM judges the 0 that is held; AC publishes 1 after it, in the same instant."""
    return expected((1,) * 5)


def output_before_the_verdict() -> Found:
    """SC's step of before publishes -1 after the look and before its verdict "AC": held then."""
    return expected((0, *(-1,) * 4))


def one_component_first() -> Found:
    """Two components, x' = u1 + u2: AC (1, -1), SC (-1, 1); for a while (-1, -1) acts."""
    return expected((0,) * 5 + (-2,) * 2, lambda _: (0,), most=2)


def late_command() -> Found:
    """AC takes eleven ticks: its 1 was judged long ago, the looks since saw the 0 that is held."""
    return expected((0,) + (1,) * 5)


def rest_entered_from_outside() -> Found:
    """Rest was proved for pasts in its own region; SC comes there faster than that."""
    times, region = Times((2, 0, 0, 0), (2, 0, 0, 0), age_sc=2), frozenset(range(-4, 5))

    def law(y: int) -> tuple[int, ...]:
        return (1,) if y < 0 else (0,) if y <= 4 else (-4,)

    c = check(times, law, range(-8, 12), (), (-4, 0, 1))
    within = replace(c, safe=region)
    found = []
    for rest in (
        {x for x in region if within.keeps(x, past_in=region)},
        {x for x in region if c.keeps(x)},
    ):
        asked = replace(c, rest=frozenset(rest))
        found.append(flown(times, asked, {x for x in c.safe if asked.starts_well(x)}))
    return found[0], found[1]


def start_by_the_state_alone() -> Found:
    """SC keeps the start, from its first read on; until tick 4 it goes by a default."""
    times, first = Times((4, 0, 0, 0), (4, 0, 0, 0)), 4
    c = check(times, lambda y: (1,) if y < 3 else (0,), range(16), range(3, 16), (0, 1))
    now, later = ({x for x in c.safe if c.starts_well(x, late)} for late in (0, first))
    return flown(times, c, now, first=first), flown(times, c, later, first=first)


def latched_after_the_look() -> Found:
    """SC latches a target, 0 or 9, at takeover; the DM saw another one."""
    times = Times((4, 0, 0, 0), (4, 0, 0, 0))

    def step(local: Any, y: int, control: bool) -> list[tuple[Command, Hashable]]:
        target, had_control = local
        targets = (0, 9) if control and not had_control else (target,)
        return [((sign(t - y),), (t, control)) for t in targets]

    seen = check(times, lambda y: (sign(-y),), range(-6, 9), {0}, (-1, 0, 1), 4)
    every = replace(seen, law=one(lambda y: (sign(-y), sign(9 - y))))
    return flown(times, seen, {0}, step=step, local=(0, False)), flies(every)


def clock_of_the_map() -> Found:
    """A wall comes nearer; it was scanned two ticks before the state that the tube begins at."""

    def free(x: int, tick: int) -> bool:
        return x < max(2, 9 - tick)

    run = [*accumulate((0,) * 4 + (-1,) * 3, initial=4)]  # any command, then SC brakes back
    assert all(free(x, tick) for tick, x in enumerate(run))
    ends = SAFE if all(free(x, tick + 2) for tick, x in enumerate(run)) else VIOLATED
    for_ever = {x for x in range(9) if all(free(x, t) for t in range(9))}
    return ends, SAFE if {x for x in range(9) if free(x, 0)} <= for_ever else REFUSED


def fail_safe_law() -> Found:
    """Wind 1 and SC's -2 keep the plant; the trusted part dies, and the law, 0, does not."""
    times = Times((4, 0, 0, 0), (1, 0, 0, 0))

    def law(y: int) -> tuple[int, ...]:
        return (-2,) if y > 3 else (0,)

    c = check(times, law, range(-12, 13), range(3, 5), (-2, 0), wind=(1,))
    assert c.good(3)
    assert all(map(c.keeps, c.rest))
    assert flown(times, c, {3}) == SAFE
    run = {*accumulate((1, -1) * 3 + (1,) * 12, initial=3)}
    as_sc = replace(c, law=one(lambda _: (0,)))
    asked = SAFE if any(map(as_sc.keeps, c.rest)) else REFUSED
    return SAFE if run <= c.safe else VIOLATED, asked


def read_of_before_the_estimate() -> Found:
    """SC reads a topic that the DM does not read: four ticks old, of before the estimate."""
    times, parked = Times((2, 0, 0, 0), (2, 0, 0, 0), age_sc=4), 23

    def plant(x: int, u: int, _w: int) -> int:
        return x if x == parked else x + u  # who comes there stays, who passes it is lost

    def law(y: int) -> tuple[int, ...]:
        return (3,) if y == 8 else (1,)

    c = check(times, law, range(parked + 1), {parked}, (0, 1, 3, 7), parked, plant=plant)
    return flown(times, c, {1}, own=True), flown(times, c, {1})


VARIANTS: dict[str, Callable[[], Found]] = {
    f.__name__: f
    for f in (
        fault_in_the_background,
        takeover_block_that_does_not_run,
        held_after_a_return,
        command_after_the_look,
        output_before_the_verdict,
        one_component_first,
        rest_entered_from_outside,
        start_by_the_state_alone,
        latched_after_the_look,
        clock_of_the_map,
        fail_safe_law,
        late_command,
        read_of_before_the_estimate,
    )
}
