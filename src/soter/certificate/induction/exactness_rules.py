"""Which values are exact, and which functions are read where they are called.

Purpose: the re-checker's own rule for what is opaque.
Non-goals: reading (`solver_reading.py`).
"""

from __future__ import annotations

from functools import lru_cache

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
LONGER = (typed.ForRange, typed.ForEach, typed.Index, typed.TypedLength, typed.Vector)


def is_plain(t: Type) -> bool:
    """A type whose values are exact."""
    return isinstance(t, (BoolType, IntType, EnumType, DurationType))


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


@lru_cache(maxsize=1_000)
def is_read(fun: typed.FunSymbol, *, deep: bool) -> bool:
    """Whether a function is read wherever it is called; another one only where all is known.

    It is where all is exact; and where it is short and only puts together what others found.
    `deep`, where the same is asked in two places: also one expression that asks other functions,
    and calculates what it asks them, however long it is.
    """
    parts = list(parts_of(fun.body or ()))
    types = [n.type for n in parts if isinstance(n, typed.TypedExpr)]
    if all(is_exact(t) for t in (*types, fun.result, *(p.type for p in fun.parameters))):
        return True
    asks = deep and [type(s) for s in fun.body or ()] == [typed.TypedReturn]
    return (asks or len(parts) <= SHORT) and all(_joins(n, asks=asks) for n in parts)


def _joins(n: object, *, asks: bool) -> bool:
    """Whether it makes no float or list of its own; `asks`: floats are added and multiplied."""
    if isinstance(n, typed.TypedBinary):
        of, compares = n.left.type, isinstance(n.type, BoolType)
        return is_plain(of) or (isinstance(of, FloatType) and (compares or (asks and n.op != "/")))
    if isinstance(n, typed.TypedUnary):
        return is_plain(n.type) or (asks and isinstance(n.type, FloatType))
    if isinstance(n, typed.Aggregate):
        return isinstance(n.type, RecordType)
    if isinstance(n, typed.Place):
        return all(isinstance(p, int) for p in n.path)
    return is_plain(n.type) if isinstance(n, typed.Builtin) else not isinstance(n, LONGER)


@lru_cache(maxsize=1_000)
def asks_extern(fun: typed.FunSymbol) -> bool:
    """Whether a call ends in an extern function, which may give another value each time."""
    seen, todo = {fun}, [fun]
    for f in todo:
        below = [n.fun for n in parts_of(f.body or ()) if isinstance(n, typed.TypedCall)]
        todo += [g for g in dict.fromkeys(below) if g not in seen]
        seen.update(todo)
    return any(f.extern or f.body is None for f in todo)
