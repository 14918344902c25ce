"""Sets of cells of a grid, and what lies in one.

Purpose: a `Grid` has breakpoints on each axis; `Cells` is a set of its cells, and says whether a
box lies in it. `cells_unshown` and `cells_uncovered` walk over blocks of cells, and try large ones
first.
Non-goals: what is tried on a block; where tables come from (`folder.py`).

Cells are closed boxes: a box that ends exactly at an edge needs only the cells on its own side.
An axis without ends, or one that wraps around, is a matter of `extras/left_out_states.py`.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.terms.linear_enclosures import HALF, exact

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    Block = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid over some states; `edges`: each axis' breakpoints, strictly increasing and finite."""

    edges: tuple[tuple[float, ...], ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of cells on each axis."""
        return tuple(len(e) - 1 for e in self.edges)

    @property
    def all_cells(self) -> Block:
        """The block of all cells of the grid."""
        return tuple((0, n) for n in self.shape)

    def cells_around(self, box: Sequence[float], offset: int = 0) -> Block | None:
        """The cells that cover a box (low, high, low, ...); None if the box leaves the grid."""
        ranges = []
        for k in range(len(self.edges)):
            found = self.cells_around_interval(k, box[offset + 2 * k], box[offset + 2 * k + 1])
            if found is None:
                return None
            ranges.append(found)
        return tuple(ranges)

    def cells_around_interval(self, axis: int, low: float, high: float) -> tuple[int, int] | None:
        """(first, last + 1) of the cells that cover an interval; None if it leaves the axis."""
        edges = self.edges[axis]
        if not (low >= edges[0] and high <= edges[-1]):
            return None
        first = min(bisect_right(edges, low) - 1, len(edges) - 2)
        return first, max(bisect_left(edges, high), first + 1)

    def box_of(self, block: Block) -> list[tuple[arb, arb]]:
        """The box of a block of cells."""
        pairs = zip(self.edges, block, strict=True)
        return [(exact(edges[low]), exact(edges[high])) for edges, (low, high) in pairs]

    def block_in_words(self, block: Block) -> str:
        """The intervals of a block of cells, as text."""
        parts = zip(self.edges, block, strict=True)
        return " x ".join(f"[{e[low]:.6g}, {e[high]:.6g}]" for e, (low, high) in parts)

    # ------------------------------------------------------------ beyond ends, where axes have none

    def table_continued(self, table: NDArray[Any]) -> NDArray[Any]:
        """A table of the grid's shape, repeated along the axes that wrap around."""
        return table

    def holds_beyond_ends(self, start: Sequence[tuple[arb, arb]], boxes: Sequence[float]) -> bool:
        """Whether boxes that enclose runs from `start` also do so for runs from beyond axis ends.

        `boxes`: low, high, ... of all boxes in turn. It is true here, as every axis has ends.
        """
        del start, boxes
        return True

    def boxes_covering(self, block: Block, reads: Sequence[bool]) -> list[list[tuple[arb, arb]]]:
        """Boxes that cover all states of a block; on a grid with ends, only the block's box.

        `reads`: for each axis, whether the question to be asked depends on its state.
        """
        del reads
        return [self.box_of(block)]

    def move_onto_axis(self, axis: int, low: float, high: float) -> tuple[float, float]:
        """An interval of starts, shifted onto an axis that wraps around, else unchanged."""
        del axis
        return low, high


@dataclass(eq=False)
class Axes:
    """Some states, and the grid over them."""

    states: tuple[int, ...]
    grid: Grid


class Cells:
    """A set of cells of a grid; a summed table counts the members in a block quickly."""

    def __init__(self, grid: Grid, members: NDArray[np.bool_]) -> None:
        if members.shape != grid.shape:
            raise AssertionError("a set of other cells")
        self.grid = grid
        self.members = members
        self.size = int(np.count_nonzero(members))
        sums = grid.table_continued(members).astype(np.int64)
        for axis in range(sums.ndim):
            sums = np.cumsum(sums, axis=axis)
        padded = np.zeros([n + 1 for n in sums.shape], dtype=np.int64)
        padded[tuple(slice(1, None) for _ in sums.shape)] = sums
        self.sums = padded
        """At each corner how many members lie below it on every axis."""
        self._sums = memoryview(padded.reshape(-1).data)
        self._strides = [int(s) // 8 for s in padded.strides]

    def members_in(self, block: Block) -> int:
        """The number of members in a block."""
        sums, strides = self._sums, self._strides
        total = 0
        for corner in product((0, 1), repeat=len(block)):
            at, sign = 0, 1
            for pick, ends, stride in zip(corner, block, strides, strict=True):
                at += ends[pick] * stride
                sign = sign if pick else -sign
            total += sign * sums[at]
        return total

    def contains(self, box: Sequence[float], offset: int = 0) -> bool:
        """Whether a box lies in the union of the cells."""
        block = self.grid.cells_around(box, offset)
        return block is not None and self.members_in(block) == cell_count(block)

    def contains_all(self, boxes: Sequence[float]) -> bool:
        """Whether all boxes of a list (low, high, low, ...) lie in the union of the cells."""
        width = 2 * len(self.grid.edges)
        return all(self.contains(boxes, k) for k in range(0, len(boxes), width))


def cell_count(block: Block) -> int:
    """The number of cells of a block."""
    count = 1
    for low, high in block:
        count *= high - low
    return count


def halves_of_block(block: Block) -> tuple[Block, Block]:
    """The two halves of a block, cut across its longest axis."""
    axis = max(range(len(block)), key=lambda i: block[i][1] - block[i][0])
    low, high = block[axis]
    middle = (low + high) // 2
    return (
        (*block[:axis], (low, middle), *block[axis + 1 :]),
        (*block[:axis], (middle, high), *block[axis + 1 :]),
    )


def cut_block(block: Block, count: int) -> list[Block]:
    """Cuts a block into about `count` blocks."""
    blocks = [block]
    while len(blocks) < count:
        largest = max(blocks, key=cell_count)
        if cell_count(largest) == 1:
            break
        blocks.remove(largest)
        blocks.extend(halves_of_block(largest))
    return blocks


def cells_unshown(
    todo: NDArray[np.bool_],
    block: Block,
    attempt: Callable[[Block, NDArray[np.bool_]], NDArray[np.bool_]],
    largest: int,
) -> Iterator[Block]:
    """Yields the cells of a block that lie in `todo` (shaped as the grid) and that stay unshown.

    `attempt` gets a block of at most `largest` cells and the wanted cells in it, and returns those
    that it showed. If some are left, it gets smaller blocks.
    """
    left = todo[block_index(block)].copy()
    base = tuple(low for low, _ in block)
    waiting = [(block, largest)]
    while waiting:
        at, limit = waiting.pop()
        wanted = left[block_index(at, base)]
        if not wanted.any():
            continue
        at = smallest_block(wanted, at)
        wanted = left[block_index(at, base)]
        size = cell_count(at)
        if size <= limit:
            wanted &= ~attempt(at, wanted)
            limit = max(size // 4, 1)
            if not wanted.any():
                continue
        if size == 1:
            yield at
        else:
            waiting.extend((half, limit) for half in halves_of_block(at))


def cells_uncovered(
    todo: NDArray[np.bool_], block: Block, attempt: Callable[[Block], bool], largest: int
) -> Iterator[Block]:
    """Yields cells as `cells_unshown` does, if an attempt shows a whole block or nothing.

    `todo`: shaped as the grid. `attempt`: true only if all cells of the block are shown.
    """

    def attempt_on_full_block(at: Block, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return wanted if wanted.all() and attempt(at) else np.zeros_like(wanted)

    return cells_unshown(todo, block, attempt_on_full_block, largest)


def holds_in_parts(
    box: list[tuple[arb, arb]], attempt: Callable[[list[tuple[arb, arb]]], bool], splits: int
) -> bool:
    """Whether `attempt` succeeds on a box, or on all parts after up to `splits` halvings."""
    if attempt(box):
        return True
    if splits == 0:
        return False
    axis = splits % len(box)
    low, high = box[axis]
    middle = ((low + high) * HALF).mid()
    return all(
        holds_in_parts([*box[:axis], half, *box[axis + 1 :]], attempt, splits - 1)
        for half in ((low, middle), (middle, high))
    )


def block_index(block: Block, base: Sequence[int] | None = None) -> tuple[slice, ...]:
    """The block as an index into the part of a table that begins at `base`."""
    starts = base or [0] * len(block)
    return tuple(slice(low - b, high - b) for (low, high), b in zip(block, starts, strict=True))


def smallest_block(wanted: NDArray[np.bool_], block: Block) -> Block:
    """The smallest block around the wanted cells; `wanted` has the shape of `block`."""
    ranges = []
    for axis, (low, _) in enumerate(block):
        others = tuple(k for k in range(wanted.ndim) if k != axis)
        places = np.flatnonzero(wanted.any(axis=others))
        ranges.append((low + int(places[0]), low + int(places[-1]) + 1))
    return tuple(ranges)
