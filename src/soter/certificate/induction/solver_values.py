"""The re-checker's values as terms of a solver: exact, or opaque, with nothing known of them.

Purpose: `unknown_value` and `value_as_terms` make values of a type, `unread_result` that of a
function that is not read. A value is a bool, an int or a float of Python where it is known, else a
term or an `Elapsed`; records and small arrays are tuples of values. Known lists and large arrays
are tuples as long as a step is read, and one term in between (`value_as_terms`). The re-checker's
own rule for what is exact and what is opaque stands here, and which functions are read where they
are called (`reads_body`).
Non-goals: what operators give, reading code (`solver_steps.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.reading.symbolic_values import is_identical, is_known
from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    has_list,
    leaf_count,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Bound


SHORT = 60
"""Nodes of the tree of a function that is read although its values are opaque."""
LEAVES_MAX = 64
"""Numbers and truths of an array whose elements are told apart; of a larger one nothing is told."""
LONGER = (typed.ForRange, typed.ForEach, typed.Index, typed.TypedLength, typed.Vector)
OPAQUE = z3.DeclareSort("opaque")
"""The sort of floats, and of lists and arrays in one term: only equality is known of these."""
LARGEST, SMALLEST = 2**63 - 1, -(2**63)
ELEMENTS_MAX = 64
"""Nothing is told of a longer list of the program."""


def is_discrete(t: Type) -> bool:
    """Whether a type has only exact values: truths, whole numbers, members or durations."""
    return isinstance(t, (BoolType, IntType, EnumType, DurationType))


def part_types(t: Type) -> tuple[Type, ...] | None:
    """The types of the parts of a record or small array, whose parts have separate terms.

    None for a type whose values are single terms: numbers, and arrays with unknown elements.
    """
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    if isinstance(t, ArrayType) and not has_list(t) and leaf_count(t) <= LEAVES_MAX:
        return (t.element,) * t.size
    return None


def is_exact(t: Type) -> bool:
    """Whether the solver has values of this type exactly: all parts are truths or whole numbers."""
    parts = part_types(t)
    return is_discrete(t) if parts is None else all(is_exact(p) for p in parts)


@lru_cache(maxsize=1_000)
def reads_body(fun: typed.FunSymbol, *, deep: bool) -> bool:
    """Whether a function's body is read at every call; if not, only when all arguments are known.

    A body is read if it is exact, or if it is short and only combines results of other calls.
    `deep`, for comparing two readings: also if it is a single expression of any length that calls
    other functions on computed arguments.
    """
    parts = list(parts_of(fun.body or ()))
    types = [n.type for n in parts if isinstance(n, typed.TypedExpr)]
    if all(is_exact(t) for t in (*types, fun.result, *(p.type for p in fun.parameters))):
        return True
    asks = deep and [type(s) for s in fun.body or ()] == [typed.TypedReturn]
    return (asks or len(parts) <= SHORT) and all(_is_free_of_floats(n, asks=asks) for n in parts)


def _is_free_of_floats(n: object, *, asks: bool) -> bool:
    """Whether code makes no float or list; `asks`: it may still add and multiply floats."""
    if isinstance(n, typed.TypedBinary):
        operand, on = n.left.type, isinstance(n.type, BoolType) or (asks and n.op != "/")
        return is_discrete(operand) or (isinstance(operand, FloatType) and on)
    if isinstance(n, typed.TypedUnary):
        return is_discrete(n.type) or (asks and isinstance(n.type, FloatType))
    if isinstance(n, typed.Aggregate):
        return isinstance(n.type, RecordType)
    if isinstance(n, typed.Place):
        return all(isinstance(p, int) for p in n.path)
    return is_discrete(n.type) if isinstance(n, typed.Builtin) else not isinstance(n, LONGER)


@lru_cache(maxsize=1_000)
def calls_extern(fun: typed.FunSymbol) -> bool:
    """Whether a call may reach an extern function, which may give another value each time."""
    seen, todo = {fun}, [fun]
    for f in todo:
        below = [n.fun for n in parts_of(f.body or ()) if isinstance(n, typed.TypedCall)]
        todo += [g for g in dict.fromkeys(below) if g not in seen]
        seen.update(todo)
    return any(f.extern or f.body is None for f in todo)


Term = Any
"""A value, as the head of this file says: of Python, of the solver, or a tuple of such."""


@dataclass(frozen=True)
class Elapsed:
    """The age of a topic, in ns."""

    ns: Term


# ---------------------------------------------------------------- truths


def and_of(*truths: Term) -> Term:
    """The term that all truths hold."""
    left = [x for x in truths if x is not True]
    if any(x is False for x in left):
        return False
    return z3.And(*left) if len(left) > 1 else left[0] if left else True


def or_of(*truths: Term) -> Term:
    """The term that at least one of the truths holds."""
    left = [x for x in truths if x is not False]
    if any(x is True for x in left):
        return True
    return z3.Or(*left) if len(left) > 1 else left[0] if left else False


def negation(a: Term) -> Term:
    """The term "not `a`"."""
    return (not a) if isinstance(a, bool) else z3.Not(a)


# ---------------------------------------------------------------- values


def unknown_value(t: Type, name: str, facts: list[Term]) -> Term:
    """Any value of a type; adds the range of the type to `facts`."""
    parts = part_types(t)
    if parts is not None:
        return tuple(unknown_value(p, f"{name}.{k}", facts) for k, p in enumerate(parts))
    return _with_range_of_type(t, z3.FreshConst(_solver_sort(t), name), facts)


def _solver_sort(t: Type) -> Any:  # noqa: ANN401 - a sort
    return z3.BoolSort() if isinstance(t, BoolType) else z3.IntSort() if is_discrete(t) else OPAQUE


def _with_range_of_type(t: Type, x: Term, facts: list[Term]) -> Term:
    if is_discrete(t) and not isinstance(t, BoolType):
        low, high = integer_range(t)
        facts.append(z3.And(x >= low, x <= high))
    return x


def integer_range(t: Type) -> tuple[int, int]:
    """The least and the greatest value of a type of whole numbers."""
    if isinstance(t, EnumType):
        return 0, len(t.members) - 1
    return (t.low, t.high) if isinstance(t, IntType) else (SMALLEST, LARGEST)


def value_as_terms(t: Type, value: Term, facts: list[Term]) -> Term:
    """A value as terms, one for each leaf; adds equations for its elements to `facts`."""
    parts = part_types(t)
    if parts is not None:
        return tuple(value_as_terms(p, v, facts) for p, v in zip(parts, value, strict=True))
    if not isinstance(value, tuple):
        return value
    whole = z3.Const(f"{t!r}: {value!r}", OPAQUE)
    if isinstance(t, (ListType, ArrayType)) and len(value) <= ELEMENTS_MAX:
        facts.append(element_count(whole, t, facts) == len(value))
        for k, v in enumerate(value):
            item, part = element_at(whole, k, t, facts), value_as_terms(t.element, v, facts)
            facts += [a == b for a, b in zip(leaf_terms(item), leaf_terms(part), strict=True)]
    return whole


def leaf_terms(value: Term) -> list[Term]:
    """The leaves of a value as terms."""
    return (
        [x for v in value for x in leaf_terms(v)] if isinstance(value, tuple) else [as_term(value)]
    )


def as_term(value: Term) -> Term:
    """A number or a truth as a term; floats are constants of the opaque sort."""
    if isinstance(value, bool):
        return z3.BoolVal(value)
    if isinstance(value, int):
        return z3.IntVal(value)
    if isinstance(value, float):
        return z3.Const(f"float: {value!r}", OPAQUE)
    if isinstance(value, Elapsed):
        return z3.Function("age in seconds", z3.IntSort(), OPAQUE)(value.ns)
    return value


def choose(c: Term, a: Term, b: Term) -> Term:
    """The term `c ? a : b` for two values of the same shape."""
    if isinstance(c, bool):
        return a if c else b
    if isinstance(a, tuple):
        return tuple(choose(c, x, y) for x, y in zip(a, b, strict=True))
    if a is b or (is_known(a) and is_known(b) and is_identical(a, b)):
        return a
    if isinstance(a, Elapsed) and isinstance(b, Elapsed):
        return Elapsed(z3.If(c, a.ns, b.ns))
    return z3.If(c, as_term(a), as_term(b))


def within_bounds(value: Term, t: Type, bounds: Sequence[Bound | None]) -> Term:
    """The term that a value may be published on a topic: it lies within its bounds and its type."""
    parts = part_types(t)
    if parts is not None:
        conditions, at = [], 0
        for v, p in zip(value, parts, strict=True):
            count = sum(1 for _ in leaves(p))
            conditions.append(within_bounds(v, p, bounds[at : at + count]))
            at += count
        return and_of(*conditions)
    if isinstance(t, (BoolType, EnumType)):
        return True
    if is_discrete(t):
        low, high = integer_range(t)
        if bounds and bounds[0] is not None:
            low, high = max(low, ceil(bounds[0].low)), min(high, floor(bounds[0].high))
        return and_of(value >= low, value <= high)
    ranges = [None if b is None else (b.low, b.high) for b in bounds]
    if isinstance(value, float):
        limits = ranges[0] or (float("-inf"), float("inf"))
        return value - value == 0.0 and limits[0] <= value <= limits[1]
    return z3.Function(f"taken {t!r} {ranges}", OPAQUE, z3.BoolSort())(as_term(value))


# ---------------------------------------------------------------- functions, lists


def unread_result(name: str, values: Sequence[Term], t: Type, facts: list[Term]) -> Term:
    """A function's unknown result, equal for equal `values`; adds its type's range to `facts`."""
    parts = part_types(t)
    if parts is not None:
        return tuple(unread_result(f"{name}.{k}", values, p, facts) for k, p in enumerate(parts))
    arguments = [x for v in values for x in leaf_terms(v)]
    if not arguments:
        return z3.Const(name, _solver_sort(t))
    function = z3.Function(name, *[a.sort() for a in arguments], _solver_sort(t))
    return _with_range_of_type(t, function(*arguments), facts)


def element_count(sequence: Term, t: Type, facts: list[Term]) -> Term:
    """The number of elements of a list or array; adds the bounds of this number to `facts`."""
    if isinstance(t, ArrayType):
        return t.size
    assert isinstance(t, ListType)
    size = z3.Function("length", OPAQUE, z3.IntSort())(sequence)
    facts.append(z3.And(size >= 0, size <= t.capacity))
    return size


def element_at(sequence: Term, index: Term, t: ListType | ArrayType, facts: list[Term]) -> Term:
    """The element of a list or an array at an index in range."""
    if not isinstance(sequence, tuple):
        return unread_result(f"element of {t!r}", [sequence, index], t.element, facts)
    value = sequence[-1]
    for k in range(len(sequence) - 2, -1, -1):
        value = choose(index == k, sequence[k], value)
    return value
