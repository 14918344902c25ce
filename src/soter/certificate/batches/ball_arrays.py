"""Arrays of balls in doubles: the arithmetic with which many boxes are looked at at once.

Purpose: `BallArray`: for each box a centre and a radius, both doubles, and operations whose balls
hold every value that the exact operation has on values of the balls; comparisons that are true only
where they are certain.
Non-goals: being as narrow as Arb (`terms/arb_balls.py`): what is not shown with these is looked at
once more with those. Functions of one number (`array_lines.py`).

Every operation on doubles is correctly rounded, so that it is off by at most 2^-53 of what it gives
as long as nothing underflows. Whoever computes with these does so within `no_underflow`, where an
underflow is a `FloatingPointError`. Bounds of rounding are taken twice as large as they are, and
radii are enlarged by `GROWN` once per operation, which is more than the few roundings in computing
them. Overflow and NaN need no care: no comparison with NaN is true, nor is one with `inf - inf`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from soter.certificate.terms.arb_balls import above, exact, magnitude

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from flint import arb
    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Truths: TypeAlias = NDArray[np.bool_]
    Operand: TypeAlias = "BallArray" | int

EPS = 2.0**-52
"""Twice the most that an operation is off, relative to its result."""
FAR = 2.0**900
"""Of larger numbers no quotient is computed: it may underflow."""
GROWN = 1.0 + 2.0**-50
"""More than (1 + 2^-53)^6: radii are computed in fewer roundings."""


def no_underflow() -> AbstractContextManager[None]:
    """Within it an underflow is a `FloatingPointError`, and all else a number, inf or NaN."""
    return np.errstate(under="raise", over="ignore", invalid="ignore", divide="ignore")


class BallArray:
    """`centre` and `radius` of each ball, boxes along the last axis, of length 1 for constants.

    `radius` has the shape of `centre`, and is None where all are exact.
    """

    __slots__ = ("_absolute", "_farthest", "_grown", "centre", "radius")

    def __init__(self, centre: Floats, radius: Floats | None = None) -> None:
        if radius is not None and radius.shape != centre.shape:
            radius = np.broadcast_to(radius, centre.shape)
        self.centre, self.radius = centre, radius
        self._absolute: Floats | None = None
        self._grown: Floats | None = None
        self._farthest: Floats | None = None

    # ------------------------------------------------------------ made of others

    @staticmethod
    def of(x: arb | float) -> BallArray:
        """A constant."""
        if isinstance(x, (int, float)):
            return Constant(float(x), 0.0)
        centre = float(x.mid())
        radius = above(magnitude(x - exact(centre)))
        if not np.isfinite(centre) or not np.isfinite(radius):
            return BallArray(np.zeros(1), np.full(1, np.inf))
        return Constant(centre, radius)

    @staticmethod
    def between(low: Floats, high: Floats) -> BallArray:
        """The balls over [low, high], of their shape."""
        centre = low * 0.5 + high * 0.5
        return BallArray(centre, np.maximum(high - centre, centre - low) * GROWN)

    def taken(self, index: NDArray[np.intp]) -> BallArray:
        """Those of some boxes, (index,)."""
        if self.centre.shape[-1] == 1:
            return self
        return BallArray(
            self.centre[..., index], None if self.radius is None else self.radius[..., index]
        )

    def __getitem__(self, index: Any) -> BallArray:  # noqa: ANN401  of numpy
        """Along axes before that of the boxes."""
        return BallArray(self.centre[index], None if self.radius is None else self.radius[index])

    # ------------------------------------------------------------ ends

    def lower(self) -> Floats:
        """No larger than anything in the ball; of its shape."""
        if self.radius is None:
            return self.centre
        low = self.centre - self.radius
        return np.where(self.radius > 0, low - np.abs(low) * EPS, low)

    def upper(self) -> Floats:
        """No smaller than anything in the ball; of its shape."""
        if self.radius is None:
            return self.centre
        high = self.centre + self.radius
        return np.where(self.radius > 0, high + np.abs(high) * EPS, high)

    def mid(self) -> BallArray:
        """The centres, as numbers that somebody chose."""
        return BallArray(self.centre)

    # ------------------------------------------------------------ arithmetic

    def __add__(self, other: Operand) -> BallArray:
        y = _balls(other)
        return _summed(self.centre + y.centre, self.radius, y.radius)

    def __sub__(self, other: Operand) -> BallArray:
        y = _balls(other)
        return _summed(self.centre - y.centre, self.radius, y.radius)

    def __radd__(self, other: int) -> BallArray:
        return self + other

    def __rsub__(self, other: int) -> BallArray:
        return _balls(other) - self

    def __neg__(self) -> BallArray:
        return BallArray(-self.centre, self.radius)

    def __abs__(self) -> BallArray:
        return BallArray(np.abs(self.centre), self.radius)

    def __mul__(self, other: Operand) -> BallArray:
        y = _balls(other)
        if isinstance(y, Constant):
            return y.times(self)
        x, y = (self, y) if self.centre.size >= y.centre.size else (y, self)
        centre = x.centre * y.centre
        radius = np.abs(centre)
        radius *= EPS
        if x.radius is not None:  # (|y| + its radius) times the radius of x
            radius += x.radius * y._at_most()
        if y.radius is not None:
            radius += x._sizes() * y._radius_grown()
        return BallArray(centre, radius)

    # what a factor of many products is asked for: computed once

    def _sizes(self) -> Floats:
        """|centre|."""
        if self._absolute is None:
            self._absolute = np.abs(self.centre)
        return self._absolute

    def _radius_grown(self) -> Floats:
        if self._grown is None:
            assert self.radius is not None
            self._grown = self.radius * GROWN
        return self._grown

    def _at_most(self) -> Floats:
        """The largest |x| in the ball, grown."""
        if self._farthest is None:
            size = self._sizes()
            self._farthest = (size if self.radius is None else size + self.radius) * GROWN
        return self._farthest

    def __rmul__(self, other: int) -> BallArray:
        return self * other

    def inverse(self) -> BallArray:
        """1 / x: |1/x - 1/c| = |x - c| / |x c|; nothing is known where 0 may be in the ball.

        Of what is farther than `FAR` from 0 only that it is small: the quotient may underflow.
        """
        far = np.abs(self.centre) > FAR
        if not far.any():
            return _inverse(self)
        near = _inverse(BallArray(np.where(far, 1.0, self.centre), self.radius))
        surely = (self.lower() > FAR) | (self.upper() < -FAR)
        small = np.where(surely, 1.0 / FAR, np.inf)
        return chosen(far, BallArray(np.zeros_like(small), small), near)

    def sqrt(self) -> BallArray:
        """Of the x >= 0 of balls whose centre is positive; nothing is known of others."""
        known = self.centre > 0
        centre = np.sqrt(np.where(known, self.centre, 1.0))
        radius = centre * EPS
        if self.radius is not None:  # |sqrt x - sqrt c| = |x - c| / (sqrt x + sqrt c)
            radius = radius + self.radius / centre * GROWN
        return BallArray(np.where(known, centre, 0.0), np.where(known, radius, np.inf))

    # ------------------------------------------------------------ order

    def max(self, other: Operand) -> BallArray:
        """The larger one: off by at most the larger of what both are off."""
        y = _balls(other)
        return BallArray(np.maximum(self.centre, y.centre), _wider(self.radius, y.radius))

    def min(self, other: Operand) -> BallArray:
        """The same of the smaller one."""
        y = _balls(other)
        return BallArray(np.minimum(self.centre, y.centre), _wider(self.radius, y.radius))

    def union(self, other: BallArray) -> BallArray:
        """Everything between."""
        low = np.minimum(self.lower(), other.lower())
        return BallArray.between(low, np.maximum(self.upper(), other.upper()))

    def __lt__(self, other: Operand) -> Truths:
        return self.upper() < _balls(other).lower()

    def __le__(self, other: Operand) -> Truths:
        return self.upper() <= _balls(other).lower()

    def __gt__(self, other: Operand) -> Truths:
        return self.lower() > _balls(other).upper()

    def __ge__(self, other: Operand) -> Truths:
        return self.lower() >= _balls(other).upper()


def _inverse(x: BallArray) -> BallArray:
    """1 / x of what is not farther from 0 than `FAR`."""
    centre = 1.0 / x.centre
    radius = np.abs(centre) * EPS
    if x.radius is not None:
        size = np.abs(x.centre)
        nearest = size * (1.0 - 2.0**-50) - x.radius * GROWN
        wide = x.radius / np.where(nearest > 0, nearest, 1.0) * np.abs(centre) * GROWN
        radius = np.where(nearest > 0, radius + wide * GROWN, np.inf)
    known = x.centre != 0
    return BallArray(np.where(known, centre, 0.0), np.where(known, radius, np.inf))


class Constant(BallArray):
    """One ball for all boxes."""

    __slots__ = ("_share", "_size", "_value")

    def __init__(self, value: float, radius: float) -> None:
        super().__init__(np.array([value]), np.array([radius]) if radius else None)
        self._value = value
        self._size = (abs(value) + radius) * GROWN
        self._share = EPS + (radius / abs(value) * GROWN if value else 0.0)
        """The rounding of a product, and what the radius adds, relative to the product."""

    def __mul__(self, other: Operand) -> BallArray:
        return self.times(_balls(other))

    def times(self, x: BallArray) -> BallArray:
        """The product: (|c| + its radius) times the radius of x, and |x| times its radius."""
        centre = x.centre * self._value
        radius = np.abs(centre)
        if self._value:
            radius *= self._share * GROWN
        elif self.radius is not None:
            radius = np.abs(x.centre) * (self.radius * GROWN)
        if x.radius is not None:
            radius += x.radius * (self._size * GROWN)
        return BallArray(centre, radius)


def _balls(x: Operand) -> BallArray:
    return Constant(float(x), 0.0) if isinstance(x, int) else x


def _summed(centre: Floats, one: Floats | None, other: Floats | None) -> BallArray:
    """A sum or difference with this rounded centre, of balls with these radii."""
    radius = np.abs(centre)
    radius *= EPS
    if one is not None:
        radius += (one if other is None else one + other) * GROWN
    elif other is not None:
        radius += other * GROWN
    return BallArray(centre, radius)


def _wider(one: Floats | None, other: Floats | None) -> Floats | None:
    if one is None and other is None:
        return None
    return np.maximum(0.0 if one is None else one, 0.0 if other is None else other)


def chosen(where: Truths, one: BallArray, other: BallArray) -> BallArray:
    """One where it says so, else the other; all of one shape."""
    radius = None
    if one.radius is not None or other.radius is not None:
        a = 0.0 if one.radius is None else one.radius
        b = 0.0 if other.radius is None else other.radius
        radius = np.where(where, a, b)
    return BallArray(np.where(where, one.centre, other.centre), radius)


def larger(one: BallArray, other: BallArray) -> BallArray:
    """One of two lower bounds, as `arb_balls.larger`: either would do."""
    return chosen(_least(one) > _least(other), one, other)


def smaller(one: BallArray, other: BallArray) -> BallArray:
    """One of two upper bounds."""
    return chosen(_most(one) < _most(other), one, other)


def _least(x: BallArray) -> Floats:
    return x.centre if x.radius is None else x.centre - x.radius


def _most(x: BallArray) -> Floats:
    return x.centre if x.radius is None else x.centre + x.radius
