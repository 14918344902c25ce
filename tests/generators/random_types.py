"""Types of a random program: their text, their parts, the sets their topics may hold.

Purpose: everything about types that expressions, statements and declarations share.
Non-goals: values (`expressions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    INT_MAX,
    INT_MIN,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    is_vector,
    leaves,
)

if TYPE_CHECKING:
    from generators.hypothesis_choices import Chooser
    from generators.random_names import Namer
    from soter.language.model.types import Type

RANGES = (
    (0, 1), (-3, 5), (0, 100), (-128, 127), (0, 255), (5, 9), (-7, -2), (-200, 300), (0, 65535),
    (-40000, 40000), (0, 4294967295), (-(2**31), 2**31 - 1), (-(2**40), 2**40), (0, INT_MAX),
    (INT_MIN, -1),
)  # fmt: skip
VEC2 = RecordType((("x", FLOAT), ("y", FLOAT)), "Vec2")
VEC3 = RecordType((("x", FLOAT), ("y", FLOAT), ("z", FLOAT)), "Vec3")
MODE = EnumType("Mode", ("SC", "AC"))


def text_of(t: Type) -> str:
    """A type as a program writes it."""
    if isinstance(t, RecordType) and t.name is None:
        return "{ " + ", ".join(f"{n}: {text_of(f)}" for n, f in t.fields) + " }"
    if isinstance(t, ArrayType):
        return f"{text_of(t.element)}[{t.size}]"
    if isinstance(t, ListType):
        return f"{text_of(t.element)}[<={t.capacity}]"
    return str(t)


# ---------------------------------------------------------------- parts of values


@dataclass(frozen=True)
class Route:
    """A way from a value to one of its parts: field names, and the types that are indexed."""

    steps: tuple[str | ArrayType | ListType, ...]
    type: Type

    @property
    def through_list(self) -> bool:
        """Whether there may be nothing at the end."""
        return any(isinstance(s, ListType) for s in self.steps)

    @property
    def fields(self) -> tuple[str, ...] | None:
        """The names, where there is nothing to index."""
        names = tuple(s for s in self.steps if isinstance(s, str))
        return names if len(names) == len(self.steps) else None


@cache
def routes(t: Type, depth: int = 4) -> tuple[Route, ...]:
    """Every part of a value, the whole first."""
    parts = [Route((), t)]
    if depth == 0:
        return tuple(parts)
    inner: list[tuple[str | ArrayType | ListType, Type]] = []
    if isinstance(t, RecordType):
        inner = list(t.fields)
    elif isinstance(t, (ArrayType, ListType)):
        inner = [(t, t.element)]
    for step, part in inner:
        parts += [Route((step, *r.steps), r.type) for r in routes(part, depth - 1)]
    return tuple(parts)


def fits(have: Type, want: Type) -> bool:
    """Whether a value of one type can stand where the other is wanted, without a fault."""
    if isinstance(have, IntType) and isinstance(want, IntType):
        return want.low <= have.low and have.high <= want.high
    return have == want


# ---------------------------------------------------------------- sets of topics

Within = dict[tuple[str, ...], tuple[float, float]]
"""Bounds of a topic: a prefix of leaf paths -> interval, as a program writes it."""


@dataclass(frozen=True)
class ValueSet:
    """The set of a topic: as text (may be empty), and by path of record fields."""

    text: str = ""
    bounds: Within = field(default_factory=dict)

    def at(self, path: tuple[str, ...]) -> tuple[float, float] | None:
        """The interval for the part at a path of record fields."""
        for n in range(len(path), -1, -1):
            if path[:n] in self.bounds:
                return self.bounds[path[:n]]
        return None


def one_kind(t: Type) -> Type | None:
    """FLOAT or INT where the type is made of nothing else."""
    kinds = {FLOAT if isinstance(leaf, FloatType) else INT if isinstance(leaf, IntType) else None
             for _, leaf in leaves(t)}  # fmt: skip
    return kinds.pop() if len(kinds) == 1 else None


def boundable(t: Type) -> bool:
    """Whether a set can bound every number in it."""
    if isinstance(t, (BoolType, EnumType)) or one_kind(t) is not None:
        return True
    if isinstance(t, RecordType):
        return all(boundable(f) for _, f in t.fields)
    return all(isinstance(leaf, (BoolType, EnumType)) for _, leaf in leaves(t))


def has_list(t: Type) -> bool:
    """Whether a bounded list is part of it."""
    return any(isinstance(s, ListType) for r in routes(t, 9) for s in r.steps) or isinstance(
        t, ListType
    )


INTERVALS = ((-1.0, 1.0), (-5.0, 5.0), (0.0, 10.0), (-0.5, 3.0), (2.0, 8.0), (-1.0e6, 1.0e6))


class SetMaker:
    """Chooses value sets."""

    def __init__(self, choose: Chooser) -> None:
        self.choose = choose

    def make(self, t: Type, *, complete: bool) -> ValueSet:
        """A set for a topic; `complete`: every number of it is bounded."""
        bounds: Within = {}
        text = self._part(t, (), bounds, complete=complete)
        return ValueSet(f" in {text}" if text else "", bounds)

    def _part(self, t: Type, path: tuple[str, ...], bounds: Within, *, complete: bool) -> str:
        kind = one_kind(t)
        ranged = all(isinstance(leaf, IntType) and not leaf.is_full for _, leaf in leaves(t))
        if kind is not None and not (isinstance(t, RecordType) and self.choose.chance(50)):
            if not self.choose.chance(30 if ranged else 100 if complete else 60):
                return ""
            low, high = self._interval(t, kind)
            bounds[path] = (low, high)
            return f"[{low}, {high}]"
        if not isinstance(t, RecordType):
            return ""
        parts = [
            f"{n} in {text}"
            for n, f in t.fields
            if (text := self._part(f, (*path, n), bounds, complete=complete))
        ]
        return "{ " + ", ".join(parts) + " }" if parts else ""

    def _interval(self, t: Type, kind: Type) -> tuple[float, float]:
        if isinstance(kind, FloatType):
            return self.choose.pick(INTERVALS)
        ints = [leaf for _, leaf in leaves(t) if isinstance(leaf, IntType)]
        low, high = max(i.low for i in ints), min(i.high for i in ints)
        if low > high:  # no number is in all of them: as wide as the widest
            return min(i.low for i in ints), max(i.high for i in ints)
        cuts = [(max(low, -10), min(high, 20)), (low, high), (max(low, 0), min(high, 1000))]
        return self.choose.pick([c for c in cuts if c[0] <= c[1]])


# ---------------------------------------------------------------- choosing types


class TypeMaker:
    """Declares a program's types and chooses among them."""

    def __init__(self, choose: Chooser, names: Namer) -> None:
        self.choose = choose
        self.names = names
        self.enums: list[EnumType] = []
        self.records: list[RecordType] = [VEC3, VEC2]
        self.declarations: list[str] = []

    def declare(self) -> None:
        """Enums, records of every depth, and an alias now and then."""
        choose = self.choose
        for _ in range(choose.count(0, 2)):
            name = self.names.fresh("type")
            members = self.names.different("member", choose.count(1, 4))
            self.enums.append(EnumType(name, tuple(members)))
            self.declarations.append(f"type {name} = enum {{ {', '.join(members)} }};")
        for _ in range(choose.count(1, 3)):
            name = self.names.fresh("type")
            fields = self.names.different("field", choose.count(1, 4))
            floats = choose.chance(35)
            record = RecordType(tuple((n, FLOAT if floats else self.any(2)) for n in fields), name)
            self.records.insert(0, record)
            plain = RecordType(record.fields)
            self.declarations.append(f"type {name} = {text_of(plain)};")

    def scalar(self) -> Type:
        """A type of one leaf."""
        choose = self.choose
        kind = choose.weighted(
            ((6, "float"), (2, "int"), (3, "ranged"), (2, "bool"), (1, "mode"), (2, "enum"))
        )
        if kind == "ranged":
            return IntType(*choose.pick(RANGES))
        if kind == "enum" and self.enums:
            return choose.pick(self.enums)
        return {"int": INT, "bool": BOOL, "mode": MODE}.get(kind, FLOAT)

    def vector(self) -> Type:
        """A type with componentwise arithmetic."""
        vectors: list[Type] = [r for r in self.records if is_vector(r)]
        array = ArrayType(FLOAT, self.choose.count(1, 4))
        return self.choose.pick([*vectors, array, ArrayType(VEC2, 2)])

    def any(self, depth: int = 2) -> Type:
        """Any type."""
        choose = self.choose
        kind = choose.weighted(
            ((8, "scalar"), (3, "record"), (2, "array"), (2, "list"), (1, "vector"), (1, "bare"))
        )
        if depth <= 0 or kind == "scalar":
            return self.scalar()
        if kind == "record":
            return choose.pick(self.records)
        if kind == "vector":
            return self.vector()
        if kind == "bare":
            fields = self.names.different("field", choose.count(1, 3))
            return RecordType(tuple((n, self.any(depth - 1)) for n in fields))
        element = self.any(depth - 1)
        size = choose.count(1, 4)
        return ArrayType(element, size) if kind == "array" else ListType(element, size)
