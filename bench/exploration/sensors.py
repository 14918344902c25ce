"""A lidar that is worse than the lemma assumes: how often that shows, and what happens before.

Purpose: frontier exploration of random worlds with each fault of `worlds.Lidar`; whether and when
the map is doubted, how many cells were called free by then that are not, who touched a wall.
Non-goals: what is no scan at all (`tests/correct/test_exploration_sensors.py`). Nothing here is a
proof: a fault that contradicts nothing is not seen, and one that is seen may be seen too late.

    python bench/exploration/sensors.py               100 worlds each
    python bench/exploration/sensors.py --worlds 10

*Doubted*: flights in which a scan contradicted the map; *after*: the median time from when the
fault began, s. *Wrong*: flights with a cell that is called free and meets a wall, in exact
arithmetic (after doubt none is freed). *Touched*: flights that touched a wall, *before* there was
doubt, *after*, and *without* any.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from bench.exploration.worlds import grid, loaded, wrong_cells

UNTIL = 120.0
SYSTEM, DOUBT = "Frontier", "e.mapper.doubt"
FAULTS: dict[str, dict[str, Any]] = {
    "as declared": {},
    "noise 2 x its bound": {"worlds.NOISE": 2.0},
    "noise 5 x": {"worlds.NOISE": 5.0},
    "noise 10 x": {"worlds.NOISE": 10.0},
    "noise 20 x": {"worlds.NOISE": 20.0},
    "noise 50 x": {"worlds.NOISE": 50.0},
    "1 % of firings lost": {"worlds.LOST": 0.01},
    "30 % of firings lost": {"worlds.LOST": 0.3},
    "the same, silence nothing": {"worlds.LOST": 0.3, "mapper.SILENCE": False},
    "mirrors": {"worlds.MIRRORS": True},
    "mirrors, silence nothing": {"worlds.MIRRORS": True, "mapper.SILENCE": False},
    "a jump of 0.3 m at 30 s": {"worlds.JUMP": 0.3},
    "a jump of 1 m at 30 s": {"worlds.JUMP": 1.0},
}
"""What is wrong, as parameters of exploration_adversaries.soter."""


@dataclass(frozen=True)
class Flight:
    """Times in s, infinity: never."""

    doubted: float
    touched: float
    wrong: int


def flight(fault: str, seed: int) -> Flight:
    """Fly one world."""
    run = loaded().simulate(
        SYSTEM, until=UNTIL, seed=seed, params=FAULTS[fault], trace=[DOUBT], sha256=False
    )
    times = run.time_s()[np.asarray(run.topic(DOUBT), dtype=bool)]
    walls = run.final["topics"]["e.worlds.walls"]
    known = np.array(run.final["e.Recorder"]["since"]).reshape(grid().count, -1) > 0.0
    touches = (v.time_s or 0.0 for v in run.violation_list if "Collides" in v.what)
    return Flight(
        doubted=float(times[0]) if len(times) else np.inf,
        touched=min(touches, default=np.inf),
        wrong=wrong_cells(known, walls["items"][: walls["len"]].tolist()),
    )


def row(fault: str, flights: list[Flight]) -> str:
    """A line of the table."""
    start = 30.0 if "worlds.JUMP" in FAULTS[fault] else 0.0
    doubts = sorted(f.doubted - start for f in flights if np.isfinite(f.doubted))
    touched = [f for f in flights if np.isfinite(f.touched)]
    never = sum(np.isinf(f.doubted) for f in touched)
    after = sum(f.doubted < f.touched for f in touched)
    figures = (
        str(len(flights)),
        str(len(doubts)),
        f"{np.median(doubts):.1f}" if doubts else "-",
        str(sum(f.wrong > 0 for f in flights)),
        str(max(f.wrong for f in flights)),
        str(len(touched) - never - after),
        str(after),
        str(never),
    )
    return f"{fault:<27}" + "".join(f"{t:>9}" for t in figures)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    above = ("", "", "", "wrong:", "cells", "touched:", "", "")
    names = ("flights", "doubted", "after s", "flights", "most", "before", "after", "without")
    for words in (above, names):
        print(f"{'':<27}" + "".join(f"{w:>9}" for w in words))
    for fault in FAULTS:
        with ProcessPoolExecutor(asked.workers) as pool:
            flights = list(
                pool.map(flight, repeat(fault, asked.worlds), range(1, asked.worlds + 1))
            )
        print(row(fault, flights), flush=True)


if __name__ == "__main__":
    main()
