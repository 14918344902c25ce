"""The drone in corridors of boxes: violations, AC share, legs flown, and how well a_ref is flown.

Purpose: flights of ten minutes over routes of the roadmap, with the AC of the example, with SC
alone and with ACs that mean harm; `--hours` of each. For every 5 ms of one flight in ten: by how
much the acceleration misses what the shaping filter asks for, which the proof takes for
disturbance.
Non-goals: planners and batteries; the conformance of single steps (`drone_conformance.py`).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from soter.program.build import check_file, system_of
from soter.report.summary import table
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from soter.simulate.result import Run

DRONE = Path(__file__).resolve().parent.parent / "examples" / "drone"
ARMS = (
    ("corridor.soter", "Protected"),
    ("corridor.soter", "SafeOnly"),
    ("corridor_adversaries.soter", "Twitching"),
    ("corridor_adversaries.soter", "Jerking"),
    ("corridor_adversaries.soter", "Pushing"),
    ("corridor_adversaries.soter", "Ramming"),
    ("corridor_adversaries.soter", "Failing"),
)
FLIGHT_NS = 600 * 10**9
FIRST_SEED = 50_000
SHORTER = 10


@dataclass(frozen=True)
class Flight:
    """One run; `residual`: of every axis in m/s^2, the largest |a - a_ref|, wind included."""

    hours: float
    violations: int
    ac_share: float
    switches: int
    legs: int
    residual: tuple[float, float, float]


def fly(task: tuple[str, str, int]) -> Flight:
    """One seed: (file, system, seed)."""
    file, name, seed = task
    program = NativeProgram(system_of(check_file(str(DRONE / file)), name))
    measured = seed % 10 == 0
    run = program.run(FLIGHT_NS // SHORTER if measured else FLIGHT_NS, seed, keep_trace=measured)
    module = next(iter(run.modules.values()))
    topics = run.final["topics"]
    flown = next(n for n in topics.dtype.names if n.rsplit(".", 1)[-1] == "flown")
    return Flight(
        run.duration_s / 3600.0,
        run.violations,
        module.ac_share,
        module.switches_to_sc,
        int(topics[flown]["number"]),
        _residual(run) if measured else (0.0, 0.0, 0.0),
    )


def declared_disturbance() -> float:
    """D of the proof, wind and residual, in m/s^2."""
    program = check_file(str(DRONE / "corridor.soter")).program
    assert program is not None
    return float(program.consts["D"].value)


def _residual(run: Run) -> tuple[float, float, float]:
    """Differences of true velocities over a step, against the mean reference in it, by axis."""
    assert run.trace is not None
    step_s = np.diff(run.time_s())
    names = run.trace["topics"].dtype.names or ()
    name = next(n for n in names if n.endswith("reference"))
    found = []
    for axis in ("x", "y", "z"):
        flown = np.diff(run.trace["d"]["v"][axis]) / step_s
        a = run.trace["topics"][name]["a"][axis]
        found.append(float(np.abs(flown - 0.5 * (a[:-1] + a[1:])).max()))
    return found[0], found[1], found[2]


def main() -> int:
    """Fly, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=10.0, help="of each arm")
    arguments = parser.parse_args()
    declared = declared_disturbance()
    whole_s = FLIGHT_NS / 1e9 * (0.9 + 0.1 / SHORTER)  # of a flight, on average
    count = max(1, math.ceil(arguments.hours * 3600.0 / whole_s))
    rows, bad, shares = [], 0, {}
    began = time.perf_counter()
    with multiprocessing.Pool(os.cpu_count()) as pool:
        for file, name in ARMS:
            tasks = [(file, name, FIRST_SEED + k) for k in range(count)]
            flights = list(pool.imap_unordered(fly, tasks, chunksize=4))
            violations = sum(f.violations for f in flights)
            residual = max(max(f.residual) for f in flights)
            shares[name] = float(np.mean([f.ac_share for f in flights]))
            bad += violations
            rows.append(
                (
                    name,
                    count,
                    f"{sum(f.hours for f in flights):.2f}",
                    violations,
                    f"{shares[name]:.2%}",
                    sum(f.switches for f in flights),
                    sum(f.legs for f in flights),
                    f"{residual:.3f}",
                    f"{residual / declared:.0%}",
                )
            )
    heads = (
        "arm",
        "flights",
        "hours",
        "violations",
        "AC share",
        "takeovers",
        "legs",
        "|a - a_ref|",
        "of D",
    )
    print(table(heads, rows))
    print(
        f"violations: {bad} (target 0); AC share at 3 m/s: {shares['Protected']:.2%} (target 99 %)"
    )
    print(f"{time.perf_counter() - began:.0f} s; flights of 600 s, one in ten of 60 s and measured")
    return bad != 0 or shares["Protected"] < 0.99


if __name__ == "__main__":
    raise SystemExit(main())
