"""The drone's laps: violations, AC share, lap times and speed of the three arms.

Purpose: the first three rows and the speed row of issue 2's "Must reach", from one command:
`python bench/drone/laps.py` flies 1,000 laps of each arm with wind and measurement errors
drawn within their declared bounds; `--adversaries` flies hostile ACs under the module instead.
Non-goals: pictures (`make demo`).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from soter.campaign.batch_flights import Fleet
from soter.language.front_end import check_file, system_of
from soter.report.tables import table
from soter.simulate.run import NativeProgram
from soter.verify.deploy.missing_predicates import complete

ROOT = Path(__file__).resolve().parents[2]
DRONE = ROOT / "examples" / "drone"
ARMS = ("AdvancedOnly", "Protected", "SafeOnly")
HOSTILE = ("Twitching", "Jerking", "Pushing", "Ramming", "Failing")
FIRST_SEED = 10_000
SPEED_RUNS = 200
FAST, REPEATS = 25_000, 5


@dataclass(frozen=True)
class Lap:
    """One run. `lap_s` None: g4 was not reached. `first_s`: of the first violation, if any."""

    seed: int
    lap_s: float | None
    ac_share: float
    switches: int
    gate_faults: int
    violations: int
    cpu_s: float
    flown_s: float


def fly(task: tuple[str, str, range, bool]) -> list[Lap]:
    """Every seed of one chunk.

    `task`: (file, system, seeds, whether AC share is that of the whole run).
    """
    file, name, seeds, whole = task
    system = system_of(check_file(str(DRONE / file)), name)
    complete(system)
    program = NativeProgram(system)
    lap_topic = next(t.name for t in system.topics if t.name.rsplit(".", 1)[-1] == "lap")
    assert system.until_ns is not None
    laps = []
    for seed in seeds:
        began = time.process_time()
        run = program.run(system.until_ns, seed)
        cpu_s = time.process_time() - began
        module = next(iter(run.modules.values()))
        lap = run.final["topics"][lap_topic]
        finished, lap_s = bool(lap["finished"]), float(lap["lap_s"])
        share = module.ac_share if whole else float(lap["ac_s"]) / lap_s
        laps.append(
            Lap(
                seed,
                lap_s if finished else None,
                share,
                module.switches_to_sc,
                module.gate_faults,
                run.violations,
                cpu_s,
                run.duration_s,
            )
        )
    return laps


def campaign(
    pool: multiprocessing.pool.Pool,
    file: str,
    name: str,
    count: int,
    *,
    whole: bool,
) -> list[Lap]:
    """`count` runs of a system, spread over the cores."""
    chunk = max(1, min(50, count // (2 * (os.cpu_count() or 1))))
    ends = range(FIRST_SEED, FIRST_SEED + count, chunk)
    tasks = [(file, name, range(a, min(a + chunk, FIRST_SEED + count)), whole) for a in ends]
    return [lap for part in pool.map(fly, tasks, chunksize=1) for lap in part]


def campaign_speed(single: list[Lap]) -> tuple[float, bool]:
    """How fast a campaign flies the laps of `single` on one core, and whether they are the same."""
    system = system_of(check_file(str(DRONE / "motion_primitive.soter")), "Protected")
    assert system.until_ns is not None
    fleet = Fleet(system, system.until_ns)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        flights = fleet.fly(range(len(single)), first_seed=single[0].seed)
        times.append(time.process_time() - began)
    told = [(f.violations, f.disengagements[0], f.gate_faults[0]) for f in flights]
    same = told == [(lap.violations, lap.switches, lap.gate_faults) for lap in single]
    return sum(lap.flown_s for lap in single) / float(np.median(times)), same


def speeds(count: int) -> list[tuple[str, str, str, bool]]:
    """The rows of speed: each lap by itself, and all of them as a campaign."""
    one_core = fly(("motion_primitive.soter", "Protected", range(1, 1 + count), False))
    alone = float(np.median([lap.flown_s / lap.cpu_s for lap in one_core]))
    together, same = campaign_speed(one_core)
    right = together >= FAST and same
    return [
        ("speed of a run, one core", f"{alone:,.0f} x real time", ">= 5,000", alone >= 5000),
        (
            "speed of a campaign, one core",
            f"{together:,.0f} x real time",
            f">= {FAST:,}, the same laps",
            right,
        ),
    ]


def mean_lap_s(laps: list[Lap]) -> float:
    """Of the laps without a violation that reached g4; NaN if there is none."""
    times = [lap.lap_s for lap in laps if lap.lap_s is not None and not lap.violations]
    return float(np.mean(times)) if times else float("nan")


def arms(pool: multiprocessing.pool.Pool, count: int) -> int:
    """Print the three arms and the targets; the number of targets missed."""
    flown = {a: campaign(pool, "motion_primitive.soter", a, count, whole=False) for a in ARMS}
    rows = []
    for name, laps in flown.items():
        shares = [lap.ac_share for lap in laps]
        rows.append(
            (
                name,
                str(count),
                str(sum(lap.violations > 0 for lap in laps)),
                str(sum(lap.lap_s is not None and not lap.violations for lap in laps)),
                f"{mean_lap_s(laps):.2f} s",
                f"{100 * float(np.mean(shares)):.1f} %",
                f"{100 * min(shares):.1f} %",
                f"{float(np.mean([lap.switches for lap in laps])):.2f}",
            )
        )
    print(
        table(
            (
                "arm",
                "laps",
                "with violation",
                "clean",
                "mean clean lap",
                "AC share mean",
                "min",
                "takeovers",
            ),
            rows,
        )
    )
    alone, protected, safe = (flown[a] for a in ARMS)
    alone_s, protected_s, safe_s = (mean_lap_s(flown[a]) for a in ARMS)
    collided = sum(lap.violations > 0 for lap in alone)
    violated = sum(lap.violations > 0 for lap in protected)
    share = float(np.mean([lap.ac_share for lap in protected]))
    unfinished = sum(lap.lap_s is None for lap in [*protected, *safe])
    targets = (
        ("violations, protected", f"{violated}", "0", violated == 0),
        ("AC alone collides", f"{collided}", f">= {0.3 * count:.0f}", collided >= 0.3 * count),
        ("AC share, protected", f"{100 * share:.1f} %", ">= 90 % (goal 96 %)", share >= 0.9),
        (
            "protected / AC alone",
            f"{protected_s / alone_s:.3f}",
            "<= 1.25 (goal 1.15)",
            protected_s / alone_s <= 1.25,
        ),
        (
            "SC alone / protected",
            f"{safe_s / protected_s:.2f}",
            ">= 1.5",
            safe_s / protected_s >= 1.5,
        ),
        ("laps not finished, protected and SC", f"{unfinished}", "0", unfinished == 0),
        *speeds(min(count, SPEED_RUNS)),
    )
    print()
    print(
        table(
            ("figure", "measured", "target", ""),
            [(a, b, c, "ok" if met else "MISSED") for a, b, c, met in targets],
        )
    )
    return sum(not met for *_, met in targets)


def adversaries(pool: multiprocessing.pool.Pool, count: int) -> int:
    """Print what hostile ACs achieve under the module; the number of violations."""
    rows = []
    total = 0
    for name in HOSTILE:
        laps = campaign(pool, "adversaries.soter", name, count, whole=True)
        violations = sum(lap.violations for lap in laps)
        total += violations
        hours = sum(lap.flown_s for lap in laps) / 3600
        rows.append(
            (
                name,
                str(count),
                f"{hours:.2f} h",
                str(violations),
                f"{100 * float(np.mean([lap.ac_share for lap in laps])):.1f} %",
                f"{sum(lap.switches for lap in laps) / hours / 60:.1f}",
                f"{sum(lap.gate_faults for lap in laps) / hours / 60:.0f}",
            )
        )
    print(
        table(
            ("AC", "runs", "flown", "violations", "AC share", "takeovers/min", "gate faults/min"),
            rows,
        )
    )
    return total


def main() -> int:
    """Read the command line, fly, print; exit code 1 when a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laps", type=int, default=1000, help="runs of each system (1000)")
    parser.add_argument("--adversaries", action="store_true", help="hostile ACs instead")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    chosen = parser.parse_args()
    with multiprocessing.Pool(chosen.jobs) as pool:
        missed = (adversaries if chosen.adversaries else arms)(pool, chosen.laps)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
