"""Cells on which a predicate certainly holds: at every point of them, and what is remembered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.certificate import cell_predicates
from soter.certificate.cell_predicates import HOLDS, TruthOverBox
from soter.certificate.cell_sets import Grid
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.terms import Linear, Proposition, Terms, and_of, negation, or_of
from unit.certificate.grid_tables import grid_beyond
from unit.certificate.small_proofs import even_edges

EXTENTS = ((-2.0, 2.0), (-3.0, 3.0))
GRID = Grid((even_edges(-2.0, 2.0, 16), even_edges(-3.0, 3.0, 12)))
OPEN = grid_beyond(GRID.edges, (True, False))
ERROR = 0.05


def _stops(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """|x| + v^2/6 + e < 1.5 and |v| <= 2."""
    far = terms.apply_function("abs", x)
    square = terms.multiply(v, v)
    room = terms.combine(
        [(exact(1.0), far), (exact(1.0) / 6, square), (exact(1.0), e)], exact(-1.5)
    )
    slow = terms.combine([(exact(1.0), terms.apply_function("abs", v))], exact(-2.0))
    return and_of(terms.below_zero(room), terms.below_zero(slow, strict=False))


def _beside(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """x + e > 1, or not v < x v, or min(x, v) <= -1.25."""
    gap = terms.combine([(exact(-1.0), x), (exact(-1.0), e)], exact(1.0))
    product = terms.subtract(v, terms.multiply(x, v))
    least = terms.combine([(exact(1.0), terms.minimum(x, v))], exact(1.25))
    return or_of(
        terms.below_zero(gap),
        or_of(negation(terms.below_zero(product)), terms.below_zero(least, strict=False)),
    )


def _edges(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """x <= 0.5, which is an edge, or v >= -1.5, another one."""
    del e
    right = terms.combine([(exact(1.0), x)], exact(-0.5))
    low = terms.combine([(exact(-1.0), v)], exact(-1.5))
    return or_of(terms.below_zero(right, strict=False), terms.below_zero(low, strict=False))


def _root(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """sqrt(x + 3) sin(v) < 1 + e."""
    root = terms.apply_function("sqrt", terms.combine([(exact(1.0), x)], exact(3.0)))
    wave = terms.multiply(root, terms.apply_function("sin", v))
    return terms.below_zero(terms.combine([(exact(1.0), wave), (exact(-1.0), e)], exact(-1.0)))


def _near(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """|x| + |v| + e < 4: so it is on outer cells, and not beyond them."""
    sizes = [(exact(1.0), terms.apply_function("abs", z)) for z in (x, v)]
    return terms.below_zero(terms.combine([*sizes, (exact(1.0), e)], exact(-4.0)))


PROPOSITIONS = {"near": _near, "stops": _stops, "beside": _beside, "edges": _edges, "root": _root}


def decision_of(name: str, ends: Any = EXTENTS) -> TruthOverBox:
    """A proposition over x, v and an error e."""
    terms = Terms()
    x, v = (terms.add_input("state", n, *map(exact, e)) for n, e in zip("xv", ends, strict=True))
    e = terms.add_input("box", "e", exact(-ERROR), exact(ERROR))
    truth = PROPOSITIONS[name](terms, x, v, e)
    model: Any = SimpleNamespace(extents=EXTENTS)
    return TruthOverBox(model, (0, 1), terms, [s.atom for s in (x, v)], truth)


@pytest.mark.parametrize("name", sorted(PROPOSITIONS))
def test_what_holds_on_a_cell_holds_at_its_points(name: str) -> None:
    """And not of all cells, nor of none; a point that certainly fails is in no such cell."""
    decision, draw = decision_of(name), np.random.default_rng(1)
    members = cell_predicates.cells_where_certain(decision, GRID).members
    assert 0 < members.sum() < members.size
    for cell in np.ndindex(GRID.shape):
        low, high = (
            np.array([e[i + k] for e, i in zip(GRID.edges, cell, strict=True)]) for k in (0, 1)
        )
        states = draw.uniform(low, high, (20, 2)).tolist()
        states += [[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])]
        errors = draw.choice([-ERROR, 0.0, ERROR], len(states))
        bits = {
            decision.bits_on_box(
                [(exact(z), exact(z)) for z in (*s, e)[: 2 + len(decision.ranges)]]
            )
            for s, e in zip(states, errors, strict=True)
        }
        assert bits == {HOLDS} or not members[cell], cell


def test_cells_that_touch_a_bound_belong_to_it() -> None:
    """Their ends are no short binary numbers."""
    terms, edges = Terms(), even_edges(-2.0, 2.0, 40)
    x, y = (terms.add_input("state", n, exact(-2.0), exact(2.0)) for n in "xy")
    near = terms.combine([(exact(1.0), terms.apply_function("abs", x))], exact(-1.0))
    left = terms.combine([(exact(1.0), x), (exact(-1.0), y)])
    truth = or_of(terms.below_zero(near, strict=False), terms.below_zero(left, strict=False))
    model: Any = SimpleNamespace(extents=((-2.0, 2.0), (-2.0, 2.0)))
    decision = TruthOverBox(model, (0, 1), terms, [s.atom for s in (x, y)], truth)
    grid = Grid((edges, edges))
    members = cell_predicates.cells_where_certain(decision, grid).members
    assert members[34, 35], "x from 1.4 to 1.5, y from 1.5 on"


@pytest.mark.parametrize("turned", [False, True])
def test_every_box_on_the_way_counts_for_runs_that_begin_beyond_an_end(turned: bool) -> None:
    """None of them may be further inwards than the outer cell is wide."""
    grid = grid_beyond(((0.0, 1.0, 2.0, 3.0), (0.0, 1.0)), (True, False))
    for start, good, bad in (
        ((2.5, 3.0), (1.6, 3.4), (1.4, 3.0)),
        ((0.0, 0.5), (-0.4, 1.4), (0.0, 1.6)),
    ):
        box = [(exact(start[0]), exact(start[1])), (exact(0.0), exact(1.0))]
        for way, followed in (((good, good), True), ((good, bad), False), ((bad, bad), False)):
            boxes = [x for ends in way[:: -1 if turned else 1] for x in (*ends, 0.0, 1.0)]
            assert grid.holds_beyond_ends(box, boxes) == followed
    inside = [(exact(1.2), exact(1.4)), (exact(0.0), exact(1.0))]
    assert grid.holds_beyond_ends(inside, [-5.0, 9.0, 0.0, 1.0])
