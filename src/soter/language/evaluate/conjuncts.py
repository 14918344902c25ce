"""The parts of a predicate that all must hold.

Purpose: `a && b` as [a, b], also where it stands in a function that only returns it; a product over
groups of states satisfies a predicate if it satisfies each part (`verify/claims/product_sets.py`),
and a view of a module keeps the parts that it can speak of (`language/elaborate/views.py`).
`premise_of`: what an implication asks for.
Non-goals: any other rewriting; a predicate that is no conjunction is its own only part.
"""

from __future__ import annotations

from dataclasses import replace

from soter.language.model import typed
from soter.language.model.tree_walk import rewritten

PARTS_MAX = 16


def conjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Expressions whose conjunction is the predicate, from left to right; at most `PARTS_MAX`."""
    parts = _parts(predicate)
    return parts if len(parts) <= PARTS_MAX else [predicate]


def disjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Expressions whose disjunction is the predicate: `a || b`, and `!e` by the parts of e."""
    inner = returned(predicate) if isinstance(predicate, typed.TypedCall) else None
    if inner is not None and len(parts := disjuncts(inner)) > 1:
        return parts
    if isinstance(predicate, typed.TypedBinary) and predicate.op == "||":
        return [*disjuncts(predicate.left), *disjuncts(predicate.right)]
    if isinstance(predicate, typed.TypedUnary) and predicate.op == "!":
        return [replace(predicate, operand=part) for part in _parts(predicate.operand)]
    return [predicate]


def premise_of(predicate: typed.TypedExpr) -> typed.TypedExpr | None:
    """Of an implication, `!p || q`, `q || !p` or `p ? q : true`, the p; None of anything else."""
    e = returned(predicate) if isinstance(predicate, typed.TypedCall) else predicate
    if isinstance(e, typed.Conditional) and isinstance(e.otherwise, typed.Literal):
        return e.condition if e.otherwise.value is True else None
    if not isinstance(e, typed.TypedBinary) or e.op != "||":
        return None
    negated = [
        x.operand for x in (e.left, e.right) if isinstance(x, typed.TypedUnary) and x.op == "!"
    ]
    return negated[0] if len(negated) == 1 else None


def _parts(e: typed.TypedExpr) -> list[typed.TypedExpr]:
    if isinstance(e, typed.TypedBinary) and e.op == "&&":
        return [*_parts(e.left), *_parts(e.right)]
    if isinstance(e, typed.TypedCall):
        inner = returned(e)
        if inner is not None and len(parts := _parts(inner)) > 1:
            return parts
    return [e]


def returned(call: typed.TypedCall) -> typed.TypedExpr | None:
    """What a call stands for, where the function is nothing but one `return`."""
    body = call.fun.body
    if body is None or len(body) != 1 or not isinstance(body[0], typed.TypedReturn):
        return None
    given = dict(zip(call.fun.parameters, call.arguments, strict=True))

    def argument(e: typed.TypedExpr) -> typed.TypedExpr:
        return given.get(e.variable, e) if isinstance(e, typed.VarRead) else e

    expansion: typed.TypedExpr = rewritten(body[0].value, argument)
    return expansion
