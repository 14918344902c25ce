"""Arb balls: the arithmetic of this room, and the linear enclosures of single functions.

Purpose: precision, outward conversion to doubles, and for each function that a program may use a
line with a remainder that encloses it over an interval: f(x) in slope x + offset +- spread for
every x in [low, high], and f(x) in [least, most].
Non-goals: knowing about programs (`reading/symbolic_reading.py`) or sets (`cell_sets.py`).

Everything here is an `arb`: a midpoint and a radius, operations rounded outwards by Arb. Bounds
such as `low` are balls themselves, so that comparing them is only true where it is certain. The
precision is far above that of doubles: sums of doubles of like size are exact, so that a set which
ends at the edge of a cell still ends there.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import flint
from flint import arb, fmpq

if TYPE_CHECKING:
    from collections.abc import Callable


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
    """The number as a ball: without radius for a double."""
    if isinstance(value, Fraction):
        return arb(fmpq(value.numerator, value.denominator))
    return arb(value)


def below(x: arb) -> float:
    """A double that is no larger than anything in the ball; -inf where there is none."""
    near = float(x)
    if x >= near:
        return near
    near = math.nextafter(near, -math.inf)
    if x >= near:
        return near
    far = math.nextafter(float(x.lower()), -math.inf)
    return far if x >= far else -math.inf


def greatest_below(bound: float, added: float) -> float:
    """The greatest double whose rounded sum with `added` does not exceed the bound."""
    step = 4 * max(math.ulp(bound), math.ulp(added))
    low, high = bound - added - step, bound - added + step
    while (middle := low / 2 + high / 2) not in (low, high):
        low, high = (middle, high) if middle + added <= bound else (low, middle)
    return low


def above(x: arb) -> float:
    """A double that is no smaller than anything in the ball; inf where there is none."""
    near = float(x)
    if x <= near:
        return near
    near = math.nextafter(near, math.inf)
    if x <= near:
        return near
    far = math.nextafter(float(x.upper()), math.inf)
    return far if x <= far else math.inf


def key_of(x: arb) -> object:
    """A key for a ball, equal for equal balls only."""
    if not x.is_finite():
        return (arb, id(x))
    return (arb, *x.mid().man_exp(), *x.rad().man_exp())


def magnitude(x: arb) -> arb:
    """The largest absolute value in the ball, without radius."""
    return arb(abs(x).upper())


def hull(low: arb, high: arb) -> arb:
    """The ball over everything between."""
    return low.union(high)


def larger(a: arb, b: arb) -> arb:
    """One of two lower bounds: the better one where that is certain, else the second."""
    return max(b, a)


def smaller(a: arb, b: arb) -> arb:
    """One of two upper bounds: the better one where that is certain, else the second."""
    return min(b, a)


# ---------------------------------------------------------------- lines over functions


def _share(x: arb) -> arb:
    """A number in [0, 1]: where x is, though its middle may be rounded beyond; any if nowhere."""
    return x.mid().max(ZERO).min(ONE) if x.is_finite() else HALF


def line_max0(low: arb, high: arb) -> Line:
    """max(x, 0): convex, so its distance above any line through 0 is largest at an end."""
    if low >= 0:
        return ONE, ZERO, ZERO, low, high
    if high <= 0:
        return ZERO, ZERO, ZERO, ZERO, ZERO
    slope = _share(high / (high - low))
    most = (-slope * low).max((ONE - slope) * high).max(ZERO)
    half = most * HALF
    return slope, half, half, ZERO, high.max(ZERO)


def range_max0(low: arb, high: arb) -> tuple[arb, arb]:
    """max(x, 0) for x in [low, high], as `line_max0` has it."""
    return larger(low, ZERO), high.max(ZERO)


def line_noisy_max0(low: arb, high: arb, noise: arb) -> tuple[arb, arb, arb]:
    """max(x + n, 0) for x in [low, high] and |n| <= noise, as slope x + offset +- spread.

    Above, the chord of the convex max(x + noise, 0); below, max(x - noise, 0), which is nearest to
    a line of that slope at x = noise. Tighter than a line over x + n where x alone decides.
    """
    if high + noise <= 0:
        return ZERO, ZERO, ZERO
    if low - noise >= 0:
        return ONE, ZERO, noise
    last = (high + noise).max(ZERO)
    slope = _share(last / (high - low))  # of the chord: 1 where low + noise is above 0
    # for every slope in [0, 1]: there x + noise is farthest above at high, elsewhere 0 is at low
    over = (-slope * low).max(last - slope * high)
    nearest = noise.max(low).min(high)
    under = (nearest - noise).max(ZERO) - slope * nearest
    return slope, (over + under) * HALF, (over - under) * HALF


def line_or_range(offset: arb, spread: arb, low: arb, high: arb) -> tuple[arb, arb, arb]:
    """A line, or a range where that has less spread: a weight for slopes, an offset, a spread.

    What is in slope x + offset +- spread and in [low, high] is in weight slope x + the rest.
    """
    half = (high - low) * HALF
    if half < spread:
        return ZERO, (low + high) * HALF, half
    return ONE, offset, spread


def _least_size(low: arb, high: arb) -> arb:
    """A lower bound of |x| for x in [low, high]."""
    return larger(-high, larger(low, ZERO))


def line_abs(low: arb, high: arb) -> Line:
    """|x| = 2 max(x, 0) - x."""
    slope, offset, spread, _, _ = line_max0(low, high)
    return 2 * slope - 1, 2 * offset, 2 * spread, _least_size(low, high), (-low).max(high)


def line_square(low: arb, high: arb) -> Line:
    """x^2, which is above its tangent in the middle by the square of the distance from there."""
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    half = far * far * HALF
    least, most = _least_size(low, high), (-low).max(high)
    return 2 * middle, half - middle * middle, half, least * least, most * most


def line_floor(low: arb, high: arb) -> Line:
    """floor(x): one number where both ends have the same, else x - 1/2 to within 1/2."""
    first, last = low.lower().floor(), high.upper().floor()
    if first == last:
        return ZERO, first, ZERO, first, last
    return ONE, -HALF, HALF, first, last


def _smooth(
    f: Callable[[arb], arb],
    slope: Callable[[arb], arb],
    curve: Callable[[arb], arb],
    low: arb,
    high: arb,
) -> Line:
    """A tangent in the middle: f(x) - tangent is curve(some x) (x - middle)^2, curve being f''/2.

    Where that is infinite, the range.
    """
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    s = slope(middle).mid()
    x, off_slope = hull(low, high), (slope(middle) - s) * far * UNIT
    value, rest = f(x), curve(x) * (far * far) * arb(0.5, 0.5) + off_slope
    offset = f(middle) - s * middle + rest.mid()
    if not rest.is_finite():
        return ZERO, value.mid(), arb(value.rad()), value.lower(), value.upper()
    return s, offset, arb(rest.rad()), arb(value.lower()), arb(value.upper())


def line_inverse(low: arb, high: arb) -> Line:
    """1 / x; infinite where 0 is not certainly outside."""
    if not (low > 0 or high < 0):
        return _nothing_known()
    return _smooth(lambda v: 1 / v, lambda v: -1 / (v * v), lambda x: 1 / (x * x * x), low, high)


def line_sqrt(low: arb, high: arb) -> Line:
    """sqrt(x) for the x >= 0 of the interval."""
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
    """The function x / (1 + |x|): it rises, is odd, and concave on x >= 0.

    There it is at most slope x + (1 - sqrt(slope))^2, which a tangent reaches; and least at ends.
    """
    if not (low.is_finite() and high.is_finite()):
        return ZERO, ZERO, ONE, -ONE, ONE
    first, last = low / (1 + abs(low)), high / (1 + abs(high))
    slope = _share((last - first) / (high - low))
    ends, hump = (first - slope * low, last - slope * high), (1 - slope.sqrt()) ** 2
    over, under = ends[0].max(ends[1]), ends[0].min(ends[1])
    if not high <= 0:
        over = over.max(hump)
    if not low >= 0:
        under = under.min(-hump)
    return slope, (over + under) * HALF, (over - under) * HALF, first, last


def _line_log(low: arb, high: arb) -> Line:
    if not low > 0:
        return _nothing_known()
    return _smooth(arb.log, lambda v: 1 / v, lambda x: -1 / (2 * x * x), low, high)


def _curve_tanh(x: arb) -> arb:
    t = x.tanh()
    return -t * (1 - t * t)


def _slope_of_tan(x: arb) -> arb:
    return 1 + x.tan() ** 2


def line_wrap_angle(low: arb, high: arb) -> Line:
    """The angle in [-pi, pi] of the same direction; any where some x may be half a turn."""
    half = arb.pi()
    if low.is_finite() and high.is_finite():
        turns = ((low + high) * HALF / (2 * half) + HALF).mid().floor()
        back = 2 * half * turns
        if low - back > -half and high - back < half:
            ends = (low - back).lower(), (high - back).upper()
            return ONE, -back.mid(), arb(back.rad()), arb(ends[0]), arb(ends[1])
    half = arb(half.upper())
    return ZERO, ZERO, half, -half, half


def _nothing_known() -> Line:
    far = arb.pos_inf()
    return ZERO, ZERO, far, -far, far


UNIVARIATE: dict[str, Callable[[arb, arb], Line]] = {
    "max0": line_max0,
    "abs": line_abs,
    "square": line_square,
    "floor": line_floor,
    "inverse": line_inverse,
    "sqrt": line_sqrt,
    "soft_sign": line_soft_sign,
    "sin": partial(_smooth, arb.sin, arb.cos, lambda x: -x.sin() * HALF),
    "cos": partial(_smooth, arb.cos, lambda v: -v.sin(), lambda x: -x.cos() * HALF),
    "exp": partial(_smooth, arb.exp, arb.exp, lambda x: x.exp() * HALF),
    "log": _line_log,
    "tanh": partial(_smooth, arb.tanh, lambda v: 1 - v.tanh() ** 2, _curve_tanh),
    "atan": partial(_smooth, arb.atan, lambda v: 1 / (1 + v * v), lambda x: -x / (1 + x * x) ** 2),
    "tan": partial(_smooth, arb.tan, _slope_of_tan, lambda x: x.tan() * _slope_of_tan(x)),
    "wrap_angle": line_wrap_angle,
}
"""Exact functions of one variable; the prelude's errors are added by `symbolic_operations.py`."""
PRELUDE = ("sin", "cos", "exp", "log", "tanh", "atan", "tan")
