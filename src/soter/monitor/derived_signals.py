"""Derives signals that a log does not hold: slopes, and values after the last sample.

Purpose: `window_slopes`, and the errors of slopes and of lines through the last two samples. All
use samples up to their time only, as a monitor in flight would have them. Angles are compared
modulo their turn; other signals have an infinite turn.
Non-goals: filters; anything that has seen samples that came later.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.core.layout import Floats


ROUNDED = 1e-3
"""Angles at the ends of a turn may be rounded by this share of it."""
LEAST = 3
"""A parabola needs so many points."""


def window_slopes(times_s: Floats, values: Floats, window_s: float) -> Floats:
    """The slope at each sample of the least-squares parabola over the window up to the sample.

    times_s, values and the result have shape (n,); times ascend. If the window has fewer than three
    samples, the last three are taken, or the line through the first two. The first slope is NaN.
    """
    derivatives = np.full(len(times_s), np.nan)
    first = np.searchsorted(times_s, times_s - window_s * (1 + 1e-9), side="left")
    for i in range(1, len(times_s)):
        a = min(int(first[i]), max(i + 1 - LEAST, 0))
        derivatives[i] = _slope_at_end(times_s[a : i + 1] - times_s[i], values[a : i + 1])
    return derivatives


def begin_of_turn(values: Sequence[float], turn: float) -> float:
    """The begin of a turn that contains all values: -turn/2, 0 or another; NaN if none does."""
    low, high, slack = min(values), max(values), ROUNDED * turn
    begins = (-turn / 2, 0.0, (low + high - turn) / 2) if math.isfinite(turn) else ()
    return next((a for a in begins if a - slack <= low and high <= a + turn + slack), math.nan)


def value_on_line(a: float, b: float, share: float, turn: float, begin: float) -> float:
    """The value at b + `share` (b - a), in the turn that starts at `begin` if it is an angle."""
    x = b + share * math.remainder(b - a, turn)
    return x if math.isnan(begin) or 0 <= x - begin <= turn else begin + (x - begin) % turn


def _slope_at_end(d: Floats, y: Floats) -> float:
    """The slope at d = 0 of the parabola through points, or of the line through two; d, y: (k,)."""
    if len(d) < LEAST:
        return float((y[1] - y[0]) / (d[1] - d[0]))
    unit = float(np.abs(d).max())
    e, y0 = d / unit, y - y[0]
    s = [float(len(e)), *(float((e**k).sum()) for k in (1, 2, 3, 4))]
    t0, t1, t2 = (float((e**k * y0).sum()) for k in (0, 1, 2))
    denominator = _determinant((s[0], s[1], s[2]), (s[1], s[2], s[3]), (s[2], s[3], s[4]))
    numerator = _determinant((s[0], t0, s[2]), (s[1], t1, s[3]), (s[2], t2, s[4]))
    return numerator / denominator / unit


def _determinant(
    a: tuple[float, float, float], b: tuple[float, float, float], c: tuple[float, float, float]
) -> float:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def slope_errors(times_s: Floats, values: Floats, window_s: float, derivatives: Floats) -> Floats:
    """Differences of slopes from slopes over half the window; times_s, values, derivatives: (n,).

    Samples for which both windows contain the same samples are left out.
    """
    half = window_slopes(times_s, values, window_s / 2)
    gaps = np.abs(derivatives - half)
    return gaps[gaps > 0.0]


def line_errors(times_s: Floats, values: Floats, gap_s: float) -> Floats:
    """Distances (m,) of `values` (n,) from the line through the two before, all within `gap_s`."""
    if len(times_s) < LEAST:
        return np.zeros(0)
    steps = np.diff(times_s)
    near = (steps[:-1] <= gap_s) & (steps[1:] <= gap_s)
    line = values[1:-1] + steps[1:] / steps[:-1] * np.diff(values)[:-1]
    return np.asarray(np.abs(values[2:] - line)[near], dtype=np.float64)


def error_quantiles(errors: Floats) -> tuple[float, float, float] | None:
    """The 50 %, 95 % and 100 % quantiles of errors (n,); None if `errors` is empty."""
    if not len(errors):
        return None
    low, high, most = np.quantile(errors, [0.5, 0.95, 1.0])
    return float(low), float(high), float(most)
