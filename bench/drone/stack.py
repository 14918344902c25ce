"""The surveillance drone as one program, flown among those who mean it no good.

    .venv/bin/python bench/drone/stack.py [--missions 10000] [--rrt-hours 0.5]

Purpose: missions that end in a landing, from whatever place and charge, with missions that never
charge, planners that lie, ACs that ram, wind at its bounds: how many ran empty, how many were not
in a dock in time, the charge at touch-down; violations and the share of AC by module. The planners
of these arms are Soter, so flights are compiled; two shorter arms have RRT* itself.
Non-goals: the motion primitive alone (`laps.py`), plans alone (`plans.py`).
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import statistics
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter import load
from soter.language.front_end import check_file, system_of
from soter.report.tables import table
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from soter.simulate.result import Run

FILE = Path(__file__).resolve().parents[2] / "examples/drone/surveillance_adversaries.soter"
ARMS = ("Careless", "Lying", "Twitching", "Ramming", "Failing")
RRT_ARMS = ("Surveyed", "Buggy")
MODULES = ("SafeBattery", "SafePlanner", "SafeMotionPrimitive")
FLIGHT_S = 1800
FIRST_SEED = 70_000


@dataclass(frozen=True)
class Flight:
    """One run. `charges`: at touch-downs, how often which, in hundredths."""

    hours: float
    broken: tuple[str, ...]
    landings: int
    forced: int
    late: int
    charges: dict[int, int]
    least: float
    left: float
    shares: tuple[float, ...]
    plans: int
    refused: int


@functools.cache
def _compiled(name: str) -> NativeProgram:
    return NativeProgram(system_of(check_file(str(FILE)), name))


def fly(task: tuple[str, int]) -> Flight:
    """One seed: (system, seed)."""
    name, seed = task
    return flight(_compiled(name).run(FLIGHT_S * 10**9, seed, keep_trace=False))


def fly_rrt(task: tuple[str, int]) -> Flight:
    """The same with RRT* in Python."""
    name, seed = task
    return flight(load(FILE).simulate(name, until=FLIGHT_S, seed=seed, trace=False))


def flight(run: Run) -> Flight:
    """What the logbook and the counters say."""
    topics = run.final["topics"]
    named = {n.rsplit(".", 1)[-1]: topics[n] for n in topics.dtype.names}
    book, force = named["landings"], named["inForce"]
    return Flight(
        run.duration_s / 3600.0,
        tuple(v.what for v in run.violation_list for _ in range(v.count)),
        int(book["number"]),
        int(book["forced"]),
        int(book["late"]),
        {k: int(n) for k, n in enumerate(book["charges"]) if n},
        float(book["least"]),
        float(book["left"]),
        tuple(run.modules[m].ac_share for m in MODULES),
        int(force["adopted"]),
        int(force["refused"]),
    )


def median(flights: list[Flight]) -> float:
    """Of the charge at touch-down, to a hundredth."""
    counts = sum((Counter(f.charges) for f in flights), Counter[int]())
    every = list(counts.elements())
    return (statistics.median_low(every) + 0.5) / 100.0 if every else float("nan")


def row(name: str, flights: list[Flight]) -> list[str]:
    """A line of the table."""
    landings = sum(f.landings for f in flights)
    shares = [sum(f.shares[k] for f in flights) / len(flights) for k in range(len(MODULES))]
    empty = sum("charge" in what for f in flights for what in f.broken)
    return [
        name,
        f"{sum(f.hours for f in flights):.1f}",
        f"{landings}",
        f"{sum(f.forced for f in flights)}",
        f"{empty}",
        f"{sum(f.late > 0 for f in flights)}",
        f"{min((f.least for f in flights if f.landings), default=float('nan')):.3f}",
        f"{median(flights):.2f}",
        f"{min(f.left for f in flights):.1f}",
        f"{sum(f.plans for f in flights)}",
        f"{sum(f.refused for f in flights)}",
        f"{sum(len(f.broken) for f in flights)}",
        *(f"{share:.1%}" for share in shares),
    ]


HEADS = (
    "arm",
    "hours",
    "landings",
    "by DM",
    "empty",
    "not in a dock",
    "least charge",
    "median",
    "s left",
    "plans",
    "refused",
    "violations",
    "AC battery",
    "planner",
    "motion",
)


def campaign(missions: int) -> dict[str, list[Flight]]:
    """Flights, arm by arm in turn, until there were so many missions."""
    flights_by_arm: dict[str, list[Flight]] = {name: [] for name in ARMS}
    batch = os.cpu_count() or 1
    with multiprocessing.Pool() as pool:
        while sum(f.landings for flights in flights_by_arm.values() for f in flights) < missions:
            first = FIRST_SEED + len(flights_by_arm[ARMS[0]])
            tasks = [(name, first + k) for name in ARMS for k in range(batch)]
            for (name, _), one in zip(tasks, pool.map(fly, tasks, chunksize=1), strict=True):
                flights_by_arm[name].append(one)
    return flights_by_arm


def main() -> int:
    """Fly, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=800, help="that end in a landing, in all")
    parser.add_argument("--rrt-hours", type=float, default=0.5, help="of each arm with RRT*")
    arguments = parser.parse_args()
    began = time.perf_counter()
    flown = campaign(arguments.missions)
    seeds = range(max(1, round(arguments.rrt_hours * 3600.0 / FLIGHT_S)))
    with multiprocessing.Pool(os.cpu_count()) as pool:
        for name in RRT_ARMS:
            flown[name] = pool.map(fly_rrt, [(name, FIRST_SEED + k) for k in seeds])
    print(table(HEADS, [row(name, flights) for name, flights in flown.items()]))
    every = [f for flights in flown.values() for f in flights]
    landings, late = sum(f.landings for f in every), sum(f.late > 0 for f in every)
    broken = Counter(what for f in every for what in f.broken)
    print(
        f"{landings} missions were flown to a landing of the {arguments.missions} asked for, "
        f"{sum(f.hours for f in every):.1f} h in all (targets: 10,000 missions, 100 h)"
    )
    print(f"flights with a landing that was not in a dock in time: {late} (target 0)")
    print(f"violations: {broken.total()} (target 0)")
    for what, count in broken.most_common():
        print(f"  {count} x {what}")
    print(f"{time.perf_counter() - began:.0f} s; flights of {FLIGHT_S} s")
    return broken.total() != 0 or late != 0


if __name__ == "__main__":
    raise SystemExit(main())
