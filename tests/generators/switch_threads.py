"""Random threads with a module in them, and what a switch takes in all executions of each.

Purpose: `Case`, `drawn`, the `program` of a case, and `longest`: from the state behind the last
"AC" to the effect of SC's first output, the greatest over all executions on the grid of ticks.
Non-goals: any formula; nothing here is shared with `soter.timing` or `soter.verify`.

An execution gives every step a delay of its release in 0 .. hold and a length in 0 .. cost. The
thread works in order. The DM reads, when it starts, a value that the sensor published at some
release of its own, no older then than `age` (it may have been silent since). It says "AC", and not
at its next step. What SC publishes is dropped until that verdict; the first step of SC behind it in
the thread counts, and acts up to `acts` after its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator

TICK = "100us"
TICK_NS = 100_000


@dataclass(frozen=True)
class Step:
    """Somebody in the thread, in its order: times in ticks."""

    name: str
    every: int
    offset: int
    cost: int
    hold: int


@dataclass(frozen=True)
class Case:
    """A thread: the DM first, SC second, others behind; the sensor, and what is behind SC."""

    thread: tuple[Step, ...]
    sensor: int
    age: int
    acts: int

    @property
    def turn(self) -> int:
        """Ticks after which everything comes again."""
        return lcm(*(s.every for s in self.thread), self.sensor)


FAMILIES = ((10, 20, 40), (10, 15, 30), (12, 24, 48), (10, 20, 50), (8, 16, 24, 48))


def drawn(rng: random.Random) -> Case:
    """A case in which the sensor, the module and up to four other nodes have small periods."""
    family = rng.choice(FAMILIES)
    sc = rng.choice(family[:-1])
    dm = rng.choice([p for p in family if p >= sc])
    sensor = rng.choice((1, 2, 5, *family[:1]))
    thread = [Step("M", dm, 0, rng.randint(1, 3), rng.choice((0, 0, 1, 2)))]
    thread.append(_step(rng, "Slow", sc, 3))
    for k in range(rng.randint(0, 4)):
        every = rng.choice(family)
        thread.append(_step(rng, f"Other{k}", every, max(1, every // rng.choice((3, 6, 10)))))
    age = sensor * rng.randint(1, 4) + rng.choice((0, 0, 0, 1, 3)) + sc
    return Case(tuple(thread), sensor, age, rng.choice((0, 0, 1, 5)))


def _step(rng: random.Random, name: str, every: int, most: int) -> Step:
    offset = rng.choice((0, 0, rng.randrange(every)))
    return Step(name, every, offset, rng.randint(1, most), rng.choice((0, 0, 1, 2, 3)))


def program(case: Case) -> str:
    """The case as a program whose module is proved of the plant beside it.

    AC is an extern, in a process of its own: the thread is the case's, and nothing else.
    """
    dm, sc, *others = case.thread
    nodes = [f"extern node Fast period {_time(sc.every)} {{ subscribes x; publishes u; }}"]
    nodes.append(_node("Slow", sc.every, sc.offset, _budget(sc), "x", "u", "-clamp(x, -1.0, 1.0)"))
    for s in others:
        nodes.append(f"topic {s.name}_out: float;")
        nodes.append(_node(s.name, s.every, s.offset, _budget(s), "x", f"{s.name}_out", "x"))
    return "\n".join(
        [
            "soter 1;",
            f"topic x: float max_age {_time(case.age)};",
            "topic u: float in [-1.0, 1.0];",
            f"plant P period {_time(case.sensor)} {{",
            "  reads u; drives x = p; state p: float; der p = u; }",
            *nodes,
            f"rta M {{ ac Fast; sc Slow; period {_time(dm.every)}; {_budget(dm)}",
            "  safe abs(x) < 1.0; ttf abs(x) > 0.5; safer abs(x) < 0.4;",
            f"  verify {{ grid x in [-1.0, 1.0] / 10; acts within {_time(case.acts)}; }}"
            if case.acts
            else "  verify { grid x in [-1.0, 1.0] / 10; }",
            "}",
            f"system S {{ p: P; module M; {' '.join(f'node {s.name};' for s in others)} }}",
        ]
    )


def _time(ticks: int) -> str:
    return f"{ticks * TICK_NS // 1000}us"


def _budget(s: Step) -> str:
    jitter = f" jitter {_time(s.hold)};" if s.hold else ""
    return f"wcet {_time(s.cost)};{jitter}"


def _node(
    name: str, every: int, offset: int, budget: str, reads: str, writes: str, value: str
) -> str:
    phase = f" phase {_time(offset)}" if offset else ""
    head = f"node {name} period {_time(every)}{phase}"
    return (
        f"{head} {{ subscribes {reads}; publishes {writes}; {budget} "
        f"step {{ publish {writes} = {value}; }} }}"
    )


def calendar(case: Case, ticks: int) -> list[tuple[int, int]]:
    """Every release before a tick, with the place of who it is of, in the order of the thread."""
    releases = [
        (at, k) for k, s in enumerate(case.thread) for at in range(s.offset, ticks, s.every)
    ]
    return sorted(releases)


def starts(step: Step, release: int, ends: set[int]) -> set[int]:
    """When a step may start, after those before it ended at one of these."""
    return {max(e, release + h) for e in ends for h in range(step.hold + 1)}


def ends_of(step: Step, begun: set[int]) -> set[int]:
    """When it may end."""
    return {s + c for s in begun for c in range(step.cost + 1)}


def longest(case: Case) -> int | None:
    """The greatest time that a switch takes, in ticks; None where the calendar cannot be kept."""
    begin = max(s.offset for s in case.thread)
    releases = calendar(case, begin + 4 * case.turn)
    last_dm = begin + 3 * case.turn - case.thread[0].every
    ends, worst = {0}, 0
    for k, (release, place) in enumerate(releases):
        step = case.thread[place]
        begun = starts(step, release, ends)
        if place == 0 and release <= last_dm:
            for start in begun:
                worst = max(worst, _switch(case, releases, k, start))
        ends = ends_of(step, begun)
        if max(ends) > release + step.every:
            return None
    return worst


def _switch(case: Case, releases: list[tuple[int, int]], k: int, start: int) -> int:
    """The same from one step of the DM, started at a tick, on."""
    shown = next(_shown(case, start))
    ends = ends_of(case.thread[0], {start})
    spoken = False
    for release, place in releases[k + 1 :]:
        step = case.thread[place]
        ends = ends_of(step, starts(step, release, ends))
        if spoken and place == 1:
            return max(ends) + case.acts - shown
        spoken = spoken or place == 0
    raise AssertionError("the calendar is too short")


def _shown(case: Case, start: int) -> Iterator[int]:
    """The instants that a read at a tick may show, the oldest first."""
    oldest = start - case.age
    at = -(-oldest // case.sensor) * case.sensor
    while at <= start:
        yield at
        at += case.sensor
