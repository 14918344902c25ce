"""Checked again: what plants publish of states that SC keeps on polytopes.

Purpose: that a topic's declared set holds all of it: in K, where AC has control and where SC begins
a hold, and at all times of such a hold (`docs/verification.md`, section 10); and of initial states.
Non-goals: states on grids (`cells/predicates.py`); what is not affine in the states.

Of an affine leaf a x + r, r within what is no state of a polytope: a x(t) <= a' x(0) + loss for one
of the instants (`half_space_images.py`), and a' x <= b on K by weak duality
(`certificate_tables.py`). Multipliers are HiGHS's where it is installed; any are right, and without
them only the box of K is counted with.
"""

from __future__ import annotations

from itertools import chain
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cells.cell_sets import Axes, Grid
from soter.certificate.cells.predicates import published
from soter.certificate.format.errors import RejectedError
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.terms.arb_balls import ZERO, exact
from soter.workers.solvers import new_highs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    from soter.certificate.polytope.certificate_tables import HalfSpaces, PolytopeTables, Weights
    from soter.certificate.polytope.half_space_images import HoldImage
    from soter.certificate.terms.terms import Linear, Terms

    Kept = tuple[PolytopeTables, HoldImage]

INPUTS = ("state", "box")
"""Kinds of atoms that are affine in the states, and whose ranges are theirs."""


def all_published(model: CaseModel, groups: Sequence[Kept], topic: int) -> bool:
    """Whether a topic's set surely holds what is published of all states that SC keeps.

    `groups`: all polytopes, each with its K and a hold of SC that begins there. Not of leaves
    that read states of other groups alone; those are anywhere in their grids.
    `model.extents` of the polytopes are their boxes of C. False: it is not known.
    """
    terms, states = model.new_terms()
    limits = model.limits(terms, states, topic)
    if terms.obligations:
        return False
    atoms = [next(iter(x.terms)) for x in states]
    own = {atoms[s] for tables, _ in groups for s in tables.states}
    elsewhere = {*atoms} - own
    for value, low, high in limits:
        if any(terms.atoms[atom].kind not in INPUTS for atom in value.terms):
            return False
        if own.isdisjoint(value.terms) and not elsewhere.isdisjoint(value.terms):
            continue
        for sign, limit in ((1, exact(high)), (-1, -exact(low))):
            if not _greatest(terms, value, sign, atoms, groups) <= limit:
                return False
    return True


def _greatest(
    terms: Terms, value: Linear, sign: int, atoms: Sequence[int], groups: Sequence[Kept]
) -> arb:
    """A number that sign * value does not exceed."""
    total = sign * value.const + value.radius
    left = {atom: sign * factor for atom, factor in value.terms.items()}
    for tables, hold in groups:
        row = [left.pop(atoms[s], ZERO) for s in tables.states]
        if not all(x.is_zero() for x in row):
            total += _on_the_way(tables.core, hold, row)
    for atom, factor in left.items():
        ends = terms.atoms[atom].low, terms.atoms[atom].high
        total += (factor * ends[0]).max(factor * ends[1])
    return total


def _on_the_way(kernel: HalfSpaces, hold: HoldImage, row: list[arb]) -> arb:
    """No row x(t) is greater: in K, and while SC holds what it commanded there."""
    bound = kernel.bound(row, _weights(kernel, row))
    for own, loss in chain.from_iterable(zip(*x, strict=True) for x in hold.everywhere([row])):
        bound = bound.max(kernel.bound(own, _weights(kernel, own)) + loss)
    return bound


def _weights(p: HalfSpaces, row: Sequence[arb]) -> Weights:
    """Multipliers by HiGHS, so that the bound of a row is small; none where it is not installed."""
    try:
        solver = new_highs()
    except ImportError:
        return []
    n, columns = len(p.low), np.arange(len(p.low), dtype=np.int32)
    solver.addVars(n, np.array(p.low), np.array(p.high))
    for face, limit in zip(p.rows, p.bounds, strict=True):
        solver.addRow(-np.inf, limit, n, columns, np.array(face, dtype=np.float64))
    solver.changeColsCost(n, columns, -np.array([float(x) for x in row]))
    solver.run()
    if solver.getModelStatus().name != "kOptimal":
        return []
    duals = list(solver.getSolution().row_dual)[: len(p.rows)]
    return [(k, -d) for k, d in enumerate(duals) if isfinite(d) and d < 0.0]


def starts_in_sets(model: CaseModel) -> None:
    """RejectedError where what is published of an initial state may lie outside of its set.

    K says so only of grids.
    """
    facts = model.facts
    ends = tuple((s.low, s.high) for s in facts.states)
    at_start, box = (
        CaseModel(facts, model.parameter, ends),
        Axes(tuple(range(len(ends))), Grid(ends)),
    )
    for topic in bounded_topics(facts):
        if not published(at_start, [box], topic)[0].members.all():
            name = facts.system.topics[topic].name
            raise RejectedError(f"an initial state may be none of those that `{name}` holds")
