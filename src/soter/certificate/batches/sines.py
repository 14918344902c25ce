"""Sine and cosine of arrays of balls.

Purpose: `sine`, `cosine`: from values at multiples of 1/32 that Arb computes, and Taylor's series
between them.
Non-goals: other functions.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import GROWN, BallArray
from soter.certificate.terms.arb_balls import exact

if TYPE_CHECKING:
    from soter.certificate.batches.ball_arrays import Floats

PER_ONE = 32
"""Known values per unit: a power of two, so that the multiples are exact."""
FARTHEST = 64.0
"""Of what is farther from 0 only that it is between -1 and 1."""
DEGREE = 9
"""Terms of the series."""
LEFT_OUT = 2.0**-72
"""More than (1/64)^9/9!, what the next term may be."""


def sine(x: BallArray) -> BallArray:
    """sin(x): |sin x - sin c| <= |x - c|."""
    return _around(x, 0)


def cosine(x: BallArray) -> BallArray:
    """cos(x)."""
    return _around(x, 1)


def _around(x: BallArray, turns: int) -> BallArray:
    """The `turns`th derivative of the sine."""
    near = np.abs(x.centre) <= FARTHEST
    centre = np.where(near, x.centre, 0.0)
    step = np.rint(centre * PER_ONE)
    off = BallArray(centre) - BallArray(step / PER_ONE)
    places, known = np.unique(step.astype(np.int64), return_inverse=True)
    total = BallArray(np.zeros(1))
    for k in range(DEGREE - 1, -1, -1):
        values = [_derivative(int(p), (turns + k) % 4) for p in places]
        factor = BallArray(*(np.array(v) for v in zip(*values, strict=True))).taken(known)
        total = total * off + factor * BallArray.of(1 / exact(float(factorial(k))))
    assert total.radius is not None
    radius: Floats = (total.radius + LEFT_OUT) * GROWN
    if x.radius is not None:
        radius = (radius + x.radius) * GROWN
    wide = ~near | ~(radius < 1.0)
    return BallArray(np.where(wide, 0.0, total.centre), np.where(wide, 1.0, radius))


@lru_cache(maxsize=1 << 16)
def _derivative(place: int, turns: int) -> tuple[float, float]:
    """Centre and radius of the sine's derivative at a known value."""
    x = exact(place / PER_ONE)
    value = (x.sin(), x.cos(), -x.sin(), -x.cos())[turns]
    ball = BallArray.of(value)
    radius = 0.0 if ball.radius is None else float(ball.radius[0])
    return float(ball.centre[0]), radius
