"""Cells on which a proposition is decided, many boxes at once.

Purpose: `decided`: of each cell whether a proposition certainly holds on it, certainly fails
somewhere in it, or neither was shown.
Non-goals: the proposition itself (`inclusions/predicates.py`), and what these arrays do not decide:
that is left to Arb.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray, no_underflow
from soter.certificate.batches.cell_arrays import boxes_of
from soter.certificate.inclusions.cell_sets import block_index, halves, volume
from soter.certificate.terms.arb_balls import above, below

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.batches.form_arrays import Forms
    from soter.certificate.inclusions.cell_sets import Block, Cells, Grid

    Bits: TypeAlias = NDArray[np.uint8]
    Boxes: TypeAlias = list[tuple[Floats, Floats]]
    Members: TypeAlias = NDArray[np.bool_]

HOLDS, FAILS, NEITHER = 2, 1, 3
"""What is known of a proposition on a box, as bits: it may fail, it may hold."""
AT_ONCE = 4096
CELLS_IN_PARTS = 256
"""Cells that are halved together."""


@dataclass(frozen=True, eq=False)
class ArrayDecision:
    """A proposition over boxes of states, errors and other topics.

    `truth` gives the bits of forms without symbols; `ranges`: of what is no state; `reads`: of each
    state of the grid whether the proposition depends on it.
    """

    truth: Callable[[Forms], tuple[tuple[Any, ...], Truths]]
    ranges: Sequence[tuple[arb, arb]]
    reads: tuple[bool, ...]

    def of(self, boxes: Boxes) -> Bits:
        """The bits of boxes, (boxes,): of the states, and of all else where they have its axes."""
        count = len(boxes[0][0])
        answers = np.full(count, NEITHER, dtype=np.uint8)
        for first in range(0, count, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            bits, sure = self.truth(_form([(low[part], high[part]) for low, high in boxes]))
            answers[part] = np.where(sure, bits[0], NEITHER)
        return answers

    def with_ranges(self, boxes: Boxes) -> Boxes:
        """Boxes of states, and of all else."""
        count = len(boxes[0][0])
        other = [(below(low), above(high)) for low, high in self.ranges]
        return [*boxes, *((np.full(count, a), np.full(count, b)) for a, b in other)]


def _form(boxes: Boxes) -> Forms:
    """The forms of boxes without symbols: ranges, centres, radii."""
    ends = [(BallArray(low), BallArray(high)) for low, high in boxes]
    half = BallArray.of(0.5)
    form = [end for interval in ends for end in interval]
    form += [(low + high) * half for low, high in ends]
    form += [(high - low) * half for low, high in ends]
    return tuple(form)


def decided(decision: ArrayDecision, todo: Cells, block: Block, splits: int) -> Bits:
    """Of each cell of `todo` in a block what is known, in the grid's shape; elsewhere `NEITHER`.

    A cell of which nothing is known as a whole is halved `splits` times, errors and other topics
    with it. What lies beyond an axis without ends belongs to its outer cells.
    """
    known = np.full(todo.grid.shape, NEITHER, dtype=np.uint8)
    try:
        with no_underflow():
            _decide(decision, todo, block, splits, known)
    except FloatingPointError:
        pass
    return known


def _decide(decision: ArrayDecision, todo: Cells, block: Block, splits: int, known: Bits) -> None:
    waiting, cells = [block], []
    while waiting:
        asked = []
        for at in waiting:
            wanted = todo.count(at)
            if wanted:
                asked.append((at, wanted == volume(at)))
        whole = [at for at, all_of_it in asked if all_of_it]
        answers = dict(zip(whole, _bits_of(decision, todo.grid, whole), strict=True))
        waiting = []
        for at, _ in asked:
            bits = answers.get(at, NEITHER)
            if bits != NEITHER:
                known[block_index(at)] = bits
            elif volume(at) > 1:
                waiting += halves(at)
            else:
                cells.append(at)
    cells = [at for at in cells if not _at_open_end(decision, todo.grid, at)]
    for first in range(0, len(cells), CELLS_IN_PARTS):
        some = cells[first : first + CELLS_IN_PARTS]
        for at, bits in zip(some, _in_parts(decision, todo.grid, some, splits), strict=True):
            known[block_index(at)] = bits


def _bits_of(decision: ArrayDecision, grid: Grid, blocks: Sequence[Block]) -> Sequence[int]:
    """The bits of blocks, each with all that lies beyond it where an axis has no ends."""
    if not blocks:
        return ()
    inside = boxes_of(grid, blocks)
    answers = decision.of(decision.with_ranges(inside))
    for first in range(0, len(blocks), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        ends = [(low[part], high[part]) for low, high in inside]
        for index, boxes in _beyond(decision, grid, blocks[part], ends):
            np.bitwise_or.at(answers, first + index, decision.of(decision.with_ranges(boxes)))
    return [int(x) for x in answers]


def _beyond(
    decision: ArrayDecision, grid: Grid, blocks: Sequence[Block], inside: Boxes
) -> Iterator[tuple[NDArray[np.intp], Boxes]]:
    """Boxes of what lies beyond blocks, and the block of each (`Grid.whole_boxes`)."""
    at = np.array(blocks, dtype=np.intp)
    open_axes = [grid.has_no_ends(k) and reads for k, reads in enumerate(decision.reads)]
    touches = np.stack(
        [at[:, :, 0] == 0, at[:, :, 1] == np.array(grid.shape)], axis=2
    ) & np.reshape(open_axes, (1, -1, 1))
    kinds, kind_of = np.unique(touches.reshape(len(blocks), -1), axis=0, return_inverse=True)
    for number, kind in enumerate(kinds):
        index = np.flatnonzero(kind_of.reshape(-1) == number)
        sides: list[Boxes] = []
        for k, (low, high) in enumerate(inside):
            away = grid.beyond(k, low=kind[2 * k], high=kind[2 * k + 1])
            ends = [(np.full(index.size, below(a)), np.full(index.size, above(b))) for a, b in away]
            sides.append([(low[index], high[index]), *ends])
        others = list(product(*sides))[1:]
        if others:
            boxes = [
                (
                    np.concatenate([low for low, _ in axis]),
                    np.concatenate([high for _, high in axis]),
                )
                for axis in zip(*others, strict=True)
            ]
            yield np.tile(index, len(others)), boxes


def _at_open_end(decision: ArrayDecision, grid: Grid, block: Block) -> bool:
    """Whether something that is read lies beyond the block, on an axis without ends."""
    return any(
        grid.has_no_ends(k) and reads and (low == 0 or high == len(grid.edges[k]) - 1)
        for k, ((low, high), reads) in enumerate(zip(block, decision.reads, strict=True))
    )


def _in_parts(
    decision: ArrayDecision, grid: Grid, cells: Sequence[Block], splits: int
) -> Sequence[int]:
    """The bits of cells: they hold where all of their parts do, and fail where some part does."""
    fails = np.zeros(len(cells), dtype=np.bool_)
    boxes = decision.with_ranges(boxes_of(grid, cells))
    owner = np.arange(len(cells))
    for left in range(splits, 0, -1):
        axis = left % len(boxes)  # as `cell_sets.finer`
        low, high = boxes[axis]
        middle = low * 0.5 + high * 0.5
        boxes = [(np.tile(a, 2), np.tile(b, 2)) for a, b in boxes]
        boxes[axis] = np.concatenate([low, middle]), np.concatenate([middle, high])
        owner = np.tile(owner, 2)
        bits = decision.of(boxes)
        fails[owner[bits == FAILS]] = True
        on = (bits == NEITHER) & ~fails[owner]
        boxes, owner = [(a[on], b[on]) for a, b in boxes], owner[on]
        if not owner.size:
            break
    answers = np.full(len(cells), HOLDS)
    answers[owner] = NEITHER
    answers[fails] = FAILS
    return [int(x) for x in answers]
