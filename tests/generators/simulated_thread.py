"""A thread that works in order, simulated tick by tick by somebody who knows the model only.

Purpose: `Job`, one execution of a thread of them (`executed`, `simulate`, `spans`), random sets.
Non-goals: analysis; nothing here is shared with `soter.timing`.

The model (docs/timing.md): at every tick the thread looks whether it is at work. If not, it takes
the first of the steps that were released and have not begun, by release and then by place, and
begins it as soon as its release has come, which a delay of its own may hold up. Then it works it
off, a tick at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterator


@dataclass(frozen=True)
class Job:
    """Periodic work: `cost` ticks at most, its release up to `hold` ticks late, done by `due`."""

    every: int
    offset: int
    cost: int
    hold: int
    due: int


Missed = tuple[int, int, int]
"""Job, the number of its release, the tick at which it ended."""


def simulate(
    jobs: list[Job],
    ticks: int,
    held: Callable[[int, int], int],
    lasts: Callable[[int, int], int],
) -> list[Missed]:
    """Every step that ends after it was due, in `ticks` ticks.

    `held(job, n)`, `lasts(job, n)`: how late release n of a job is, and how long its step takes, in
    ticks, within what the job allows; asked once each. Steps that have not ended at the last tick
    count where they were due before it.
    """
    missed = []
    for k, n, released, _, end in executed(jobs, ticks, held, lasts):
        if (ticks if end is None else end) > released + jobs[k].due:
            missed.append((k, n, ticks if end is None else end))
    return missed


def at_worst(jobs: list[Job], ticks: int) -> list[Missed]:
    """`simulate` with every release as late and every step as long as it may be."""
    return simulate(jobs, ticks, lambda k, _: jobs[k].hold, lambda k, _: jobs[k].cost)


def spans(
    jobs: list[Job],
    ticks: int,
    held: Callable[[int, int], int],
    lasts: Callable[[int, int], int],
) -> list[tuple[int, int]]:
    """Of each job the latest start and end after a release, of steps that end in `ticks` ticks."""
    bounds = [(0, 0) for _ in jobs]
    for k, _, released, start, end in executed(jobs, ticks, held, lasts):
        if start is not None and end is not None:
            bounds[k] = max(bounds[k][0], start - released), max(bounds[k][1], end - released)
    return bounds


def executed(
    jobs: list[Job],
    ticks: int,
    held: Callable[[int, int], int],
    lasts: Callable[[int, int], int],
) -> Iterator[tuple[int, int, int, int | None, int | None]]:
    """Job, number, tick of the release, of the start and of the end of every step."""
    waiting: list[tuple[int, int, int]] = []  # tick of the release, job, number
    working: tuple[int, int, int, int] | None = None
    rest = 0
    holds: dict[tuple[int, int], int] = {}
    for now in range(ticks):
        for k, job in enumerate(jobs):
            if now >= job.offset and (now - job.offset) % job.every == 0:
                waiting.append((now, k, (now - job.offset) // job.every))
        if working is not None:
            rest -= 1
            if rest == 0:
                released, k, n, start = working
                yield k, n, released, start, now
                working = None
        while working is None and waiting:
            released, k, n = waiting[0]
            if (k, n) not in holds:
                holds[k, n] = held(k, n)
                assert 0 <= holds[k, n] <= jobs[k].hold
            if now < released + holds[k, n]:
                break
            waiting.pop(0)
            del holds[k, n]
            rest = lasts(k, n)
            assert 0 <= rest <= jobs[k].cost
            if rest:
                working = (released, k, n, now)
            else:
                yield k, n, released, now, now
    if working is not None:
        released, k, n, start = working
        yield k, n, released, start, None
    for released, k, n in waiting:
        yield k, n, released, None, None


def turn(jobs: list[Job]) -> int:
    """The ticks after which all releases come again as they did."""
    return lcm(*(j.every for j in jobs))


BASES = (12, 16, 20, 24, 30, 36)
RATIOS = ((1, 1), (1, 1), (3, 2), (2, 1), (2, 1), (3, 1), (4, 1))


def drawn(rng: random.Random, use: float) -> list[Job]:
    """A set of two to eight jobs that keep the thread busy for about this share of the time."""
    count, base = rng.randint(2, 8), rng.choice(BASES)
    left, shares = use, []
    for k in range(count - 1, 0, -1):  # even over all ways to divide it
        rest = left * rng.random() ** (1 / k)
        shares.append(left - rest)
        left = rest
    jobs = []
    for share in (*shares, left):
        over, under = rng.choice(RATIOS)
        every = base * over // under
        offset = rng.randrange(every) if rng.random() < 0.5 else 0
        hold = rng.randint(0, every // 10) if rng.random() < 0.3 else 0
        due = every if rng.random() < 0.9 else rng.randint(every * 3 // 4, every)
        jobs.append(Job(every, offset, round(share * every), hold, due))
    return jobs


def busy(jobs: list[Job]) -> float:
    """The share of the time that the thread is busy where every step is as long as it may be."""
    return sum(j.cost / j.every for j in jobs)
