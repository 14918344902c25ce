"""Sine and cosine of arrays of balls.

Purpose: `sine`, `cosine`: from values at multiples of 1/32 that Arb computes, and Taylor's series
between them.
Non-goals: other functions.
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import GROWN, BallArray, chosen
from soter.certificate.terms.arb_balls import exact

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats

PER_ONE = 32
"""Known values per unit: a power of two, so that the multiples are exact."""
FARTHEST = 64.0
"""Of what is farther from 0 only that it is between -1 and 1."""
DEGREE = 9
"""Terms of the series."""
INVERSE_FACTORIALS = [BallArray.of(1 / exact(float(factorial(k)))) for k in range(DEGREE)]
NARROW = 1e-6
"""Radii up to which the slope does not matter."""
KNOWN = [np.full((2, 2 * int(FARTHEST) * PER_ONE + 1), np.nan) for _ in range(4)]
"""Centres and radii of the sine's derivatives at -FARTHEST, ... and FARTHEST, from place 0 on;
those at places below 0 stand at the end, as an index of numpy has it."""
LEFT_OUT = 2.0**-72
"""More than (1/64)^9/9!, what the next term may be."""


def sine(x: BallArray) -> BallArray:
    """sin(x)."""
    return _around(x, 0)


def cosine(x: BallArray) -> BallArray:
    """cos(x)."""
    return _around(x, 1)


def _around(x: BallArray, turns: int) -> BallArray:
    """The `turns`th derivative f of the sine: |f(x) - f(c)| <= r (|f'(c)| + r), and <= r."""
    value, radius = _at(x.centre, turns)
    if x.radius is not None:
        more = x.radius
        if (more > NARROW).any():
            slope, off = _at(x.centre, turns + 1)
            more = more * np.minimum(np.abs(slope) + off + more, 1.0) * GROWN
        radius = (radius + more) * GROWN
    ball = BallArray(value, radius)
    low, high = np.maximum(ball.lower(), -1.0), np.minimum(ball.upper(), 1.0)
    cut = ~(np.abs(value) + radius < 1.0)  # and what is no number
    ends = BallArray.between(np.where(low <= 1.0, low, -1.0), np.where(high >= -1.0, high, 1.0))
    return chosen(cut, ends, ball)


def _at(centre: Floats, turns: int) -> tuple[Floats, Floats]:
    """Values of the `turns`th derivative of the sine, and how far they may be off."""
    near = np.abs(centre) <= FARTHEST
    centre = np.where(near, centre, 0.0)
    step = np.rint(centre * PER_ONE)
    off = BallArray(centre) - BallArray(step / PER_ONE)
    places = step.astype(np.intp)
    total = BallArray(np.zeros(1))
    for k in range(DEGREE - 1, -1, -1):
        total = total * off + _derivatives(places, (turns + k) % 4) * INVERSE_FACTORIALS[k]
    assert total.radius is not None
    radius = (total.radius + LEFT_OUT) * GROWN
    return np.where(near, total.centre, 0.0), np.where(near, radius, 1.0)


def _derivatives(places: NDArray[np.intp], turns: int) -> BallArray:
    """The sine's derivative at known values, looked up; what was not asked for is computed."""
    centres, radii = KNOWN[turns]
    new = np.unique(places[np.isnan(centres[places])])
    for place in new:
        centres[place], radii[place] = _derivative(int(place), turns)
    return BallArray(centres[places], radii[places])


def _derivative(place: int, turns: int) -> tuple[float, float]:
    """Centre and radius of the sine's derivative at a known value."""
    x = exact(place / PER_ONE)
    value = (x.sin(), x.cos(), -x.sin(), -x.cos())[turns]
    ball = BallArray.of(value)
    radius = 0.0 if ball.radius is None else float(ball.radius[0])
    return float(ball.centre[0]), radius
