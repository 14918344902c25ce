"""Values that differ from lane to lane: their C types, and what is done with whole ones.

Purpose: types, choices between two values, values loaded from states, the same value everywhere.
Non-goals: expressions and statements (`lane_code.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.language.model.types import ArrayType, BoolType, FloatType, RecordType

if TYPE_CHECKING:
    from soter.codegen.function_context import Frame
    from soter.language.model.types import Type

FLOAT, BOOL = "soter_lane_float", "soter_lane_bool"
ALL = c.CallExpr("soter_lane_all_bool", (c.Name("true"),))
NOWHERE = c.CallExpr("soter_lane_all_bool", (c.Name("false"),))


class NotStraight(Exception):  # noqa: N818 - nothing is wrong
    """This code has no lanes: it says so to `Lanes`, which leaves it out."""


class LaneValues:
    """Types of one program; what they need stands in `definitions`, in order.

    NotStraight for a type that has no lanes.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.definitions: list[c.CTop] = []
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
        known = self._types.get(t)
        if known is not None:
            return known
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

    def choice(self, t: Type) -> str:
        """The function that takes one of two values in each lane."""
        lanes = self.type(t)
        if lanes in {FLOAT, BOOL}:
            return "soter_lane_select" + ("_bool" if lanes == BOOL else "")
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
        if isinstance(t, FloatType):
            return c.CallExpr("soter_lane_all", (value,))
        if isinstance(t, BoolType):
            return c.CallExpr("soter_lane_all_bool", (value,))
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

    def loaded(self, path: str, t: Type) -> c.CExpr:
        """A value of the states, in lanes."""
        if isinstance(t, FloatType):
            return c.CallExpr("SOTER_LANE_FLOAT", (c.Name(path),))
        if isinstance(t, BoolType):
            return c.CallExpr("SOTER_LANE_BOOL", (c.Name(path),))
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            for n, f in t.fields:
                own = field_name(n)
                items.append((own, self.loaded(f"{path}.{own}", f)))
        else:
            assert isinstance(t, ArrayType)
            each = [(None, self.loaded(f"{path}.at[{k}]", t.element)) for k in range(t.size)]
            items.append(("at", c.Initializer(tuple(each))))
        return c.Initializer(tuple(items), self.type(t))


def inline(f: c.FunctionDef) -> c.FunctionDef:
    """A function that compilers put in where it is called: vectors pass through no call."""
    return c.FunctionDef(
        f"SOTER_LANE_INLINE {f.result}", f.name, f.parameters, f.body, f.doc, static=False
    )
