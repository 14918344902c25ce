"""Where the plants' equations are defined: nothing in them faults anywhere on the grid.

Purpose: `rates_are_defined`: every obligation of the rates (a divisor is not 0, an index is there,
an assertion holds) that no group shows cell by cell is shown over the whole grid at once.
Non-goals: the rates' values. A group that is not linear, and that runs could leave, shows those
obligations itself that concern a state of its own (`flow_enclosures.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.terms import NotRecheckedError, inputs_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Linear, Proposition, Terms

CERTAIN = 2


def rates_are_defined(model: CaseModel, seen_to: Sequence[Sequence[int]]) -> None:
    """`NotRecheckedError` where a rate may be undefined; `seen_to`: groups that look themselves.

    An obligation about states of several groups is left to one that looks: there the others' states
    range over their grids.
    """
    if model.facts.kind == "map":
        return  # a map's obligations are demanded of every cell
    terms, states = model.new_terms()
    model.rates(terms, states, control_inputs(model.facts, terms))
    shown = [{_atom(states[i]) for i in members} for members in seen_to]
    left = []
    for truth in terms.obligations:
        inputs = inputs_of(terms, [truth])
        if any(inputs & own for own in shown):
            continue
        if shown and not inputs & {_atom(x) for x in states}:
            continue  # about commands and disturbances alone: every such group asks it
        left.append(truth)
    if not all_certain(terms, left):
        raise NotRecheckedError("a plant's equation that is not defined everywhere on the grid")


def all_certain(terms: Terms, truths: Sequence[Proposition]) -> bool:
    """Whether all of them certainly hold, whatever the inputs are in their ranges."""
    places = sorted(inputs_of(terms, truths))
    box = [(terms.atoms[i].low, terms.atoms[i].high) for i in places]
    decided = compile_truths(terms, places, truths, {})(form_of_box(box, symbols=False))
    return all(bits == CERTAIN for bits in decided)


def _atom(x: Linear) -> int:
    (index,) = x.terms
    return index
