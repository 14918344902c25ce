"""Which values are exact, and which functions are read where they are called.

Purpose: the re-checker's own rule for what is opaque.
Non-goals: reading (`solver_reading.py`).
"""

from __future__ import annotations

from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    Type,
    has_list,
    leaf_count,
)

SHORT = 60
"""Nodes of the tree of a function that is read although its values are opaque."""
LEAVES_MAX = 64
"""Numbers and truths of an array whose elements are told apart; of a larger one nothing is told."""


def is_plain(t: Type) -> bool:
    """A type whose values are exact."""
    return isinstance(t, (BoolType, IntType, EnumType, DurationType))


_SIMPLE = (
    typed.Literal, typed.ParamRead, typed.VarRead, typed.Conditional, typed.TypedField,
    typed.Narrow, typed.TypedCall, typed.TypedUnary, typed.TypedBinary, typed.TypedReturn,
    typed.TypedIf, typed.TypedDeclare, typed.TypedAssign,
    typed.Place, typed.Aggregate, typed.Builtin, typed.ForRange, typed.Assert,
)  # fmt: skip


_EXACT = (*_SIMPLE, typed.Index, typed.TypedLength, typed.ForEach)


def parts_of_value(t: Type) -> tuple[Type, ...] | None:
    """The types of the parts of which a value is put together: of a record, or a small array.

    None for everything that is one term, be it a number or an array of which nothing is told.
    """
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    if isinstance(t, ArrayType) and not has_list(t) and leaf_count(t) <= LEAVES_MAX:
        return (t.element,) * t.size
    return None


def is_exact(t: Type) -> bool:
    """Whether all of a value is."""
    parts = parts_of_value(t)
    return is_plain(t) if parts is None else all(is_exact(p) for p in parts)


def is_simple(fun: typed.FunSymbol) -> bool:
    """Whether its body is all of what is read here."""
    parts = list(parts_of(fun.body or ()))
    exact = all(is_exact(n.type) for n in parts if isinstance(n, typed.TypedExpr))
    return exact and all(isinstance(n, _EXACT) for n in parts)


def is_short(fun: typed.FunSymbol) -> bool:
    """Whether it only puts together what others found: then it is read, whatever its values."""
    parts = list(parts_of(fun.body or ()))
    return len(parts) <= SHORT and all(isinstance(n, _SIMPLE) and _joins(n) for n in parts)


_PASSING = (
    typed.Literal, typed.ParamRead, typed.VarRead, typed.TypedField, typed.TypedCall,
    typed.TypedReturn, typed.Aggregate, typed.TypedUnary, typed.TypedBinary,
)  # fmt: skip


def passes_on(fun: typed.FunSymbol) -> bool:
    """Whether it is one expression that asks other functions, and calculates what it asks them.

    Where the same is asked in two places, such a function is read however long it is.
    """
    body = fun.body or ()
    if len(body) != 1 or not isinstance(body[0], typed.TypedReturn):
        return False
    return all(isinstance(n, _PASSING) and _hands_on(n) for n in parts_of(body))


def _hands_on(n: object) -> bool:
    if isinstance(n, typed.TypedBinary):
        return n.op in ("&&", "||") or (isinstance(n.left.type, FloatType) and n.op != "/")
    if isinstance(n, typed.TypedUnary):
        return n.op == "!" or isinstance(n.type, FloatType)
    return not isinstance(n, typed.Aggregate) or isinstance(n.type, RecordType)


def _joins(n: object) -> bool:
    if isinstance(n, typed.TypedBinary):
        t = n.left.type
        return is_plain(t) or (isinstance(t, FloatType) and isinstance(n.type, BoolType))
    if isinstance(n, typed.Aggregate):
        return isinstance(n.type, RecordType)
    if isinstance(n, typed.Place):
        return all(isinstance(p, int) for p in n.path)
    if isinstance(n, (typed.Builtin, typed.TypedUnary)):
        return is_plain(n.type)
    return not isinstance(n, typed.ForRange)
