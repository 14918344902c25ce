"""Values of programs as terms of a solver: exact, or elements of a sort of which nothing is known.

Purpose: what a value of a type looks like (`unknown`, `known`), what the same function of the same
values gives (`applied`), elements of lists and arrays.
Non-goals: reading code (`solver_reading.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.exactness_rules import is_plain, parts_of_value
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value

Term = Any
OPAQUE = z3.DeclareSort("opaque")
LARGEST, SMALLEST = 2**63 - 1, -(2**63)
ELEMENTS_MAX = 64
"""Of a list of the program that is longer nothing is told."""


@dataclass(frozen=True)
class Elapsed:
    """The age of a topic."""

    ns: Term


@dataclass(frozen=True)
class Seconds:
    """A float that is known."""

    value: float


def true(x: bool | Term) -> Term:
    """A truth as a term."""
    return z3.BoolVal(x) if isinstance(x, bool) else x


def unknown(t: Type, name: str, facts: list[Term]) -> Term:
    """Any value of a type; what the type says of it goes to `facts`."""
    parts = parts_of_value(t)
    if parts is not None:
        return tuple(unknown(p, f"{name}.{k}", facts) for k, p in enumerate(parts))
    if isinstance(t, BoolType):
        return z3.FreshBool(name)
    if is_plain(t):
        constant = z3.FreshInt(name)
        low, high = extent(t)
        facts.append(z3.And(constant >= low, constant <= high))
        return constant
    return z3.FreshConst(OPAQUE, name)


def extent(t: Type) -> tuple[int, int]:
    """The least and the greatest value."""
    if isinstance(t, EnumType):
        return 0, len(t.members) - 1
    return (t.low, t.high) if isinstance(t, IntType) else (SMALLEST, LARGEST)


def known(t: Type, value: Value) -> Term:
    """A value of the program."""
    parts = parts_of_value(t)
    if parts is not None:
        return tuple(known(p, v) for p, v in zip(parts, value, strict=True))
    if isinstance(t, BoolType):
        return z3.BoolVal(bool(value))
    if is_plain(t):
        return z3.IntVal(int(value))
    if isinstance(t, FloatType):
        return Seconds(value)
    return z3.Const(f"{t!r}: {value!r}", OPAQUE)


def both(a: Term, b: Term) -> Term:
    """`a && b`, which is one of them where the other is known."""
    if z3.is_true(a) or z3.is_false(b):
        return b
    return a if z3.is_true(b) or z3.is_false(a) else z3.And(a, b)


def negation(a: Term) -> Term:
    """`!a`."""
    return z3.BoolVal(z3.is_false(a)) if z3.is_true(a) or z3.is_false(a) else z3.Not(a)


def one_of(a: Term, b: Term) -> Term:
    """`a || b`, likewise."""
    if z3.is_false(a) or z3.is_true(b):
        return b
    return a if z3.is_false(b) or z3.is_true(a) else z3.Or(a, b)


def opaque(value: Term) -> Term:
    """A float as an element of the sort."""
    if isinstance(value, Seconds):
        return z3.Const(f"float: {value.value!r}", OPAQUE)
    if isinstance(value, Elapsed):
        return z3.Function("age in seconds", z3.IntSort(), OPAQUE)(value.ns)
    return value


def either(c: Term, a: Term, b: Term) -> Term:
    """`c ? a : b`."""
    if z3.is_true(c) or z3.is_false(c):
        return a if z3.is_true(c) else b
    if isinstance(a, tuple):
        return tuple(either(c, x, y) for x, y in zip(a, b, strict=True))
    if a is b:
        return a
    if isinstance(a, Elapsed) and isinstance(b, Elapsed):
        return Elapsed(z3.If(c, a.ns, b.ns))
    return z3.If(c, opaque(a), opaque(b))


def flat(value: Term) -> list[Term]:
    """Its leaves."""
    if isinstance(value, tuple):
        return [x for v in value for x in flat(v)]
    return [opaque(value)]


def inside(value: Term, t: Type, bounds: Sequence[Bound | None]) -> Term:
    """Whether a topic with these bounds takes a value."""
    parts = parts_of_value(t)
    if parts is not None:
        conditions, at = [], 0
        for v, p in zip(value, parts, strict=True):
            count = sum(1 for _ in leaves(p))
            conditions.append(inside(v, p, bounds[at : at + count]))
            at += count
        return z3.And(*conditions) if conditions else z3.BoolVal(True)
    if isinstance(t, (BoolType, EnumType)):
        return z3.BoolVal(True)
    if is_plain(t):
        low, high = extent(t)
        if bounds and bounds[0] is not None:
            low, high = max(low, ceil(bounds[0].low)), min(high, floor(bounds[0].high))
        return z3.And(value >= low, value <= high)
    said = [None if b is None else (b.low, b.high) for b in bounds]
    if isinstance(value, Seconds):
        limits = said[0] or (float("-inf"), float("inf"))
        finite = value.value - value.value == 0.0
        return z3.BoolVal(finite and limits[0] <= value.value <= limits[1])
    return z3.Function(f"taken {t!r} {said}", OPAQUE, z3.BoolSort())(opaque(value))


# ---------------------------------------------------------------- functions, lists


def applied(name: str, values: Sequence[Term], t: Type, facts: list[Term]) -> Term:
    """What a function gives for these values: for the same ones the same; its type to `facts`."""
    parts = parts_of_value(t)
    if parts is not None:
        return tuple(applied(f"{name}.{k}", values, p, facts) for k, p in enumerate(parts))
    arguments = [x for v in values for x in flat(v)]
    sort = z3.BoolSort() if isinstance(t, BoolType) else z3.IntSort() if is_plain(t) else OPAQUE
    if not arguments:
        return z3.Const(name, sort)
    application = z3.Function(name, *[a.sort() for a in arguments], sort)(*arguments)
    if is_plain(t) and not isinstance(t, BoolType):
        low, high = extent(t)
        facts.append(z3.And(application >= low, application <= high))
    return application


def length(sequence: Term, t: Type, facts: list[Term]) -> Term:
    """How many elements a list or an array has."""
    if isinstance(t, ArrayType):
        return z3.IntVal(t.size)
    assert isinstance(t, ListType)
    size = z3.Function("length", OPAQUE, z3.IntSort())(opaque(sequence))
    facts.append(z3.And(size >= 0, size <= t.capacity))
    return size


def element(sequence: Term, index: Term, t: ListType | ArrayType, facts: list[Term]) -> Term:
    """The element of a list or an array at an index that it has."""
    if isinstance(sequence, tuple):
        if z3.is_int_value(index):
            return sequence[min(max(index.as_long(), 0), len(sequence) - 1)]
        value = sequence[-1]
        for k in range(len(sequence) - 2, -1, -1):
            value = either(index == k, sequence[k], value)
        return value
    return applied(f"element of {t!r}", [sequence, index], t.element, facts)


def contents(t: Type, value: Value, facts: list[Term]) -> None:
    """What is known of the lists and arrays in a value of the program goes to `facts`."""
    parts = parts_of_value(t)
    if parts is not None:
        for p, v in zip(parts, value, strict=True):
            contents(p, v, facts)
    elif isinstance(t, (ListType, ArrayType)) and len(value) <= ELEMENTS_MAX:
        whole = known(t, value)
        facts.append(length(whole, t, facts) == len(value))
        for k, v in enumerate(value):
            item = element(whole, z3.IntVal(k), t, facts)
            pairs = zip(flat(item), flat(known(t.element, v)), strict=True)
            facts += [a == b for a, b in pairs]
            contents(t.element, v, facts)
