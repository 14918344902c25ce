"""Fly the surveillance program and tell what the three modules did.

    python examples/drone/patrol.py [--until 900] [--seed 1] [--system Protected]

Purpose: beside what `soter run examples/drone/surveillance.soter` prints, the battery, the landings
and the plans: how many came into force, how many were refused and why. `--file` takes the hostile
systems of surveillance_adversaries.soter.
Non-goals: many flights (bench/drone/stack.py).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import soter

if TYPE_CHECKING:
    from soter.simulate.result import Run

HERE = Path(__file__).resolve().parent
REASONS = (
    "Covered",
    "Empty",
    "NotFinite",
    "OutsideMap",
    "InBuilding",
    "TooNarrow",
    "TooLong",
    "TooManyBlocks",
    "Elsewhere",
    "Unsound",
)  # in the order of boxes.Verdict


def said(run: Run) -> list[tuple[str, str]]:
    """The flight in lines."""
    topics = run.final["topics"]
    last: dict[str, Any] = {n.rsplit(".", 1)[-1]: topics[n] for n in topics.dtype.names}
    book, force, battery = last["landings"], last["inForce"], last["battery"]
    why = {r: int(n) for r, n in zip(REASONS, book["reasons"], strict=True) if n}
    docked = "docked" if battery["docked"] else "aloft"
    lines = [
        (name, f"{m.ac_share:.1%} AC, {m.switches_to_sc} takeovers, {m.gate_faults} gate faults")
        for name, m in run.modules.items()
    ]
    lines.append(("plans in force", f"{int(force['adopted'])}"))
    reasons = ", ".join(f"{n} {r}" for r, n in why.items())
    lines.append(("plans refused", f"{int(force['refused'])}" + (f": {reasons}" if why else "")))
    lines.append(("battery at the end", f"{float(battery['charge']):.0%}, {docked}"))
    if book["number"]:
        asked = f"{int(book['number'])}, {int(book['forced'])} of them by the decision module"
        least = f"{float(book['least']):.1%} charge and {float(book['left']):.0f} s left"
        lines.append(("landings", f"{asked}; at touch-down at least {least}"))
    lines.append(("violations", f"{run.violations}"))
    lines += [
        (f"  at {v.time_s:.1f} s", v.what) for v in run.violation_list if v.time_s is not None
    ]
    return lines


def main() -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", type=Path, default=HERE / "surveillance.soter")
    parser.add_argument("--system", default="Protected")
    parser.add_argument("--until", type=float, default=900.0, help="s")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    run = soter.load(arguments.file).simulate(
        arguments.system, until=arguments.until, seed=arguments.seed, trace=False
    )
    print(f"{arguments.system}, seed {run.seed}, {run.duration_s:g} s\n")
    for name, text in said(run):
        print(f"{name:24}{text}")
    for name, why in run.extern_failures.items():
        print(f"{name}: {why}")
    return 3 if run.violations else 0


if __name__ == "__main__":
    sys.exit(main())
