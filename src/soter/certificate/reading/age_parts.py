"""What of `ttf` claims go by where parts of it ask how old a read is.

Purpose: `ttf_of_states`: "not ttf" asks for every part of it; without those that read an age it is
weaker, so what is shown of an estimate on which the rest lets AC have control is shown of more.
Non-goals: sharing code with `verify/problem/age_disjuncts.py`, which the prover goes by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.module_views import must_hold, negated
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from soter.language.model.typed import TypedExpr


def ttf_of_states(ttf: TypedExpr | None) -> TypedExpr | None:
    """`ttf` without what reads an age; as it is where that is nothing, or all."""
    if ttf is None or not _aged(ttf):
        return ttf
    rest = [part for part in must_hold(ttf, wanted=False) if not _aged(part[0])]
    if not rest:
        return ttf
    weaker: TypedExpr = typed.Literal(BOOL, ttf.span, value=False)
    for expr, truth in rest:
        part = negated(expr) if truth else expr
        weaker = typed.TypedBinary(BOOL, ttf.span, "||", weaker, part)
    return weaker


def _aged(e: TypedExpr) -> bool:
    return any(type(node) is typed.AgeRead for node in nodes([e]))
