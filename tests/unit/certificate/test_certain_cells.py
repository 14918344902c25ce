"""Cells on which a predicate certainly holds: what Arb is asked about, and what is remembered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.inclusions import predicates
from soter.certificate.inclusions.cell_sets import Cells, Grid
from soter.certificate.inclusions.predicates import Decision
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.terms import Terms, both, either
from unit.certificate.small_proofs import even_edges
from unit.certificate.test_decided_cells import (
    EXTENTS,
    GRID,
    OPEN,
    PROPOSITIONS,
    decision_of,
)

if TYPE_CHECKING:
    import pytest


def test_certain_cells_are_those_of_arb_alone_and_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """With arrays and without; where arrays are asked Arb is asked about what they leave."""
    for name in PROPOSITIONS:
        members = []
        for few in (predicates.FEW, GRID.shape[0] * GRID.shape[1] + 1):
            monkeypatch.setattr(predicates, "FEW", few)
            members.append(predicates._decided_cells(decision_of(name), GRID))
        assert not (members[1] & ~members[0]).any(), name
        assert members[0].sum() - members[1].sum() <= 0.1 * members[0].size, name


def test_cells_that_touch_a_bound_are_those_of_arb(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their ends are no short binary numbers: doubles that round outwards leave them open."""
    terms, edges = Terms(), even_edges(-2.0, 2.0, 40)
    x, y = (terms.input("state", n, exact(-2.0), exact(2.0)) for n in "xy")
    near = terms.combine([(exact(1.0), terms.function("abs", x))], exact(-1.0))
    left = terms.combine([(exact(1.0), x), (exact(-1.0), y)])
    truth = either(terms.below(near, strict=False), terms.below(left, strict=False))
    model: Any = SimpleNamespace(extents=((-2.0, 2.0), (-2.0, 2.0)))
    decision = Decision(model, (0, 1), terms, [next(iter(s.terms)) for s in (x, y)], truth)
    grid = Grid((edges, edges))
    members = predicates._decided_cells(decision, grid)
    monkeypatch.setattr(predicates, "FEW", members.size + 1)
    assert np.array_equal(members, predicates._decided_cells(decision, grid))
    assert members[34, 35], "x from 1.4 to 1.5, y from 1.5 on"


def test_cells_are_remembered_for_the_same_question_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another number by one last place, range, grid, open end or proposition is another one."""
    model: Any = SimpleNamespace(extents=EXTENTS)
    decided = predicates._decided_cells
    made: list[Grid] = []

    def counted(decision: Decision, grid: Grid) -> Any:
        made.append(grid)
        return decided(decision, grid)

    monkeypatch.setattr(predicates, "_decided_cells", counted)
    monkeypatch.setattr(predicates, "_CERTAIN_CELLS", {})

    def cells(grid: Grid, bound: float, error: float, speed: float, axes: str) -> Cells:
        terms = Terms()
        x = terms.input("state", "x", *map(exact, EXTENTS[0]))
        v = terms.input("state", "v", *map(exact, EXTENTS[1]))
        e = terms.input("box", "e", exact(-error), exact(error))
        parts = {"x": x, "v": v, "e": e}
        sizes = [(exact(1.0), terms.function("abs", parts[a])) for a in axes]
        fast = terms.below(terms.combine([(exact(1.0), v)], exact(-speed)))
        truth = both(terms.below(terms.combine(sizes, exact(-bound))), fast)
        group: Any = SimpleNamespace(grid=grid, states=(0, 1))
        atoms = [next(iter(s.terms)) for s in (x, v)]
        return predicates._certain_cells(model, group, terms, atoms, truth)

    asked = (GRID, 1.3, 0.05, 2.0, "xve")
    moved = Grid((GRID.edges[0], (*GRID.edges[1][:5], np.nextafter(-0.5, 0), *GRID.edges[1][6:])))
    others = [
        asked,
        (OPEN, *asked[1:]),
        (moved, *asked[1:]),
        (GRID, float(np.nextafter(1.3, 2)), *asked[2:]),
        (GRID, 1.3, float(np.nextafter(0.05, 1)), *asked[3:]),
        (GRID, 1.3, 0.05, float(np.nextafter(2.0, 3)), "xve"),
        (*asked[:4], "xe"),
        (*asked[:4], "ve"),
    ]
    first = [cells(*x) for x in others]
    assert made == [x[0] for x in others]
    again = [cells(Grid(x[0].edges, x[0].unbounded), *x[1:]) for x in others]
    assert len(made) == len(others)
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.members, other.members)
