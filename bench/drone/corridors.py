"""The drone in corridors of boxes: violations, AC share, legs flown, and how well a_ref is flown.

Purpose: flights of ten minutes over routes of the roadmap, with the AC of the example, with SC
alone and with ACs that mean harm; `--hours` of each. For every 5 ms of one flight in ten: by how
much the acceleration misses what the shaping filter asks for, which the proof takes for
disturbance.
Non-goals: planners and batteries; the conformance of single steps (`conformance.py`).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.drone.conformance import DRONE, declared, needed  # noqa: E402 - needs the path

from soter.language.front_end import check_file, system_of  # noqa: E402 - the same
from soter.report.terminal_tables import table  # noqa: E402 - the same
from soter.simulate.run import NativeProgram  # noqa: E402 - the same

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
    """One run; `residual`: the least |d| in m/s^2 that explains every step of it."""

    hours: float
    violations: int
    ac_share: float
    switches: int
    legs: int
    residual: float


def fly(task: tuple[str, str, int]) -> Flight:
    """One seed: (file, system, seed)."""
    file, name, seed = task
    checked = check_file(str(DRONE / file))
    program = NativeProgram(system_of(checked, name))
    assert checked.program is not None
    prefix = "" if file == "corridor.soter" else "drone."
    known = {n.removeprefix(prefix): c.value for n, c in checked.program.consts.items()}
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
        float(needed(run, known)[0].max()) if measured else 0.0,
    )


def main() -> int:
    """Fly, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=10.0, help="of each arm")
    arguments = parser.parse_args()
    bound = declared("corridor.soter")
    whole_s = FLIGHT_NS / 1e9 * (0.9 + 0.1 / SHORTER)  # of a flight, on average
    count = max(1, math.ceil(arguments.hours * 3600.0 / whole_s))
    rows, bad, shares = [], 0, {}
    began = time.perf_counter()
    with multiprocessing.Pool(os.cpu_count()) as pool:
        for file, name in ARMS:
            tasks = [(file, name, FIRST_SEED + k) for k in range(count)]
            flights = list(pool.imap_unordered(fly, tasks, chunksize=4))
            violations = sum(f.violations for f in flights)
            residual = max(f.residual for f in flights)
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
                    f"{residual / bound:.0%}",
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
