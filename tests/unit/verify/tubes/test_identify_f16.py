"""What `bench/tubes/identify_f16.py` fits and bounds, of flights that are made by a known rule."""

import random
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[4]
sys.path.insert(0, str(ROOT))

from bench.tubes import identify_f16 as bench  # noqa: E402

TRUE = bench.Fit(rate=0.3, level=210.0, weight=5.0)


def made(seed: int, sink: float, thrust: float) -> np.ndarray:
    """A flight of the model itself, under disturbances of these sizes that switch sign."""
    draw = random.Random(seed)  # noqa: S311 - no secret
    rows = [np.array([2000.0, draw.uniform(180.0, 230.0), 0.0, 0.0, 0.0, 0.0])]
    signs, path = [1.0, -1.0], 0.0
    for k in range(1000):
        if k % 50 == 0:
            signs, path = [draw.choice([-1.0, 1.0]) for _ in signs], draw.uniform(-0.7, 0.4)
        now = rows[-1].copy()
        now[2:5] += 0.02 * (path - now[2:5])
        # midpoints, as the bench reads them, so that nothing is left but what is put in
        a, b = TRUE.rate, bench.PERIOD_S
        down = -0.5 * (np.sin(rows[-1][4]) + np.sin(now[4]))
        v, free = rows[-1][1], a * TRUE.level + TRUE.weight * down + signs[1] * thrust
        now[1] = (v * (1 - 0.5 * a * b) + b * free) / (1 + 0.5 * a * b)
        climb = 0.5 * (v * np.sin(rows[-1][4]) + now[1] * np.sin(now[4]))
        now[0] += b * (climb + signs[0] * sink)
        rows.append(now)
    return np.array(rows)


def test_a_flight_of_the_model_itself_gives_the_model_and_nothing_is_left() -> None:
    flights = [made(seed, 0.0, 0.0) for seed in range(4)]
    fit = bench.fitted(flights)
    assert (fit.rate, fit.level, fit.weight) == pytest.approx((0.3, 210.0, 5.0), rel=1e-6)
    assert bench.bound([bench.sinks(f) for f in flights]) < 1e-6
    assert bench.bound([bench.thrusts(f, fit) for f in flights]) < 1e-6


@pytest.mark.parametrize("size", [0.5, 4.0])
def test_a_bound_is_what_was_put_in_times_the_margin(size: float) -> None:
    flights = [made(seed, size, 0.0) for seed in range(4)]
    assert bench.bound([bench.sinks(f) for f in flights], 1.0) == pytest.approx(size, rel=1e-6)
    assert bench.bound([bench.sinks(f) for f in flights], 1.25) == pytest.approx(1.25 * size)
    pushed = [made(seed, 0.0, size) for seed in range(4)]
    left = bench.bound([bench.thrusts(f, TRUE) for f in pushed], 1.0)
    assert left == pytest.approx(size, rel=1e-6)


def test_disturbances_that_have_no_side_hardly_move_the_fit() -> None:
    fit = bench.fitted([made(seed, 3.0, 3.0) for seed in range(20)])
    assert (fit.rate, fit.level) == pytest.approx((0.3, 210.0), rel=0.1)


def test_a_path_that_is_read_a_lag_too_early_leaves_more() -> None:
    flights = [made(seed, 0.0, 0.0) for seed in range(2)]
    for f in flights:
        f[1:, bench.PATH] = f[:-1, bench.PATH] + 0.1
    early = bench.bound([bench.sinks(f, bench.PATH) for f in flights])
    assert early > 10.0 > bench.bound([bench.sinks(f) for f in flights])


def test_the_bounds_of_the_program_are_those_of_its_text() -> None:
    text = bench.PROGRAM.read_text(encoding="utf-8")
    for name, (low, high) in bench.declared().items():
        assert f"disturbance {name}: float in [{low}, {high}];" in text
    assert set(bench.declared()) == {"sink", "thrust"}
