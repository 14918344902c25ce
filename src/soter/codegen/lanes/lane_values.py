"""Values that differ from lane to lane: their C types, and what is done with whole ones.

Purpose: types, choices between two values, values loaded from states and tables, the same value
everywhere. Lists have no lanes: of what lies in the states parts are loaded.
Non-goals: expressions and statements (`lane_code.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaf_count,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.function_context import Frame
    from soter.language.model.types import Type

FLOAT, INT, BOOL = "soter_lane_float", "soter_lane_int", "soter_lane_bool"
ALL = c.CallExpr("soter_lane_all_bool", (c.Name("true"),))
NOWHERE = c.CallExpr("soter_lane_all_bool", (c.Name("false"),))
LEAVES = 64
"""Values of more numbers are not held in lanes."""


class NotStraight(Exception):  # noqa: N818 - nothing is wrong
    """This code has no lanes: it says so to `Lanes`, which leaves it out."""


@dataclass(frozen=True)
class Place:
    """Where a value lies: in each state, or in a table, which is the same for all.

    `path` leads there. Where each lane has an `index` of its own, `path` leads to the array, and
    `rest` from its element on.
    """

    path: str
    in_state: bool = True
    index: c.CExpr | None = None
    rest: str = ""
    in_loop: bool = False
    """Whether the path has the variable of a loop."""

    def part(self, more: str) -> Place:
        """A part of it."""
        if self.index is None:
            return replace(self, path=self.path + more)
        return replace(self, rest=self.rest + more)

    def element(self, t: Type, index: c.CExpr, *, varies: bool) -> Place:
        """An element of an array or list there; NotStraight for what is too involved."""
        items = self.part(".at" if isinstance(t, ArrayType) else ".items")
        if varies and items.index is None:
            return replace(items, index=index)
        if varies or not isinstance(index, (c.Name, c.Number)):
            raise NotStraight
        looped = self.in_loop or isinstance(index, c.Name)
        return replace(items.part(f"[{index.text}]"), in_loop=looped)

    def lanes(self, kind: str) -> c.CExpr:
        """A scalar there, in lanes of a type."""
        path = (c.Name(kind), c.Name(self.path))
        if self.index is None:
            return c.CallExpr("SOTER_LANE_OF", path)
        name = "SOTER_LANE_AT" if self.in_state else "SOTER_LANE_IN"
        return c.CallExpr(name, (*path, self.index, c.Name(self.rest)))


class LaneValues:
    """Types of one program; what they need stands in `definitions`, in order.

    NotStraight for a type that has no lanes.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.definitions: list[c.CTop] = []
        self.operations: dict[str, int] = {}
        """How many operations each function may take, by its name."""
        self._types: dict[Type, str] = {}
        self._choices: dict[Type, str] = {}

    def function(self, name: str) -> str:
        """The function of this name over lanes."""
        raise NotImplementedError

    def type(self, t: Type) -> str:
        """The C type of a value that differs from lane to lane."""
        if isinstance(t, FloatType):
            return FLOAT
        if isinstance(t, BoolType):
            return BOOL
        if isinstance(t, (IntType, EnumType)):
            return INT
        known = self._types.get(t)
        if known is not None:
            return known
        if leaf_count(t) > LEAVES:
            raise NotStraight
        members: tuple[c.StructMember, ...]
        if isinstance(t, RecordType):
            members = tuple(c.StructMember(self.type(f), field_name(n)) for n, f in t.fields)
        elif isinstance(t, ArrayType):
            members = (c.StructMember(self.type(t.element), "at", t.size),)
        else:
            raise NotStraight
        name = f"{self.frame.types.stored(t)}_lanes"
        self._types[t] = name
        self.definitions.append(c.StructDef(name, members))
        return name

    def has_lanes(self, t: Type) -> bool:
        """Whether values of a type can differ from lane to lane."""
        try:
            self.type(t)
        except NotStraight:
            return False
        return True

    def made(self, t: Type, leaf: Callable[[str, Type], c.CExpr], path: str = "") -> c.CExpr:
        """A value of which `leaf` makes the scalars, by the path that leads to each."""
        if isinstance(t, RecordType):
            fields = tuple((field_name(n), f) for n, f in t.fields)
            items: list[tuple[str | None, c.CExpr]] = [
                (n, self.made(f, leaf, f"{path}.{n}")) for n, f in fields
            ]
        elif isinstance(t, ArrayType):
            each = [(None, self.made(t.element, leaf, f"{path}.at[{k}]")) for k in range(t.size)]
            items = [("at", c.Initializer(tuple(each)))]
        elif isinstance(t, ListType):
            raise NotStraight
        else:
            return leaf(path, t)
        return c.Initializer(tuple(items), self.type(t))

    def choice(self, t: Type) -> str:
        """The function that takes one of two values in each lane."""
        lanes = self.type(t)
        if lanes in {FLOAT, INT, BOOL}:
            return "soter_lane_select" + ("" if lanes == FLOAT else "_int")
        known = self._choices.get(t)
        if known is not None:
            return known
        a, b, on = c.Name("a"), c.Name("b"), c.Name("on")
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            for n, f in t.fields:
                own = field_name(n)
                parts = (on, c.Member(a, own), c.Member(b, own))
                items.append((own, c.CallExpr(self.choice(f), parts)))
        else:
            assert isinstance(t, ArrayType)
            each: list[tuple[str | None, c.CExpr]] = []
            for k in range(t.size):
                at = (c.IndexExpr(c.Member(x, "at"), c.Number(str(k))) for x in (a, b))
                each.append((None, c.CallExpr(self.choice(t.element), (on, *at))))
            items.append(("at", c.Initializer(tuple(each))))
        name = self._choices[t] = f"{lanes}_select"
        parameters = ((BOOL, "on"), (lanes, "a"), (lanes, "b"))
        body = (c.Return(c.Initializer(tuple(items), lanes)),)
        self.definitions.append(inline(c.FunctionDef(lanes, name, parameters, body)))
        return name

    def spread(self, t: Type, value: c.CExpr) -> c.CExpr:
        """What is the same in every lane."""
        if isinstance(t, (FloatType, BoolType, IntType, EnumType)):
            suffix = {FLOAT: "", BOOL: "_bool", INT: "_int"}[self.type(t)]
            return c.CallExpr(f"soter_lane_all{suffix}", (value,))
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            for n, f in t.fields:
                own = field_name(n)
                items.append((own, self.spread(f, c.Member(value, own))))
        elif isinstance(t, ArrayType):
            at = c.Member(value, "at")
            each = [
                (None, self.spread(t.element, c.IndexExpr(at, c.Number(str(k)))))
                for k in range(t.size)
            ]
            items.append(("at", c.Initializer(tuple(each))))
        return c.Initializer(tuple(items), self.type(t))

    def loaded(self, place: Place, t: Type) -> c.CExpr:
        """A value of the states or of a table, in lanes."""

        def leaf(path: str, t: Type) -> c.CExpr:
            kind = self.type(t)
            lanes = place.part(path).lanes(kind)
            return c.Unary("-", lanes) if kind == BOOL else lanes

        return self.made(t, leaf)

    def picked(self, t: Type, items: c.CExpr, index: c.CExpr) -> c.CExpr:
        """Of elements in lanes in each lane the one at its index."""

        def leaf(path: str, t: Type) -> c.CExpr:
            parts = (c.Name(self.type(t)), items, index, c.Name(path))
            return c.CallExpr("SOTER_LANE_PICK", parts)

        return self.made(t, leaf)


def inline(f: c.FunctionDef) -> c.FunctionDef:
    """A function that compilers put in where it is called: vectors pass through no call."""
    return c.FunctionDef(
        f"SOTER_LANE_INLINE {f.result}", f.name, f.parameters, f.body, f.doc, static=False
    )
