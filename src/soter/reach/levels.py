"""Computed predicates: the sets S_0, S_1, ... on estimates (docs/verification.md, section 3).

Purpose: for a module without `ttf` and `safer`: ttf := estimate not in S_0, safer := S_(m-2), of
every case; and what of that the DM holds for all of them, to which P2b returns.
Non-goals: reading them from tables (`tables.py`), putting them into a program (`complete.py`).

An axis that no topic of the DM shows counts as anywhere: then S_j does not depend on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.reach import polytope_claims
from soter.reach.claims import in_horizon
from soter.reach.estimates import errors_of, seen
from soter.reach.facets import Facets
from soter.reach.tables import FULL, Table, pairs_of, tables

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.reach.claims import Case
    from soter.reach.results import GroupSets

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


def deploy(cases: Sequence[Case]) -> None:
    """What the DM holds, of all cases together; before P2b, which needs control to come back.

    The DM has one table for all values of the parameters: an estimate lets AC have control only
    where S_0 of every case holds it. Where a case has no sets there is no table.
    """
    problem = cases[0].problem
    pairs = [pairs_of(case.sets) for case in cases]
    if any(len(p) != len(problem.groups) for p in pairs) or any(_refused(c) for c in cases):
        return
    found = tables(problem, pairs)
    for case in cases:
        count = len(case.sets.groups)
        for part, table in zip(case.sets.groups, found[:count], strict=True):
            assert isinstance(table, Table)
            part.deployed = _of_table(part, table)
        for polytope, facets in zip(case.sets.polytopes, found[count:], strict=True):
            assert isinstance(facets, Facets)
            polytope.deployed = facets.certain
        _admitted(case)


def _refused(case: Case) -> bool:
    """What was not proved of a polytope is not put into a DM."""
    claims = ("P2a", "ttf", "safer")
    return any(f.part is not None and f.claim in claims for f in case.failures)


def _of_table(part: GroupSets, table: Table) -> tuple[Bools, Bools]:
    """The two sets of a table over all axes of its group."""
    shape = [len(a.edges) - 1 if a.state in table.states else 1 for a in part.group.axes]
    entries = np.broadcast_to(table.entries.reshape(shape), part.allowed.shape)
    return entries > 0, entries >= FULL


def _admitted(case: Case) -> None:
    """States from which AC may have control; failures where that is none in all cases together."""
    errors = errors_of(case.problem)
    for i, (engine, part) in enumerate(zip(case.groups, case.sets.groups, strict=True)):
        assert part.deployed is not None
        assert part.free is not None
        outer, inner = part.deployed
        part.lets_ac = engine.dilate(outer, errors) & part.free
        part.gives_back = engine.dilate(inner, errors) & part.free
        hint = "fewer values of the parameters: the DM has one table for all of them"
        for claim, j, cells in (("ttf", 0, outer), ("safer", -1, inner)):
            if part.levels[j].any() and not cells.any():
                which = j % len(part.levels)
                text = f"no estimate is in S_{which} of every case: AC would never get control"
                case.fail(claim, text, i, part.free, hint)
    hint = "fewer values of the parameters: the DM has one set of half-spaces for all of them"
    for polytope in case.sets.polytopes:
        assert polytope.deployed is not None
        for claim, p in zip(("ttf", "safer"), polytope.deployed, strict=True):
            if polytope_claims.inner_point(p) is None:
                text = "no estimate is in the sets of every case: AC would never get control"
                case.fail(claim, text, hint=hint, part=polytope)


def targets(case: Case) -> list[Bools] | None:
    """Per group the states whose every estimate the DM gives back; None without a table.

    Those of polytope groups become their own target.
    """
    errors = errors_of(case.problem)
    found = []
    for engine, part in zip(case.groups, case.sets.groups, strict=True):
        if part.deployed is None:
            return None
        found.append(engine.erode(part.deployed[1], errors))
    for polytope in case.sets.polytopes:
        if polytope.deployed is None or polytope.sets is None:
            return None
        sets = polytope.sets
        sets.target = polytope.deployed[1].shrunk(sets.group.error)
    return found
