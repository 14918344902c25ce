"""What of `ttf` a proof goes by where a part of it asks how old a read is.

Purpose: `ttf e || age(t) > c` takes AC's control away where e does, and at other times, too. What
is proved of e is then proved of it: "not ttf" implies "not e". So a proof reads e alone.
Non-goals: what the DM does, which is compiled and compared with all of `ttf`; `safe` and `safer`.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

from soter.language.evaluate.conjuncts import disjuncts
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from soter.language.model.typed import TypedExpr

AGES = (
    "`ttf` also holds where {}: that takes control from AC and never gives it, and the proof does "
    "not go by it; AC keeps control only while it is false"
)


def ttf_of_states(ttf: TypedExpr | None) -> TypedExpr | None:
    """`ttf` without the disjuncts that read an age; all of it where none would be left."""
    if ttf is None or not _ages(ttf):
        return ttf
    left = [part for part in disjuncts(ttf) if not _ages(part)]
    return reduce(_or, left) if left else ttf


def said_of_ages(ttf: TypedExpr | None) -> tuple[str, ...]:
    """A line about the disjuncts that `ttf_of_states` leaves out."""
    left = ttf_of_states(ttf)
    if ttf is None or left is None or left is ttf:
        return ()
    parts = [" ".join(p.span.text.split()) for p in disjuncts(ttf) if _ages(p)]
    return (AGES.format(" or ".join(f"`{p}`" for p in parts)),)


def _ages(e: TypedExpr) -> bool:
    return any(isinstance(n, typed.AgeRead) for n in nodes([e]))


def _or(a: TypedExpr, b: TypedExpr) -> TypedExpr:
    return typed.TypedBinary(BOOL, a.span, "||", a, b)
