"""Cells that only lead where they should in parts, many of them at once.

Purpose: `unled_in_parts`: what `ChainCheck.leads_in_parts` asks of one cell, of many: finer tubes,
parts of the cell, and parts on the way.
Non-goals: cells that this does not show: they are left to Arb. Whole blocks (`chain_walks.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray, larger, no_underflow, smaller
from soter.certificate.batches.cell_arrays import boxes_of, contained, followed_beyond
from soter.certificate.batches.form_arrays import behind, box_of, of_boxes, taken
from soter.certificate.terms.compile_terms import states_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.batches.chain_walks import ArrayChain, Walk
    from soter.certificate.batches.form_arrays import Forms

    Indices: TypeAlias = NDArray[np.intp]
    Boxes: TypeAlias = list[tuple[Floats, Floats]]

FORMS = 4096
"""At once, those that are halved on the way among them."""
SAMPLE = 64
"""A try that shows fewer than half of so many cells is made of no others."""


@dataclass(frozen=True)
class Try:
    """Chains of which each shows some runs; how often boxes are halved, and sets on the way."""

    chains: tuple[ArrayChain, ...]
    splits: int
    cuts: int


def unled_in_parts(walk: Walk, left: NDArray[np.bool_], tries: Iterable[Try]) -> NDArray[np.bool_]:
    """The cells of `left` that no try shows, in the grid's shape."""
    cells = np.argwhere(left & (walk.holds > 0))
    if not cells.size:
        return left
    blocks = [tuple((int(i), int(i) + 1) for i in cell) for cell in cells]
    boxes = boxes_of(walk.within.grid, blocks)
    at = tuple(cells.T)
    waiting = np.arange(len(blocks))

    def shown(one: Try, some: Indices) -> Truths:
        asked = tuple(x[some] for x in at)
        parts = _Parts(walk, one, walk.holds[asked], walk.order[asked])
        return parts.shown([(low[some], high[some]) for low, high in boxes])

    try:
        with no_underflow():
            for one in tries:
                first = np.arange(waiting.size) % -(-waiting.size // SAMPLE) == 0
                sample, others = waiting[first], waiting[~first]
                fine = shown(one, sample)
                if 2 * fine.sum() >= sample.size and others.size:
                    others = others[~shown(one, others)]
                waiting = np.concatenate([sample[~fine], others])
                if not waiting.size:  # what the next one needs is not even made
                    break
    except FloatingPointError:
        pass
    rest: NDArray[np.bool_] = left & (walk.holds == 0)
    rest[tuple(x[waiting] for x in at)] = True
    return rest


@dataclass(eq=False)
class _Parts:
    """One try for some cells; of each its holds and its order."""

    walk: Walk
    one: Try
    holds: NDArray[np.uint8]
    order: NDArray[np.int64]

    def shown(self, boxes: Boxes) -> Truths:
        """Which cells are: a box that is not is halved, and both halves have to be."""
        fine: Truths = np.ones(len(self.holds), dtype=np.bool_)
        owner = np.arange(len(self.holds))
        for splits in range(self.one.splits, -1, -1):
            led = self._led(boxes, owner)
            if splits == 0:
                fine[owner[~led]] = False
                break
            again = ~led
            boxes, owner = [(a[again], b[again]) for a, b in boxes], owner[again]
            axis = splits % len(boxes)
            low, high = boxes[axis]
            middle = low * 0.5 + high * 0.5
            boxes = [(np.tile(a, 2), np.tile(b, 2)) for a, b in boxes]
            boxes[axis] = np.concatenate([low, middle]), np.concatenate([middle, high])
            owner = np.tile(owner, 2)
        return fine

    def _led(self, boxes: Boxes, owner: Indices) -> Truths:
        """Which boxes lead where their cells should, by all chains."""
        led: Truths = np.ones(len(owner), dtype=np.bool_)
        size = max(FORMS >> self.one.cuts, 1)
        for first in range(0, len(owner), size):
            part = np.arange(first, min(first + size, len(owner)))
            for chain in self.one.chains:
                part = part[led[part]]
                if part.size:
                    led[part] = self._follow(
                        chain, [(a[part], b[part]) for a, b in boxes], owner[part]
                    )
        return led

    def _follow(self, chain: ArrayChain, boxes: Boxes, owner: Indices) -> Truths:
        """The same of few boxes and one chain."""
        fine: Truths = np.ones(len(owner), dtype=np.bool_)
        holds, cuts = self.holds[owner].astype(np.int64), self.one.cuts
        form, of = of_boxes(boxes), np.arange(len(owner))
        k = 0
        while of.size:
            due = np.zeros(of.size, dtype=np.bool_)
            for c in range(1, cuts + 1):
                due |= holds[of] * c // (cuts + 1) == k
            if k and due.any():
                form, of = self._halved(form, of, due)
            step = chain.later if k else chain.first
            (form, ways), sure = step.of_many(form)
            fine_now = sure & contained(self.walk.within, ways) & self._followed(boxes, of, ways)
            stay = np.broadcast_to(fine_now, of.shape)
            fine[of[~stay]] = False
            k += 1
            done = np.flatnonzero(fine[of] & (holds[of] == k))
            if done.size:
                there = self._there(chain, taken(form, done), boxes, of[done], owner)
                fine[of[done[~there]]] = False
            on = np.flatnonzero(fine[of] & (holds[of] > k))
            form, of = taken(form, on), of[on]
        return fine

    def _followed(self, boxes: Boxes, of: Indices, ways: Sequence[Floats]) -> Truths:
        """Whether what is said of runs from some boxes holds of those from beyond."""
        start = [(low[of], high[of]) for low, high in boxes]
        return followed_beyond(self.walk.within.grid, start, ways)

    def _there(
        self, chain: ArrayChain, form: Forms, boxes: Boxes, of: Indices, owner: Indices
    ) -> Truths:
        """Which forms are where they should be when the last command ends."""
        ends: Sequence[Floats] = box_of(form, chain.dimension)
        order = self.order[owner[of]]
        fine: Truths = np.ones(order.shape, dtype=np.bool_)
        if chain.last is not None:
            (_, ends), sure = chain.last.of_many(form)
            fine = fine & sure & contained(self.walk.within, ends)
        fine = fine & self._followed(boxes, of, ends)
        width = 2 * chain.dimension
        for n in range(0, len(ends), width):
            box = [np.broadcast_to(x, order.shape) for x in ends[n : n + width]]
            fine = fine & (self.walk.highest(box) < order)
        return fine

    def _halved(self, form: Forms, of: Indices, due: Truths) -> tuple[Forms, Indices]:
        """Forms of which some are cut in two, along the state with the widest rest, in cells."""
        edges = self.walk.within.grid.edges
        n = len(edges)
        whole, cut = np.flatnonzero(~due), np.flatnonzero(due)
        new, owners = [taken(form, whole)], [of[whole]]
        part, own = taken(form, cut), of[cut]
        count = states_of(len(form), n)
        rest = 2 * count + count + count * n
        widths = np.stack(
            [
                np.broadcast_to(part[rest + i].centre, own.shape) * (len(e) - 1) / (e[-1] - e[0])
                for i, e in enumerate(edges)
            ]
        )
        widest = widths.argmax(axis=0)
        for axis in range(n):
            index = np.flatnonzero(widest == axis)
            if index.size:
                for side in (-0.5, 0.5):
                    new.append(halved(taken(part, index), n, axis, BallArray.of(side)))
                    owners.append(own[index])
        sizes = [len(o) for o in owners]
        return behind([f for f, s in zip(new, sizes, strict=True) if s], [s for s in sizes if s]), (
            np.concatenate(owners)
        )


def halved(form: Forms, n: int, axis: int, side: BallArray) -> Forms:
    """The parts of forms in which the beta of a state lies on one side (`compile_terms.halved`)."""
    count = states_of(len(form), n)
    new = list(form)
    centre, symbols = 2 * count, 3 * count
    rest = symbols + count * n
    common = rest + count
    b = form[rest + axis]
    new[centre + axis] = new[centre + axis] + side * b
    new[rest + axis] = b * BallArray.of(0.5)
    for k in range(count - n):
        moved = side * b * form[common + k * n + axis]
        new[centre + n + k] = new[centre + n + k] + moved
    radius = new[rest + axis]
    for k in range(n):
        radius = radius + abs(form[symbols + axis * n + k])
    new[2 * axis] = larger(new[centre + axis] - radius, form[2 * axis])
    new[2 * axis + 1] = smaller(new[centre + axis] + radius, form[2 * axis + 1])
    return tuple(new)
