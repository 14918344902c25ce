"""What a Core value is while its enclosure is emitted.

Purpose: records, arrays and lists fall apart into scalars; a scalar is known now (a constant) or
lies in a variable of the emitted C.
Non-goals: emitting (`c_emitter.py`), meaning (`core_enclosure.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
)

if TYPE_CHECKING:
    from soter.codegen.c import tree as c
    from soter.language.model.types import Type
    from soter.language.model.types import Value as Plain

LARGEST = math.nextafter(math.inf, 0.0)


@dataclass(frozen=True)
class Form:
    """A float in a `soter_form` of the emitted C."""

    place: c.CExpr
    turns: int = 0
    """How often a state enters that is read modulo a full turn: it may be turns off as often."""
    sums: int = 0
    """Operations since: each rounds by as much as far turns are large."""


@dataclass(frozen=True)
class FloatRange:
    """A float known to lie in [low, high], both finite; low == high: exactly that one."""

    low: float
    high: float


@dataclass(frozen=True)
class EmittedInts:
    """An int or enum in a `soter_ints` of the emitted C."""

    place: c.CExpr


@dataclass(frozen=True)
class KnownInt:
    """A known int or enum."""

    value: int


@dataclass(frozen=True)
class EmittedTruth:
    """A bool in a `soter_truth` of the emitted C."""

    place: c.CExpr


@dataclass(frozen=True)
class KnownTruth:
    """A bool known now: True, False, or None for "either"."""

    value: bool | None


@dataclass(frozen=True)
class AggregateParts:
    """A record's fields or an array's elements."""

    items: tuple[Item, ...]


@dataclass(frozen=True)
class Sequence:
    """A bounded list: its length and `capacity` items."""

    length: EmittedInts | KnownInt
    items: tuple[Item, ...]


@dataclass(frozen=True)
class Constant:
    """A constant that has not been taken apart (tables are large)."""

    type: Type
    value: Plain


Scalar = Form | FloatRange | EmittedInts | KnownInt | EmittedTruth | KnownTruth
Item = Scalar | AggregateParts | Sequence | Constant


def element_types(t: Type) -> tuple[Type, ...]:
    """Types of a record's fields, or of an array's or list's places."""
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    if isinstance(t, ArrayType):
        return (t.element,) * t.size
    assert isinstance(t, ListType)
    return (t.element,) * t.capacity


def is_scalar(t: Type) -> bool:
    """Whether values of the type are one leaf."""
    return isinstance(t, (BoolType, EnumType, FloatType, IntType))


def opened(v: Constant) -> Item:
    """A constant, taken apart one level; a float that is not finite stays a `Constant`."""
    t, value = v.type, v.value
    if isinstance(t, FloatType):
        x = float(value)
        return FloatRange(x, x) if math.isfinite(x) else v
    if isinstance(t, BoolType):
        return KnownTruth(bool(value))
    if isinstance(t, (IntType, EnumType)):
        return KnownInt(int(value))
    if isinstance(t, ListType):
        rest = (default_value(t.element),) * (t.capacity - len(value))
        items = tuple(Constant(t.element, x) for x in (*value, *rest))
        return Sequence(KnownInt(len(value)), items)
    parts = zip(element_types(t), value, strict=True)
    return AggregateParts(tuple(Constant(f, x) for f, x in parts))


def at_most(x: Fraction) -> float:
    """The largest double not above `x` (-inf below all)."""
    if x < -Fraction(LARGEST):
        return -math.inf
    if x >= Fraction(LARGEST):
        return LARGEST
    near = float(x)
    return near if Fraction(near) <= x else math.nextafter(near, -math.inf)


def enclosed(values: tuple[Fraction, ...]) -> FloatRange | None:
    """The smallest span around exact values; it also holds what they round to.

    None where a value may round to infinity.
    """
    low, high = at_most(min(values)), -at_most(-max(values))
    return FloatRange(low, high) if math.isfinite(low) and math.isfinite(high) else None


def span_binary(op: str, a: FloatRange, b: FloatRange) -> FloatRange | None:
    """`a op b` on constants, by exact arithmetic; None: not to be settled now."""
    left, right = (Fraction(a.low), Fraction(a.high)), (Fraction(b.low), Fraction(b.high))
    if op == "+":
        return enclosed((left[0] + right[0], left[1] + right[1]))
    if op == "-":
        return enclosed((left[0] - right[1], left[1] - right[0]))
    if op == "*":
        return enclosed(tuple(x * y for x in left for y in right))
    if right[0] <= 0 <= right[1]:
        return None
    return enclosed(tuple(x / y for x in left for y in right))


def span_unary(op: str, a: FloatRange) -> FloatRange | None:
    """neg, abs, floor, sqrt of a constant; None: not to be settled now."""
    if op == "neg":
        return FloatRange(-a.high, -a.low)
    if op == "abs":
        ends = (abs(a.low), abs(a.high))
        return FloatRange(0.0 if a.low <= 0.0 <= a.high else min(ends), max(ends))
    if op == "floor":
        return FloatRange(float(math.floor(a.low)), float(math.floor(a.high)))
    if op == "sqrt" and a.low >= 0.0:
        low, high = math.sqrt(a.low), math.sqrt(a.high)
        exact = low == high and Fraction(low) ** 2 == Fraction(a.low)
        if exact:
            return FloatRange(low, high)
        return FloatRange(max(0.0, math.nextafter(low, -1.0)), math.nextafter(high, math.inf))
    return None


def compared(op: str, a: tuple[float, float], b: tuple[float, float]) -> bool | None:
    """A comparison of two closed ranges of numbers: True, False, or None for either."""
    if op in {">", ">="}:
        return compared("<" if op == ">" else "<=", b, a)
    if op == "!=":
        equal = compared("==", a, b)
        return None if equal is None else not equal
    if op == "==":
        if a[0] == a[1] == b[0] == b[1]:
            return True
        return None if a[0] <= b[1] and b[0] <= a[1] else False
    if op == "<":
        may_hold, may_fail = a[0] < b[1], a[1] >= b[0]
    else:
        may_hold, may_fail = a[0] <= b[1], a[1] > b[0]
    return None if may_hold and may_fail else may_hold
