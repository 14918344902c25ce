"""Sets of cells, and many boxes at once: whether each lies in the set.

Purpose: what `Grid.cells` and `Cells.contains` say of one box, of arrays of boxes.
Non-goals: axes without ends, of which runs beyond have to be followed.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

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
        assert not grid.has_no_ends(k)
        low, high = box[2 * k], box[2 * k + 1]
        at = np.array(edges)
        inside = inside & (low >= at[0]) & (high <= at[-1]) & (low <= high)
        count = len(edges) - 1
        first = np.clip(np.searchsorted(at, low, side="right") - 1, 0, count - 1)
        last = np.clip(np.searchsorted(at, high, side="left"), first + 1, count)
        ranges.append((first, last))
    return inside, ranges


def count_of(cells: Cells, ranges: Sequence[tuple[Indices, Indices]]) -> NDArray[np.int64]:
    """Members in each block."""
    total: NDArray[np.int64] = np.zeros(1, dtype=np.int64)
    for corner in product((0, 1), repeat=len(ranges)):
        part = cells.sums[tuple(ends[pick] for pick, ends in zip(corner, ranges, strict=True))]
        total = total + part if (len(ranges) - sum(corner)) % 2 == 0 else total - part
    return total


def contained(cells: Cells, boxes: Sequence[Floats]) -> Truths:
    """Which boxes lie in the set; `boxes`: several of each, one after the other, all of which."""
    width = 2 * len(cells.grid.edges)
    within: Truths = np.ones(1, dtype=np.bool_)
    for k in range(0, len(boxes), width):
        inside, ranges = cells_of(cells.grid, boxes[k : k + width])
        volume = np.ones(1, dtype=np.int64)
        for first, last in ranges:
            volume = volume * (last - first)
        within = within & inside & (count_of(cells, ranges) == volume)
    return within


def boxes_of(grid: Grid, blocks: Sequence[Block]) -> list[tuple[Floats, Floats]]:
    """The ends of blocks by axis."""
    at = np.array(blocks, dtype=np.intp)
    edges = [np.array(e) for e in grid.edges]
    return [(e[at[:, k, 0]], e[at[:, k, 1]]) for k, e in enumerate(edges)]
