"""A rover among people: who is touched while it moves, how fast it gets along.

Purpose: `examples/exploration/people.soter` with people who walk into the rover, who lure it, and
who stroll; the proved module, a stop zone without timing and AC alone, from the same seeds.
Non-goals: what is proved (`soter verify`), who steps out from behind something.

    python bench/exploration/people.py               10,000 encounters and more
    python bench/exploration/people.py --runs 10

An *encounter* begins where somebody comes within 1 m of the rover's box and ends beyond 2 m.
*Touched*: onsets of a distance of 0 or less while the rover is faster than what counts as rest.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import soter

FILE = Path(__file__).parents[2] / "examples" / "exploration" / "people.soter"
RUNS = {"Hunting": 330, "Luring": 100, "Strolling": 100}
ROVERS = {
    "Soter": ("Hunted", "Passive"),
    "stop zone": ("Zoned", "h.Passive"),
    "AC alone": ("Bare", "h.Passive"),
}


def row(program: soter.Program, rover: str, kind: str, runs: int) -> tuple[str, int]:
    """A line of the table, and the encounters in it."""
    system, module = ROVERS[rover]
    touched = encounters = 0
    far, share = [], []
    for seed in range(1, runs + 1):
        run = program.simulate(
            system, seed=seed, params={"KIND": kind}, trace=[module], sha256=False
        )
        topics = run.final["topics"]
        (street,) = [n for n in topics.dtype.names if n.endswith("street")]
        touched += run.violations
        encounters += int(topics[street]["encounters"])
        far.append(float(topics[street]["x"]) / run.duration_s)
        share.append(float((np.asarray(run.mode(module)) == 1).mean()))
    text = (
        f"{rover:<12}{kind:<12}{runs:>6}{encounters:>12}{touched:>9}{np.mean(far):>10.2f}"
        f"{100.0 * np.mean(share):>8.1f}"
    )
    return text, encounters


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs", type=int, help="of each kind; by default as many as the table has"
    )
    asked = parser.parse_args()
    program = soter.load(FILE)
    print(
        f"{'':<12}{'people':<12}{'runs':>6}{'encounters':>12}{'touched':>9}{'m/s':>10}{'AC %':>8}"
    )
    for rover in ROVERS:
        total = 0
        for kind, runs in RUNS.items():
            text, encounters = row(program, rover, kind, asked.runs or runs)
            total += encounters
            print(text, flush=True)
        print(f"{rover:<12}{'all':<12}{'':>6}{total:>12}")


if __name__ == "__main__":
    main()
