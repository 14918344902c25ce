"""Matrices for the bounds of polytope proofs: of balls, and of rationals.

Purpose: `Ball` has linear algebra in binary64 with an error bound beside every entry: products,
sums and (`exponential`) the matrix exponential with its integral, all rounding outward. A result
`[mid - rad, mid + rad]` contains the exact result for every choice of exact operands inside theirs.
In rationals, `pivots_of` chooses independent rows and an input of each, and `inverse_of` inverts.
Non-goals: speed for large matrices; anything that is not linear.

Why it rounds outward: for inner products of n <= 4096 terms in any order of summation, fused or
not, |fl(a.b) - a.b| <= gamma_n |a|.|b| with gamma_n = n u / (1 - n u), u = 2^-53 (Higham, Accuracy
and Stability, section 3.1). A product takes twice that; sums of non-negative terms are inflated by
2^-40, more than gamma_4096; underflow is covered by 2^-1000 an entry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from soter.core.layout import Floats


Array: TypeAlias = npt.NDArray[np.float64]

UNIT = 2.0**-52
INFLATE = 1.0 + 2.0**-40
TINY = 2.0**-1000
TERMS_MAX = 4096
TAYLOR_ORDER = 20


class BeyondError(ArithmeticError):
    """Numbers, or sums, are too large to be bounded here, so nothing is shown of them."""


@dataclass(frozen=True, eq=False)
class Ball:
    """An array of balls: `mid` and `rad` (>= 0) of one shape."""

    mid: Array
    rad: Array

    @property
    def T(self) -> Ball:  # noqa: N802 - as in NumPy
        """The transpose."""
        return Ball(self.mid.T, self.rad.T)

    def __getitem__(self, key: object) -> Ball:
        return Ball(np.asarray(self.mid[key]), np.asarray(self.rad[key]))  # type: ignore[call-overload]

    def __matmul__(self, other: Ball) -> Ball:
        count = self.mid.shape[-1]
        if count > TERMS_MAX:
            raise BeyondError(f"a product of {count} terms")
        left, right = np.abs(self.mid), np.abs(other.mid)
        spread = left @ other.rad + self.rad @ (right + other.rad)
        error = (count + 4) * UNIT * (left @ right)
        return Ball(self.mid @ other.mid, (spread + error) * INFLATE + TINY)

    def __add__(self, other: Ball) -> Ball:
        mid = self.mid + other.mid
        return Ball(mid, (self.rad + other.rad + np.abs(mid) * UNIT) * INFLATE + TINY)

    def __neg__(self) -> Ball:
        return Ball(-self.mid, self.rad)

    def __sub__(self, other: Ball) -> Ball:
        return self + (-other)

    def times(self, other: Ball) -> Ball:
        """The product entry by entry."""
        mid = self.mid * other.mid
        spread = np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad)
        return Ball(mid, (spread + np.abs(mid) * UNIT) * INFLATE + TINY)

    def upper(self) -> Array:
        """Upper bounds of the entries, in the shape of `mid`."""
        return np.nextafter(self.mid + self.rad, np.inf)

    def lower(self) -> Array:
        """Lower bounds of the entries, in the shape of `mid`."""
        return np.nextafter(self.mid - self.rad, -np.inf)

    def magnitude(self) -> Array:
        """Upper bounds of the entries' absolute values, in the shape of `mid`."""
        return np.nextafter(np.abs(self.mid) + self.rad, np.inf)


def exact(values: npt.ArrayLike) -> Ball:
    """Doubles as balls of radius 0; `BeyondError` where one is not finite."""
    mid = np.asarray(values, dtype=np.float64)
    if not np.isfinite(mid).all():
        raise BeyondError("a number is not finite")
    return Ball(mid, np.zeros_like(mid))


def seconds(time_ns: int) -> Ball:
    """A time in s as a ball, since the division rounds once."""
    mid = np.float64(time_ns / 1e9)
    return Ball(np.asarray(mid), np.asarray(abs(mid) * UNIT))


def centred(low: Array, high: Array) -> tuple[Array, Array]:
    """Doubles (c, r) with [low, high] inside [c - r, c + r]; all are of one shape."""
    centre = low + (high - low) / 2
    radius = np.maximum((exact(high) - exact(centre)).upper(), (exact(centre) - exact(low)).upper())
    return centre, np.where(high > low, radius, np.where(centre == low, 0.0, radius))


def up_product(left: Array, right: Array) -> Array:
    """An upper bound of the product of two non-negative matrices.

    (n, k) by (k, m) or (k,); `BeyondError` where k is above `TERMS_MAX`.
    """
    if left.shape[-1] > TERMS_MAX:
        raise BeyondError(f"a product of {left.shape[-1]} terms")
    return np.asarray((left @ right) * INFLATE + TINY)


def up_times(*factors: Array | float) -> Array:
    """An upper bound of the entrywise product of non-negative arrays.

    Of the shape to which they broadcast.
    """
    product: Array = np.asarray(1.0)
    for factor in factors:
        product = np.asarray(product * factor * INFLATE + TINY)
    return product


def up_sum(*terms: Array | float) -> Array:
    """An upper bound of the sum of arrays (any sign).

    Of the shape to which they broadcast.
    """
    total: Array = np.asarray(0.0)
    for term in terms:
        total = np.nextafter(total + term, np.inf)
    return total


def exponential(matrix: Array, time_ns: int) -> tuple[Ball, Ball]:
    """(e^{At}, int_0^t e^{As} ds), both (n, n), for a matrix (n, n) of doubles and a time in ns.

    Both are blocks of exp([[A, I], [0, 0]] t): Taylor to order 20 with remainder, on a time that
    was halved until the norm is below 1/2, then squared (Van Loan 1978). BeyondError where the
    norm is not finite.
    """
    n = matrix.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = matrix, np.eye(n)
    norm = float(np.abs(block).sum(axis=1).max()) * time_ns / 1e9
    if not math.isfinite(norm):
        raise BeyondError("the norm of a matrix is not finite")
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 2)
    step = exact(block).times(seconds(time_ns)).times(exact(2.0**-halvings))
    size = float(up_product(step.magnitude(), np.ones(2 * n)).max())
    assert size <= 0.5, size
    total = term = exact(np.eye(2 * n))
    for k in range(1, TAYLOR_ORDER + 1):
        term = (term @ step).times(Ball(np.asarray(1.0 / k), np.asarray(UNIT / k)))
        total = total + term
    # sum of ||X||^k / k! over k > 20 is below 2 ||X||^21 / 21! for ||X|| <= 1/2
    rest = 2.0 * size ** (TAYLOR_ORDER + 1) / math.factorial(TAYLOR_ORDER + 1) * INFLATE + TINY
    total = Ball(total.mid, (total.rad + rest) * INFLATE)
    for _ in range(halvings):
        total = total @ total
    return total[:n, :n], total[:n, n:]


F = Fraction


def pivots_of(gain: Floats, radius: Floats) -> tuple[list[int], list[int]]:
    """The numbers of independent rows, and of an input for each that it can be solved for.

    `gain`: (rows, inputs); `radius`: (inputs,).
    """
    work = [[F(x) for x in row] for row in gain]
    rows: list[int] = []
    pivots: list[int] = []
    for a, row in enumerate(work):
        weight = [0.0 if i in pivots else abs(float(x)) * radius[i] for i, x in enumerate(row)]
        p = int(np.argmax(weight))
        if weight[p] <= 0.0:
            continue
        for later in work[a + 1 :]:
            factor = later[p] / row[p]
            later[:] = [x - factor * y for x, y in zip(later, row, strict=True)]
        rows.append(a)
        pivots.append(p)
    return rows, pivots


def inverse_of(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """The inverse of an invertible matrix of rationals (Gauss-Jordan)."""
    n = len(matrix)
    work = [[*row, *(F(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        swap = next(k for k in range(i, n) if work[k][i] != 0)
        work[i], work[swap] = work[swap], work[i]
        head = work[i][i]
        work[i] = [x / head for x in work[i]]
        for k in range(n):
            if k != i:
                factor = work[k][i]
                work[k] = [x - factor * y for x, y in zip(work[k], work[i], strict=True)]
    return [row[n:] for row in work]
