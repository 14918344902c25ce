"""Others that announce their speed, and several at once: bounds that are no less than what is.

Purpose: in `examples/exploration/announced.soter` nobody is hit by a robot that moves, and the
bound of what the others do holds; the least of several distances changes as one of them may.
Non-goals: the proof (`docs/exploration.md` says what is not decided).
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter

FILE = Path(__file__).resolve().parents[2] / "examples" / "exploration" / "announced.soter"


@pytest.mark.parametrize("kind", ["Hunting", "Luring", "Strolling"])
def test_nobody_is_hit_and_no_speed_exceeds_its_bound(kind: str) -> None:
    program = soter.load(FILE)
    for seed in range(1, 4):
        run = program.simulate(system="Hunted", seed=seed, params={"walkers.KIND": kind})
        assert run.violations == 0, run.violation_list


def test_robots_are_hit_where_nobody_switches() -> None:
    program = soter.load(FILE)
    runs = [program.simulate(system="Bare", seed=seed) for seed in range(1, 4)]
    assert sum(run.violations for run in runs) > 0


WALKERS = soter.load(FILE.with_name("walkers.soter"))
PLACE = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
STEP = st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 2.0 * math.pi))


@given(st.lists(st.tuples(PLACE, STEP), min_size=3, max_size=3), st.floats(-1.2, 1.2))
def test_the_least_of_several_distances_changes_as_one_of_them_may(
    people: list[tuple[tuple[float, float], tuple[float, float]]], v: float
) -> None:
    nearest = WALKERS.function("nearest")

    def least(s: float) -> float:
        """`nearest` of `walkers.soter` after s seconds."""
        everybody = [
            {
                "p": {"x": x + s * w * math.cos(a), "y": y + s * w * math.sin(a)},
                "v": {"x": 0.0, "y": 0.0},
                "leaving": False,
                "near": False,
            }
            for (x, y), (w, a) in people
        ]
        disc = {"p": {"x": s * v, "y": 0.0}, "v": {"x": v, "y": 0.0}, "radius": 0.3, "fast": 1.2}
        return float(nearest(everybody, disc))

    assert abs(least(0.5) - least(0.0)) <= 0.5 * (1.0 + abs(v)) + 1e-9
