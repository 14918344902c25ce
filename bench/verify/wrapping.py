"""Axes that wrap around, of drawn plants, against an adversary and against axes of five turns.

    .venv/bin/python bench/verify/wrapping.py [--systems 300] [--wide 3]
        [--kept .soter/wrapping]

Purpose: for each plant of `tests/generators/turning_systems.py` K on one turn of headings. *Wrong*:
SC, flown in doubles from states of K up to 2,000 turns away, with errors, ages and pushes at their
limits, does not keep one of them safe. For every third one the same program with an axis of five
turns, which does not wrap: *lost* are cells of its middle turn that are not in K. *Counted*: the
same program with one place where somebody counts turns; it may not wrap. Answers are kept, by plant
and sources: the next call goes on.
Non-goals: the re-checker (tests/unit/certificate/test_axes_around_a_turn.py).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from bench.newcomers.first_attempt import kept as kept_answer  # noqa: E402 - needs the path
from bench.newcomers.first_attempt import tool  # noqa: E402
from bench.newcomers.wrong_robots import cpu_now_s  # noqa: E402

from generators.turning_systems import Drawn, counted  # noqa: E402
from soter.language.front_end import check_file, system_of  # noqa: E402
from soter.verify.enclose import compiled_enclosures  # noqa: E402
from soter.verify.enclose.compiled_enclosures import library_of  # noqa: E402
from soter.verify.grid.sets import GridGroup  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.problem.problem import Problem

CELLS, RUNS, HOLDS, TURNS = 32, 600, 120, 2000


@dataclass
class Row:
    """Of all plants."""

    systems: int = 0
    wraps: int = 0
    kept: int = 0
    flown: int = 0
    wrong: int = 0
    wide: int = 0
    wide_cells: int = 0
    lost: int = 0
    counted: int = 0
    counted_wraps: int = 0
    cpu_s: float = 0.0


def problem_of(text: str) -> Problem:
    """Of the module of a program."""
    flat = system_of(check_file("boat.soter", text), None)
    return extract(flat, flat.modules[0])


def kept(problem: Problem) -> tuple[GridGroup, NDArray[np.bool_]]:
    """The engine, and K."""
    engine = GridGroup.for_group(library_of(problem)[0], problem, problem.groups[0])
    return engine, engine.compute_core(engine.compute_constraint()).cells


def looked_at(seed: int, wide: bool) -> dict[str, Any]:
    """One plant: a `Row`; `wide`: with an axis of five turns."""
    row, began = Row(), cpu_now_s()
    drawn, chance = Drawn(seed), np.random.default_rng(seed)
    problem = problem_of(drawn.text(CELLS))
    engine, core = kept(problem)
    row.systems += 1
    row.wraps += bool(problem.quantities.turning)
    row.kept += bool(core.any())
    for text in counted(drawn, CELLS):
        row.counted += 1
        row.counted_wraps += bool(problem_of(text).quantities.turning)
    if core.any():
        at = np.argwhere(core)
        at = at[chance.integers(0, len(at), size=RUNS)]
        share = chance.choice([1e-9, 1.0 - 1e-9, 0.5], size=at.shape)
        ends = [np.stack([e[at[:, k] + s] for k, e in enumerate(engine.edges)]) for s in (0, 1)]
        x = ends[0] + share.T * (ends[1] - ends[0])
        x[-1] += 2 * math.pi * chance.integers(-TURNS, TURNS + 1, size=RUNS)
        fine = drawn.flown(x, chance, HOLDS, problem.times.delay_sc * 1e-9)
        row.flown += RUNS
        row.wrong += int((~fine).sum())
    if wide and not drawn.from_zero:
        _, long = kept(problem_of(drawn.text(CELLS, turns=5)))
        middle = long[..., 2 * CELLS : 3 * CELLS]
        row.wide += 1
        row.wide_cells += int(middle.sum())
        row.lost += int((middle & ~core).sum())
    row.cpu_s = cpu_now_s() - began
    return asdict(row)


def main() -> int:
    """Exit code 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--systems", type=int, default=300)
    parser.add_argument("--wide", type=int, default=3)
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "wrapping")
    options = parser.parse_args()
    compiled_enclosures.UNIT_LEVEL = "-O1"  # the same bits, and many small modules are compiled
    drawing = ROOT / "tests" / "generators" / "turning_systems.py"
    reader = tool() + "".join(file.read_text() for file in (Path(__file__), drawing))
    found = Counter[str]()
    for seed in range(options.systems):
        wide = bool(options.wide) and seed % options.wide == 0
        about = (str((seed, wide)), reader)
        found.update(kept_answer(options.kept, about, partial(looked_at, seed, wide)))
    row = Row(**found)
    print(
        f"{row.systems} drawn plants, {row.wraps} with an axis that wraps around, a K of {row.kept}"
    )
    print(f"wrong: {row.wrong} of {row.flown:,} runs from K; target 0")
    print(f"lost: {row.lost} of {row.wide_cells:,} cells that {row.wide} axes of five turns keep")
    print(f"{row.counted} where somebody counts turns, {row.counted_wraps} wrap; target 0")
    print(f"{row.cpu_s:.0f} s of CPU")
    return int(bool(row.wrong or row.counted_wraps))


if __name__ == "__main__":
    sys.exit(main())
