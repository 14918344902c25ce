"""Walks over the cells of a table that look at many blocks at once.

Purpose: `unled`: cells from which SC was not shown to lead where it should; `unkept`: cells from
which it was not shown that nothing leads out. What is shown is shown with arrays of balls
(`ball_arrays.py`), one pass of the code for many blocks.
Non-goals: showing what these do not show: that is left to Arb (`inclusions/group_claims.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from soter.certificate.batches.ball_arrays import no_underflow
from soter.certificate.batches.cell_arrays import boxes_of, contained, followed_beyond
from soter.certificate.batches.form_arrays import box_of, of_boxes, taken
from soter.certificate.inclusions.cell_sets import around, block_index, halves, volume

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.batches.form_arrays import Forms
    from soter.certificate.inclusions.cell_sets import Block, Cells

    Image = tuple[tuple[Forms, Sequence[Floats]], Truths]
    Members = NDArray[np.bool_]

AT_ONCE = 4096
"""Blocks: so many that a call of numpy is worth it, and so few that they stay in the caches."""


FEW = 8
"""A step of many forms takes as long as so many steps of one."""
LITTLE, IDLE = 0.01, 2
"""Who shows less than this share of what is left, so often in a row, is not asked again."""
ENOUGH = 400
"""Blocks to begin with."""


@runtime_checkable
class ArrayStep(Protocol):
    """A step of a chain that is also one of many forms."""

    def of_many(self, form: Forms) -> Image:
        """What it makes of each form, boxes on the way, and for which of them it is defined."""


@dataclass(frozen=True, eq=False)
class ArrayChain:
    """The steps of a chain, as `sc_chains.Chain` has them."""

    dimension: int
    first: ArrayStep
    later: ArrayStep
    last: ArrayStep | None
    bare: tuple[ArrayStep, ArrayStep]


@dataclass(frozen=True, eq=False)
class Walk:
    """What is asked of the cells of a table.

    After `holds` holds of SC, those of each cell, every box in which the state may be has to be of
    a number `highest` below `order`, that of the cell; within `within` all the time. Tables are of
    the grid's shape; `highest` takes boxes, low, high, low, high, ....
    """

    chain: ArrayChain
    within: Cells
    holds: NDArray[np.uint8]
    order: NDArray[np.int64]
    highest: Callable[[Sequence[Floats]], NDArray[np.int64]]


def unled(walk: Walk, todo: Members, block: Block, largest: int) -> tuple[Members, int]:
    """The cells of `todo` in a block that are not shown, in the grid's shape.

    Blocks of at most `largest` cells are tried, then smaller ones, while there are enough of them.
    Behind the cells: of how many a block may be that is still worth trying.
    """
    left = np.zeros_like(todo)
    left[block_index(block)] = todo[block_index(block)]
    seen = np.zeros(todo.shape, dtype=np.uint16)
    idle = 0
    largest = min(largest, max(int(np.count_nonzero(left)) // ENOUGH, 1))
    waiting = [(block, largest)]
    try:
        while waiting:
            tried = list(_to_try(left, waiting))
            if not tried:
                return left, 1
            largest = max(map(volume, tried))
            attempts = [_Attempt(walk, part, left, seen) for part in _dealt(tried)]
            last = _worth_it(np.concatenate([a.until for a in attempts]))
            if not last or idle == IDLE:
                return left, largest
            before = np.count_nonzero(left)
            for attempt in attempts:
                attempt.until = np.minimum(attempt.until, last)
                with no_underflow():
                    attempt.make()
            idle = idle + 1 if np.count_nonzero(left) > (1.0 - LITTLE) * before else 0
            failed = [at for at in tried if left[block_index(at)].any()]
            waiting = [(at, max(volume(at) // 4, 1)) for at in failed if volume(at) > 1]
    except FloatingPointError:
        pass
    return left, largest


def _worth_it(until: NDArray[np.int64]) -> int:
    """How many holds at least `FEW` blocks are followed for."""
    followed = np.bincount(until)[::-1].cumsum()[::-1]  # for k holds and more, by k
    return int(np.flatnonzero(followed >= FEW).max(initial=0))


def _to_try(left: Members, waiting: Sequence[tuple[Block, int]]) -> Iterator[Block]:
    """Blocks around what is left of those that wait, none larger than its limit."""
    stack = list(waiting)
    while stack:
        block, limit = stack.pop()
        wanted = left[block_index(block)]
        if limit == 1:
            first = [low for low, _ in block]
            for cell in (np.argwhere(wanted) + first).tolist():
                yield tuple((i, i + 1) for i in cell)
            continue
        if not wanted.any():
            continue
        block = around(wanted, block)
        if volume(block) <= limit:
            yield block
        else:
            stack.extend((half, limit) for half in halves(block))


def _dealt(blocks: Sequence[Block]) -> Iterator[Sequence[Block]]:
    for first, last in pairwise([*range(0, len(blocks), AT_ONCE), len(blocks)]):
        yield blocks[first:last]


class _Attempt:
    """Some blocks, followed hold by hold; the cells that this shows are taken from `left`."""

    def __init__(
        self, walk: Walk, blocks: Sequence[Block], left: Members, seen: NDArray[np.uint16]
    ) -> None:
        self.walk, self.blocks, self.left, self.seen = walk, blocks, left, seen
        self.at = [block_index(b) for b in blocks]
        self.asked: dict[int, list[int]] = {}
        """Holds -> the blocks with a wanted cell that has so many."""
        self.until = np.zeros(len(blocks), dtype=np.int64)
        for b, at in enumerate(self.at):
            wanted = np.unique(walk.holds[at][left[at]])
            for k in wanted:
                self.asked.setdefault(int(k), []).append(b)
            self.until[b] = wanted[-1]
        self.known = np.array([int(seen[at].min()) for at in self.at])
        self.start = boxes_of(walk.within.grid, blocks)

    def make(self) -> None:
        """Follow all of them as far as they are asked for, while they are within."""
        alive = np.arange(len(self.blocks))
        form = of_boxes(self.start)
        reached = np.zeros(len(self.blocks), dtype=np.int64)
        k = 0
        while alive.size:
            k += 1
            alive, form = self._step(k, alive, form)
            reached[alive] = k
            self._judge(k, alive, form)
            on = np.flatnonzero(self.until[alive] > k)
            alive, form = alive[on], taken(form, on)
        for b in np.flatnonzero(reached > self.known):
            at = self.at[b]
            self.seen[at] = np.maximum(self.seen[at], reached[b])

    def _step(self, k: int, alive: NDArray[np.intp], form: Forms) -> tuple[NDArray[np.intp], Forms]:
        """The kth hold, and which blocks stay within; what was seen before is not looked at."""
        chain = self.walk.chain
        known = k <= self.known[alive]
        steps = chain.bare if known.all() else (chain.first, chain.later)
        (after, boxes), sure = steps[k > 1].of_many(form)
        within = contained(self.walk.within, boxes) & self._followed(alive, boxes)
        fine = sure & (within | known)  # of what is not sure the form says nothing
        stay = np.flatnonzero(fine)
        return alive[stay], taken(after, stay)

    def _followed(self, index: NDArray[np.intp], boxes: Sequence[Floats]) -> Truths:
        """Whether boxes of some runs hold of those from beyond, too."""
        grid = self.walk.within.grid
        return followed_beyond(grid, [(low[index], high[index]) for low, high in self.start], boxes)

    def _judge(self, k: int, alive: NDArray[np.intp], form: Forms) -> None:
        """Which cells are shown where the blocks are after k holds."""
        index = np.flatnonzero(np.isin(alive, self.asked.get(k, ())))
        if not index.size:
            return
        walk = self.walk
        part = taken(form, index)
        ends: Sequence[Floats] = box_of(part, walk.chain.dimension)
        fine = np.ones(index.size, dtype=np.bool_)
        if walk.chain.last is not None:
            (_, ends), sure = walk.chain.last.of_many(part)
            fine = fine & sure & contained(walk.within, ends)
        fine = fine & self._followed(alive[index], ends)
        width = 2 * walk.chain.dimension
        tops = np.full(index.size, np.iinfo(np.int64).min)
        for n in range(0, len(ends), width):
            box = [np.broadcast_to(x, index.shape) for x in ends[n : n + width]]
            tops = np.maximum(tops, walk.highest(box))
        for b, top in zip(alive[index[fine]], tops[fine], strict=True):
            at = self.at[b]
            self.left[at] &= (walk.holds[at] != k) | (walk.order[at] <= top)


def unkept(
    step: ArrayStep, repeats: int, claimed: Cells, within: Cells, block: Block, largest: int
) -> Members:
    """The cells of `claimed` in a block from which it is not shown that the step stays within.

    `repeats`: how often it is made, one after the other. In the grid's shape.
    """
    left = np.zeros_like(claimed.members)
    waiting = [block]
    try:
        while waiting:
            tried = list(_full(claimed, waiting, largest))
            waiting = []
            for part in _dealt(tried):
                with no_underflow():
                    fine = _stay(step, repeats, within, part)
                waiting += [at for at, kept in zip(part, fine, strict=True) if not kept]
            for at in waiting:
                if volume(at) == 1:
                    left[block_index(at)] = True
            waiting = [half for at in waiting if volume(at) > 1 for half in halves(at)]
    except FloatingPointError:
        left[block_index(block)] = claimed.members[block_index(block)]
    return left


def _full(claimed: Cells, waiting: Sequence[Block], largest: int) -> Iterator[Block]:
    """Blocks that consist of such cells, of at most so many, that cover those which wait."""
    stack = list(waiting)
    while stack:
        block = stack.pop()
        wanted, size = claimed.count(block), volume(block)
        if wanted == size and size <= largest:
            yield block
        elif wanted:
            stack.extend(halves(block))


def _stay(step: ArrayStep, repeats: int, within: Cells, blocks: Sequence[Block]) -> Members:
    """From which blocks all steps are within, the beginning included."""
    start = boxes_of(within.grid, blocks)
    form = of_boxes(start)
    fine = np.zeros(len(blocks), dtype=np.bool_)
    alive = np.flatnonzero(contained(within, box_of(form, len(within.grid.edges))))
    form = taken(form, alive)
    for _ in range(repeats):
        if not alive.size:
            return fine
        (form, boxes), sure = step.of_many(form)
        kept = sure & contained(within, boxes)
        kept = kept & followed_beyond(
            within.grid, [(low[alive], high[alive]) for low, high in start], boxes
        )
        stay = np.flatnonzero(np.broadcast_to(kept, alive.shape))
        alive, form = alive[stay], taken(form, stay)
    fine[alive] = True
    return fine
