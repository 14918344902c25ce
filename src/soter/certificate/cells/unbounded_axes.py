"""Axes without ends: that nothing moves, and SC does nothing, by where the state is.

Purpose: `nothing_reads`: of a state whose axis is unbounded the value occurs in no rate and in no
command of SC, for whatever value it has.
Non-goals: what follows for sets of cells (`cell_sets.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.terms import NotRecheckedError, inputs_of

if TYPE_CHECKING:
    from soter.certificate.reading.case_model import CaseModel

FARTHEST = exact(2.0**1000)
"""No state is farther out than that: a sum of two such numbers is still a double."""


def nothing_reads(model: CaseModel, groups: int) -> None:
    """`NotRecheckedError` where that is not certain, or axes have no ends where it would not do.

    The rates and SC's step are read with states that may be anything up to `FARTHEST`, so that no
    branch is left out because of where a grid ends.
    """
    facts = model.facts
    if facts.kind == "map" or facts.symbol.verify.enters is not None:
        raise NotRecheckedError("an axis without ends of a map, or of `enters`")
    if groups != 1:
        raise NotRecheckedError("an axis without ends beside other groups")
    terms, states = model.new_terms(FARTHEST)
    rates, _ = model.rates(terms, states, control_inputs(facts, terms))
    read = inputs_of(terms, [*rates, *model.commands(terms, states), *terms.obligations])
    for i in sorted(facts.unbounded):
        (atom,) = states[i].terms
        if atom in read:
            name = facts.states[i].name
            raise NotRecheckedError(f"`{name}`, whose axis has no ends, is read by SC or a plant")
