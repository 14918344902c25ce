"""Arb balls: the arithmetic of this room, and the linear enclosures of single functions.

Purpose: precision, outward conversion to doubles, and for each function that an operation of the
language needs a line with a remainder that encloses it over an interval: f(x) in slope x + offset
+- spread for every x in [low, high], and f(x) in [least, most].
Non-goals: functions of the prelude (`extras/prelude_functions.py`); knowing about programs
(`reading/symbolic_reading.py`) or sets (`cell_sets.py`).

Everything here is an `arb`: a midpoint and a radius, operations rounded outwards by Arb. Bounds
such as `low` are balls themselves, so that comparing them is only true where it is certain. The
precision is far above that of doubles: sums of doubles of like size are exact, so that a set which
ends at the edge of a cell still ends there.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import reduce
from typing import TYPE_CHECKING, TypeAlias

import flint
from flint import arb, fmpq

from soter.certificate.extras import extras

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Function = Callable[[arb], arb]
    Range = tuple[arb, arb]


PRECISION = 128
"""Bits; doubles have 53."""
flint.ctx.prec = PRECISION

ZERO = arb(0)
ONE = arb(1)
HALF = arb(0.5)
UNIT = arb(0, 1)
"""The ball [-1, 1]."""
UNIT_ROUNDOFF = arb(2) ** -53
TINIEST = arb(2) ** -1074

Line: TypeAlias = "tuple[arb, arb, arb, arb, arb]"
"""slope, offset, spread, least, most."""


def exact(value: float | Fraction) -> arb:
    """The ball of a number; for a double it has no radius."""
    if isinstance(value, Fraction):
        return arb(fmpq(value.numerator, value.denominator))
    return arb(value)


def lower(x: arb) -> float:
    """A double that is at most every number in the ball; -inf if no double is."""
    near = float(x)
    if x >= near:
        return near
    near = math.nextafter(near, -math.inf)
    if x >= near:
        return near
    far = math.nextafter(float(x.lower()), -math.inf)
    return far if x >= far else -math.inf


def greatest_below(bound: float, added: float) -> float:
    """The greatest double whose rounded sum with `added` is at most `bound`."""
    step = 4 * max(math.ulp(bound), math.ulp(added))
    low, high = bound - added - step, bound - added + step
    while (middle := low / 2 + high / 2) not in (low, high):
        low, high = (middle, high) if middle + added <= bound else (low, middle)
    return low


def upper(x: arb) -> float:
    """A double that is at least every number in the ball; inf if no double is."""
    near = float(x)
    if x <= near:
        return near
    near = math.nextafter(near, math.inf)
    if x <= near:
        return near
    far = math.nextafter(float(x.upper()), math.inf)
    return far if x <= far else math.inf


def ball_key(x: arb) -> object:
    """A key for a ball; only equal balls have equal keys."""
    if not x.is_finite():
        return (arb, id(x))
    return (arb, *x.mid().man_exp(), *x.rad().man_exp())


def magnitude(x: arb) -> arb:
    """The largest absolute value in the ball, without radius."""
    return arb(abs(x).upper())


def hull(low: arb, high: arb) -> arb:
    """A ball over all numbers between two balls."""
    return low.union(high)


def larger(a: arb, b: arb) -> arb:
    """The larger of two lower bounds if that is certain, else the second."""
    return max(b, a)


def smaller(a: arb, b: arb) -> arb:
    """The smaller of two upper bounds if that is certain, else the second."""
    return min(b, a)


# ---------------------------------------------------------------- lines over functions


def _clip_to_unit(x: arb) -> arb:
    """The middle of x, moved into [0, 1]; 1/2 if x is not finite."""
    return x.mid().max(ZERO).min(ONE) if x.is_finite() else HALF


def line_max0(low: arb, high: arb) -> Line:
    """The line over max(x, 0), which is convex: its distance from the line is largest at an end."""
    if low >= 0:
        return ONE, ZERO, ZERO, low, high
    if high <= 0:
        return ZERO, ZERO, ZERO, ZERO, ZERO
    slope = _clip_to_unit(high / (high - low))
    most = (-slope * low).max((ONE - slope) * high).max(ZERO)
    half = most * HALF
    return slope, half, half, ZERO, high.max(ZERO)


def range_max0(low: arb, high: arb) -> tuple[arb, arb]:
    """The range of max(x, 0) for x in [low, high], as in `line_max0`."""
    return larger(low, ZERO), high.max(ZERO)


def line_noisy_max0(low: arb, high: arb, noise: arb) -> tuple[arb, arb, arb, arb]:
    """max(x + n, 0) for x in [low, high], |n| <= noise, as slope x + kept n + offset +- spread.

    If x + n is never negative, the result is x + n. Otherwise it lies below the chord of the convex
    max(x + noise, 0) and above max(x - noise, 0), which is nearest to a line of that slope at x =
    noise. This is tighter than a line over x + n if x alone decides.
    """
    if high + noise <= 0:
        return ZERO, ZERO, ZERO, ZERO
    if low - noise >= 0:
        return ONE, ONE, ZERO, ZERO
    last = (high + noise).max(ZERO)
    slope = _clip_to_unit(last / (high - low))  # of the chord: 1 where low + noise is above 0
    # for every slope in [0, 1]: there x + noise is farthest above at high, elsewhere 0 is at low
    over = (-slope * low).max(last - slope * high)
    nearest = noise.max(low).min(high)
    under = (nearest - noise).max(ZERO) - slope * nearest
    return slope, ZERO, (over + under) * HALF, (over - under) * HALF


def line_or_range(
    offset: arb, spread: arb, low: arb, high: arb, more: arb = ZERO
) -> tuple[arb, arb, arb]:
    """(weight, offset, spread): weight 1 for the line, or 0 for the range if it spreads less.

    A number in slope x + offset +- spread and in [low, high] is in weight slope x + offset +-
    spread. `more`: the line's spread from free inputs, half of which counts, as it may cancel.
    """
    half, least = (high - low) * HALF, spread + more * HALF
    if half < least or not least.is_finite():
        return ZERO, (low + high) * HALF, half
    return ONE, offset, spread


def _least_size(low: arb, high: arb) -> arb:
    """A lower bound of |x| for x in [low, high]."""
    return larger(-high, larger(low, ZERO))


def line_abs(low: arb, high: arb) -> Line:
    """The line over |x| = 2 max(x, 0) - x."""
    slope, offset, spread, _, _ = line_max0(low, high)
    return 2 * slope - 1, 2 * offset, 2 * spread, _least_size(low, high), (-low).max(high)


def line_square(low: arb, high: arb) -> Line:
    """The line over x^2: the middle tangent, plus up to the square of the distance from it."""
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    half = far * far * HALF
    least, most = _least_size(low, high), (-low).max(high)
    return 2 * middle, half - middle * middle, half, least * least, most * most


def line_floor(low: arb, high: arb) -> Line:
    """The line over floor(x): a constant if both ends agree, else x - 1/2 +- 1/2."""
    first, last = low.lower().floor(), high.upper().floor()
    if first == last:
        return ZERO, first, ZERO, first, last
    return ONE, -HALF, HALF, first, last


def line_truncated(low: arb, high: arb) -> Line:
    """The line over x rounded towards 0: less than 1 from x, and never farther from 0 than x."""
    first, last = (x.floor() if x >= 0 else x.ceil() for x in (low.lower(), high.upper()))
    if first == last:
        return ZERO, first, ZERO, first, last
    up, down = (ZERO if low >= 0 else ONE), (ZERO if high <= 0 else ONE)
    return ONE, (up - down) * HALF, (up + down) * HALF, first, last


def least_and_greatest(values: Sequence[arb]) -> Range:
    """The least and the greatest of some numbers."""
    return reduce(arb.min, values), reduce(arb.max, values)


def monotone_range(f: Function, low: arb, high: arb) -> Range:
    """The range of a function that is monotone on [low, high]."""
    return least_and_greatest((f(low), f(high)))


def tangent(
    f: Function,
    slope: Function,
    curve: Callable[[arb, arb], arb],
    ends: Callable[[Function, arb, arb], Range],
    low: arb,
    high: arb,
) -> Line:
    """The line of a smooth f, tangent in the middle: f - tangent = curve(v, f(v)) (x - middle)^2.

    This holds for some v. `curve` is f''/2; `ends` gives the range, used if `curve` is infinite.
    """
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    s = slope(middle).mid()
    least, most = ends(f, low, high)
    value, off_slope = hull(least, most), (slope(middle) - s) * far * UNIT
    rest = curve(hull(low, high), value) * (far * far) * arb(0.5, 0.5) + off_slope
    if not rest.is_finite():
        return ZERO, value.mid(), arb(value.rad()), least, most
    return s, f(middle) - s * middle + rest.mid(), arb(rest.rad()), least, most


def line_inverse(low: arb, high: arb) -> Line:
    """The line over 1 / x; infinite if x may be 0."""
    if not (low > 0 or high < 0):
        return unbounded_line()
    slope, curve = (lambda v: -1 / (v * v)), (lambda _, y: y * y * y)
    return tangent(lambda v: 1 / v, slope, curve, monotone_range, low, high)


def line_sqrt(low: arb, high: arb) -> Line:
    """The line over sqrt(x) for all x >= 0 of the interval."""
    low = larger(low, ZERO)
    if not low > 0:
        top = high.max(ZERO).upper().sqrt()
        half = top * HALF
        return ZERO, half, half, ZERO, top
    root = low.sqrt()
    top = high.sqrt()
    # between chord (below, as sqrt is concave) and the parallel tangent (above)
    slope = (1 / (root + top)).mid()
    under = (root - slope * low).min(top - slope * high)
    over = 1 / (4 * slope)
    return slope, (under + over) * HALF, (over - under) * HALF, root, top


def line_soft_sign(low: arb, high: arb) -> Line:
    """The line over x / (1 + |x|), which rises, is odd, and is concave on x >= 0.

    There it is at most slope x + (1 - sqrt(slope))^2, which a tangent reaches; least at an end.
    """
    if not (low.is_finite() and high.is_finite()):
        return ZERO, ZERO, ONE, -ONE, ONE
    first, last = low / (1 + abs(low)), high / (1 + abs(high))
    slope = _clip_to_unit((last - first) / (high - low))
    ends, hump = (first - slope * low, last - slope * high), (1 - slope.sqrt()) ** 2
    over, under = ends[0].max(ends[1]), ends[0].min(ends[1])
    if not high <= 0:
        over = over.max(hump)
    if not low >= 0:
        under = under.min(-hump)
    return slope, (over + under) * HALF, (over - under) * HALF, first, last


def unbounded_line() -> Line:
    """The line over a function that may have any value or no value."""
    far = arb.pos_inf()
    return ZERO, ZERO, far, -far, far


FUNCTIONS: dict[str, Callable[[arb, arb], Line]] = {
    "max0": line_max0,
    "abs": line_abs,
    "square": line_square,
    "floor": line_floor,
    "truncated": line_truncated,
    "inverse": line_inverse,
    "sqrt": line_sqrt,
    "soft_sign": line_soft_sign,
}
"""Exact functions of one variable; those of the prelude: `extras/prelude_functions.py`."""


def line_function(name: str) -> Callable[..., tuple[arb, ...]]:
    """The function of ends that computes the line over the function called `name`."""
    return FUNCTIONS.get(name) or extras.prelude_functions.FUNCTIONS[name]
