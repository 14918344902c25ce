"""Matrices and vectors of balls, one for each of many boxes.

Purpose: sums and products along axes, with the rounding of sums; matrices of single numbers.
Non-goals: arithmetic on single balls (`ball_arrays.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import EPS, BallArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb


def total(x: BallArray, axis: int = 0) -> BallArray:
    """The sum along an axis that is not that of the boxes.

    Of n numbers it takes n - 1 sums, each off by at most 2^-53 of the sum of all sizes.
    """
    n = x.centre.shape[axis]
    radius = np.abs(x.centre).sum(axis=axis) * ((n + 1) * EPS)
    if x.radius is not None:
        radius = radius + x.radius.sum(axis=axis)
    return BallArray(x.centre.sum(axis=axis), radius * (1.0 + (n + 8) * EPS))


def product(a: BallArray, b: BallArray) -> BallArray:
    """Of matrices (n, k, boxes) and (k, m, boxes)."""
    return total(a[:, :, None] * b[None], axis=1)


def applied(a: BallArray, x: BallArray) -> BallArray:
    """A matrix (n, k, boxes) times vectors (k, boxes)."""
    return total(a * x[None], axis=1)


def stacked(parts: Sequence[BallArray]) -> BallArray:
    """Arrays as the rows of one, with a radius."""
    shape = np.broadcast_shapes(*(x.centre.shape for x in parts))
    none = np.zeros(1)
    radii = [none if x.radius is None else x.radius for x in parts]
    return BallArray(
        np.stack([np.broadcast_to(x.centre, shape) for x in parts]),
        np.stack([np.broadcast_to(r, shape) for r in radii]),
    )


def joined(parts: Sequence[BallArray], axis: int = 0) -> BallArray:
    """Arrays one behind the other along an axis that is not that of the boxes."""
    boxes = max(x.centre.shape[-1] for x in parts)
    none = np.zeros(1)
    radii = [np.broadcast_to(none, x.centre.shape) if x.radius is None else x.radius for x in parts]
    shapes = [(*x.centre.shape[:-1], boxes) for x in parts]
    return BallArray(
        np.concatenate(
            [np.broadcast_to(x.centre, s) for x, s in zip(parts, shapes, strict=True)], axis
        ),
        np.concatenate([np.broadcast_to(r, s) for r, s in zip(radii, shapes, strict=True)], axis),
    )


def with_last(rows: BallArray, more: BallArray) -> BallArray:
    """Rows (n, k, boxes), to the last column of which vectors (n, boxes) are added."""
    return joined([rows[:, :-1], rows[:, -1:] + more[:, None]], axis=1)


def constants(numbers: Sequence[arb]) -> BallArray:
    """A vector of constants."""
    if not numbers:
        return BallArray(np.zeros((0, 1)))
    return stacked([BallArray.of(x) for x in numbers])


def identity(n: int) -> BallArray:
    """The same for every box."""
    return BallArray(np.eye(n)[:, :, None])


def picked(width: int, first: int, count: int) -> BallArray:
    """Rows that pick entries of a vector of this width."""
    return BallArray(np.eye(width)[first : first + count, :, None])
