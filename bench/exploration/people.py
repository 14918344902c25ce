"""Vehicles among what moves: who is touched while they move, how fast they get along.

Purpose: `examples/exploration/people.soter` with people who walk into the rover, who lure it, and
who stroll; the proved module, a stop zone without timing and AC alone, from the same seeds. The
same in `street.soter`, where a lidar sees them, and those who lure step out from behind things, and
for a robot on wheels, one among robots that announce their speed, and a drone.
Non-goals: what is proved (`soter verify`).

    python bench/exploration/people.py               10,000 encounters and more
    python bench/exploration/people.py --runs 10
    python bench/exploration/people.py --only street
    python bench/exploration/people.py --price       what a lidar costs: shares of AC's mean speed

An *encounter* begins where somebody comes within 1 m of the vehicle's hull and ends beyond 2 m.
*Touched*: onsets of a distance of 0 or less while the vehicle is faster than what counts as rest.
*x real*: simulated seconds for each of the processor's, one core.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import soter

if TYPE_CHECKING:
    from collections.abc import Mapping

FOLDER = Path(__file__).parents[2] / "examples" / "exploration"
RUNS = {"Hunting": 330, "Luring": 100, "Strolling": 100}


def _arms(module: str, second: str = "stop zone") -> dict[str, tuple[str, str]]:
    """The system and the module of each vehicle in a table."""
    other = {"stop zone": "Zoned", "not heard": "Unheard"}[second]
    return {
        "Soter": ("Hunted", module),
        second: (other, f"h.{module}"),
        "AC alone": ("Bare", f"h.{module}"),
    }


VEHICLES = {
    "people": _arms("Passive"),
    "street": _arms("Sighted"),
    "wheels": _arms("Passive"),
    "announced": _arms("Passive", "not heard"),
    "hover": _arms("Passive"),
}


def row(
    program: soter.Program, vehicle: tuple[str, str], runs: int, params: Mapping[str, object]
) -> tuple[str, int]:
    """What stands in a line of the table, and the encounters in it."""
    system, module = vehicle
    touched = encounters = 0
    far, share = [], []
    began, simulated = time.process_time(), 0.0
    for seed in range(1, runs + 1):
        run = program.simulate(system, seed=seed, params=params, trace=[module], sha256=False)
        topics = run.final["topics"]
        (street,) = [n for n in topics.dtype.names if n.endswith(("street", "view"))]
        told = sum("people.seen.gap" in v.what for v in run.violation_list)
        assert told == 0, f"seed {seed}: somebody is nearer than the lidar's node says"
        simulated += run.duration_s
        touched += run.violations
        encounters += int(topics[street]["encounters"])
        far.append(float(topics[street]["x"]) / run.duration_s)
        share.append(float((np.asarray(run.mode(module)) == 1).mean()))
    speed = simulated / (time.process_time() - began)
    text = (
        f"{runs:>6}{encounters:>12}{touched:>9}{np.mean(far):>10.2f}"
        f"{100.0 * np.mean(share):>8.1f}{speed:>8.0f}"
    )
    return text, encounters


def table(name: str, asked: argparse.Namespace) -> None:
    """Print what comes of each vehicle of a file with each kind of people."""
    path = FOLDER / f"{name}.soter"
    program = soter.load(path)
    kind_of_people = {"people": "KIND", "street": "people.KIND"}.get(name, "walkers.KIND")
    print(
        f"{path.name:<17}{'people':<12}{'runs':>6}{'encounters':>12}{'touched':>9}{'m/s':>10}"
        f"{'AC %':>8}{'x real':>8}"
    )
    for arm, vehicle in VEHICLES[name].items():
        total = 0
        for kind, runs in RUNS.items():
            text, encounters = row(program, vehicle, asked.runs or runs, {kind_of_people: kind})
            total += encounters
            print(f"{arm:<17}{kind:<12}{text}", flush=True)
        print(f"{arm:<17}{'all':<12}{'':>6}{total:>12}")


ROOM = "from the middle of the street to the cars, 0.5 % of the rays dropped"
LOST = "rays dropped, cars 2 m away"
PEOPLE = "nobody is thinner than, 0.5 % dropped, cars 2 m away"
PRICES = {
    ROOM: ("PASSAGE", {"1.0 m": 1.0, "1.5 m": 1.5, "2.0 m": 2.0, "2.5 m": 2.5, "4.0 m": 4.0}),
    LOST: ("DROPPED", {"none": 0.0, "0.1 %": 0.001, "0.5 %": 0.005, "2 %": 0.02}),
    PEOPLE: ("THIN", {"0.1 m": 0.1, "0.15 m": 0.15, "0.2 m": 0.2, "0.3 m": 0.3}),
}
"""Rows of the table of docs/exploration.md: a parameter of street.soter, or THIN of sight.soter."""


def price(runs: int) -> None:
    """Print how fast strollers let the rover go, as a share of AC's mean speed alone."""

    def mean(program: soter.Program, system: str, params: dict[str, object]) -> float:
        far = []
        for seed in range(1, runs + 1):
            values = {"people.KIND": "Strolling", **params}
            run = program.simulate(system, seed=seed, params=values, trace=False, sha256=False)
            topics = run.final["topics"]
            (street,) = [n for n in topics.dtype.names if n.endswith(("street", "view"))]
            far.append(float(topics[street]["x"]) / run.duration_s)
        return float(np.mean(far))

    program = soter.load(FOLDER / "street.soter")
    alone = mean(program, "Bare", {})
    for what, (name, values) in PRICES.items():
        cells = []
        for label, number in values.items():
            if name == "THIN":
                speed = mean(_with_thin(number), "Hunted", {})
            else:
                speed = mean(program, "Hunted", {name: number})
            cells.append(f"{label}: {100.0 * speed / alone:.0f} %")
        print(f"| {what} | {' | '.join(cells)} |", flush=True)


def _with_thin(thin: float) -> soter.Program:
    """The street with a lidar that reckons with people of this size (m)."""
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "examples"
        shutil.copytree(FOLDER.parent, there, ignore=shutil.ignore_patterns("*.html", "build"))
        sight = there / FOLDER.name / "sight.soter"
        text = sight.read_text(encoding="utf-8")
        changed = text.replace("const THIN: float = 0.2;", f"const THIN: float = {thin};")
        assert changed != text or thin == 0.2
        sight.write_text(changed, encoding="utf-8")
        program = soter.load(there / FOLDER.name / "street.soter")
        assert program.check() is not None
        program.simulate("Hunted", until="1s", trace=False, sha256=False)
        return program


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs", type=int, help="of each kind; by default as many as the table has"
    )
    parser.add_argument("--only", choices=VEHICLES, help="one file of them")
    parser.add_argument("--price", action="store_true", help="the price of a lidar, of 100 runs")
    asked = parser.parse_args()
    if asked.price:
        price(asked.runs or RUNS["Strolling"])
        return
    for name in [asked.only] if asked.only else VEHICLES:
        table(name, asked)


if __name__ == "__main__":
    main()
