"""Random systems of small whole times, and the model of time against every schedule of each.

Purpose: draw systems (periods with and without common divisors, phases, lateness, responses,
latencies, paths of 0 to 4 nodes to DM and to SC, several outputs, silence, enforced ages); compare
every quantity of `soter.verify.problem.schedule` with the largest value that a schedule reaches.
Non-goals: enumerating (`every_schedule.py`), how many (`bench/verify/time_model.py`, the tests).

A system is only drawn if its times are such as the language allows: late + response <= period, and
no step of SC still runs, waiting for a verdict included, when its next one is due.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field, replace
from math import lcm

from generators.every_schedule import QUANTITIES
from generators.every_schedule_of_module import EverySchedule
from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath

FAMILIES = (
    (2, 4, 8, 12),
    (3, 6, 9, 12),
    (4, 6, 12),
    (5, 10),
    (2, 5, 10),
    (3, 4, 6),
    (3, 5),
    (4, 7),
)
"""Periods that one system is made of: their common multiple is small."""
PERIODS_SC = (4, 6, 8, 9, 10, 12)
MOST = 120
"""The largest common multiple of all periods of a system."""

NEAR = 2
"""Slack that may be a matter of the grid alone."""


@dataclass
class Compared:
    """One quantity: what the model says, what a schedule reaches, and that schedule."""

    quantity: str
    says: int | None
    reached: int | None
    why: tuple[tuple[int, str], ...] = ()

    @property
    def slack(self) -> int | None:
        """How far the model is from the worst schedule; below 0 it is wrong. None: none at all."""
        if self.says is None or self.reached is None:
            return None
        return self.says - self.reached


@dataclass
class System:
    """A system, its number and what is odd about it."""

    number: int
    schedule: Schedule
    traits: set[str] = field(default_factory=set)


def system(number: int) -> System:
    """The system of that number: the same one for ever."""
    draw = random.Random(f"schedule {number}")  # noqa: S311 - systems, not secrets
    while True:
        drawn = _drawn(draw)
        if _allowed(drawn):
            return System(number, drawn, _traits(drawn))


def _allowed(s: Schedule) -> bool:
    """Small enough, and SC is done with a step before the next one is due."""
    if multiple(s) > MOST:
        return False
    every = EverySchedule(s)
    every.starts_of_sc()
    latest = every.worst["latest_start_of_sc"].value
    return latest is not None and latest + s.sc.response <= s.sc.period


def multiple(s: Schedule) -> int:
    """After so many units all phases are the same again."""
    paths = s.read_by_dm + s.read_by_sc
    nodes = [n.period for x in paths for n in x.nodes]
    nodes += [n.period for x in s.outputs for n in x.nodes]
    return lcm(s.dm.period, s.sc.period, *(p.sensor.period for p in paths), *nodes)


def _drawn(draw: random.Random) -> Schedule:
    family = draw.choice(FAMILIES)
    mix = draw.choice((1, 1, 2, 3, 5))
    sc = _releases(draw, tuple(p for p in PERIODS_SC if lcm(p, *family) <= MOST))
    dm_periods = [k * sc.period for k in (1, 1, 2, 3) if k * sc.period <= 24]
    dm_periods += [p for p in family if p > sc.period]
    dm = _releases(draw, tuple(dm_periods))
    in_use = tuple(dict.fromkeys(draw.choice(family) for _ in range(mix)))
    between = draw.choice(((0,), (0,), (0, 0, 1, 2)))
    lengths = draw.choice(((0,), (0, 1), (1, 2), (0, 1, 2, 3, 4)))
    return Schedule(
        dm=dm,
        sc=sc,
        read_by_dm=tuple(
            _path(draw, in_use, draw.choice(lengths), enforced=draw.random() < 0.3)
            for _ in range(draw.choice((1, 1, 1, 2)))
        ),
        read_by_sc=tuple(
            _path(draw, in_use, draw.choice(lengths), enforced=False)
            for _ in range(draw.choice((1, 1, 1, 2)))
        ),
        outputs=tuple(_output(draw, in_use, between) for _ in range(draw.choice((1, 1, 2, 3)))),
        dropout=draw.choice((0, 0, 0, draw.randrange(1, 13), draw.choice(in_use))),
    )


def _releases(draw: random.Random, periods: tuple[int, ...]) -> Releases:
    period = draw.choice(periods)
    late = draw.choice((0, 0, 1, draw.randrange(period // 2 + 1), draw.randrange(period + 1)))
    response = draw.choice((0, 0, 1, draw.randrange(period + 1)))
    late = min(late, 5)
    phase = draw.choice((0, 0, draw.randrange(period), draw.randrange(2 * period)))
    return Releases(period, phase, late, min(response, period - late, 4))


def _path(
    draw: random.Random, periods: tuple[int, ...], nodes: int, *, enforced: bool
) -> SensorPath:
    period = draw.choice(periods)
    sensor = Releases(period, draw.choice((0, draw.randrange(period), draw.randrange(2 * period))))
    path = tuple(_releases(draw, periods) for _ in range(nodes))
    return SensorPath(sensor, path, draw.randrange(1, 25) if enforced else None)


def _output(
    draw: random.Random, periods: tuple[int, ...], between: tuple[int, ...]
) -> ActuationPath:
    least = draw.choice((0, 0, 1, draw.randrange(4)))
    nodes = tuple(_releases(draw, periods) for _ in range(draw.choice(between)))
    return ActuationPath(least, least + draw.choice((0, 1, draw.randrange(4))), nodes)


def _traits(s: Schedule) -> set[str]:
    """Which kinds of systems it belongs to: a figure may be sharp for some of them only."""
    traits = set()
    if s.dropout:
        traits.add("silence")
    if any(p.max_age is not None for p in s.read_by_dm):
        traits.add("enforced age")
    if any(o.nodes for o in s.outputs):
        traits.add("output nodes")
    if any(n.period > s.sc.period for o in s.outputs for n in o.nodes):
        traits.add("slow output nodes")
    if max(len(p.nodes) for p in s.read_by_dm + s.read_by_sc) > 0:
        traits.add("path nodes")
    if len(s.read_by_dm) > 1 or len(s.read_by_sc) > 1:
        traits.add("several paths")
    return traits


def said(s: Schedule, quantity: str) -> int | None:
    """What the model of time says."""
    if quantity == "stamp_age_sc":
        return max(s.stamp_age_sc(p) for p in s.read_by_sc)
    if quantity in {"published_age", "available_from"}:
        paths = [replace(p, dropout=s.dropout) for p in s.read_by_dm + s.read_by_sc]
        age: int = max(getattr(p, quantity) for p in paths)
        return age
    value: int = getattr(s, quantity)
    return value


def compare(s: Schedule, told: dict[str, int | None] | None = None) -> list[Compared]:
    """Every quantity of a system against all its schedules."""
    every = EverySchedule(s)
    reached = every.enumerate()
    told = told if told is not None else {q: said(s, q) for q in QUANTITIES}
    return [Compared(q, told[q], reached[q], every.worst[q].why) for q in QUANTITIES]


def scaled(s: Schedule, by: int, over: int = 1) -> Schedule:
    """The same system on a grid that is finer by a whole factor, or coarser by another one."""

    def on(time: int) -> int:
        return time * by // over

    def node(x: Releases) -> Releases:
        return Releases(on(x.period), on(x.phase), on(x.late), on(x.response))

    def path(x: SensorPath) -> SensorPath:
        age = None if x.max_age is None else on(x.max_age)
        return SensorPath(node(x.sensor), tuple(map(node, x.nodes)), age)

    def output(x: ActuationPath) -> ActuationPath:
        return ActuationPath(on(x.least), on(x.most), tuple(map(node, x.nodes)))

    return Schedule(
        dm=node(s.dm),
        sc=node(s.sc),
        read_by_dm=tuple(map(path, s.read_by_dm)),
        read_by_sc=tuple(map(path, s.read_by_sc)),
        outputs=tuple(map(output, s.outputs)),
        dropout=on(s.dropout),
    )


def in_the_limit(s: Schedule, comparisons: list[Compared]) -> set[str]:
    """The quantities that are reached but for one step of the grid, however fine the grid is.

    "Just before the next publication" is one unit before it on the grid; where twice as fine a
    grid leaves as many units (half as much time), no smaller figure would be sound.
    """
    near = {c.quantity for c in comparisons if c.slack is not None and 0 < c.slack <= NEAR}
    if not near:
        return set()
    slack = {c.quantity: c.slack for c in comparisons}
    finer = compare(scaled(s, 2))
    return {c.quantity for c in finer if c.quantity in near and c.slack == slack[c.quantity]}
