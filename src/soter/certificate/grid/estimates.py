"""Estimates in cells and the states behind them: what computed predicates are shown with.

Purpose: cells of states all of whose estimates lie in a set, and that nothing leads out of a set
from the states behind estimates.
Non-goals: free phases (`group_claims.py`), which claims there are (`grid_group.py`).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cells.cell_sets import Cells, uncovered, volume
from soter.certificate.grid.group_claims import CELLS_AT_ONCE, SPLITS
from soter.certificate.reading.problem import error_of
from soter.certificate.reading.symbolic_operations import FAR_TURNS
from soter.certificate.terms.arb_balls import TINIEST, UNIT_ROUNDOFF, above, below, exact, magnitude

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cells.cell_sets import Block
    from soter.certificate.grid.group_claims import FreeCheck, GroupTables
    from soter.certificate.reading.case_model import CaseModel


def around(model: CaseModel, group: GroupTables, box: list[tuple[arb, arb]]) -> tuple[float, ...]:
    """Everything an estimate of a state in the box may be, and the other way round.

    Of a state that no topic shows nothing is known: it is anywhere on its axis.
    """
    bounds: list[float] = []
    for state, (low, high) in zip(group.states, box, strict=True):
        bounds += _estimates(model, state, low, high)
    return tuple(bounds)


def _estimates(model: CaseModel, state: int, low: arb, high: arb) -> tuple[float, float]:
    """The same of one state between two numbers."""
    if state not in model.facts.leaves:
        return model.extents[state]
    error = exact(error_of(model.facts, state))
    if state in model.facts.turning:  # the DM brings it back to the grid
        error += FAR_TURNS
    if not error.is_zero():
        error += (magnitude(low).max(magnitude(high)) + error) * (2 * UNIT_ROUNDOFF) + TINIEST
    return below(low - error), above(high + error)


def eroded(model: CaseModel, group: GroupTables, level: Cells) -> Cells:
    """Cells of states all of whose estimates lie in a level; and of estimates of such states.

    An error is as large on either side, so that the same set answers both.
    """
    grid = group.grid
    ends = [
        [_estimates(model, state, low, high) for low, high in pairwise(map(exact, edges))]
        for state, edges in zip(group.states, grid.edges, strict=True)
    ]
    members = np.zeros(grid.shape, dtype=np.bool_)
    for cell in map(tuple, np.argwhere(level.members)):
        box = [end for i, axis in zip(cell, ends, strict=True) for end in axis[i]]
        members[cell] = level.contains(box)
    return Cells(grid, members)


def levels_hold(
    model: CaseModel, group: GroupTables, claimed: NDArray[np.bool_], inside: Cells, block: Block
) -> Iterator[Block]:
    """Cells of estimates, some state behind which is not certainly inside."""

    def attempt(at: Block) -> bool:
        return inside.contains(around(model, group, group.grid.box(at)))

    return uncovered(claimed, block, attempt, 1 << 20)


def drifts(
    check: FreeCheck, claimed: NDArray[np.bool_], within: Cells, block: Block
) -> Iterator[Block]:
    """Cells of estimates, some state behind which may be driven out of `within` in time."""
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        ends = around(check.model, check.group, grid.box(at))
        box = [(exact(a), exact(b)) for a, b in zip(ends[::2], ends[1::2], strict=True)]
        return check.keeps(box, within, SPLITS if volume(at) == 1 else 0)

    return uncovered(claimed, block, attempt, 4 * CELLS_AT_ONCE)
