"""Levels of estimates on a grid, and what of them a DM holds.

Purpose: S_0, S_1, ... by eroding R(H) (docs/verification.md, section 3); the states from which AC
may have control by the table of all cases.
Non-goals: the table itself (`verify/tables/grid_tables.py`).

An axis that no topic of the DM shows counts as anywhere: then S_j does not depend on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.grid import shields
from soter.verify.problem.estimates import errors_of, seen
from soter.verify.tables.grid_tables import FULL

if TYPE_CHECKING:
    from soter.core.layout import Bools
    from soter.verify.claims.case import Case, GroupProof
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.sets import GridGroup
    from soter.verify.tables.grid_tables import GroupTable


def find(case: Case, proof: GroupProof, engine: GridGroup, part: GroupSets) -> None:
    """S_0 ... S_(m-2); failures of `ttf` and `safer` where they are empty."""
    problem = case.problem
    errors, shown = errors_of(problem), seen(problem)
    window = problem.in_horizon(problem.times.decision)
    assert part.free is not None
    blind = tuple(k for k, a in enumerate(engine.axes) if a not in shown)
    part.levels = [_anywhere(engine.erode(part.free, errors), blind)]
    for _ in range(max(problem.levels, 2) - 2):
        inner = engine.erode(part.levels[-1], errors)
        following = engine.safe_for(window, inner)
        estimates = _anywhere(engine.erode(following, errors), blind)
        part.levels.append(estimates & part.levels[-1])
    if problem.module.shield is not None:
        shields.find(case, proof, engine, part, lambda cells: _anywhere(cells, blind))
    names = [problem.quantities.states[engine.axes[k]].name for k in blind]
    hint = problem.stronger
    if names:
        hint = f"let a plant drive a topic with {', '.join(names)}, or write `ttf` and `safer`"
    empty = next((j for j, s in enumerate(part.levels) if not s.any()), 0)
    for claim, j in (("ttf", 0), ("safer", len(part.levels) - 1)):
        if not part.levels[j].any():
            text = f"S_{empty} is empty: AC would never get control"
            case.fail(claim, text, proof, hint).cells = part.free


def _anywhere(cells: Bools, axes: tuple[int, ...]) -> Bools:
    """Cells that are in the set wherever they lie on these axes."""
    if not axes:
        return cells
    every: Bools = np.asarray(cells.all(axis=axes, keepdims=True), dtype=np.bool_)
    return np.array(np.broadcast_to(every, cells.shape), dtype=np.bool_)


def admit(
    case: Case, proof: GroupProof, engine: GridGroup, part: GroupSets, table: GroupTable
) -> None:
    """States from which AC may have control; failures where that is none in all cases together."""
    errors = errors_of(case.problem)
    outer, inner = part.deployed = _of_table(part, table)
    assert part.free is not None
    part.lets_ac = engine.dilate(outer, errors) & part.free
    part.gives_back = engine.dilate(inner, errors) & part.free
    hint = "fewer values of the parameters: the DM has one table for all of them"
    for claim, j, cells in (("ttf", 0, outer), ("safer", -1, inner)):
        if part.levels[j].any() and not cells.any():
            which = j % len(part.levels)
            text = f"no estimate is in S_{which} of every case: AC would never get control"
            case.fail(claim, text, proof, hint).cells = part.free


def _of_table(part: GroupSets, table: GroupTable) -> tuple[Bools, Bools]:
    """The two sets of a table over all axes of its group."""
    shape = [len(a.edges) - 1 if a.state in table.states else 1 for a in part.group.axes]
    entries = np.broadcast_to(table.entries.reshape(shape), part.allowed.shape)
    return entries > 0, entries >= FULL


def held(case: Case, engine: GridGroup, part: GroupSets) -> Bools | None:
    """States whose every estimate the DM gives back, in the grid's shape; None without a table."""
    if part.deployed is None:
        return None
    return engine.erode(part.deployed[1], errors_of(case.problem))
