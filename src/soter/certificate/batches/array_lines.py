"""Functions of one number, over arrays of balls: lines with a remainder, as in `arb_balls.py`.

Purpose: the enclosures that generated code calls by name, for many boxes at once (`NAMES`). What is
not known here is told as `nothing known`, with which no claim is shown.
Non-goals: derivations, which stand beside the functions of the same names in `arb_balls.py` and
`runtime_calls.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray, chosen, larger, smaller
from soter.certificate.batches.sines import cosine, sine

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats, Truths

    Line = tuple[BallArray, BallArray, BallArray, BallArray, BallArray]
    Bits = NDArray[np.uint8]

ZERO, ONE, HALF = BallArray.of(0.0), BallArray.of(1.0), BallArray.of(0.5)


def _slope(x: BallArray) -> BallArray:
    """Its centre, between 0 and 1."""
    return BallArray(np.clip(x.centre, 0.0, 1.0))


def line_max0(low: BallArray, high: BallArray) -> Line:
    """max(x, 0)."""
    above, below = low >= 0, high <= 0
    slope = _slope(high * (high - low).inverse())
    most = (-slope * low).max((1 - slope) * high).max(ZERO)
    half = most * HALF
    slope = chosen(above, ONE, chosen(below, ZERO, slope))
    half = chosen(above | below, ZERO, half)
    return slope, half, half, *range_max0(low, high)


def range_max0(low: BallArray, high: BallArray) -> tuple[BallArray, BallArray]:
    """Its range."""
    above, below = low >= 0, high <= 0
    most = chosen(above, high, high.max(ZERO))
    return chosen(above, low, ZERO), chosen(below, ZERO, most)


def line_noisy_max0(
    low: BallArray, high: BallArray, noise: BallArray
) -> tuple[BallArray, BallArray, BallArray]:
    """max(x + n, 0)."""
    below, above = high + noise <= 0, low - noise >= 0
    first, last = (low + noise).max(ZERO), (high + noise).max(ZERO)
    width = high - low
    slope = (last - first) * width.inverse()
    slope = _slope(chosen(width > 0, slope, ZERO))
    over = (first - slope * low).max(last - slope * high)
    nearest = noise.max(low).min(high)
    under = (nearest - noise).max(ZERO) - slope * nearest
    return (
        chosen(above, ONE, chosen(below, ZERO, slope)),
        chosen(above | below, ZERO, (over + under) * HALF),
        chosen(above, noise, chosen(below, ZERO, (over - under) * HALF)),
    )


def line_or_range(
    offset: BallArray, spread: BallArray, low: BallArray, high: BallArray
) -> tuple[BallArray, BallArray, BallArray]:
    """The less spread of the two."""
    half = (high - low) * HALF
    narrow = half < spread
    return (
        chosen(narrow, ZERO, ONE),
        chosen(narrow, (low + high) * HALF, offset),
        chosen(narrow, half, spread),
    )


def line_abs(low: BallArray, high: BallArray) -> Line:
    """|x|."""
    above, below = low >= 0, high <= 0
    slope, offset, spread, _, _ = line_max0(low, high)
    return (
        chosen(above, ONE, chosen(below, -ONE, 2 * slope - ONE)),
        chosen(above | below, ZERO, 2 * offset),
        chosen(above | below, ZERO, 2 * spread),
        chosen(above, low, chosen(below, -high, ZERO)),
        chosen(above, high, chosen(below, -low, (-low).max(high))),
    )


def line_square(low: BallArray, high: BallArray) -> Line:
    """x^2."""
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    half = far * far * HALF
    first, last = low * low, high * high
    least = chosen(low >= 0, first, chosen(high <= 0, last, ZERO))
    return 2 * middle, half - middle * middle, half, least, first.max(last)


def line_floor(low: BallArray, high: BallArray) -> Line:
    """floor(x)."""
    first, last = BallArray(np.floor(low.lower())), BallArray(np.floor(high.upper()))
    one = first.centre == last.centre
    return (
        chosen(one, ZERO, ONE),
        chosen(one, first, -HALF),
        chosen(one, ZERO, HALF),
        first,
        last,
    )


def line_sqrt(low: BallArray, high: BallArray) -> Line:
    """sqrt(x) for the x >= 0 of the interval."""
    low = larger(low, ZERO)
    none = high <= 0
    root, top = low.sqrt(), BallArray(high.upper()).sqrt()
    slope = (root + top).inverse().mid()
    under = (root - slope * low).min(top - slope * high)
    over = (4 * slope).inverse()
    sure, half = low > 0, top * HALF
    line = (
        chosen(sure, slope, ZERO),
        chosen(sure, (under + over) * HALF, half),
        chosen(sure, (over - under) * HALF, half),
        chosen(sure, root, ZERO),
        top,
    )
    slope, offset, spread, least, most = (chosen(none, ZERO, x) for x in line)
    return slope, offset, spread, least, most


def _smooth(
    low: BallArray,
    high: BallArray,
    f: Callable[[BallArray], BallArray],
    slope: Callable[[BallArray], BallArray],
    curve: BallArray,
) -> Line:
    """A tangent in the middle and its remainder; `curve` encloses f''/2 over the interval."""
    middle = ((low + high) * HALF).mid()
    far = abs(high - middle).max(abs(low - middle))
    of_middle = slope(middle)
    s = of_middle.mid()
    off = (of_middle - s) * far
    size = np.maximum(np.abs(off.lower()), np.abs(off.upper()))
    off_slope = BallArray(np.zeros_like(size), size)
    square = far * far
    bent = BallArray.between(np.zeros(1), np.maximum(square.upper(), 0.0)) * curve
    rest = bent + off_slope
    offset = f(middle) - s * middle + rest.mid()
    value = f(low.union(high))
    least, most = BallArray(value.lower()), BallArray(value.upper())
    assert rest.radius is not None
    return s, offset, BallArray(rest.radius), least, most


def line_inverse(low: BallArray, high: BallArray) -> Line:
    """1 / x; nothing is known where 0 is not certainly outside."""
    known = (low > 0) | (high < 0)
    line = _smooth(
        low,
        high,
        BallArray.inverse,
        lambda v: -((v * v).inverse()),
        _cubed(low.union(high)).inverse(),
    )
    return _where_known(known, line)


def _cubed(x: BallArray) -> BallArray:
    return x * x * x


def line_sin(low: BallArray, high: BallArray) -> Line:
    """sin(x): f''/2 = -sin(x)/2."""
    return _smooth(low, high, sine, cosine, -sine(low.union(high)) * HALF)


def line_cos(low: BallArray, high: BallArray) -> Line:
    """cos(x)."""
    return _smooth(low, high, cosine, lambda v: -sine(v), -cosine(low.union(high)) * HALF)


def line_unknown(low: BallArray, high: BallArray) -> Line:
    """A function of which nothing is known here."""
    return _where_known(np.zeros(low.centre.shape, dtype=np.bool_), (low, low, low, low, high))


def _where_known(known: Truths, line: Line) -> Line:
    """Where nothing is known, balls of every number."""
    unknown = BallArray(np.zeros(1), np.full(1, np.inf))
    slope, *others = line
    offset, spread, least, most = (chosen(known, x, unknown) for x in others)
    return chosen(known, slope, ZERO), offset, spread, least, most


# ---------------------------------------------------------------- what the code calls besides


def corners(
    al: BallArray, ah: BallArray, bl: BallArray, bh: BallArray
) -> tuple[BallArray, BallArray]:
    """The range of a product."""
    a, b, c, d = al * bl, al * bh, ah * bl, ah * bh
    return a.min(b).min(c.min(d)), a.max(b).max(c.max(d))


def swept(
    low: BallArray,
    high: BallArray,
    low_after: BallArray,
    high_after: BallArray,
    between: BallArray,
    rest: BallArray,
    own: BallArray,
    grown: BallArray,
) -> tuple[Floats, Floats]:
    """The ends of a state between two instants, one a box."""
    rate = own * between + rest
    rising, falling = rate >= 0, rate <= 0
    down, up = BallArray((own * low + rest).lower()), BallArray((own * high + rest).upper())
    least = chosen(down >= 0, low, low + down * grown)
    most = chosen(up <= 0, high, high + up * grown)
    return (
        chosen(rising, low, chosen(falling, low_after, least)).lower(),
        chosen(rising, high_after, chosen(falling, high, most)).upper(),
    )


def pick(values: NDArray[np.float64], *ends: Floats) -> tuple[BallArray, BallArray]:
    """The range of a table, (n,), between positions: that of all of it."""
    del ends
    return BallArray.of(float(values.min())), BallArray.of(float(values.max()))


def bits(yes: Truths, no: Truths) -> Bits:
    """The bits of a proposition, one for each box: 0: may be false, 1: may be true."""
    return np.where(yes, 2, np.where(no, 1, 3)).astype(np.uint8)


def by_truth(truth: Bits, yes: Any, no: Any, both: Any) -> BallArray:  # noqa: ANN401
    """What is so where a proposition is true, false, or neither for certain; one a box."""
    balls = [x if isinstance(x, BallArray) else BallArray.of(x) for x in (yes, no, both)]
    return chosen(truth == 2, balls[0], chosen(truth == 1, balls[1], balls[2]))


NAMES: dict[str, Any] = {
    "HALF": HALF,
    "ONE": ONE,
    "ZERO": ZERO,
    "NOT": np.array([0, 2, 1, 3], dtype=np.uint8),
    "larger": larger,
    "smaller": smaller,
    "below": BallArray.lower,
    "above": BallArray.upper,
    "bits": bits,
    "by_truth": by_truth,
    "corners": corners,
    "pick": pick,
    "swept": swept,
    "range_max0": range_max0,
    "line_noisy_max0": line_noisy_max0,
    "line_or_range": line_or_range,
    "line_max0": line_max0,
    "line_abs": line_abs,
    "line_square": line_square,
    "line_floor": line_floor,
    "line_sqrt": line_sqrt,
    "line_inverse": line_inverse,
    "line_sin": line_sin,
    "line_cos": line_cos,
    **{f"line_{name}": line_unknown for name in ("exp", "log", "tanh", "atan")},
}
"""What generated code refers to, in place of the names of `python_source.py`."""
