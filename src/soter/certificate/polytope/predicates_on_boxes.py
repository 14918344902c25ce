"""Predicates of the user over polytope groups.

Purpose: that a predicate holds on the product of boxes and cells; that `ttf` and `safer` let AC
have control only in R(H), box by box: a box lies in R(H) where the worst corner of every half-space
does.
Non-goals: computed predicates (`case_check.py`, `dm_half_spaces.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.format.errors import RejectedError
from soter.certificate.inclusions.predicates import AdmitCheck, certain
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.terms.arb_balls import exact

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.certificate.inclusions.cell_sets import Cells
    from soter.certificate.inclusions.group_claims import GroupTables
    from soter.certificate.polytope.certificate_tables import HalfSpaces, PolytopeTables
    from soter.language.model import typed

    Floats = NDArray[np.float64]
    Extents = tuple[tuple[float, float], ...]

BOXES_MAX = 200_000
SMALLEST = 2.0**-16
"""Of the group's box: a box that small is not halved any more."""
ROUNDING = 1e-12
"""Far above the rounding of a sum of a dozen products of doubles, relative to their sizes."""


def narrowed(extents: Extents, polytopes: Sequence[PolytopeTables]) -> Extents:
    """Ranges of all states in which those of polytope groups are the boxes of C."""
    return _boxed(extents, polytopes, [p.constraint for p in polytopes])


def _boxed(
    extents: Extents, polytopes: Sequence[PolytopeTables], boxes: Sequence[HalfSpaces]
) -> Extents:
    new_extents = list(extents)
    for group, box in zip(polytopes, boxes, strict=True):
        for state, low, high in zip(group.states, box.low, box.high, strict=True):
            new_extents[state] = (low, high)
    return tuple(new_extents)


def certain_beside(
    model: CaseModel,
    grids: Sequence[GroupTables],
    polytopes: Sequence[PolytopeTables],
    expr: typed.TypedExpr,
    *,
    errors: bool,
) -> list[Cells]:
    """As `certain`: cells of grids so that the predicate holds on their product with the boxes.

    The boxes are those of C, for `safe`, or with errors the targets, for `safer`. RejectedError
    where the predicate is not certain on the boxes, or they are empty or not there.
    """
    boxes = []
    for p in polytopes:
        box = p.target if errors else p.constraint
        if box is None:
            raise RejectedError("a claim needs the target of P2b, which is not there")
        boxes.append(box)
    if any(not a < b for box in boxes for a, b in zip(box.low, box.high, strict=True)):
        raise RejectedError("the box of a polytope group is empty")
    inside = CaseModel(model.facts, model.parameter, _boxed(model.extents, polytopes, boxes))
    cells = [p.as_cell(box) for p, box in zip(polytopes, boxes, strict=True)]
    certain_cells = certain(inside, [*grids, *cells], expr, errors=errors)
    if not all(c.members.all() for c in certain_cells[len(grids) :]):
        name = "safer" if errors else "safe"
        raise RejectedError(f"`{name}` is not certain on the box of a polytope group")
    return certain_cells[: len(grids)]


def show_admitted(
    model: CaseModel, tables: PolytopeTables, name: str, expr: typed.TypedExpr, *, admits: bool
) -> None:
    """Where the predicate may let AC have control, on an estimate, the state is in R(H).

    RejectedError where that is not certain.
    """
    check = AdmitCheck(model, tables.as_cell(tables.constraint), expr, admits=admits)
    faces, limits = (np.array(x) for x in tables.free.faces)
    first = np.array([tables.constraint.low, tables.constraint.high])
    width = first[1] - first[0]
    todo, looked = [(first, 0)], 0
    while todo:
        box, depth = todo.pop()
        looked += 1
        excess = _excess(faces, limits, box)
        if (excess <= 0).all():
            continue
        ends = [(exact(a), exact(b)) for a, b in box.T.tolist()]
        if check.decision.holds(ends, 0):
            continue
        shares = (box[1] - box[0]) / width
        if looked > BOXES_MAX or shares.max() < SMALLEST:
            text = ", ".join(f"[{a:.6g}, {b:.6g}]" for a, b in box.T)
            raise RejectedError(f"`{name}` may leave AC in control outside R(H) in {text}")
        weight = np.abs(faces[int(np.argmax(excess))]) * (box[1] - box[0])
        weight = np.where(shares >= SMALLEST, weight if depth % 2 else shares, -1.0)
        k = int(np.argmax(weight))
        middle = box[0, k] / 2 + box[1, k] / 2
        for end in (1, 0):
            half = box.copy()
            half[end, k] = middle
            todo.append((half, depth + 1))


def _excess(faces: Floats, limits: Floats, box: Floats) -> Floats:
    """By how much the worst corners of a box exceed half-spaces; up to 0 they surely do not."""
    reach = np.abs(faces) @ np.abs(box).max(axis=0) + np.abs(limits)
    corners = np.where(faces > 0, box[1], box[0])
    values = (faces * corners).sum(axis=1)
    excess: Floats = values - limits + ROUNDING * reach
    return excess
