"""What a log does not hold, from what it does: slopes and values between samples.

Purpose: both with a measure of their error that comes from the same samples.
Non-goals: filters; what is derived here has seen samples that came later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LEAST = 3
"""A parabola needs so many points."""


def slopes(times_s: Floats, values: Floats, window_s: float) -> Floats:
    """Slope at each sample of the parabola of least squares over a window around it.

    times_s, values: (n,), n >= 2, times ascending; gives (n,). At the ends the window is cut; where
    it holds fewer than three samples it takes the nearest three, or all.
    """
    found = np.empty(len(times_s))
    half = window_s / 2 * (1 + 1e-9)
    low = np.searchsorted(times_s, times_s - half, side="left")
    high = np.searchsorted(times_s, times_s + half, side="right")
    for i, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        if b - a < LEAST:
            a, b = _nearest(i, len(times_s))  # noqa: PLW2901 - a wider window
        found[i] = _slope(times_s[a:b] - times_s[i], values[a:b])
    return found


def _nearest(i: int, n: int) -> tuple[int, int]:
    first = min(max(i - 1, 0), max(n - LEAST, 0))
    return first, min(first + LEAST, n)


def _slope(d: Floats, y: Floats) -> float:
    """Slope at d = 0 of the parabola, of the line where there are two points; d, y: (k,)."""
    if len(d) < LEAST:
        return float((y[1] - y[0]) / (d[1] - d[0]))
    unit = float(np.abs(d).max())
    e, y0 = d / unit, y - y[0]
    s = [float(len(e)), *(float((e**k).sum()) for k in (1, 2, 3, 4))]
    t0, t1, t2 = (float((e**k * y0).sum()) for k in (0, 1, 2))
    whole = _determinant((s[0], s[1], s[2]), (s[1], s[2], s[3]), (s[2], s[3], s[4]))
    part = _determinant((s[0], t0, s[2]), (s[1], t1, s[3]), (s[2], t2, s[4]))
    return part / whole / unit


def _determinant(
    a: tuple[float, float, float], b: tuple[float, float, float], c: tuple[float, float, float]
) -> float:
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def slope_errors(times_s: Floats, values: Floats, window_s: float, found: Floats) -> Floats:
    """How far the slopes are from those over half the window; times_s, values, found: (n,).

    Where both windows hold the same samples that says nothing and is left out.
    """
    half = slopes(times_s, values, window_s / 2)
    gaps = np.abs(found - half)
    return gaps[gaps > 0.0]


def between_errors(times_s: Floats, values: Floats) -> Floats:
    """What straight lines between samples miss, (m,): times_s, values (n,).

    Each sample is compared with the line between its neighbours, which is twice as long as those
    that are used; the error of a line grows with the square of its length, so a quarter of that.
    """
    if len(times_s) < LEAST:
        return np.zeros(0)
    a, b = times_s[:-2], times_s[2:]
    share = (times_s[1:-1] - a) / (b - a)
    line = values[:-2] + share * (values[2:] - values[:-2])
    return np.asarray(np.abs(values[1:-1] - line) / 4, dtype=np.float64)


def quantiles(errors: Floats) -> tuple[float, float, float]:
    """Half of the errors, 95 % of them and all are below; errors (n,). Zeros for none."""
    if not len(errors):
        return 0.0, 0.0, 0.0
    low, high, most = np.quantile(errors, [0.5, 0.95, 1.0])
    return float(low), float(high), float(most)
