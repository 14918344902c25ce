"""Ranges of real expressions over ranges of their inputs.

Purpose: `Enclosures` encloses lists of expressions by the forms of `forms.soter`.
Non-goals: expressions that share errors over steps (`tube.soter`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import in_order
from soter.verify.tubes.generated_functions import Caller, function, shared_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.verify.tubes.expression_graph import Node

    Ranges = Mapping[tuple[str, int], Interval]


RANGES = "const SYMBOLS: int = 1;\nconst NONE: float[SYMBOLS] = [0.0];"
"""Constants for forms with one symbol, so that no two of them share an error."""


def enclosed(nodes: Sequence[Node], ranges: Ranges) -> list[Interval]:
    """A range that holds each expression, over `ranges`; endless where nothing is known."""
    return Enclosures([nodes]).of(0, ranges)


class Enclosures:
    """Lists of expressions, written out once and enclosed over several ranges."""

    def __init__(self, lists: Sequence[Sequence[Node]]) -> None:
        self._count = [len(nodes) for nodes in lists]
        self._used = [[e for e in in_order(nodes) if e.op == "input"] for nodes in lists]
        text = [RANGES, shared_text("forms.soter")]
        for k, (nodes, used) in enumerate(zip(lists, self._used, strict=True)):
            over = {e.of: f"a[{i}]" for i, e in enumerate(used)}
            many = f"Form[{max(1, len(used))}]"
            text.append(function(f"asked_{k}", f"a: {many}", nodes, over, f"Form[{len(nodes)}]"))
        self._caller = Caller("\n".join(text))

    def of(self, k: int, ranges: Ranges) -> list[Interval]:
        """Ranges of the expressions of list `k`, over `ranges`; endless where nothing is known."""
        value = self._caller.value
        inputs: list[Any] = [
            value("f_range", ranges[e.of].low, ranges[e.of].high) for e in self._used[k]
        ] or [value("f_number", 0.0)]
        found = value(f"asked_{k}", inputs)
        if found is None:
            return [Interval(-inf, inf)] * self._count[k]
        return [Interval(f[2], f[3]) for f in found]
