"""Ranges of real expressions over ranges of their inputs.

Purpose: `Enclosures` encloses lists of expressions by the forms of `forms.soter`.
Non-goals: expressions that share errors over steps (`tube.soter`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import in_order
from soter.verify.tubes.generated_functions import (
    Caller,
    fun_text,
    numbers_text,
    text_of_package_file,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.verify.tubes.expression_graph import Node

    Ranges = Mapping[tuple[str, int], Interval]


def enclosed_ranges(nodes: Sequence[Node], ranges: Ranges) -> list[Interval]:
    """A range around each expression over `ranges` of the inputs; (-inf, inf): none is known."""
    return Enclosures([nodes]).ranges(0, ranges)


class Enclosures:
    """Lists of expressions; each list is compiled once and then enclosed over several ranges.

    With `shared` an input has the same value wherever it occurs in a list; otherwise each
    occurrence may have another value.
    """

    def __init__(self, lists: Sequence[Sequence[Node]], *, shared: bool = False) -> None:
        self._count = [len(nodes) for nodes in lists]
        self._used = [[e for e in in_order(nodes) if e.op == "input"] for nodes in lists]
        self._shared, symbols = shared, max(1, *map(len, self._used)) if shared else 1
        sizes = f"const SYMBOLS: int = {symbols};"
        none = f"const NONE: float[SYMBOLS] = {numbers_text([0.0] * symbols)};"
        text = [sizes, none, text_of_package_file("forms.soter")]
        for k, (nodes, used) in enumerate(zip(lists, self._used, strict=True)):
            over = {e.of: f"a[{i}]" for i, e in enumerate(used)}
            many = f"Form[{max(1, len(used))}]"
            text.append(fun_text(f"asked_{k}", f"a: {many}", nodes, over, f"Form[{len(nodes)}]"))
        self._caller = Caller("\n".join(text))

    def ranges(self, k: int, ranges: Ranges) -> list[Interval]:
        """A range around each expression of list `k`; (-inf, inf) where nothing is known."""
        value = self._caller.result
        inputs: list[Any] = [self._input_form(i, ranges[e.of]) for i, e in enumerate(self._used[k])]
        inputs = inputs or [value("f_number", 0.0)]
        found = value(f"asked_{k}", inputs)
        if found is None:
            return [Interval(-inf, inf)] * self._count[k]
        return [Interval(f[2], f[3]) for f in found]

    def _input_form(self, i: int, r: Interval) -> Any:  # noqa: ANN401 - a value of the program
        c, off, *ends, g = self._caller.result("f_range", r.low, r.high)
        return (c, 0.0, *ends, (*g[:i], off, *g[i + 1 :])) if self._shared else (c, off, *ends, g)
