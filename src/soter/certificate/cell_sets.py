"""Sets of cells of a grid, and what lies in one.

Purpose: a `Grid` has breakpoints on each axis; `Cells` is a set of its cells, and says whether a
box lies in it. `cells_unshown` and `cells_uncovered` walk over blocks of cells, and try large ones
first.
Non-goals: what is tried on a block; where tables come from (`folder.py`).

Cells are closed boxes: a box that ends exactly at an edge needs only the cells on its own side.

An axis may have no ends: then its first and its last cell hold all that lies beyond, and nothing
reads its state (`extras/left_out_states.py`). Of the runs that begin there those are enclosed that
begin between the edges. Let one begin at z beyond the upper edge e, which a box from which runs are
enclosed touches. Take from it, at all times, z - e along that axis: that is a run from the box.
Where it does not fall by more than the last cell is wide it stays in the last cell, and the other
one, which is above it, does so, too, while all else of the two is the same (`followed_beyond`).
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from soter.certificate.reading.case_model import FARTHEST
from soter.certificate.terms.linear_enclosures import HALF, above, below, exact

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    Block = tuple[tuple[int, int], ...]


TURN = 2 * math.pi
SEAM = 2.0**-40
"""By so much the cells at the ends of a full turn go on beyond them: the ends are a turn apart but
for rounding, so that these two cells meet."""
BACK = 2.0**-45
"""More than what is lost where a number is brought back by whole turns."""
FAR = 2.0**14
"""The farthest from 0 that a state on an axis which wraps around is assumed to be, in rad."""
FARTHEST_TURNED = 32.0
"""Farther numbers are not brought back."""
WIDER = 256
"""The factor by which each box is wider than the one before, on the way there."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid over some states; `edges`: each axis' breakpoints, strictly increasing and finite."""

    edges: tuple[tuple[float, ...], ...]
    unbounded: tuple[bool, ...] = ()
    """Whether each axis has no ends; empty: none of them."""
    wraps: tuple[bool, ...] = ()
    """Whether each axis is a full turn that wraps around; empty: none of them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of cells on each axis."""
        return tuple(len(e) - 1 for e in self.edges)

    @property
    def whole(self) -> Block:
        """The block of every cell."""
        return tuple((0, n) for n in self.shape)

    def cells(self, box: Sequence[float], offset: int = 0) -> Block | None:
        """The cells that cover a box low, high, low, high, ...; None where it leaves the grid.

        Of an axis that wraps around: begun within it, and counted on behind its last cell.
        """
        ranges = []
        at = offset
        for k, edges in enumerate(self.edges):
            low, high = box[at], box[at + 1]
            at += 2
            if self.wraps_around(k):
                if not (-FARTHEST_TURNED <= low <= high <= FARTHEST_TURNED):
                    return None
                ranges.append(_cells_around(edges, low, high))
                continue
            if self.has_no_ends(k):
                width = edges[-1] - edges[0]
                if not (edges[0] - width <= low <= high <= edges[-1] + width):
                    return None
                low, high = (min(max(x, edges[0]), edges[-1]) for x in (low, high))
            if not (low >= edges[0] and high <= edges[-1]):
                return None
            first = min(bisect_right(edges, low) - 1, len(edges) - 2)
            last = max(bisect_left(edges, high), first + 1)
            ranges.append((first, last))
        return tuple(ranges)

    def has_no_ends(self, axis: int) -> bool:
        """Whether what lies beyond the ends of an axis belongs to its outer cells."""
        return bool(self.unbounded) and self.unbounded[axis]

    def reach(self, axis: int) -> tuple[float, ...]:
        """Breakpoints of an axis, the outer ones as far out as their cells go."""
        edges = self.edges[axis]
        far = float(FARTHEST)
        return (-far, *edges[1:-1], far) if self.has_no_ends(axis) else edges

    def wraps_around(self, axis: int) -> bool:
        """Whether what leaves an axis at one end comes in at the other."""
        return bool(self.wraps) and self.wraps[axis]

    def counted_on(self, table: NDArray[Any]) -> NDArray[Any]:
        """A table, of the grid's shape, once more behind itself along axes that wrap around."""
        for k in (k for k in range(len(self.edges)) if self.wraps_around(k)):
            table = np.concatenate([table, table], axis=k)
        return table

    def followed_beyond(self, start: Sequence[tuple[arb, arb]], boxes: Sequence[float]) -> bool:
        """Whether what is enclosed from a box holds of all runs from the cells that it is part of.

        `boxes`: where runs from `start` are, one after the other. See the top of this file.
        """
        width = 2 * len(self.edges)
        if not boxes:
            return True
        for k in (k for k in range(len(self.edges)) if self.has_no_ends(k)):
            edges, (low, high) = self.edges[k], start[k]
            least, most = min(boxes[2 * k :: width]), max(boxes[2 * k + 1 :: width])
            if not high < edges[-1] and not low - exact(least) <= _width(edges, -2):
                return False
            if not low > edges[0] and not exact(most) - high <= _width(edges, 0):
                return False
        return True

    def whole_boxes(self, block: Block, reads: Sequence[bool]) -> list[list[tuple[arb, arb]]]:
        """Boxes that cover a block together with all that lies beyond, up to `FARTHEST`.

        The first one is that of the block. Those beyond are far wider each than the one before: in
        each the numbers are of a size, so that rounding is small. `reads`: of each axis whether
        what is asked depends on its state; along others nothing lies beyond that would matter.
        """
        sides = []
        for k, inside in enumerate(self.box(block)):
            parts = [inside]
            if self.has_no_ends(k) and reads[k]:
                parts += self.beyond(k, low=block[k][0] == 0, high=block[k][1] == self.shape[k])
            sides.append(parts)
        return [list(box) for box in product(*sides)]

    def beyond(self, axis: int, *, low: bool, high: bool) -> list[tuple[arb, arb]]:
        """Intervals that cover what lies beyond the ends of an axis, up to `FARTHEST`."""
        first, last = self.edges[axis][0], self.edges[axis][-1]
        below_it = [(-b, -a) for a, b in _intervals_beyond(-first, last - first)] if low else []
        return [*below_it, *(_intervals_beyond(last, last - first) if high else ())]

    def box(self, block: Block) -> list[tuple[arb, arb]]:
        """The box of a block of cells; at the ends of an axis that wraps around a little more."""
        ends = []
        for k, (low, high) in enumerate(block):
            edges = self.edges[k]
            if self.wraps_around(k):
                edges = (edges[0] - SEAM, *edges[1:-1], edges[-1] + SEAM)
            ends.append((exact(edges[low]), exact(edges[high])))
        return ends

    def text(self, block: Block) -> str:
        """A block of cells in words, for people."""
        parts = zip(self.edges, block, strict=True)
        return " x ".join(f"[{e[low]:.6g}, {e[high]:.6g}]" for e, (low, high) in parts)


@dataclass(eq=False)
class Axes:
    """Some states, and the grid over them."""

    states: tuple[int, ...]
    grid: Grid


def _cells_around(edges: Sequence[float], low: float, high: float) -> tuple[int, int]:
    """The cells of a full turn that cover an interval, from within the first turn on."""
    count, turns = len(edges) - 1, [math.floor((x - edges[0]) / TURN) for x in (low, high)]
    if turns[0] == -1 and low >= edges[0] - SEAM:
        turns[0] = 0  # of the first cell still
    if turns[1] == 1 and high <= edges[-1] + SEAM:
        turns[1] = 0  # of the last one
    low, high = (
        x - TURN * k + apart * (k != 0)
        for x, k, apart in zip((low, high), turns, (-BACK, BACK), strict=True)
    )
    first = min(max(bisect_right(edges, low) - 1, 0), count - 1) + turns[0] * count
    last = max(min(bisect_left(edges, high), count), 1) + turns[1] * count
    if last - first >= count:
        return 0, count
    last = max(last, first + 1)
    return first % count, first % count + last - first


def turned_back(edges: Sequence[float], low: float, high: float) -> tuple[float, float]:
    """An interval less so many whole turns that it begins on an axis, rounded outwards.

    As it is where it lies on the axis, or where it is so far away that nothing is known there; all
    of the axis where it is longer than half of it: what is enclosed goes half a turn beyond.
    """
    if edges[0] <= low <= high <= edges[-1] or not max(-low, high) <= FAR:
        return low, high
    if high - low >= TURN / 2:
        return edges[0] - SEAM, edges[-1] + SEAM
    back = 2 * arb.pi() * math.floor((low - edges[0]) / TURN)
    return below(exact(low) - back), above(exact(high) - back)


def _width(edges: Sequence[float], cell: int) -> arb:
    """The width of one cell of an axis; the last cell is -2."""
    return exact(edges[cell + 1]) - exact(edges[cell])


@lru_cache(maxsize=64)
def _intervals_beyond(end: float, width: float) -> Sequence[tuple[arb, arb]]:
    """Intervals from an end upwards to `FARTHEST`."""
    intervals, low, step = [], exact(end), exact(width)
    while low < FARTHEST:
        high = (exact(end) + step).min(FARTHEST)
        intervals.append((low, high))
        low, step = high, step * WIDER
    return intervals


class Cells:
    """A set of cells with a summed table: how many cells of a block belong to it."""

    def __init__(self, grid: Grid, members: NDArray[np.bool_]) -> None:
        if members.shape != grid.shape:
            raise AssertionError("a set of other cells")
        self.grid = grid
        self.members = members
        self.size = int(np.count_nonzero(members))
        sums = grid.counted_on(members).astype(np.int64)
        for axis in range(sums.ndim):
            sums = np.cumsum(sums, axis=axis)
        padded = np.zeros([n + 1 for n in sums.shape], dtype=np.int64)
        padded[tuple(slice(1, None) for _ in sums.shape)] = sums
        self.sums = padded
        """At each corner how many members lie below it on every axis."""
        self._sums = memoryview(padded.reshape(-1).data)
        self._strides = [int(s) // 8 for s in padded.strides]

    def count(self, block: Block) -> int:
        """Members in a block."""
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
        block = self.grid.cells(box, offset)
        return block is not None and self.count(block) == volume(block)

    def contains_all(self, boxes: Sequence[float]) -> bool:
        """Whether several boxes, one after the other, all lie in the union of the cells."""
        width = 2 * len(self.grid.edges)
        return all(self.contains(boxes, k) for k in range(0, len(boxes), width))


def volume(block: Block) -> int:
    """The number of cells of a block."""
    count = 1
    for low, high in block:
        count *= high - low
    return count


def halves(block: Block) -> tuple[Block, Block]:
    """A block cut across its longest axis."""
    axis = max(range(len(block)), key=lambda i: block[i][1] - block[i][0])
    low, high = block[axis]
    middle = (low + high) // 2
    return (
        (*block[:axis], (low, middle), *block[axis + 1 :]),
        (*block[:axis], (middle, high), *block[axis + 1 :]),
    )


def parts(block: Block, count: int) -> list[Block]:
    """A block cut into about `count` blocks."""
    blocks = [block]
    while len(blocks) < count:
        largest = max(blocks, key=volume)
        if volume(largest) == 1:
            break
        blocks.remove(largest)
        blocks.extend(halves(largest))
    return blocks


def cells_unshown(
    todo: NDArray[np.bool_],
    block: Block,
    attempt: Callable[[Block, NDArray[np.bool_]], NDArray[np.bool_]],
    largest: int,
) -> Iterator[Block]:
    """Cells of `todo`, a set of the grid's shape, in the block that no attempt showed.

    `attempt` is made on blocks of at most `largest` cells, with those of them that are wanted; it
    gives back which of these it showed. Where it did not show all, smaller blocks follow.
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
        size = volume(at)
        if size <= limit:
            wanted &= ~attempt(at, wanted)
            limit = max(size // 4, 1)
            if not wanted.any():
                continue
        if size == 1:
            yield at
        else:
            waiting.extend((half, limit) for half in halves(at))


def cells_uncovered(
    todo: NDArray[np.bool_], block: Block, attempt: Callable[[Block], bool], largest: int
) -> Iterator[Block]:
    """As `cells_unshown`, for an attempt on a block of which every cell is in `todo`.

    What holds of the block holds of its cells.

    `todo`: shaped as the grid.
    """

    def whole(at: Block, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return wanted if wanted.all() and attempt(at) else np.zeros_like(wanted)

    return cells_unshown(todo, block, whole, largest)


def holds_in_parts(
    box: list[tuple[arb, arb]], attempt: Callable[[list[tuple[arb, arb]]], bool], splits: int
) -> bool:
    """Whether the attempt works on all parts of a box, halving where it does not."""
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
    """A block as an index, of a part of the table that begins at `base`."""
    starts = base or [0] * len(block)
    return tuple(slice(low - b, high - b) for (low, high), b in zip(block, starts, strict=True))


def smallest_block(wanted: NDArray[np.bool_], block: Block) -> Block:
    """The smallest block around the cells that are wanted, of the shape of `block`."""
    ranges = []
    for axis, (low, _) in enumerate(block):
        others = tuple(k for k in range(wanted.ndim) if k != axis)
        places = np.flatnonzero(wanted.any(axis=others))
        ranges.append((low + int(places[0]), low + int(places[-1]) + 1))
    return tuple(ranges)
