"""The method of half-spaces: a group's polytopes, against the comparisons that the DM makes.

Purpose: `PolytopeGroup` (`groups.py`) shows that every estimate which the DM's comparisons let
through lies in S_0 (S_(m-2)) of every case, and finds real half-spaces on which the DM surely gives
control back, for P2b. It draws states of K by hit and run.
Non-goals: the claims about its sets (`polytope_check.py`).

The DM compares the estimate with a box and then, for every half-space, the computed r x with a
threshold. A sum of n products, in any order, is off by at most n u / (1 - n u) sum |r_i| |x_i| and
what underflows (u = 2^-53): so r x <= threshold + err wherever it passes, and it passes wherever
r x <= threshold - err, err taken over the box.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.groups import Group
from soter.certificate.polytope.certificate_tables import (
    HINTS,
    OPTIONAL,
    REQUIRED,
    read_half_spaces,
    read_polytope,
)
from soter.certificate.polytope.polytope_check import PolytopeCheck, least_limits
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import TINIEST, UNIT_ROUNDOFF, ZERO, exact
from soter.certificate.vacuous_proofs import RARE_SHARE, on_drawn, rarity

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Axes, Cells
    from soter.certificate.folder import Certificate
    from soter.certificate.groups import Entry
    from soter.certificate.polytope.certificate_tables import HalfSpaces, PolytopeTables
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import RecheckedModule

TRIES = 500
"""Points of the box of a polytope, for one in its K, where the initial state is none."""
TINY = 1e-9
"""No face counts as nearer to the point where a walk begins."""


class PolytopeGroup(Group):
    """One group of which a certificate has half-spaces and multipliers; C is their box."""

    kind = "polytope"
    required, optional = REQUIRED, (*OPTIONAL, *HINTS)
    why_no_entry = "half-spaces are not looked at"

    def __init__(self, tables: PolytopeTables) -> None:
        self.tables, self.states = tables, tables.states

    @classmethod
    def read(
        cls, certificate: Certificate, facts: Facts, entry: Entry, axes: Axes
    ) -> PolytopeGroup:
        """RejectedError where a matrix has another shape than it should have."""
        inputs = [facts.states, facts.controls, facts.disturbances, facts.errors, facts.others]
        count, ends = sum(len(x) for x in inputs), [(e[0], e[-1]) for e in axes.grid.edges]
        return cls(read_polytope(certificate, entry, axes.states, ends, count))

    def cells_asked(self, *, errors: bool) -> Axes:
        """The box of C as one cell, or that of the target. RejectedError where that is empty."""
        box = self.tables.target if errors else self.tables.constraint
        if box is None:
            raise RejectedError("a claim needs the target of P2b, which is not there")
        if any(not a < b for a, b in zip(box.low, box.high, strict=True)):
            raise RejectedError("the box of a polytope group is empty")
        return self.tables.as_cell(box)

    def check(self, model: CaseModel, lawful: Cells | None) -> PolytopeCheck:
        """The check of this group's claims; NotRecheckedError where there is a `lawful`."""
        if lawful is not None:
            raise NotRecheckedError("a law that half-spaces are to keep")
        return PolytopeCheck(model, self.tables)

    def compare(
        self, certificate: Certificate, facts: Facts, same: Sequence[PolytopeGroup], entry: Entry
    ) -> None:
        """RejectedError where the DM's half-spaces let through more than the sets S.

        NotRecheckedError of a shield.
        """
        if facts.symbol.shield is not None:
            raise NotRecheckedError("a shield beside polytopes")
        names = [facts.states[i].name for i in self.states]
        if entry.keys() != {"states", "outer", "inner"} or entry["states"] != names:
            raise RejectedError("half-spaces of the DM are not as they should be")
        n = len(names)
        outer, inner = (read_half_spaces(certificate, entry[p], n) for p in ("outer", "inner"))
        for group in (g.tables for g in same):
            if group.states != self.states or not group.levels:
                raise RejectedError("the cases have other polytopes, and the DM has one for all")
            _require_no_more(outer, group.levels[0], [outer])
            _require_no_more(inner, group.levels[-1], [outer, inner])
            group.leaves, group.gives_back = (
                _certainly_passed([outer]),
                _certainly_passed([outer, inner]),
            )

    def add_size_to(self, report: RecheckedModule) -> None:
        """Add to a report how many half-spaces K has."""
        report.half_spaces += len(self.tables.core.bounds)

    def why_ac_never(self, drawn: Iterator[NDArray[np.float64]]) -> tuple[str, str]:
        """Asks the half-spaces of the DM, on states that are drawn (one number a state)."""
        tables, states = self.tables, list(drawn)
        if not states:
            return "", "no state of K was drawn"
        points = np.array(states)[:, list(self.states)]
        of = (
            (tables.gives_back, "has", "give it back"),
            (tables.leaves, "keeps", "leave it in control"),
        )
        for faces, what, does in of:
            rows = np.array([row for row, _ in faces or ()]).reshape(-1, len(self.states))
            limits = np.array([float(limit) for _, limit in faces or ()])
            count = int((points @ rows.T <= limits).all(axis=1).sum())
            if count < RARE_SHARE * len(points):
                where = f"the half-spaces {does} {on_drawn(count, len(points))}"
                return f"{rarity(count)} {what} control ({where})", ""
        return "", ""

    def random_points(
        self, facts: Facts, chance: np.random.Generator
    ) -> Iterator[NDArray[np.float64]]:
        """States of K (one number a state) by hit and run; none where none is found."""
        p = self.tables
        faces, limits = (np.array(part) for part in p.core.faces)
        middle = [facts.states[s].low / 2 + facts.states[s].high / 2 for s in p.states]
        tried = (chance.uniform(p.constraint.low, p.constraint.high) for _ in range(TRIES))
        inside = (q for q in (np.array(middle), *tried) if (faces @ q <= limits).all())
        at = next(inside, None)
        if at is None:
            return
        near = faces / np.maximum(limits - faces @ at, TINY)[:, None]
        stretch = np.linalg.cholesky(np.linalg.inv(near.T @ near))  # a thin K is walked along
        while True:
            for _ in p.states:
                way = stretch @ chance.normal(size=len(p.states))
                slope, room = faces @ way, np.maximum(limits - faces @ at, 0.0)
                up, down = slope > 0, slope < 0
                far = np.min(room[up] / slope[up])
                at = at + way * chance.uniform(np.max(room[down] / slope[down]), far)
            yield at


# ---------------------------------------------------------------- half-spaces of the DM


def _rounding(row: Sequence[float], box: HalfSpaces) -> arb:
    """A bound of the rounding error of the product of `row` with a point of the box."""
    n, size = len(row), ZERO
    for r, low, high in zip(row, box.low, box.high, strict=True):
        size += abs(exact(r)) * max((abs(exact(low)), abs(exact(high))), key=float)
    share = n * UNIT_ROUNDOFF / (1 - n * UNIT_ROUNDOFF)
    return share * size + 2 * n * TINIEST


def _require_no_more(box: HalfSpaces, claimed: HalfSpaces, held: Sequence[HalfSpaces]) -> None:
    """RejectedError unless what passes `box` and all comparisons of `held` is in `claimed`."""
    if not box.boxed_in(claimed):
        raise RejectedError("the DM's box is larger than that of its set")
    passed = least_limits(
        (row, exact(limit) + _rounding(row, p))
        for p in held
        for row, limit in zip(p.rows, p.bounds, strict=True)
    )
    for row, bound in zip(claimed.rows, claimed.bounds, strict=True):
        if row not in passed or not passed[row] <= exact(bound):
            raise RejectedError("the DM does not hold the half-spaces of its sets")


def _certainly_passed(held: Sequence[HalfSpaces]) -> list[tuple[tuple[float, ...], arb]]:
    """Half-spaces: an estimate in all of them passes every comparison of `held`."""
    half_spaces = []
    for p in held:
        count = len(p.rows)
        faces, limits = p.faces
        for k, (row, limit) in enumerate(zip(faces, limits, strict=True)):
            # the box is compared as it is; what is outside it is not let through
            half_spaces.append((row, exact(limit) - (_rounding(row, p) if k < count else ZERO)))
    return half_spaces
