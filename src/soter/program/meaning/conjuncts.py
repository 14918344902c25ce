"""The parts of a predicate that all must hold.

Purpose: `a && b` as [a, b], also where it stands in a function that only returns it; a product over
groups of states satisfies a predicate if it satisfies each part (`reach/claims/products.py`), and a
view of a module keeps the parts that it can speak of (`program/flatten/views.py`).
`premise_of`: what an implication asks for.
Non-goals: any other rewriting; a predicate that is no conjunction is its own only part.
"""

from __future__ import annotations

from dataclasses import replace

from soter.program.model import typed
from soter.program.model.walk import rewritten

PARTS_MAX = 16


def conjuncts(predicate: typed.Expr) -> list[typed.Expr]:
    """Expressions whose conjunction is the predicate, from left to right; at most `PARTS_MAX`."""
    found = _parts(predicate)
    return found if len(found) <= PARTS_MAX else [predicate]


def disjuncts(predicate: typed.Expr) -> list[typed.Expr]:
    """Expressions whose disjunction is the predicate: `a || b`, and `!e` by the parts of e."""
    inner = returned(predicate) if isinstance(predicate, typed.Call) else None
    if inner is not None and len(found := disjuncts(inner)) > 1:
        return found
    if isinstance(predicate, typed.Binary) and predicate.op == "||":
        return [*disjuncts(predicate.left), *disjuncts(predicate.right)]
    if isinstance(predicate, typed.Unary) and predicate.op == "!":
        return [replace(predicate, operand=part) for part in _parts(predicate.operand)]
    return [predicate]


def premise_of(predicate: typed.Expr) -> typed.Expr | None:
    """Of an implication, `!p || q`, `q || !p` or `p ? q : true`, the p; None of anything else."""
    e = returned(predicate) if isinstance(predicate, typed.Call) else predicate
    if isinstance(e, typed.Conditional) and isinstance(e.otherwise, typed.Literal):
        return e.condition if e.otherwise.value is True else None
    if not isinstance(e, typed.Binary) or e.op != "||":
        return None
    negated = [x.operand for x in (e.left, e.right) if isinstance(x, typed.Unary) and x.op == "!"]
    return negated[0] if len(negated) == 1 else None


def _parts(e: typed.Expr) -> list[typed.Expr]:
    if isinstance(e, typed.Binary) and e.op == "&&":
        return [*_parts(e.left), *_parts(e.right)]
    if isinstance(e, typed.Call):
        inner = returned(e)
        if inner is not None and len(found := _parts(inner)) > 1:
            return found
    return [e]


def returned(call: typed.Call) -> typed.Expr | None:
    """What a call stands for, where the function is nothing but one `return`."""
    body = call.fun.body
    if body is None or len(body) != 1 or not isinstance(body[0], typed.Return):
        return None
    given = dict(zip(call.fun.parameters, call.arguments, strict=True))

    def argument(e: typed.Expr) -> typed.Expr:
        return given.get(e.variable, e) if isinstance(e, typed.VarRead) else e

    found: typed.Expr = rewritten(body[0].value, argument)
    return found
