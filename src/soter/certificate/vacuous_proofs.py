"""Finds claims that hold but say almost nothing, as AC can never, or hardly ever, have control.

Purpose: `why_vacuous` asks this of a module for the report, of the tables of its DM, or of its
predicates on states drawn from K. It reads nothing that the prover says about it. A share of drawn
states is a measurement, and is called so.
Non-goals: verdicts, as such a proof is a proof; inductions (`induction/check_claims.py`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cell_predicates import AdmitCheck
from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import KEEPS, NotRecheckedError
from soter.certificate.terms.linear_enclosures import exact
from soter.language.elaborate.passes.read_ages import fresh_ages_ns
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.topic_ranges import reader_with_limits, truth_by_parts
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import AgeRead
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.grid.grid_group import GridGroup
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model import typed

    Groups = Sequence[Sequence[GridGroup]]
    """The groups of each combination of parameter values."""

READS_NOTHING = "`safe` reads no topic: it says nothing of the plant"
HOLDS_ANYWAY = "`safe` holds of all values that its topics may have: it says nothing"
DRAWN = 2000
RARE_SHARE = 0.01
"""The share of states drawn from K: where AC has control on less, the report says so."""
FAILS, HOLDS = 1, 2
"""The bits of a proposition on a box: it may be false, it may hold."""


def why_vacuous(facts: Facts, groups: Groups) -> tuple[str, str]:
    """(why the claims about a module say almost nothing, why that was not checked); else ""."""
    if nothing := why_safe_says_nothing(facts):
        return nothing, ""
    for values, of_case in zip(facts.parameter_combinations(), groups, strict=True):
        try:
            if facts.is_computed:
                found, unseen = (next(filter(None, (g.why_never_ac for g in of_case)), ""), "")
            elif _does_ttf_hold_when_fresh(facts):
                found, unseen = f"{KEEPS} (`ttf` holds of whatever is fresh)", ""
            else:
                found, unseen = _why_vacuous_on_drawn_states(facts, values, of_case)
                found = found or _why_ac_may_never_get_control(facts, values)
        except (NotRecheckedError, StepFault, ArithmeticError, ValueError) as error:
            found, unseen = "", f"{type(error).__name__}: {error}"
        if found or unseen:
            pairs = zip(facts.parameters, values, strict=True)
            named = ", ".join(f"{p.name} = {v}" for p, v in pairs)
            return f"with {named} {found}" if named and found else found, unseen
    return "", ""


def why_safe_says_nothing(facts: Facts) -> str:
    """Why `safe` of a module says nothing about its plants; "" if `safe` may be false."""
    safe, scope = facts.symbol.safe, facts.module.scope
    if not topic_reads(safe):
        return READS_NOTHING
    return HOLDS_ANYWAY if truth_by_parts(safe, facts.system, scope) else ""


def _why_ac_may_never_get_control(facts: Facts, values: tuple[int, ...]) -> str:
    """Why AC may never get control: SC has it at the start, and P2b is not claimed; else ""."""
    if not facts.symbol.stay_clause or facts.symbol.safer is None:
        return ""
    safer = _prepare_admit_check(facts, values, facts.symbol.safer, admits=True)
    box = [(exact(i.low), exact(i.high)) for i in facts.states] + safer.decision.ranges
    if safer.decision.bits_on_box(box) & FAILS:
        return ""
    why = f"at the start `safer` does not hold, and P2b is not asked: `{facts.symbol.stay_clause}`"
    return f"nothing says that AC ever gets control ({why})"


def _prepare_admit_check(
    facts: Facts, values: tuple[int, ...], expr: typed.TypedExpr, *, admits: bool
) -> AdmitCheck:
    """Prepares the check whether a predicate keeps AC from control, for states anywhere."""
    box = Axes(tuple(range(len(facts.extents))), Grid(facts.extents))
    model = CaseModel(facts, values, facts.extents)
    return AdmitCheck(model, box, expr, admits=admits, anywhere=True)


def _does_ttf_hold_when_fresh(facts: Facts) -> bool:
    """Whether `ttf` reads an age, and holds in every state as long as all reads are fresh."""
    ttf = facts.symbol.ttf
    if ttf is None or not any(isinstance(n, AgeRead) for n in nodes([ttf])):
        return False
    within = {}
    for state, (topic, path) in facts.leaves.items():
        leaf = [at for at, _ in leaves(facts.system.topics[topic].type)].index(path)
        off = [max(-e.low, e.high) for e in facts.errors if (e.owner, e.leaf) == (topic, leaf)]
        low, high = facts.extents[state]
        slack = sum(off) + 2.0**-50 * (abs(low) + abs(high) + sum(off))
        within[topic, leaf] = (low - slack, high + slack)
    ages = fresh_ages_ns(facts.system, facts.module, facts.times["A_ns"])
    read = reader_with_limits(facts.system, ages, within)
    return truth_by_parts(ttf, facts.system, facts.module.scope, read) is True


def _why_vacuous_on_drawn_states(
    facts: Facts, values: tuple[int, ...], groups: Sequence[GridGroup]
) -> tuple[str, str]:
    """The pair of `why_vacuous`, found by `ttf` and `safer` on estimates of states drawn from K."""
    ttf, safer = facts.ttf, facts.symbol.safer
    if ttf is None or safer is None:
        return "", "predicates that are not there are not looked at"
    chance = np.random.default_rng(0)
    asked = partial(_prepare_admit_check, facts, values)
    checks = asked(safer, admits=True), asked(ttf, admits=False)
    drawn, gets, keeps, both = 0, 0, 0, 0
    for x in _random_states(facts, chance, groups):
        drawn += 1
        switched, left = (_is_ac_admitted(check, x, chance) for check in checks)
        gets, keeps, both = gets + switched, keeps + left, both + (switched and left)
        if both >= RARE_SHARE * DRAWN:
            return "", ""
    if not drawn:
        return "", "no state of K was drawn"
    least = RARE_SHARE * drawn
    if gets < least:
        return (f"{how_often(gets)} has control (`safer` holds {share_text(gets, drawn)})", "")
    if keeps < least:
        return (f"{how_often(keeps)} keeps control (`ttf` is false {share_text(keeps, drawn)})", "")
    if both < least:
        where = "where `safer` holds `ttf` does, too: not so"
        return (f"{how_often(both)} keeps control ({where} {share_text(both, drawn)})", "")
    return "", ""


def how_often(count: int) -> str:
    """Words for AC that has control on `count` drawn states: "hardly ever", or "never" for 0."""
    return "AC hardly ever" if count else "as far as was seen AC never"


def share_text(count: int, drawn: int) -> str:
    """Text on how many of the drawn states something holds."""
    return f"on {count or 'none'} of {drawn:,} states drawn from K"


def _random_states(
    facts: Facts, chance: np.random.Generator, groups: Sequence[GridGroup]
) -> Iterator[NDArray[np.float64]]:
    """Yields random states: parts in a group are in its K, all others in the states' ranges."""
    parts = [g.random_points(chance) for g in groups]
    for _ in range(DRAWN):
        x = np.array([chance.uniform(*ends) for ends in facts.extents])
        for g, part in zip(groups, parts, strict=True):
            point = next(part, None)
            if point is None:
                return
            x[list(g.states)] = point
        yield x


def _is_ac_admitted(check: AdmitCheck, x: NDArray[np.float64], chance: np.random.Generator) -> bool:
    """Whether the predicate certainly gives AC control on an estimate of `x` with random errors."""
    box: list[tuple[arb, arb]] = [(exact(v), exact(v)) for v in x.tolist()]
    for low, high in check.decision.ranges:
        end = (low, high)[int(chance.integers(2))]
        box.append((end, end))
    return not check.decision.bits_on_box(box) & HOLDS
