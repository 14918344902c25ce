"""Kinks of SC, behind which the check in flight collects runs in one set (docs/proof-flight.md).

Purpose: a kink is a clamp in the law of SC whose argument reads one state; `kinks_of` finds them,
with their ends in units of that state. `text_that_follows_sc` writes the functions that follow SC,
with `collect.soter` or without.
Non-goals: the choice of a kink (`rest_claims.py`). Any other numbers as ends would be sound, too.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from soter.verify.problem.problem import Interval
from soter.verify.tubes.enclosures import enclosed_ranges
from soter.verify.tubes.expression_graph import in_order, states_read
from soter.verify.tubes.generated_functions import number_text, text_of_package_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.verify.tubes.expression_graph import Node

LINES = re.compile(r".*  // collects\n")
"""Lines of `answer.soter` that a module without a kink does not have."""


@dataclass(frozen=True)
class Kink:
    """The ends of a clamp, low < high, in units of `state`, the only one its argument reads."""

    state: int
    low: float
    high: float


def kinks_of(law: Sequence[Node]) -> Iterator[Kink]:
    """The kinks of a law, whose arguments read one input each, in the order of computation."""
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


def kink_entry(kink: Kink | None, names: Sequence[str]) -> dict[str, object]:
    """The part of a certificate's entry for a kink; `names` has the names of all states."""
    if kink is None:
        return {}
    return {"collects": {"state": names[kink.state], "at": [kink.low.hex(), kink.high.hex()]}}


def text_that_follows_sc(states: Sequence[int], kink: Kink | None) -> str:
    """The text of the functions that follow SC; with `kink` they collect the runs beyond it."""
    text = text_of_package_file("answer.soter")
    if kink is None:
        return LINES.sub("", text).replace("n - began", "n").replace(" && !heap.some", "")
    lines = [
        f"const KINKED: int = {states.index(kink.state)};",
        f"const KINK_LOW: float = {number_text(kink.low)};",
        f"const KINK_HIGH: float = {number_text(kink.high)};",
    ]
    return "\n".join([*lines, text_of_package_file("collect.soter"), text])
