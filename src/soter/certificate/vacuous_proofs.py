"""Whether what was confirmed says anything: how often AC can have control at all.

Purpose: by states drawn from the sets of a certificate, and by the tables of the DM; nothing that
the prover says about it is read. A share of what was drawn is a measurement and is called so.
Non-goals: verdicts: a proof about an AC that never flies is a proof. Inductions are asked in
`induction/check_claims.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.inclusions.cell_sets import Grid
from soter.certificate.inclusions.group_claims import GroupTables
from soter.certificate.inclusions.predicates import AdmitCheck
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.view_predicates import ttf_of_states
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.evaluate.arithmetic import StepFault
from soter.language.model.tree_walk import topic_reads

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.polytope.certificate_tables import PolytopeTables
    from soter.certificate.reading.problem import Facts
    from soter.language.model import typed

    Extents = tuple[tuple[float, float], ...]
    Groups = Sequence[tuple[list[GroupTables], list[PolytopeTables]]]

DRAWN = 2000
HARDLY = 0.01
"""Below this share of what was drawn from K it is said."""
TRIES = 50
"""Points of the box of a polytope, for one in its K."""
HOLDS = 2
"""The bit that says: a proposition may hold."""
READS_NOTHING = "`safe` reads no topic: it says nothing of the plant"
GETS = "AC never has control"
KEEPS = "AC never keeps control"


def vacuous(facts: Facts, groups: Groups, extents: Extents) -> tuple[str, str]:
    """Why the claims about a module say next to nothing, and why that was not looked at; or ""."""
    if not topic_reads(facts.symbol.safe):
        return READS_NOTHING, ""
    for values, (grids, polytopes) in zip(facts.cases(), groups, strict=True):
        if facts.computed:
            found, unseen = _of_tables(grids, polytopes)
        else:
            try:
                found, unseen = _of_predicates(facts, values, grids, polytopes, extents)
            except (NotRecheckedError, StepFault, ArithmeticError, ValueError) as error:
                found, unseen = "", f"{type(error).__name__}: {error}"
        if found or unseen:
            pairs = zip(facts.parameters, values, strict=True)
            named = ", ".join(f"{p.name} = {v}" for p, v in pairs)
            return f"with {named} {found}" if named and found else found, unseen
    return "", ""


def _of_tables(
    grids: Sequence[GroupTables], polytopes: Sequence[PolytopeTables]
) -> tuple[str, str]:
    """S_0 leaves AC in control, S_(m-2) gives it back."""
    for g in grids:
        if g.given_back is not None and not g.given_back.any():
            return f"{GETS} (the table gives it back on no estimate)", ""
        if g.levels and not g.levels[0].any():
            return f"{KEEPS} (the table leaves it in control on no estimate)", ""
    return "", "tables of half-spaces are not looked at" if polytopes else ""


def _of_predicates(
    facts: Facts,
    values: tuple[int, ...],
    grids: Sequence[GroupTables],
    polytopes: Sequence[PolytopeTables],
    extents: Extents,
) -> tuple[str, str]:
    """`ttf` and `safer` of estimates of states drawn from K, all groups together."""
    ttf, safer = ttf_of_states(facts.symbol.ttf), facts.symbol.safer
    if ttf is None or safer is None:
        return "", "predicates that are not there are not looked at"
    model = CaseModel(facts, values, extents)
    every = tuple(range(len(extents)))
    box = GroupTables(every, Grid(extents), np.ones((1,) * len(every), dtype=np.uint8))
    chance = np.random.default_rng(0)

    def refusing(expr: typed.TypedExpr, *, admits: bool) -> AdmitCheck:
        return AdmitCheck(model, box, expr, admits=admits, anywhere=True)

    checks = refusing(safer, admits=True), refusing(ttf, admits=False)
    drawn, gets, keeps, both = 0, 0, 0, 0
    for x in _states(chance, grids, polytopes, extents):
        drawn += 1
        given, left = (_lets(check, x, chance) for check in checks)
        gets, keeps, both = gets + given, keeps + left, both + (given and left)
        if both >= HARDLY * DRAWN:
            return "", ""
    if not drawn:
        return "", "no state of K was drawn"
    least = HARDLY * drawn
    if gets < least:
        return f"{_seldom(gets)} has control (`safer` holds {_on(gets, drawn)})", ""
    if keeps < least:
        return f"{_seldom(keeps)} keeps control (`ttf` is false {_on(keeps, drawn)})", ""
    if both < least:
        where = "where `safer` holds `ttf` does, too: not so"
        return f"{_seldom(both)} keeps control ({where} {_on(both, drawn)})", ""
    return "", ""


def _seldom(count: int) -> str:
    return "AC hardly ever" if count else "as far as was seen AC never"


def _on(count: int, drawn: int) -> str:
    return f"on {count or 'none'} of {drawn:,} states drawn from K"


def _states(
    chance: np.random.Generator,
    grids: Sequence[GroupTables],
    polytopes: Sequence[PolytopeTables],
    extents: Extents,
) -> Iterator[NDArray[np.float64]]:
    """States of the product of all K, others anywhere in their ranges."""
    cells = [np.argwhere(g.core > 0) for g in grids]
    for _ in range(DRAWN):
        x = np.array([chance.uniform(*ends) for ends in extents])
        for g, inside in zip(grids, cells, strict=True):
            cell = inside[chance.integers(len(inside))]
            ends = [(e[i], e[i + 1]) for e, i in zip(g.grid.edges, cell, strict=True)]
            x[list(g.states)] = [chance.uniform(*pair) for pair in ends]
        for p in polytopes:
            faces, limits = (np.array(part) for part in p.core.faces)
            for _ in range(TRIES):
                point = chance.uniform(p.constraint.low, p.constraint.high)
                if (faces @ point <= limits).all():
                    x[list(p.states)] = point
                    break
            else:
                return
        yield x


def _lets(check: AdmitCheck, x: NDArray[np.float64], chance: np.random.Generator) -> bool:
    """Whether an estimate of a state certainly lets AC have control, all else at some value."""
    box: list[tuple[arb, arb]] = [(exact(v), exact(v)) for v in x.tolist()]
    for low, high in check.decision.ranges:
        end = (low, high)[int(chance.integers(2))]
        box.append((end, end))
    return not check.decision.of(box) & HOLDS
