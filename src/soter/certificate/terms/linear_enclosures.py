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
    """The better of two lower bounds where that is certain, else the second."""
    return max(b, a)


def smaller(a: arb, b: arb) -> arb:
    """The better of two upper bounds where that is certain, else the second."""
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


def line_noisy_max0(low: arb, high: arb, noise: arb) -> tuple[arb, arb, arb, arb]:
    """max(x + n, 0) for x in [low, high], |n| <= noise: slope x + kept n + offset +- spread.

    It is x + n where that is never negative. Elsewhere, above, the chord of the convex max(x +
    noise, 0); below, max(x - noise, 0), which is nearest to a line of that slope at x = noise.
    Tighter than a line over x + n where x alone decides.
    """
    if high + noise <= 0:
        return ZERO, ZERO, ZERO, ZERO
    if low - noise >= 0:
        return ONE, ONE, ZERO, ZERO
    last = (high + noise).max(ZERO)
    slope = _share(last / (high - low))  # of the chord: 1 where low + noise is above 0
    # for every slope in [0, 1]: there x + noise is farthest above at high, elsewhere 0 is at low
    over = (-slope * low).max(last - slope * high)
    nearest = noise.max(low).min(high)
    under = (nearest - noise).max(ZERO) - slope * nearest
    return slope, ZERO, (over + under) * HALF, (over - under) * HALF


def line_or_range(
    offset: arb, spread: arb, low: arb, high: arb, more: arb = ZERO
) -> tuple[arb, arb, arb]:
    """A line, or a range where that has less spread: a weight for slopes, an offset, a spread.

    What is in slope x + offset +- spread and in [low, high] is in weight slope x + the rest.
    `more`: the spread of what is free in the line, which counts half: it may still cancel.
    """
    half, least = (high - low) * HALF, spread + more * HALF
    if half < least or not least.is_finite():
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


def line_truncated(low: arb, high: arb) -> Line:
    """The whole number next to x on the side of 0: less than 1 from x, and not beyond it."""
    first, last = (x.floor() if x >= 0 else x.ceil() for x in (low.lower(), high.upper()))
    if first == last:
        return ZERO, first, ZERO, first, last
    up, down = (ZERO if low >= 0 else ONE), (ZERO if high <= 0 else ONE)
    return ONE, (up - down) * HALF, (up + down) * HALF, first, last


def extremes(values: Sequence[arb]) -> Range:
    """The least and the greatest of some numbers."""
    return reduce(arb.min, values), reduce(arb.max, values)


def of_monotone(f: Function, low: arb, high: arb) -> Range:
    """The range of a function that only rises, or only falls, between these."""
    return extremes((f(low), f(high)))


def smooth(
    f: Function,
    slope: Function,
    curve: Callable[[arb, arb], arb],
    ends: Callable[[Function, arb, arb], Range],
    low: arb,
    high: arb,
) -> Line:
    """A tangent in the middle: f(x) - tangent is curve(v, f(v)) (x - middle)^2 for some v.

    `curve` is f''/2, `ends` gives the range, which it is where the curve is infinite.
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
    """1 / x; infinite where 0 is not certainly outside."""
    if not (low > 0 or high < 0):
        return nothing_known()
    slope, curve = (lambda v: -1 / (v * v)), (lambda _, y: y * y * y)
    return smooth(lambda v: 1 / v, slope, curve, of_monotone, low, high)


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


def nothing_known() -> Line:
    """The line of a function where it has no value, or any."""
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


def lines_over(name: str) -> Callable[..., tuple[arb, ...]]:
    """The function of ends that gives the line over a function, of the prelude, too."""
    return FUNCTIONS.get(name) or extras.prelude_functions.FUNCTIONS[name]
