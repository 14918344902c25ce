"""Ranges of ints that are declared as they can hardly be meant.

Purpose: W025 for an index that counts from 1, and for a place that only one value fits into.
Non-goals: which range an expression has (`step_ranges.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import IntType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.evaluate.ranges import Range
    from soter.language.model.types import Type


def counts_from_one(
    index: typed.VarRead,
    of: Type,
    size: int,
    conditions: Sequence[typed.TypedExpr],
    diagnostics: Diagnostics,
) -> None:
    """W025 for `var k: int in [1, 4]` as the index of four elements.

    Nothing where one of the `conditions` of the step looks at it.
    """
    looked_at = [n.variable for n in nodes(conditions) if isinstance(n, typed.VarRead)]
    if index.variable.type != IntType(1, size) or index.variable in looked_at:
        return
    name = index.variable.name
    diagnostics.warning(
        "W025",
        f"`{name}` counts from 1, the elements of `{of}` from 0",
        index.span,
        f"{name} is 1 to {size}, and 0 to {size - 1} are possible",
        notes=(f"reading or writing element {size} is a step fault",),
        helps=(f"declare it with `int in [0, {size - 1}]`",),
    )


def one_fits(e: typed.Narrow, known: Range, diagnostics: Diagnostics) -> None:
    """W025 for `n = max(n + 1, 9)` of an `int in [0, 9]`: only 9 fits, so that `n` never changes.

    `known`: what the value may be, more than one number, of which only an end is in the type.
    """
    assert isinstance(e.type, IntType)
    only, keeps = (known.low, "min") if known.low == e.type.high else (known.high, "max")
    diagnostics.warning(
        "W025",
        f"of what this may be only {only} fits into `{e.type}`",
        e.span,
        f"it is from {known.low} to {known.high}",
        notes=("putting anything else there is a step fault",),
        helps=(f"keep it inside: `{keeps}(x, {only})`",),
    )
