"""Comparisons of stored values whose result a compiler knows, and would remark on.

Purpose: which ones; the generated C writes `soter_plain` around their operands.
Non-goals: the C itself (`codegen/body.py`).
"""

from __future__ import annotations

from soter.core import core
from soter.core.layout import LENGTH, scalar, storage_range
from soter.language.model.types import EnumType, FloatType, IntType

LOGICAL = frozenset(("&&", "||"))
STORED = (core.Get, core.Field, core.Element, core.Fact)


def is_foregone(op: str, value: core.Expr, other: core.Expr) -> bool:
    """Whether a compiler could tell the result of an int comparison, and would remark on it.

    That is a stored value against a constant at or beyond the limits of its storage, or constants
    chosen by a condition that it knows.
    """
    if isinstance(value, core.Select):
        return True
    if not isinstance(other, core.Const) or isinstance(value, (core.Var, core.Const)):
        return False
    s = scalar(LENGTH if isinstance(value, core.Length) else value.type)
    if s is None or not isinstance(value.type, (IntType, EnumType)):
        return False
    low, high = storage_range(s)
    if op in {"==", "!="}:
        return not low <= other.value <= high
    return not low < other.value < high


def compared_twice(condition: core.Expr) -> list[core.Expr]:
    """Stored values that parts of a condition compare with several constants for equality.

    Where no value fits all of them a compiler knows the result.
    """
    comparisons: list[tuple[core.Expr, object]] = []
    parts = [condition]
    while parts:
        part = parts.pop()
        if isinstance(part, core.Unary) and part.op == "not":
            parts.append(part.operand)
        elif isinstance(part, core.Binary) and part.op in LOGICAL:
            parts += (part.left, part.right)
        elif isinstance(part, core.Binary) and part.op in {"==", "!="}:
            for value, other in ((part.left, part.right), (part.right, part.left)):
                exact = isinstance(value, STORED) and not isinstance(value.type, FloatType)
                if exact and isinstance(other, core.Const):
                    comparisons.append((value, other.value))
    return [v for v, x in comparisons if any(w == v and y != x for w, y in comparisons)]
