"""What the inner module of a tower is worth to a passenger: jerk, and seconds until AC resumes.

    .venv/bin/python bench/drone/tower_comfort.py [--flights 40] [--json FILE]

Purpose: the drone of examples/drone/tower.soter with the inner module, and with AC straight below
the outer one (`stop_alone.soter`), the same seeds. Jerk is that of the shaped reference, in the
world frame; an interruption lasts from the step that takes control from AC to the one that gives it
back. Exit code 1 where a flight violated a property.
Non-goals: which of the two is safe: the outer module is proved for both.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import soter

ROOT = Path(__file__).resolve().parents[2]
ARMS = {
    "tower": (ROOT / "examples/drone/tower.soter", "Tower", ("StopInside", "ReturnAlong")),
    "stop alone": (ROOT / "bench/drone/stop_alone.soter", "Alone", ("StopAlone",)),
}
FINE_S = 0.02
"""Jerk is looked at so often: the shaping filter moves on in 5 ms."""

Flight = dict[str, Any]


def interruptions(in_control: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Lengths in s of the times at which AC had no control; the first one is the start."""
    edges = np.diff(in_control.astype(np.int8), prepend=1, append=1)
    begins, ends = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    last = np.append(time_s, time_s[-1])
    return np.asarray(last[ends] - time_s[begins], dtype=np.float64)


def _length(of: np.ndarray) -> np.ndarray:
    parts = np.array([of[a] for a in ("x", "y", "z")], dtype=np.float64)
    return np.asarray(np.sqrt((parts**2).sum(axis=0)))


def measured(
    program: soter.Program, system: str, modules: tuple[str, ...], seed: int
) -> dict[str, Any]:
    """Of one flight."""
    run = program.simulate(system, seed=seed, trace=True)
    trace = run.require_trace()
    time_s = trace["header"]["ct"] / 1e9
    modes = [m.index for m in run.system.modules if m.name.rpartition(".")[2] in modules]
    in_control = (trace["modules"]["mode"][:, modes] == 1).all(axis=1)
    (topic,) = [t.name for t in run.system.topics if t.name.endswith("reference")]
    jerk, pull = (_length(trace["topics"][topic][part]) for part in ("j", "a"))
    at = np.searchsorted(time_s, np.arange(0.0, time_s[-1], FINE_S))
    pauses = interruptions(in_control, time_s)[1:]
    return {
        "violations": run.violations,
        "jerk": jerk[at].tolist(),
        "taken_jerk": jerk[at][~in_control[at]].tolist(),
        "taken_pull": pull[at][~in_control[at]].tolist(),
        "pauses": pauses.tolist(),
        "ac_share": float(in_control[at].mean()),
        "switches_outer": run.modules[run.system.modules[0].name].switches_to_sc,
    }


def main() -> int:
    """0 where no flight violated anything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    rows, violations = {}, 0
    for name, (path, system, modules) in ARMS.items():
        program = soter.load(path)
        flights = [
            measured(program, system, modules, seed) for seed in range(1, options.flights + 1)
        ]
        jerk = np.concatenate([f["jerk"] for f in flights])
        taken, pull = (
            np.concatenate([f[k] for f in flights]) for k in ("taken_jerk", "taken_pull")
        )
        pauses = np.concatenate([f["pauses"] for f in flights])
        violations += sum(f["violations"] for f in flights)
        rows[name] = {
            "jerk_rms": float(np.sqrt(np.mean(jerk**2))),
            "jerk_p99": float(np.quantile(jerk, 0.99)),
            "jerk_max": float(jerk.max()),
            "jerk_rms_without_ac": float(np.sqrt(np.mean(taken**2))),
            "acceleration_p99_without_ac": float(np.quantile(pull, 0.99)),
            "interruptions_per_flight": len(pauses) / options.flights,
            "resume_median_s": float(np.median(pauses)) if len(pauses) else 0.0,
            "resume_p95_s": float(np.quantile(pauses, 0.95)) if len(pauses) else 0.0,
            "ac_share": float(np.mean([f["ac_share"] for f in flights])),
            "outer_takeovers": float(np.mean([f["switches_outer"] for f in flights])),
        }
    for key in next(iter(rows.values())):
        print(f"{key:26}" + "".join(f"{name}: {row[key]:10.3f}   " for name, row in rows.items()))
    print(f"{violations} violations in {len(ARMS) * options.flights} flights")
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(violations > 0)


if __name__ == "__main__":
    sys.exit(main())
