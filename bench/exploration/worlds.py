"""The drone in unknown worlds: collisions, wrong cells, what was explored, how long it was stuck.

Purpose: `examples/exploration/exploration_adversaries.soter` on random worlds, one a seed (pillars,
rooms, lanes, furnished rooms) with the frontier AC, hostile controllers, planners with bugs, a stop
zone without timing, and without a decision module; wind and errors drawn within their bounds.
Non-goals: what is proved (`soter verify`), the lemma (`tests/correct/test_exploration_mapper.py`).

    python bench/exploration/worlds.py                     as the table in docs/benchmarks.md
    python bench/exploration/worlds.py --worlds 20 --only frontier ramming

A cell is *wrong* if it is called free and a wall touches it, in exact arithmetic. *Explored*: of
the cells that can be reached, in which the middle of the vehicle can be, from home, with the
module's margins and STRIP, which no scan frees before a wall. *Without*: of those that could be,
if all that is free were known. *Stuck*: time without a new cell, beyond 10 s at a time, until all
that can be reached are known.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import soter
from generators.exploration_referee import Grid, met_cells, rectangle

if TYPE_CHECKING:
    from collections.abc import Iterator

FILE = Path(__file__).parents[2] / "examples" / "exploration" / "exploration_adversaries.soter"


@dataclass(frozen=True)
class Arm:
    """Who flies, in so many worlds of a thousand, for so long."""

    system: str
    worlds: int
    until: float
    params: dict[str, Any]


ARMS = {
    "frontier": Arm("Frontier", 1000, 300.0, {}),
    "ramming": Arm("Ramming", 1000, 100.0, {}),
    "jerking": Arm("Jerking", 100, 100.0, {}),
    "OMPL's RRTConnect": Arm("Sampled", 100, 300.0, {}),
    "learned": Arm("Learned", 100, 300.0, {}),
    "boxes into the unknown": Arm("Bugs", 100, 100.0, {"BUG": "IntoUnknown"}),
    "boxes anywhere": Arm("Bugs", 100, 100.0, {"BUG": "IgnoresMap"}),
    "boxes shifted": Arm("Bugs", 100, 100.0, {"BUG": "ShiftedMap"}),
    "boxes of an old map": Arm("Bugs", 100, 300.0, {"BUG": "StaleMap"}),
    "frontier, silence says nothing": Arm("Frontier", 50, 300.0, {"mapper.SILENCE": False}),
    "frontier, by SC alone": Arm("Careful", 50, 300.0, {}),
    "bare: frontier": Arm("BareFrontier", 50, 300.0, {}),
    "bare: learned": Arm("BareLearned", 100, 300.0, {}),
    "bare: ramming": Arm("BareRamming", 1000, 60.0, {}),
    "stop zone of 1 m: ramming": Arm("StopZone", 300, 60.0, {}),
    "stop zone of 3 m: ramming": Arm("StopZone", 300, 60.0, {"ZONE": 3.0}),
}
KINDS = ("pillars", "rooms", "lanes", "furnished")
PATIENCE = 10.0
"""s without a new cell that nobody calls stuck."""
MODULE = "e.SafeMotionPrimitive"
STRIP = 2
"""Cells before a wall that even a near scan does not free: 0.4 m (docs/exploration.md)."""
NEAR = 1e-3
"""m: cells that are farther from a wall are not looked at in exact arithmetic."""


@dataclass(frozen=True)
class Flight:
    """One world, one arm."""

    kind: int
    collided: bool
    left_box: bool
    wrong: int
    explored: float
    without: float
    ac_share: float
    takeovers: int
    stuck_s: float
    longest_s: float
    wall_s: float
    """Of one core."""


@cache
def loaded() -> soter.Program:
    """The program, once a process."""
    return soter.load(FILE)


@cache
def grid() -> Grid:
    """The cells of the map."""
    return Grid.of(loaded().constant)


def touched(walls: list[tuple[float, ...]], slack: float) -> np.ndarray:
    """Which cells a wall reaches into by more than `slack` m: by separating axes, (n, n) bools.

    Below zero: also those that it is so near to.
    """
    g = grid()
    half, middles = 0.5 * g.cell, g.cell * (np.arange(g.count) + 0.5)
    mx, my = (g.x0 + middles)[:, None], (g.y0 + middles)[None, :]
    all_of_them = np.zeros((g.count, g.count), bool)
    for x, y, long, wide, c, s in walls:
        dx, dy = mx - x, my - y
        reach = abs(c) * half + abs(s) * half
        along = np.abs(c * dx + s * dy) - long - reach
        across = np.abs(c * dy - s * dx) - wide - reach
        east = np.abs(dx) - abs(c) * long - abs(s) * wide - half
        north = np.abs(dy) - abs(s) * long - abs(c) * wide - half
        apart = np.maximum(np.maximum(along, across), np.maximum(east, north))
        all_of_them |= apart < -slack
    return all_of_them


def wrong_cells(known: np.ndarray, walls: list[tuple[float, ...]]) -> int:
    """How many known cells a wall meets, a touch included: exact, doubles as what they are."""
    near = {(int(i), int(j)) for i, j in np.argwhere(known & touched(walls, -NEAR))}
    if not near:
        return 0
    met = (met_cells(grid(), rectangle(*wall), near.__contains__) for wall in walls)
    return len(set().union(*met))


def reachable(solid: np.ndarray, strip: int) -> np.ndarray:
    """Cells in which the middle of the vehicle can be, from home, with margins and `strip`."""
    n, room = solid.shape[0], loaded().constant("frontier.ROOM") + strip
    sums = np.pad(solid.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    fits = np.zeros((n, n), bool)
    w = 2 * room + 1
    counts = sums[w:, w:] - sums[:-w, w:] - sums[w:, :-w] + sums[:-w, :-w]
    fits[room : n - room, room : n - room] = counts == 0
    met = np.zeros((n, n), bool)
    ahead = [(n // 2, n // 2)]
    met[ahead[0]] = True
    while ahead:
        i, j = ahead.pop()
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if fits[a, b] and not met[a, b]:
                met[a, b] = True
                ahead.append((a, b))
    return met


def standstill(since: np.ndarray, wanted: np.ndarray, until: float) -> tuple[float, float]:
    """Seconds stuck, and the longest time without a new cell, until all wanted ones are known."""
    known = since > 0.0
    done = since[wanted].max() - 1.0 if (known | ~wanted).all() else until
    times = np.unique(since[known]) - 1.0
    gaps = np.diff(np.append(times[times <= done], done))
    return float(np.maximum(gaps - PATIENCE, 0.0).sum()), float(gaps.max(initial=0.0))


def flight(name: str, seed: int) -> Flight:
    """Fly one world."""
    arm = ARMS[name]
    begun = time.process_time()
    run = loaded().simulate(
        arm.system, until=arm.until, seed=seed, params=arm.params, trace=[MODULE], sha256=False
    )
    n = grid().count
    walls = run.final["topics"]["e.worlds.walls"]
    solid = walls["items"][: walls["len"]].tolist()
    since = np.array(run.final["e.Recorder"]["since"]).reshape(n, n)
    wanted = reachable(touched(solid, 0.0), STRIP)
    without = reachable(touched(solid, 0.0), 0)
    known = since > 0.0
    mode = np.asarray(run.mode(MODULE)) == 1
    broken = {v.what for v in run.violation_list}
    stuck, longest = standstill(since, wanted, arm.until)
    return Flight(
        kind=int(run.final["e.world"]["chance"]) % len(KINDS),
        collided=any("Collides" in text for text in broken),
        left_box=any("Contains" in text for text in broken),
        wrong=wrong_cells(known, solid),
        explored=float((known & wanted).sum() / max(wanted.sum(), 1)),
        without=float((known & without).sum() / max(without.sum(), 1)),
        ac_share=float(mode.mean()),
        takeovers=int((np.diff(mode.astype(int)) == -1).sum()),
        stuck_s=stuck,
        longest_s=longest,
        wall_s=time.process_time() - begun,
    )


def flown(arm: str, worlds: int, workers: int) -> Iterator[Flight]:
    """All worlds of an arm, as they come."""
    with ProcessPoolExecutor(workers) as pool:
        seeds = range(1, worlds + 1)
        yield from pool.map(flight, [arm] * worlds, seeds, chunksize=4)


def row(name: str, flights: list[Flight], until: float) -> str:
    """A line of the table."""
    explored = [100.0 * f.explored for f in flights]
    stuck = [100.0 * f.stuck_s / until for f in flights]
    counts = [
        sum(v) for v in zip(*((f.collided, f.left_box, f.wrong) for f in flights), strict=True)
    ]
    figures = (
        *(str(c) for c in (len(flights), int(until), *counts)),
        f"{np.mean(explored):.1f}",
        f"{min(explored):.1f}",
        f"{100.0 * float(np.mean([f.without for f in flights])):.1f}",
        f"{100.0 * float(np.mean([f.ac_share for f in flights])):.1f}",
        f"{np.mean([f.takeovers for f in flights]):.1f}",
        f"{np.mean(stuck):.2f}",
        f"{max(f.longest_s for f in flights):.1f}",
        f"{len(flights) * until / sum(f.wall_s for f in flights):.0f}",
    )
    return f"{name:<31}" + "".join(f"{t:>{w}}" for t, w in zip(figures, WIDTHS, strict=True))


WIDTHS = (8, 6, 10, 7, 7, 10, 7, 9, 7, 10, 7, 8, 7)
HEAD = {
    "worlds": "",
    "s": "",
    "collided": "",
    "box": "left",
    "cells": "wrong",
    "mean": "explored",
    "least": "%",
    "without": "%",
    "%": "AC",
    "a flight": "takeovers",
    "% ": "stuck",
    "s ": "longest",
    "time": "x real",
}
"""What stands above a column, and what above that."""


def head() -> str:
    """Two lines above the table."""
    lines = (HEAD.values(), HEAD)
    return "\n".join(
        " " * 31 + "".join(f"{t.strip():>{w}}" for t, w in zip(line, WIDTHS, strict=True))
        for line in lines
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, default=1000, help="the others in proportion")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=ARMS, default=list(ARMS))
    asked = parser.parse_args()
    print(head())
    for arm in asked.only:
        until = ARMS[arm].until
        worlds = max(1, ARMS[arm].worlds * asked.worlds // 1000)
        flights = list(flown(arm, worlds, asked.workers))
        print(row(arm, flights, until), flush=True)
        if arm == "frontier":
            for k, kind in enumerate(KINDS):
                of_kind = [f for f in flights if f.kind == k]
                if of_kind:
                    print(row(f"  {kind}", of_kind, until), flush=True)


if __name__ == "__main__":
    main()
