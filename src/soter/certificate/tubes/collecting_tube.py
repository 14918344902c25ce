"""Tubes for a module whose check in flight lets runs go on together beyond a kink of SC.

Purpose: `CollectingTube` follows SC as `ModuleTube` does, and lets runs go on together that are
beyond a number, in one state, at one of SC's outputs.
Non-goals: where the certificate says that this is (`check_rest.py`): any number will do.

The argument ("A set on the way", proof-flight.md): let N be the first output at which a run is
beyond. All states in which runs can be at such an instant lie in a box P, over all N, and from
there a run is one that begins in P, whatever acted before. So what is shown of P, with the outputs
that the last N leaves, is shown of all that met it. A run that is not beyond at output n came there
within the window of that output, under any commands: that bounds where it was when that began, and
its tube goes on from there. Nothing else of a run that is cut off is needed, for it was in C until
then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.grid.flow_chains import NOW
from soter.certificate.tubes.tube_chains import ModuleTube, StateSet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flint import arb

    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.certificate.tubes.tube_chains import Box


class CollectingTube(ModuleTube):
    """A `ModuleTube` in which runs beyond `ends`, low < high, of one state go on together."""

    def __init__(
        self, problem: RestProblem, ways: Mapping[int, Range], place: int, ends: tuple[arb, arb]
    ) -> None:
        super().__init__(problem, ways)
        self._place, self._ends = place, ends

    def why_not_settled_at(self, body: StateSet, pieces: int, used: int = 0) -> str | None:
        """Why SC may not rest, or None; joins runs from below at the low end, others at high."""
        (low, high), (least, most) = self._ends, body.box[self._place]
        upwards = bool(least < low)
        if not (upwards or most > high):
            return super().why_not_settled_at(body, pieces, used)
        met: Box = []
        for n in range(used, self.problem.times.switches + 1):
            late = self.chain.span if n > used else NOW
            here = self.chain.at_some_instant(body, late).box if late else body.box
            if not self.is_within_c(here):
                return "any command may lead out of C while SC's may begin to act"
            below, above = self._parts_below_and_above(here, low if upwards else high)
            beyond, left = (above, below) if upwards else (below, above)
            met = _hull_of_boxes(met, beyond)
            if not left:
                return super().why_not_settled_at(StateSet.from_box(met), pieces, n)
            if late:
                left = self.chain.flow.enclose(left, self.chain.flow.ranges, -late, NOW).box
            ends = _common_part(body.box[self._place], left[self._place])
            box = [*body.box[: self._place], ends, *body.box[self._place + 1 :]]
            body, boxes = self.chain.follow_hold(
                StateSet(box, body.rows, body.memory, body.ranges), pieces
            )
            if not self.are_within_c(boxes):
                return f"SC may lead out of C within {n + 1} of its steps"
        return "SC is not certainly at rest in time"

    def _parts_below_and_above(self, box: Box, at: arb) -> tuple[Box, Box]:
        """The parts of a box where the state at `place` is below `at`, and above; [] if empty."""
        (low, high), before, behind = box[self._place], box[: self._place], box[self._place + 1 :]
        below = [] if low > at else [*before, (low, high.min(at)), *behind]
        return below, [] if high < at else [*before, (low.max(at), high), *behind]


def _hull_of_boxes(a: Box, b: Box) -> Box:
    pairs = zip(a, b, strict=True) if a and b else ()
    return [(x[0].min(y[0]), x[1].max(y[1])) for x, y in pairs] or [*a, *b]


def _common_part(a: tuple[arb, arb], b: tuple[arb, arb]) -> tuple[arb, arb]:
    low, high = a[0].max(b[0]), a[1].min(b[1])
    return (low, high) if low <= high else a  # nothing is left: anything holds it
