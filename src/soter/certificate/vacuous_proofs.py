"""Whether what was confirmed says anything: how often AC can have control at all.

Purpose: by states drawn from the sets of a certificate, and by the tables of the DM; nothing that
the prover says about it is read. A share of what was drawn is a measurement and is called so.
Non-goals: verdicts: a proof about an AC that never flies is a proof. Inductions are asked in
`induction/check_claims.py`.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.inclusions.cell_sets import Grid
from soter.certificate.inclusions.group_claims import GroupTables
from soter.certificate.inclusions.predicates import AdmitCheck
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.view_predicates import ttf_of_states
from soter.certificate.report import HOLDS_ANYWAY, READS_NOTHING
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.topic_ranges import always_by_parts, narrowed
from soter.language.model.least_ages import fresh_ages_ns
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import AgeRead
from soter.language.model.types import leaves

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
TRIES = 500
"""Points of the box of a polytope, for one in its K, where the initial state is none."""
TINY = 1e-9
"""No face counts as nearer to the point where a walk begins."""
FAILS, HOLDS = 1, 2
"""The bits that say: a proposition may be false, and may hold."""
GETS = "AC never has control"
KEEPS = "AC never keeps control"


def vacuous(facts: Facts, groups: Groups, extents: Extents) -> tuple[str, str]:
    """Why the claims about a module say next to nothing, and why that was not looked at; or ""."""
    safe, scope = facts.symbol.safe, facts.module.scope
    if not topic_reads(safe):
        return READS_NOTHING, ""
    if always_by_parts(safe, facts.system, scope):
        return HOLDS_ANYWAY, ""
    for values, (grids, polytopes) in zip(facts.cases(), groups, strict=True):
        try:
            if facts.computed:
                found, unseen = _of_tables(facts, grids, polytopes, extents)
            elif _taken_by_age(facts, extents):
                found, unseen = f"{KEEPS} (`ttf` holds of whatever is fresh)", ""
            else:
                found, unseen = _of_predicates(facts, values, grids, polytopes, extents)
                found = found or _never_given(facts, values, extents)
        except (NotRecheckedError, StepFault, ArithmeticError, ValueError) as error:
            found, unseen = "", f"{type(error).__name__}: {error}"
        if found or unseen:
            pairs = zip(facts.parameters, values, strict=True)
            named = ", ".join(f"{p.name} = {v}" for p, v in pairs)
            return f"with {named} {found}" if named and found else found, unseen
    return "", ""


def _of_tables(
    facts: Facts,
    grids: Sequence[GroupTables],
    polytopes: Sequence[PolytopeTables],
    extents: Extents,
) -> tuple[str, str]:
    """S_0 leaves AC in control, S_(m-2) gives it back; of half-spaces on states drawn from K."""
    for g in grids:
        if g.given_back is not None and not g.given_back.any():
            return f"{GETS} (the table gives it back on no estimate)", ""
        if g.levels and not g.levels[0].any():
            return f"{KEEPS} (the table leaves it in control on no estimate)", ""
    for p in polytopes:
        states = list(_states(facts, np.random.default_rng(0), [], [p], extents))
        if not states:
            return "", "no state of K was drawn"
        points = np.array(states)[:, list(p.states)]
        of = ((p.gives_back, "has", "give it back"), (p.leaves, "keeps", "leave it in control"))
        for faces, what, does in of:
            rows = np.array([row for row, _ in faces or ()]).reshape(-1, len(p.states))
            limits = np.array([float(limit) for _, limit in faces or ()])
            count = int((points @ rows.T <= limits).all(axis=1).sum())
            if count < HARDLY * len(points):
                on = f"the half-spaces {does} {_on(count, len(points))}"
                return f"{_seldom(count)} {what} control ({on})", ""
    return "", ""


def _never_given(facts: Facts, values: tuple[int, ...], extents: Extents) -> str:
    """Where SC has control at the start, and no claim is asked that says that it gives it."""
    if not facts.symbol.stays or facts.symbol.safer is None:
        return ""
    safer = _asked(facts, values, extents, facts.symbol.safer, admits=True)
    box = [(exact(i.low), exact(i.high)) for i in facts.states] + safer.decision.ranges
    if safer.decision.of(box) & FAILS:
        return ""
    why = f"at the start `safer` does not hold, and P2b is not asked: `{facts.symbol.stays}`"
    return f"nothing says that AC ever gets control ({why})"


def _asked(
    facts: Facts,
    values: tuple[int, ...],
    extents: Extents,
    expr: typed.TypedExpr,
    *,
    admits: bool,
) -> AdmitCheck:
    """Whether a predicate refuses AC, of states anywhere."""
    every = tuple(range(len(extents)))
    box = GroupTables(every, Grid(extents), np.ones((1,) * len(every), dtype=np.uint8))
    model = CaseModel(facts, values, extents)
    return AdmitCheck(model, box, expr, admits=admits, anywhere=True)


def _taken_by_age(facts: Facts, extents: Extents) -> bool:
    """Whether `ttf`, with what it asks of ages, holds of all that is fresh, at every state."""
    ttf = facts.symbol.ttf
    if ttf is None or not any(isinstance(n, AgeRead) for n in nodes([ttf])):
        return False
    within = {}
    for state, (topic, path) in facts.leaves.items():
        leaf = [at for at, _ in leaves(facts.system.topics[topic].type)].index(path)
        off = [max(-e.low, e.high) for e in facts.errors if (e.owner, e.leaf) == (topic, leaf)]
        low, high = extents[state]
        slack = sum(off) + 2.0**-50 * (abs(low) + abs(high) + sum(off))
        within[topic, leaf] = (low - slack, high + slack)
    ages = fresh_ages_ns(facts.system, facts.module, facts.times["A_ns"])
    read = narrowed(facts.system, ages, within)
    return always_by_parts(ttf, facts.system, facts.module.scope, read) is True


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
    chance = np.random.default_rng(0)
    asked = partial(_asked, facts, values, extents)
    checks = asked(safer, admits=True), asked(ttf, admits=False)
    drawn, gets, keeps, both = 0, 0, 0, 0
    for x in _states(facts, chance, grids, polytopes, extents):
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
    facts: Facts,
    chance: np.random.Generator,
    grids: Sequence[GroupTables],
    polytopes: Sequence[PolytopeTables],
    extents: Extents,
) -> Iterator[NDArray[np.float64]]:
    """States of the product of all K, others anywhere in their ranges."""
    cells = [np.argwhere(g.core > 0) for g in grids]
    walks = [_walk(facts, chance, p) for p in polytopes]
    for _ in range(DRAWN):
        x = np.array([chance.uniform(*ends) for ends in extents])
        for g, inside in zip(grids, cells, strict=True):
            cell = inside[chance.integers(len(inside))]
            ends = [(e[i], e[i + 1]) for e, i in zip(g.grid.edges, cell, strict=True)]
            x[list(g.states)] = [chance.uniform(*pair) for pair in ends]
        for p, walk in zip(polytopes, walks, strict=True):
            point = next(walk, None)
            if point is None:
                return
            x[list(p.states)] = point
        yield x


def _walk(
    facts: Facts, chance: np.random.Generator, p: PolytopeTables
) -> Iterator[NDArray[np.float64]]:
    """Points of the K of a polytope, by hit and run from one of them; none where none is known."""
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


def _lets(check: AdmitCheck, x: NDArray[np.float64], chance: np.random.Generator) -> bool:
    """Whether an estimate of a state certainly lets AC have control, all else at some value."""
    box: list[tuple[arb, arb]] = [(exact(v), exact(v)) for v in x.tolist()]
    for low, high in check.decision.ranges:
        end = (low, high)[int(chance.integers(2))]
        box.append((end, end))
    return not check.decision.of(box) & HOLDS
