"""Computed predicates: the sets S_0, S_1, ... on estimates (docs/verification.md, section 3).

Purpose: for a module without `ttf` and `safer`: ttf := estimate not in S_0, safer := S_(m-2).
Non-goals: reading them from tables (`tables.py`), putting them into a program (`complete.py`).

An axis that no topic of the DM shows counts as anywhere: then S_j does not depend on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.reach import polytope_claims
from soter.reach.claims import in_horizon
from soter.reach.estimates import errors_of, seen

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.reach.claims import Case

    Bools = NDArray[np.bool_]


def levels(case: Case) -> None:
    """S_0 ... S_(m-2) of every group; failures of `ttf` and `safer` where they are empty."""
    problem = case.problem
    polytope_claims.levels(case)
    errors, shown = errors_of(problem), seen(problem)
    window = in_horizon(problem, problem.times.decision)
    for i, (engine, part) in enumerate(zip(case.groups, case.sets.groups, strict=True)):
        assert part.free is not None
        blind = tuple(k for k, a in enumerate(engine.axes) if a not in shown)
        part.levels = [_anywhere(engine.erode(part.free, errors), blind)]
        for _ in range(max(problem.levels, 2) - 2):
            inner = engine.erode(part.levels[-1], errors)
            following = engine.safe_for(window, inner)
            estimates = _anywhere(engine.erode(following, errors), blind)
            part.levels.append(estimates & part.levels[-1])
        part.lets_ac = engine.dilate(part.levels[0], errors) & part.free
        part.gives_back = engine.dilate(part.levels[-1], errors) & part.free
        names = [problem.quantities.states[engine.axes[k]].name for k in blind]
        hint = "fewer levels, a smaller period, smaller errors, a stronger SC"
        if names:
            hint = f"let a plant drive a topic with {', '.join(names)}, or write `ttf` and `safer`"
        for claim, j in (("ttf", 0), ("safer", len(part.levels) - 1)):
            if not part.levels[j].any():
                text = f"S_{j} is empty: AC would never get control"
                case.fail(claim, text, i, part.free, hint)


def _anywhere(cells: Bools, axes: tuple[int, ...]) -> Bools:
    """Cells that are in the set wherever they lie on these axes."""
    if not axes:
        return cells
    every: Bools = np.asarray(cells.all(axis=axes, keepdims=True), dtype=np.bool_)
    return np.array(np.broadcast_to(every, cells.shape), dtype=np.bool_)


def targets(case: Case) -> list[Bools] | None:
    """Per group the states whose every estimate lies in S_(m-2); None where there is none."""
    errors = errors_of(case.problem)
    if any(not part.levels for part in case.sets.groups):
        return None
    return [
        engine.erode(part.levels[-1], errors)
        for engine, part in zip(case.groups, case.sets.groups, strict=True)
    ]
