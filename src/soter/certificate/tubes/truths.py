"""Conditions on true states, over boxes of some of them.

Purpose: `Truths`: what is certain, and what is certainly not; nothing is, outside of their sets.
Non-goals: which conditions (`rest_problem.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.map_steps import atom_of, boxes_of
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.operations import CERTAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Linear, Proposition, Terms
    from soter.certificate.tubes.tube_chains import Box

NOWHERE = 1
"""The bits of what is certainly false."""


class Truths:
    """Conditions on true states, over boxes of some of them."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        said: Callable[[Terms, list[Linear]], Proposition],
    ) -> None:
        terms, states = model.new_terms()
        first = said(terms, states)
        own = [atom_of(states[i]) for i in members]
        known = [(terms.atoms[a].low, terms.atoms[a].high) for a in own]
        boxes = boxes_of(model, states, members)
        self._truths = compile_truths(terms, own, [first, *terms.obligations], boxes)
        self._ends = [
            ends if i in model.facts.unbounded else (exact(low), exact(high))
            for i, ends, (low, high) in zip(
                members, known, (model.extents[i] for i in members), strict=True
            )
        ]

    def certain(self, box: Box) -> bool:
        """Whether it holds, and is defined, in all of a box."""
        return self._within(box) and all(t == CERTAIN for t in self._of(box))

    def nowhere(self, box: Box) -> bool:
        """Whether it holds in none of it."""
        return self._within(box) and self._of(box)[0] == NOWHERE

    def _within(self, box: Box) -> bool:
        pairs = zip(box, self._ends, strict=True)
        return all(low >= a and high <= b and low <= high for (low, high), (a, b) in pairs)

    def _of(self, box: Box) -> Sequence[int]:
        found: Sequence[int] = self._truths(form_of_box(box, symbols=False))
        return found
