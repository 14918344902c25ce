"""Slopes and lines: exact where they can be, and their errors where they cannot."""

from __future__ import annotations

import numpy as np
import pytest

from soter.monitor.derived_signals import ahead_errors, quantiles, slope_errors, slopes
from tables import all_rows


def times(seed: int, n: int = 60) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).uniform(0.05, 0.15, n))


@pytest.mark.parametrize("seed", range(5))
def test_a_slope_is_that_of_the_parabola_of_least_squares(seed: int) -> None:
    t = times(seed)
    x = np.sin(t) + 0.01 * np.random.default_rng(seed).normal(size=len(t))
    slope_values = slopes(t, x, 0.5)
    tried = 0
    for i in range(len(t)):
        near = (t <= t[i]) & (t >= t[i] - 0.5 * (1 + 1e-9))
        if near.sum() >= 3:
            assert slope_values[i] == pytest.approx(
                np.polyfit(t[near] - t[i], x[near], 2)[1], abs=1e-8
            )
            tried += 1
    assert tried > 50


@all_rows("n", [2, 3, 4, 60])
@all_rows("window", [0.01, 0.5, 100.0])
def test_a_parabola_has_its_own_slope_whatever_the_window(n: int, window: float) -> None:
    t = times(3, n) + 1e6  # far from the beginning of time
    u = t - t[0]
    x = 2.0 + 3.0 * u - (0.7 * u * u if n > 2 else 0.0)
    exact = 3.0 - (1.4 * u if n > 2 else 0.0 * u)
    exact[1] = (x[1] - x[0]) / u[1]
    slope_values = slopes(t, x, window)
    assert np.isnan(slope_values[0])
    assert np.allclose(slope_values[1:], exact[1:], atol=1e-6)
    assert slope_errors(t, x, window, slopes(t, x, window)).max(initial=0.0) < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_the_error_of_lines_is_about_what_they_miss(seed: int) -> None:
    """Against samples that were there twice as often."""
    fine = np.linspace(0.0, 6.0, 121)
    x = np.sin((1 + seed) * fine)
    told = quantiles(ahead_errors(fine[::2], x[::2], 1.0))
    assert told is not None
    half = x[2:-2:2] + (x[2:-2:2] - x[:-4:2]) / 2  # half-way to the next sample
    missed = float(np.abs(half - x[3:-1:2]).max())
    assert missed < told[2] < 4 * missed


def test_of_nothing_there_is_no_error() -> None:
    assert quantiles(np.zeros(0)) is None
    assert len(ahead_errors(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 2.0)) == 0
    assert len(ahead_errors(np.array([0.0, 1.0, 9.0]), np.zeros(3), 2.0)) == 0, "across a gap"
