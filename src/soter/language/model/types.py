"""The types of Soter, how values of them look in Python, and how durations are written.

Purpose: one small class hierarchy that every room shares; record types compare by structure.
`show_ns` writes `10 ms` for a sentence, `write_ns` `10ms` for code; `duration_ns` reads what
callers and command lines give.
Non-goals: inference (`language/check/expr.py`), storage layout (`core/layout.py`), durations in a
program (`language/syntax/lexer.py`).

Values: bool -> bool, int -> int, float -> float, duration -> int (ns), enum -> int (index of
the member), record -> tuple of field values in declared order, array -> tuple,
list -> tuple of at most `capacity` elements.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from soter.language.syntax.lexer import UNIT_NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


INT_MIN = -(2**63)
INT_MAX = 2**63 - 1

Value = Any
"""A Soter value in Python, in the representation of the module docstring."""


@dataclass(frozen=True, slots=True)
class Type:
    """The base class of all types of Soter."""


@dataclass(frozen=True, slots=True)
class BoolType(Type):
    """The type `bool`."""

    def __str__(self) -> str:
        return "bool"


@dataclass(frozen=True, slots=True)
class IntType(Type):
    """`int` or `int in [low, high]`, stored in as few bytes as fit; arithmetic has 64 bits.

    `unit` tells people the unit of the number; types that differ only in `unit` are the same type.
    """

    low: int = INT_MIN
    high: int = INT_MAX
    unit: str = field(default="", compare=False, repr=False)

    def __str__(self) -> str:
        return "int" if self.is_full else f"int in [{self.low}, {self.high}]"

    @property
    def is_full(self) -> bool:
        """Whether this is plain `int`."""
        return self.low == INT_MIN and self.high == INT_MAX


@dataclass(frozen=True, slots=True)
class FloatType(Type):
    """`float`: binary64; `unit` as in `IntType`."""

    unit: str = field(default="", compare=False, repr=False)

    def __str__(self) -> str:
        return "float"


@dataclass(frozen=True, slots=True)
class DurationType(Type):
    """`duration`: a whole number of nanoseconds, the type of constants and parameters only."""

    def __str__(self) -> str:
        return "duration"


@dataclass(frozen=True, slots=True)
class EnumType(Type):
    """An enumeration, equal only to the enumeration of the same full name."""

    name: str
    members: tuple[str, ...]

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class RecordType(Type):
    """A record; two records with the same fields in the same order are the same type."""

    fields: tuple[tuple[str, Type], ...]
    name: str | None = field(default=None, compare=False)
    scalars: int = field(init=False, compare=False, repr=False, default=0)
    """Number of scalar leaves; computed once, as types inside types can be huge."""
    vector: bool = field(init=False, compare=False, repr=False, default=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "scalars", sum(leaf_count(t) for _, t in self.fields))
        vector = bool(self.fields) and all(is_vector_part(t) for _, t in self.fields)
        object.__setattr__(self, "vector", vector)

    def __str__(self) -> str:
        if self.name:
            return self.name
        return "{ " + ", ".join(f"{n}: {t}" for n, t in self.fields) + " }"

    def index(self, name: str) -> int | None:
        """Gives the position of the field called `name`, or None."""
        return next((i for i, (n, _) in enumerate(self.fields) if n == name), None)


@dataclass(frozen=True, slots=True)
class ArrayType(Type):
    """`T[n]`: exactly n elements."""

    element: Type
    size: int

    def __str__(self) -> str:
        return f"{self.element}[{self.size}]"


@dataclass(frozen=True, slots=True)
class ListType(Type):
    """`T[<=n]`: up to n elements and a length; the unused tail is zero."""

    element: Type
    capacity: int

    def __str__(self) -> str:
        return f"{self.element}[<={self.capacity}]"


@dataclass(frozen=True, slots=True)
class ErrorType(Type):
    """The type of a wrong expression; it fits every type, to avoid a second error."""

    def __str__(self) -> str:
        return "<error>"


BOOL = BoolType()
INT = IntType()
FLOAT = FloatType()
DURATION = DurationType()
ERROR = ErrorType()
MODE = EnumType("Mode", ("SC", "AC"))
"""The type of `mode(M)`; SC is 0 because every module starts there."""


def default_value(t: Type) -> Value:
    """Gives a type's default: zero, false, the first member, or the int in range nearest zero."""
    if isinstance(t, BoolType):
        return False
    if isinstance(t, IntType):
        return min(max(0, t.low), t.high)
    if isinstance(t, FloatType):
        return 0.0
    if isinstance(t, (DurationType, EnumType)):
        return 0
    if isinstance(t, RecordType):
        return tuple(default_value(f) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return (default_value(t.element),) * t.size
    if isinstance(t, ListType):
        return ()
    msg = f"no default for {t}"
    raise AssertionError(msg)


def with_unit(t: Type, unit: str) -> Type:
    """Gives the type with `unit` added to each number that has no unit."""
    if isinstance(t, (FloatType, IntType)):
        return t if t.unit else replace(t, unit=unit)
    if isinstance(t, RecordType):
        return replace(t, fields=tuple((n, with_unit(f, unit)) for n, f in t.fields))
    if isinstance(t, (ArrayType, ListType)):
        return replace(t, element=with_unit(t.element, unit))
    return t


def is_vector(t: Type) -> bool:
    """Whether a type is a record or array of only floats, on which arithmetic is component-wise."""
    if isinstance(t, ArrayType):
        return is_vector_part(t.element)
    return isinstance(t, RecordType) and t.vector


def is_vector_part(t: Type) -> bool:
    """Whether `t` may be a part of a vector: a float or a vector."""
    return isinstance(t, FloatType) or is_vector(t)


def leaves(
    t: Type, path: tuple[str, ...] = (), *, whole_lists: bool = False
) -> Iterator[tuple[tuple[str, ...], Type]]:
    """Yields (path, type) of all scalar leaves, in declared order; `[]` for a list's elements.

    With `whole_lists`, a list counts as one leaf.
    """
    if isinstance(t, RecordType):
        for n, f in t.fields:
            yield from leaves(f, (*path, n), whole_lists=whole_lists)
    elif isinstance(t, ArrayType):
        for i in range(t.size):
            yield from leaves(t.element, (*path, f"[{i}]"), whole_lists=whole_lists)
    elif isinstance(t, ListType) and not whole_lists:
        yield from leaves(t.element, (*path, "[]"))
    else:
        yield path, t


def leaf_name(name: str, path: Iterable[str]) -> str:
    """Gives a leaf's name in source form, `j.q[0]`; draws name it `j.q.[0]` (semantics.md)."""
    return ".".join((name, *path)).replace(".[", "[")


def positions(t: Type, path: Iterable[str]) -> list[int]:
    """Gives the position of each field or element on the path to a leaf; the type has no lists."""
    found: list[int] = []
    for part in path:
        if isinstance(t, RecordType):
            at = t.index(part)
            assert at is not None, part
            t = t.fields[at][1]
        else:
            assert isinstance(t, ArrayType)
            at, t = int(part[1:-1]), t.element
        found.append(at)
    return found


def has_list(t: Type) -> bool:
    """Whether a type is a list or contains a list."""
    if isinstance(t, RecordType):
        return any(has_list(f) for _, f in t.fields)
    return isinstance(t, ListType) or (isinstance(t, ArrayType) and has_list(t.element))


def leaf_count(t: Type) -> int:
    """Gives how many scalar leaves a full value has; a list has its capacity and its length."""
    if isinstance(t, RecordType):
        return t.scalars
    if isinstance(t, ArrayType):
        return t.size * leaf_count(t.element)
    if isinstance(t, ListType):
        return 1 + t.capacity * leaf_count(t.element)
    return 1


def numbers_in(value: Value) -> Iterator[float]:
    """Yields the numbers of a value that is made of floats, in declared order."""
    if isinstance(value, tuple):
        for part in value:
            yield from numbers_in(part)
    else:
        yield value


def value_of_numbers(t: Type, numbers: Iterator[float]) -> Value:
    """Makes a value of a type without lists from its numbers, in declared order."""
    if isinstance(t, RecordType):
        return tuple([value_of_numbers(f, numbers) for _, f in t.fields])
    if isinstance(t, ArrayType):
        return tuple([value_of_numbers(t.element, numbers) for _ in range(t.size)])
    return next(numbers)


DURATION_NS_MAX = 2**62
"""About 146 years: the sum of a time and a period still fits 64 bits."""

TEXT_MAX = 100
"""Most characters of a duration that a person gives."""

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?)\s*([a-z]+)")

HOUR = 3600 * 10**9
UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))


def _number_and_unit(ns: int) -> tuple[str, str]:
    """Gives a duration as an exact number and a unit, the largest unit that is not above it."""
    if ns and ns % HOUR == 0:
        return f"{ns // HOUR}", "h"
    for unit, size in UNITS:
        if abs(ns) >= size:
            whole, rest = divmod(abs(ns), size)
            digits = f"{rest:0{len(str(size)) - 1}d}".rstrip("0") if rest else ""
            return ("-" if ns < 0 else "") + f"{whole}" + (f".{digits}" if digits else ""), unit
    return "0", "s"


def show_ns(ns: int) -> str:
    """Gives the text of a duration in a sentence: `10 ms`, `1.5 us`, `0 s`."""
    return " ".join(_number_and_unit(ns))


def write_ns(ns: int) -> str:
    """Gives the text of a duration in Soter source: `10ms`, `1.5us`."""
    return "".join(_number_and_unit(ns))


class WrongTextError(Exception):
    """An error for a text or number that is no valid value; the message says which values are."""


def duration_ns(duration: float | str) -> int:
    """Gives the ns of a text with a unit (`"30s"`, `"1.5 min"`), or of a number of seconds.

    The result is exact: `"0.1s"` is 100,000,000 ns. Raises `WrongTextError`.
    """
    if isinstance(duration, str):
        ns = _ns_of_text(duration.strip())
    elif isinstance(duration, bool) or not hasattr(duration, "__float__"):
        raise WrongTextError(f"expected a text such as '30s', or seconds, found {duration!r}")
    else:
        seconds = math.inf if abs(duration) > DURATION_NS_MAX else float(duration)
        if not math.isfinite(seconds):
            raise WrongTextError(f"{seconds} is no length of time")
        ns = round(Fraction(repr(seconds)) * 10**9)
    if abs(ns) > DURATION_NS_MAX:
        raise WrongTextError("longer than 146 years")
    return ns


def _ns_of_text(text: str) -> int:
    match = _DURATION.fullmatch(text) if len(text) <= TEXT_MAX else None
    if match is None or match[2] not in UNIT_NS:
        units = ", ".join(UNIT_NS)
        raise WrongTextError(f"write a number with its unit ({units}), such as 30s or 1.5min")
    ns = Fraction(match[1]) * UNIT_NS[match[2]]
    if ns.denominator != 1:
        raise WrongTextError("that is no whole number of nanoseconds")
    return int(ns)
