"""Sets that are products over groups, and predicates that may not be.

Purpose: parts C_g of a predicate for every group, and the check that their product satisfies it
(docs/verification.md, Groups); that SC's commands lie in their sets.
Non-goals: dynamics.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.reach.forms import Forms
    from soter.reach.grids import GridGroup
    from soter.reach.problem import Problem

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]
    Ranges = Mapping[int, tuple[float, float]]

SPLITS_MAX = 20_000
"""Boxes that a product check may look at."""
LAW_SPLITS_MAX = 4_000


def states_elsewhere(
    problem: Problem, group: GridGroup, point: Floats
) -> dict[int, tuple[float, float]]:
    """Ranges that pin the states of other groups to a point."""
    own = set(group.axes)
    return {
        s: (float(point[s]), float(point[s])) for s in range(len(problem.states)) if s not in own
    }


def candidates(problem: Problem) -> list[Floats]:
    """Points at which a product predicate may hold: the start, zero, the middle of the ranges."""
    low = np.array([r.low for r in problem.states])
    high = np.array([r.high for r in problem.states])
    start = np.array([i.low / 2 + i.high / 2 for i in problem.initial])
    return [np.clip(p, low, high) for p in (start, np.zeros_like(low), low / 2 + high / 2)]


def parts(problem: Problem, groups: Sequence[GridGroup], predicate: str) -> list[Bools] | None:
    """For every group the cells on which the predicate holds, other groups at some point.

    None where no point is found at which it holds. The product of the parts need not satisfy the
    predicate: `product_holds` checks that.
    """
    if len(groups) == len(problem.groups) == 1:
        return [groups[0].definitely(predicate)]
    for point in candidates(problem):
        found = [
            g.definitely(predicate, ranges=states_elsewhere(problem, g, point)) for g in groups
        ]
        if all(f.any() for f in found):
            return found
    return None


def product_holds(
    forms: Forms, groups: Sequence[GridGroup], sets: Sequence[Bools], predicate: str
) -> bool:
    """Whether a predicate is true all over the product of the sets; False also where unknown.

    A product of blocks is the hull of the cells that the sets have in them. Where the predicate is
    unknown there, the block that matters is split: along the axis with most cells, of the group for
    which splitting decides most.
    """
    if len(groups) == 1 and (groups[0].definitely(predicate) | ~sets[0]).all():
        return True  # the only grid holds just cells on which the predicate is definitely true
    conjuncts = forms.conjuncts(predicate)
    return all(_holds(forms, groups, sets, part) for part in conjuncts or [predicate])


def _holds(
    forms: Forms, groups: Sequence[GridGroup], sets: Sequence[Bools], predicate: str
) -> bool:
    todo = [tuple(_hull(s, [slice(0, n) for n in s.shape]) for s in sets)]
    looked = 0
    while todo:
        blocks = todo.pop()
        if any(b is None for b in blocks):
            continue  # no cells: nothing to show
        looked += 1
        if looked > SPLITS_MAX:
            return False
        box = _box(forms, groups, blocks)  # type: ignore[arg-type]
        if forms.true(predicate, box):
            continue
        split = _split(forms, groups, sets, blocks, predicate)  # type: ignore[arg-type]
        if split is None:
            return False
        todo += split
    return True


Block = list[slice]


def _hull(cells: Bools, block: Block) -> Block | None:
    """The smallest block inside that holds the same cells; None where there is none."""
    inside = cells[tuple(block)]
    if not inside.any():
        return None
    found = []
    for axis, part in enumerate(block):
        others = tuple(k for k in range(cells.ndim) if k != axis)
        at = np.flatnonzero(inside.any(axis=others))
        found.append(slice(part.start + int(at[0]), part.start + int(at[-1]) + 1))
    return found


def _box(forms: Forms, groups: Sequence[GridGroup], blocks: Sequence[Block]) -> Floats:
    box = np.array(forms.whole)
    for group, block in zip(groups, blocks, strict=True):
        for state, edges, part in zip(group.axes, group.edges, block, strict=True):
            box[state] = edges[part.start], edges[part.stop]
    return box


def _split(
    forms: Forms,
    groups: Sequence[GridGroup],
    sets: Sequence[Bools],
    blocks: tuple[Block, ...],
    predicate: str,
) -> list[tuple[Block | None, ...]] | None:
    """Two products that hold the same cells, or None where all blocks are single cells."""
    best: tuple[int, int] | None = None
    for g, block in enumerate(blocks):
        sizes = [p.stop - p.start for p in block]
        if max(sizes) == 1:
            continue
        # does this group matter? with it at one cell of its set the rest may be decided
        alone = list(blocks)
        first = np.argwhere(sets[g][tuple(block)])[0]
        alone[g] = [
            slice(p.start + int(i), p.start + int(i) + 1) for p, i in zip(block, first, strict=True)
        ]
        decided = forms.true(predicate, _box(forms, groups, alone))
        axis = int(np.argmax(sizes))
        if decided:
            best = (g, axis)
            break
        if best is None or sizes[axis] > max(p.stop - p.start for p in blocks[best[0]]):
            best = (g, axis)
    if best is None:
        return None
    g, axis = best
    part = blocks[g][axis]
    middle = (part.start + part.stop) // 2
    found: list[tuple[Block | None, ...]] = []
    for half in (slice(part.start, middle), slice(middle, part.stop)):
        block = list(blocks[g])
        block[axis] = half
        halves: list[Block | None] = list(blocks)
        halves[g] = _hull(sets[g], block)
        found.append(tuple(halves))
    return found


def law_stays_inside(
    problem: Problem, forms: Forms, groups: Sequence[GridGroup], allowed: Sequence[Bools]
) -> str:
    """Why SC might publish outside its sets, or fault, on the hull of the sets; "" if it cannot.

    SC steps at every instant, in control or not, so all of C is looked at, with every error.
    """
    count = len(problem.controls)
    box = forms.whole.copy()
    for group, cells in zip(groups, allowed, strict=True):
        block = _hull(cells, [slice(0, n) for n in cells.shape])
        if block is None:
            return ""
        for state, edges, part in zip(group.axes, group.edges, block, strict=True):
            box[state] = edges[part.start], edges[part.stop]
    limits = np.array([(c.low, c.high) for c in problem.controls])
    moving = [i for i in range(len(box)) if box[i, 0] < box[i, 1]]
    todo = [box]
    looked = 0
    while todo:
        at = todo.pop()
        found = forms.numbers("law", at, count)
        if (
            found is not None
            and np.all(found[:, 0] >= limits[:, 0])
            and np.all(found[:, 1] <= limits[:, 1])
        ):
            continue
        looked += 1
        if looked > LAW_SPLITS_MAX:
            if found is None:
                return "SC might fault, or publish outside its set"
            out = np.flatnonzero((found[:, 0] < limits[:, 0]) | (found[:, 1] > limits[:, 1]))
            name = problem.quantities.controls[int(out[0])].name
            return f"SC could publish {name} outside its set"
        widths = [(at[i, 1] - at[i, 0]) / (box[i, 1] - box[i, 0]) for i in moving]
        i = moving[int(np.argmax(widths))]
        middle = at[i, 0] / 2 + at[i, 1] / 2
        for low, high in ((at[i, 0], middle), (middle, at[i, 1])):
            half = at.copy()
            half[i] = low, high
            todo.append(half)
    return ""
