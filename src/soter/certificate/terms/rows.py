"""Matrices as lists of rows, of balls or of values of a straight-line program.

Purpose: sums and products that are computed of balls at once, and written down of values.
Non-goals: exponentials (`reading/linear_flows.py`, `grid/flow_enclosures.py`).
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Any

from flint import arb_mat

from soter.certificate.terms.arb_balls import ONE, ZERO
from soter.certificate.terms.straight_line import Value

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    Rows = list[list[Any]]


def total(parts: Iterable[Any]) -> Any:  # noqa: ANN401  a ball or a value
    """The sum of all of them."""
    return sum(parts, ZERO)


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:  # noqa: ANN401  a ball or a value
    """The sum of the products."""
    return total(x * y for x, y in zip(a, b, strict=True))


def product(a: Rows, b: Rows) -> Rows:
    """Rows of `a` times columns of `b`."""
    if Value in map(type, chain(*a, *b)):
        columns = list(zip(*b, strict=True))
        return [[dot(row, column) for column in columns] for row in a]
    return (arb_mat(a) * arb_mat(b)).tolist()


def times(a: Rows, column: Sequence[Any]) -> list[Any]:
    """The product with one column."""
    return [dot(row, column) for row in a]


def units(n: int, *, width: int = 0, first: int = 0) -> Rows:
    """`n` rows of zeros, with one in each: in columns from `first` on; n columns or `width`."""
    return [[ONE if k == first + i else ZERO for k in range(width or n)] for i in range(n)]


def plus(a: Rows, b: Rows, factor: Any = ONE) -> Rows:  # noqa: ANN401  a ball or a value
    """`a + factor b`, row by row."""
    return [[x + factor * y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def beside(a: Rows, b: Rows) -> Rows:
    """Two matrices side by side."""
    return [[*x, *y] for x, y in zip(a, b, strict=True)]


def sum_of_sizes(row: Sequence[Any], sizes: Sequence[Any]) -> Any:  # noqa: ANN401
    """What factors make of numbers of these sizes at most; 0 of none."""
    return dot(list(map(abs, row)), sizes) if sizes else ZERO
