"""Kinks of SC behind which the check in flight collects runs ("A set on the way", proof-flight.md).

Purpose: `kinks_of` finds clamps in the law of SC whose argument reads one state, and where their
ends are, in that state. `following_text` writes the functions that follow SC, with
`collect.soter` or without.
Non-goals: which kink is taken (`rest_claims.py`). Any number would be sound in the place of an end.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from soter.verify.problem.problem import Interval
from soter.verify.tubes.enclosures import enclosed_ranges
from soter.verify.tubes.expression_graph import in_order, states_read
from soter.verify.tubes.generated_functions import number_text, shared_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.verify.tubes.expression_graph import Node

LINES = re.compile(r".*  // collects\n")
"""Lines of `answer.soter` that a module without a kink does not have."""


@dataclass(frozen=True)
class Kink:
    """The ends of a clamp, low < high, in units of `state`: only that state its argument reads."""

    state: int
    low: float
    high: float


def kinks_of(law: Sequence[Node]) -> Iterator[Kink]:
    """The kinks of a law whose argument reads one input alone; those computed first come first."""
    for e in in_order(law):
        if e.op == "min" and e.of[0].op == "max" and e.of[1].op == e.of[0].of[1].op == "number":
            argument, low, high = e.of[0].of[0], e.of[0].of[1].of[0], e.of[1].of[0]
            states = states_read([argument])
            if len(states) == 1 and sum(x.op == "input" for x in in_order([argument])) == 1:
                (state,) = states
                at = ({("y", state): Interval(x, x)} for x in (0.0, 1.0))
                first, second = (enclosed_ranges([argument], x)[0].low for x in at)
                if first != second and isfinite(second - first):
                    ends = ((end - first) / (second - first) for end in (low, high))
                    yield Kink(state, *sorted(ends))


def collects_entry(kink: Kink | None, names: Sequence[str]) -> dict[str, object]:
    """The part about a kink of a certificate's entry; `names` are those of all states."""
    if kink is None:
        return {}
    return {"collects": {"state": names[kink.state], "at": [kink.low.hex(), kink.high.hex()]}}


def following_text(states: Sequence[int], kink: Kink | None) -> str:
    """The functions that follow SC: with `kink` they also collect the runs that are beyond it."""
    text = shared_text("answer.soter")
    if kink is None:
        return LINES.sub("", text).replace("n - began", "n").replace(" && !heap.some", "")
    lines = [
        f"const KINKED: int = {states.index(kink.state)};",
        f"const KINK_LOW: float = {number_text(kink.low)};",
        f"const KINK_HIGH: float = {number_text(kink.high)};",
    ]
    return "\n".join([*lines, shared_text("collect.soter"), text])
