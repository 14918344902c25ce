"""The ground robot in a hall with walls, against whoever wishes it ill, five hundred times.

Purpose: `examples/ros/ground_robot_hall.soter`, with the proved module, with a stop zone without
timing (that of Nav2's tutorial, ahead, and one all around), and with AC alone, from the same seeds:
collisions, the least distance to the hull, what was driven, and for how long the robot stood
although it was wished away from what was nearest.
Non-goals: real time and ROS itself (`kills.py`); what is proved (`soter verify`).

    python bench/ros/ground_robot.py            500 runs of 60 s each way
    python bench/ros/ground_robot.py --runs 25
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import soter

if TYPE_CHECKING:
    from collections.abc import Iterator

HALL = Path(__file__).parents[2] / "examples" / "ros" / "ground_robot_hall.soter"
HOSTILE = ("rams", "at random", "to and fro", "spins, dashes", "repeats old")
WAYS: dict[str, tuple[str, dict[str, Any]]] = {
    "Soter": ("Guarded", {}),
    "stop zone ahead": ("Zoned", {}),
    "stop zone around": ("Zoned", {"AROUND": True}),
    "AC alone": ("Alone", {}),
}


@dataclass
class Tally:
    """Of some runs."""

    runs: int = 0
    collided: int = 0
    touches: int = 0
    least_m: float = float("inf")
    driven_m: float = 0.0
    stuck_s: float = 0.0
    longest_s: float = 0.0

    def add(self, other: Tally) -> None:
        """Count runs of another tally, too."""
        self.runs += other.runs
        self.collided += other.collided
        self.touches += other.touches
        self.least_m = min(self.least_m, other.least_m)
        self.driven_m += other.driven_m
        self.stuck_s += other.stuck_s
        self.longest_s = max(self.longest_s, other.longest_s)


def one_run(program: soter.Program, way: str, kind: int, seed: int) -> Tally:
    """A minute in the hall."""
    system, params = WAYS[way]
    run = program.simulate(
        system=system,
        seed=seed,
        params={"KIND": kind, **params},
        trace=["who.account"],
        sha256=False,
    )
    last = run.topic("who.account")[-1]
    touches = int(last["touches"])
    stuck = float(last["stuck"])
    return Tally(
        1, int(touches > 0), touches, float(last["least"]), float(last["driven"]), stuck, stuck
    )


def tallies(program: soter.Program, runs: int) -> Iterator[tuple[str, str, Tally]]:
    """Of every way and everybody who wishes; seeds are those of the run, the same for all ways."""
    for way in WAYS:
        for kind, name in enumerate(HOSTILE):
            tally = Tally()
            for seed in range(1 + kind, 1 + runs, len(HOSTILE)):
                tally.add(one_run(program, way, kind, seed))
            yield way, name, tally


def row(way: str, name: str, t: Tally) -> str:
    """A line of the table."""
    return (
        f"{way:<17} {name:<14} {t.runs:>5} {t.collided:>8} {t.touches:>8} {100 * t.least_m:>9.1f} "
        f"{t.driven_m / t.runs:>9.1f} {t.stuck_s / t.runs:>9.1f} {t.longest_s:>9.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=500)
    runs = parser.parse_args().runs
    program = soter.load(HALL)
    print(
        f"{'':<17} {'':<14} {'':>5} {'runs that':>8}{'':>9}{'least':>9} {'driven':>9} {'stuck':>9} "
        f"{'longest':>9}"
    )
    print(
        f"{'':<17} {'/cmd_vel_nav':<14} {'runs':>5} {'collide':>8} {'touches':>8} {'cm':>9} "
        f"{'m a run':>9} {'s a run':>9} {'s':>9}"
    )
    sums = {way: Tally() for way in WAYS}
    for way, name, tally in tallies(program, runs):
        print(row(way, name, tally), flush=True)
        sums[way].add(tally)
    for way, tally in sums.items():
        print(row(way, "all", tally))


if __name__ == "__main__":
    main()
