"""The drone's proved module on MuJoCo's rigid body: whether the plant of the proof is true of it.

    python bench/drone/off_model.py [--hours H] [--minutes M] [--system S]... [--keep FILE]

Purpose: fly seeded laps of examples/drone/mujoco_quad.soter; for every step of every flight the
model monitor's verdict (soter monitor, on true states) and the least |d| that explains it.
Every flight is kept: stopped at any time (`--minutes` does), it goes on from there.
Non-goals: `iris.Iris` (bench/drone/conformance.py), speed.

Not called mujoco.py: `import mujoco` would find it.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from soter.api import Program, load
from soter.api.monitoring import judge_modules
from soter.report.tables import table

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from bench.drone.conformance import QUANTILES, declared, needed
from bench.pieces import Pieces

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
PROGRAM = DRONE / "mujoco_quad.soter"
SYSTEMS = ("Protected", "Jerking", "InAir")
FIRST_SEED = 40_000

FIELDS = ["seed", "flown_s", "violations", "ac_share", "steps", "alarms", "first_alarm_s"]
FIELDS += ["share", "state", "d_x", "d_y", "d_z", "d_50", "d_99", "d_9999", "wall_s"]


def made_of() -> str:
    """What a result depends on: programs, the vehicle, MuJoCo."""
    import mujoco  # noqa: PLC0415 - the extra `simulators`

    parts = [load(PROGRAM).sha256 or "", (DRONE / "mujoco_quad.py").read_text(encoding="utf-8")]
    return hashlib.sha256("".join([*parts, mujoco.__version__]).encode()).hexdigest()


def one(program: Program, system: str, seed: int, known: dict[str, Any]) -> dict[str, Any]:
    """A flight: its violations, the monitor's verdict, what |d| had to be."""
    began = time.perf_counter()
    run = program.simulate(system, seed=seed)
    (verdict,) = judge_modules(run.system, None, run, None, estimates=False)
    d, _ = needed(run, known)
    worst, level = d.max(axis=0), np.quantile(d.max(axis=1), QUANTILES)
    (module,) = run.modules.values()
    numbers: list[Any] = [seed, run.duration_s, run.violations, module.ac_share]
    numbers += [verdict.steps, verdict.alarms, verdict.first_alarm_s, verdict.share, verdict.state]
    values = [*numbers, *worst, *level, time.perf_counter() - began]
    return dict(zip(FIELDS, values, strict=True))


def fly(system: str, hours: float, stop_s: float, pieces: Pieces) -> list[dict[str, Any]]:
    """Fly what is left, in the order of seeds, until `stop_s` of the clock."""
    program = load(PROGRAM)
    known = {n: program._require_sound().consts[n].value  # noqa: SLF001 - as the conformance does
             for n in ("iris.BAND", "iris.FAST", "city.TUBES")}  # fmt: skip
    rows: list[dict[str, Any]] = []
    for seed in itertools.count(FIRST_SEED):
        name = f"{system} {seed}"
        late = time.perf_counter() >= stop_s and not pieces.has(name)
        if late or sum(r["flown_s"] for r in rows) >= hours * 3600:
            return rows
        rows.append(pieces.piece(name, partial(one, program, system, seed, known)))
    raise AssertionError


def told(system: str, rows: list[dict[str, Any]]) -> list[str]:
    """A row of the table."""

    def numbers(name: str) -> list[float]:
        return [r[name] for r in rows]

    worst = [max(numbers(n)) for n in ("d_x", "d_y", "d_z")]
    steps = sum(numbers("steps"))
    states = Counter(r["state"] for r in rows).most_common(1)[0][0]
    return [
        system,
        f"{sum(numbers('flown_s')) / 3600:.2f}",
        f"{sum(numbers('violations')):.0f}",
        f"{np.mean(numbers('ac_share')):.1%}",
        f"{steps:,.0f}",
        f"{sum(numbers('alarms')):,.0f}",
        f"{sum(a > 0 for a in numbers('alarms'))} of {len(rows)}",
        f"{max(numbers('share')):.0%} {states}",
        f"{np.median(numbers('d_50')):.3f}",
        f"{np.median(numbers('d_99')):.3f}",
        *(f"{x:.3f}" for x in worst),
        f"{max(worst) / declared('motion_primitive.soter'):.0%}",
    ]


def main() -> int:
    """Fly, and print; 1 where a vehicle without air left the model or the tube."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--hours", type=float, default=10.0, help="of each system; by default 10")
    parser.add_argument("--minutes", type=float, default=1e9, help="stop after so many, of all")
    parser.add_argument("--system", action="append", choices=SYSTEMS, help="by default all")
    parser.add_argument("--keep", type=Path, default=Path(".soter/off_model.jsonl"))
    args = parser.parse_args()
    args.keep.parent.mkdir(parents=True, exist_ok=True)
    pieces = Pieces(args.keep, made_of()[:12])
    chosen = args.system or SYSTEMS
    rows_by_system = {}
    began = time.perf_counter()
    for k, system in enumerate(chosen):
        stop = began + 60 * args.minutes * (k + 1) / len(chosen)
        rows_by_system[system] = fly(system, args.hours, stop, pieces)
    rows_by_system = {system: rows for system, rows in rows_by_system.items() if rows}
    head = ["system", "hours", "violations", "AC share", "steps", "alarms", "in flights"]
    head += ["most used by", "|d| 50 %", "99 %", "along, x", "side, y", "up, z", "of D"]
    print(table(head, [told(system, rows) for system, rows in rows_by_system.items()]))
    print(
        f"\nthe least |d| that explains 5 ms, m/s^2; D = {declared('motion_primitive.soter'):.3f}"
    )
    for system, rows in rows_by_system.items():
        wall = sum(r["wall_s"] for r in rows)
        flown = sum(r["flown_s"] for r in rows)
        ten = 600 * wall / flown
        print(f"{system}: {flown / wall:.1f} x real time, 10 h in {ten:.0f} min")
    bad = [r for s, rows in rows_by_system.items() if s != "InAir" for r in rows]
    return int(any(r["alarms"] or r["violations"] for r in bad))


if __name__ == "__main__":
    sys.exit(main())
