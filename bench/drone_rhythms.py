"""The rhythm of set-points that the drone follows worst: a search against D of the proofs.

Purpose: the proofs of laps and of corridors rest on the vehicle's following a_ref to within D. An
AC may ask for anything, so this looks for the reversals that are followed worst, on all axes:
random ones (`Rhythmic` of the adversaries), then others drawn about the worst of them, generation
after generation (the cross-entropy method). Exit code 1 where D is exceeded.
Non-goals: a proof; flights as they are flown (`drone_conformance.py`).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.drone_conformance import DRONE, declared, needed  # noqa: E402 - needs the path

from soter.program.build import check_file, system_of  # noqa: E402 - the same
from soter.report.summary import table  # noqa: E402 - the same
from soter.simulate.run import NativeProgram  # noqa: E402 - the same

PROGRAMS = (
    ("adversaries.soter", "motion_primitive.soter"),
    ("corridor_adversaries.soter", "corridor.soter"),
)
Floats: TypeAlias = npt.NDArray[np.float64]
INPUTS = ("first", "spell", "side")
LOW = np.array([0.0] * 6 + [-1.0] * 3)
HIGH = np.ones(9)
STEPS = 400
"""Of a rhythm's two seconds."""
KEPT = 25
DECIDED = 0.5
"""From so large a mean sign on, the kept rhythms agree on a side."""


@dataclass(frozen=True)
class Found:
    """The worst rhythm of a search: its nine numbers, and |d| in m/s^2 by axis."""

    rhythm: Floats
    d: Floats


def limited(text: str, low: Floats, high: Floats) -> str:
    """The program with inputs drawn from the box [low, high], (9,) each."""
    for k, name in enumerate(INPUTS):
        line = next(x for x in text.splitlines() if x.startswith(f"input topic {name}: Vec3"))
        box = ", ".join(
            f"{c} in [{float(low[3 * k + i])!r}, {float(high[3 * k + i])!r}]"
            for i, c in enumerate("xyz")
        )
        default = ", ".join(f"{c}: {float(low[3 * k + i])!r}" for i, c in enumerate("xyz"))
        text = text.replace(line, f"input topic {name}: Vec3 in {{ {box} }} = {{ {default} }};")
    return text


def rhythms(folder: Path, file: str, seeds: range) -> list[Found]:
    """Every rhythm that is flown under these seeds."""
    checked = check_file(str(folder / file))
    assert checked.program is not None
    known = {n.removeprefix("drone."): c.value for n, c in checked.program.consts.items()}
    system = system_of(checked, "Rhythmic")
    assert system.until_ns is not None
    program = NativeProgram(system)
    found = []
    for seed in seeds:
        run = program.run(system.until_ns, seed, keep_trace=True)
        d, _ = needed(run, known)
        topics = run.trace["topics"] if run.trace is not None else None
        assert topics is not None
        flown = np.stack([topics[n][c] for n in INPUTS for c in "xyz"], axis=1)[1:-1]
        for k in range(0, len(d), STEPS):
            middle = min(k + STEPS // 2, len(d) - 1)
            found.append(Found(flown[middle], d[k : k + STEPS].max(axis=0)))
    return found


def narrowed(kept: list[Found], low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The next box, (9,) each: towards where the kept rhythms lie, and their side if they agree."""
    points = np.array([f.rhythm for f in kept])
    mean, wide = points[:, :6].mean(axis=0), 1.8 * points[:, :6].std(axis=0) + 0.01
    low, high = low.copy(), high.copy()
    low[:6] = 0.4 * low[:6] + 0.6 * np.clip(mean - wide, 0.0, 1.0)
    high[:6] = 0.4 * high[:6] + 0.6 * np.clip(mean + wide, 0.0, 1.0)
    for k, sign in enumerate(np.sign(points[:, 6:]).mean(axis=0), start=6):
        if abs(sign) > DECIDED:
            low[k], high[k] = (0.1, 1.0) if sign > 0 else (-1.0, -0.1)
    return low, high


def search(task: tuple[str, int, int, int]) -> Found:
    """One search: (file, axis or -1 for all, generations, flights of a generation)."""
    file, axis, generations, flights = task
    text = (DRONE / file).read_text(encoding="utf-8")
    low, high, worst = LOW, HIGH, Found(LOW, np.zeros(3))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "drone"
        shutil.copytree(DRONE, folder)
        for generation in range(generations):
            (folder / file).write_text(limited(text, low, high), encoding="utf-8")
            first = 1_000_000 * (axis + 2) + 1_000 * generation
            found = rhythms(folder, file, range(first, first + flights))
            found.sort(key=lambda f: -float(f.d.max() if axis < 0 else f.d[axis]))
            worst = max(worst, found[0], key=lambda f: float(f.d.max()))
            low, high = narrowed(found[:KEPT], low, high)
    return worst


def main() -> int:
    """Search along every axis and along all at once; exit code 1 where a bound is exceeded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--generations", type=int, default=15)
    parser.add_argument("--flights", type=int, default=40, help="of 60 s, a generation (40)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    chosen = parser.parse_args()
    axes = (-1, 0, 1, 2)
    tasks = [(f, k, chosen.generations, chosen.flights) for f, _ in PROGRAMS for k in axes]
    with multiprocessing.Pool(chosen.jobs) as pool:
        found = pool.map(search, tasks, chunksize=1)
    rows, exceeded = [], 0
    for (file, program), worst in zip([p for p in PROGRAMS for _ in axes], found, strict=True):
        bound = declared(program)
        beyond = bool(worst.d.max() > bound)
        exceeded += beyond
        rhythm = " ".join(f"{x:.2f}" for x in worst.rhythm[:6])
        sides = "".join("+" if x > 0 else "-" for x in worst.rhythm[6:])
        rows.append(
            (
                file,
                *(f"{x:.3f}" for x in worst.d),
                f"{worst.d.max() / bound:.0%}",
                "EXCEEDED" if beyond else "ok",
                rhythm,
                sides,
            )
        )
    heads = ("program", "along, x", "side, y", "up, z", "of D", "", "first and spell, s", "side")
    print(table(heads, rows))
    count = chosen.generations * chosen.flights * 30
    print(
        f"\neach the worst of {count:,} rhythms: |d| in m/s^2 that explains it; a search, no proof"
    )
    return exceeded != 0


if __name__ == "__main__":
    raise SystemExit(main())
