"""Sets of cells, and many boxes at once: whether each lies in the set.

Purpose: what `Grid.cells`, `Cells.contains` and `Grid.followed_beyond` say of one box, of arrays of
boxes.
Non-goals: why that is so (`inclusions/cell_sets.py`).
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import EPS, BallArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.inclusions.cell_sets import Block, Cells, Grid

    Indices = NDArray[np.intp]


def cells_of(grid: Grid, box: Sequence[Floats]) -> tuple[Truths, list[tuple[Indices, Indices]]]:
    """Which boxes lie in the grid, and by axis the first cell of each and the one after its last.

    `box`: low, high, low, high, ..., each one number or one for every box. What is no number lies
    in no grid. The cells of what is outside are some that there are.
    """
    inside: Truths = np.ones(1, dtype=np.bool_)
    ranges = []
    for k, edges in enumerate(grid.edges):
        low, high = box[2 * k], box[2 * k + 1]
        at = np.array(edges)
        if grid.has_no_ends(k):
            width = at[-1] - at[0]
            inside = inside & (low >= at[0] - width) & (high <= at[-1] + width) & (low <= high)
            low, high = np.clip(low, at[0], at[-1]), np.clip(high, at[0], at[-1])
        inside = inside & (low >= at[0]) & (high <= at[-1]) & (low <= high)
        count = len(edges) - 1
        first = np.clip(np.searchsorted(at, low, side="right") - 1, 0, count - 1)
        last = np.clip(np.searchsorted(at, high, side="left"), first + 1, count)
        ranges.append((first, last))
    return inside, ranges


def count_of(cells: Cells, ranges: Sequence[tuple[Indices, Indices]]) -> NDArray[np.int64]:
    """Members in each block, (blocks,)."""
    total: NDArray[np.int64] = np.zeros(1, dtype=np.int64)
    for corner in product((0, 1), repeat=len(ranges)):
        part = cells.sums[tuple(ends[pick] for pick, ends in zip(corner, ranges, strict=True))]
        total = total + part if (len(ranges) - sum(corner)) % 2 == 0 else total - part
    return total


def contained(cells: Cells, boxes: Sequence[Floats]) -> Truths:
    """Which boxes lie in the set, (boxes,); `boxes`: several of each, in a row, all of which."""
    width = 2 * len(cells.grid.edges)
    within: Truths = np.ones(1, dtype=np.bool_)
    for k in range(0, len(boxes), width):
        inside, ranges = cells_of(cells.grid, boxes[k : k + width])
        volume = np.ones(1, dtype=np.int64)
        for first, last in ranges:
            volume = volume * (last - first)
        within = within & inside & (count_of(cells, ranges) == volume)
    return within


def followed_beyond(
    grid: Grid, start: Sequence[tuple[Floats, Floats]], boxes: Sequence[Floats]
) -> Truths:
    """Whether what is enclosed from each box of `start` holds of runs beyond ends that it touches.

    `boxes`: where runs from there are, several, one after the other (`Grid.followed_beyond`); the
    arrays are (boxes,).
    """
    fine: Truths = np.ones(1, dtype=np.bool_)
    width = 2 * len(grid.edges)
    for k in (k for k in range(len(grid.edges)) if boxes and grid.has_no_ends(k)):
        at = np.array(grid.edges[k])
        low, high = start[k]
        least = np.minimum.reduce(np.broadcast_arrays(*boxes[2 * k :: width]))
        most = np.maximum.reduce(np.broadcast_arrays(*boxes[2 * k + 1 :: width]))
        last, first = at[-1:] - at[-2:-1], at[1:2] - at[:1]
        fine = fine & ((high < at[-1]) | (BallArray(low) - BallArray(least) <= _ball(last)))
        fine = fine & ((low > at[0]) | (BallArray(most) - BallArray(high) <= _ball(first)))
    return fine


def _ball(difference: Floats) -> BallArray:
    """Around a rounded difference."""
    return BallArray(difference, np.abs(difference) * EPS)


def boxes_of(grid: Grid, blocks: Sequence[Block]) -> list[tuple[Floats, Floats]]:
    """The ends of blocks by axis, each (blocks,)."""
    at = np.array(blocks, dtype=np.intp)
    edges = [np.array(e) for e in grid.edges]
    return [(e[at[:, k, 0]], e[at[:, k, 1]]) for k, e in enumerate(edges)]
