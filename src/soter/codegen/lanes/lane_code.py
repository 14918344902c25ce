"""Core over lanes: both sides of a branch, and a mask that says whose is taken.

Purpose: expressions and statements of straight code. What is the same in every lane stays a number
of C. Where anything faults in any lane, or takes a branch whose code has no lanes, that is noted.
Non-goals: steps and predicates around it (`lane_steps.py`).
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.codegen.body import COMPARISONS, UNARY_CALLS
from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import int_number
from soter.codegen.lanes.lane_values import ALL, BOOL, INT, NOWHERE, NotStraight, Place
from soter.codegen.storage.trivial_comparisons import LOGICAL
from soter.core import core
from soter.core.layout import scalar
from soter.core.operation_counts import operations
from soter.language.model import types
from soter.language.model.types import ArrayType, BoolType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.lanes.lane_values import LaneValues
    from soter.language.model.types import Type

CT, BAD, MASK = c.Name("given_ct"), c.Name("given_bad"), c.Name("given_mask")
LANE_CALLS = {
    "sqrt": "soter_lane_sqrt",
    "floor": "soter_lane_floor",
    "abs": "soter_lane_abs",
    "to_float": "soter_lane_to_float",
}


SKIPPED = 24
"""A side of a branch of so many operations is skipped where no lane takes it."""


class LaneCode:
    """Core statements over lanes; NotStraight for what has none."""

    def __init__(self, lanes: LaneValues) -> None:
        self.lanes = lanes
        self.types = lanes.frame.types
        self.varying: set[str] = set()
        """Temporaries that differ from lane to lane."""
        self.places: dict[str, Place] = {}
        """Temporaries that are read where they lie."""
        self.loads: dict[Place, tuple[str, Type]] = {}
        """Of each place in the state that is read its name, and the type."""
        self.outputs: tuple[str, ...] = ()
        self.in_state = False
        self.mask: c.CExpr = MASK
        self.certain = False
        """Whether the mask is that of all lanes for certain."""
        self._masks = 0

    def has(self, _output: int) -> c.Name | None:
        """In which lanes the step published an output; None where it always does."""
        raise NotStraight

    def enabled(self) -> c.CExpr:
        """In which lanes the outputs of the step are enabled."""
        raise NotStraight

    def local(self, name: str) -> str:
        """The C name of a temporary."""
        return self.lanes.frame.body.local(name)

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> tuple[c.CExpr, bool]:
        """An expression, and whether it differs from lane to lane."""
        if isinstance(e, core.Const):
            return self.types.named_constant(e.type, e.value, e.name), False
        place = self.place(e)
        if place is not None:
            return self.load(place, e.type), True
        if isinstance(e, core.Var):
            return c.Name(self.local(e.name)), e.name in self.varying
        if isinstance(e, core.Fact):
            return self._fact(e)
        if isinstance(e, core.Unary):
            return self._unary(e)
        if isinstance(e, core.Binary):
            return self._binary(e)
        if isinstance(e, core.Extreme):
            return self._extreme(e)
        if isinstance(e, core.Select):
            return self._select(e)
        if isinstance(e, core.Field):
            target, varies = self.expr(e.target)
            assert isinstance(e.target.type, RecordType)
            return c.Member(target, field_name(e.target.type.fields[e.index][0])), varies
        if isinstance(e, core.Element):
            return self._element(e)
        if isinstance(e, core.Length):
            return self._length(e)
        if isinstance(e, core.Make):
            return self._make(e)
        raise NotStraight

    def lane(self, e: core.Expr) -> c.CExpr:
        """An expression as it is in each lane."""
        value, varies = self.expr(e)
        return value if varies else self.lanes.spread(e.type, value)

    def place(self, e: core.Expr) -> Place | None:
        """Where a value lies that differs from lane to lane, if it lies in states or a table."""
        if isinstance(e, core.Get):
            if not self.in_state:
                raise NotStraight
            return Place(self.cell(e.cell))
        if isinstance(e, core.Var):
            return self.places.get(e.name)
        if isinstance(e, core.Field):
            outer = self.place(e.target)
            assert isinstance(e.target.type, RecordType)
            own = field_name(e.target.type.fields[e.index][0])
            return None if outer is None else outer.part(f".{own}")
        if isinstance(e, core.Element):
            outer = self.place(e.target)
            if outer is None:
                return self._row(e)
            index, varies = self.expr(e.index)
            return outer.element(e.target.type, index, varies=varies)
        return None

    def _row(self, e: core.Element) -> Place | None:
        """An element of what is the same in every lane, at an index that is not."""
        table, varies = self.expr(e.target)
        index, moves = self.expr(e.index)
        if varies or not moves:
            return None
        there = Place(_path(table), in_state=False)
        return there.element(e.target.type, index, varies=True)

    def cell(self, cell: core.Cell) -> str:
        """The member of the state that a cell is."""
        frame = self.lanes.frame
        if cell.kind == "topic":
            return f"topics.{frame.topic_field(cell.owner)}"
        return f"{frame.groups[cell.owner]}.{field_name(cell.name)}"

    def load(self, place: Place, t: Type) -> c.CExpr:
        """A value that lies somewhere; what needs nothing to be found is loaded at the start."""
        self.lanes.type(t)
        if place.index is not None or place.in_loop:
            return self.lanes.loaded(place, t)
        if place not in self.loads:
            self.loads[place] = f"given_{len(self.loads)}", t
        return c.Name(self.loads[place][0])

    def _fact(self, e: core.Fact) -> tuple[c.CExpr, bool]:
        if not self.in_state:
            raise NotStraight
        if e.fact == "time":
            return c.CallExpr("soter_seconds", (CT,)), False
        if e.fact == "age":
            stamp = self.load(Place(f"stamps[{e.index}]"), types.INT)
            since = c.Binary("-", c.CallExpr("soter_lane_all_int", (CT,)), stamp)
            return c.CallExpr("soter_lane_seconds", (since,)), True
        if e.fact == "mode":
            return self.load(Place(f"modules[{e.index}].mode"), e.type), True
        if e.fact == "published":
            return self.has(e.index) or ALL, True
        return self.enabled(), True

    def _unary(self, e: core.Unary) -> tuple[c.CExpr, bool]:
        operand, varies = self.expr(e.operand)
        if not varies:
            return self._alone(e, operand), False
        if e.op == "neg":
            return c.Unary("-", operand), True
        if e.op == "not":
            return c.Unary("~", operand), True
        return c.CallExpr(LANE_CALLS[e.op], (operand,)), True

    def _alone(self, e: core.Unary, operand: c.CExpr) -> c.CExpr:
        """The same where no lane differs."""
        if e.op in {"neg", "not"}:
            return c.Unary("-" if e.op == "neg" else "!", operand)
        if e.op == "to_float":
            return c.Cast("double", operand)
        return c.CallExpr(UNARY_CALLS[e.op], (operand,))

    def _binary(self, e: core.Binary) -> tuple[c.CExpr, bool]:
        (left, a), (right, b) = self.expr(e.left), self.expr(e.right)
        if not a and not b:
            return c.Binary(e.op, left, right), False
        left, right = self.lane(e.left), self.lane(e.right)
        if e.op in LOGICAL:
            return c.Binary("&" if e.op == "&&" else "|", left, right), True
        if e.op not in COMPARISONS:
            return c.Binary(e.op, left, right), True
        if isinstance(e.left.type, BoolType):
            differ = c.Binary("^", left, right)
            return differ if e.op == "!=" else c.Unary("~", differ), True
        if scalar(e.left.type) is None:
            raise NotStraight
        return c.Cast(BOOL, c.Binary(e.op, left, right)), True

    def _extreme(self, e: core.Extreme) -> tuple[c.CExpr, bool]:
        (left, a), (right, b) = self.expr(e.left), self.expr(e.right)
        suffix = "_int" if isinstance(e.type, IntType) else ""
        if not a and not b:
            return c.CallExpr(f"soter_{e.op}{suffix}", (left, right)), False
        sides = self.lane(e.left), self.lane(e.right)
        return c.CallExpr(f"soter_lane_{e.op}{suffix}", sides), True

    def _select(self, e: core.Select) -> tuple[c.CExpr, bool]:
        condition, varies = self.expr(e.condition)
        then, otherwise = self.lane(e.then), self.lane(e.otherwise)
        if not varies:
            condition = c.CallExpr("soter_lane_all_bool", (condition,))
        return c.CallExpr(self.lanes.choice(e.type), (condition, then, otherwise)), True

    def _element(self, e: core.Element) -> tuple[c.CExpr, bool]:
        target, varies = self.expr(e.target)
        index, moves = self.expr(e.index)
        items = c.Member(target, "at" if isinstance(e.target.type, ArrayType) else "items")
        if not moves:
            return c.IndexExpr(items, index), varies
        return self.lanes.picked(e.type, items, index), True

    def _length(self, e: core.Length) -> tuple[c.CExpr, bool]:
        place = self.place(e.target)
        if place is not None:
            return self.load(place.part(".len"), e.type), True
        target, varies = self.expr(e.target)
        if varies:
            raise NotStraight
        return c.Member(target, "len"), False

    def _make(self, e: core.Make) -> tuple[c.CExpr, bool]:
        t = e.type
        if isinstance(t, RecordType):
            items: list[tuple[str | None, c.CExpr]] = [
                (field_name(n), self.lane(x))
                for (n, _), x in zip(t.fields, e.elements, strict=True)
            ]
        elif isinstance(t, ArrayType):
            each = tuple((None, self.lane(x)) for x in e.elements)
            items = [("at", c.Initializer(each))]
        else:
            raise NotStraight
        return c.Initializer(tuple(items), self.lanes.type(t)), True

    # ------------------------------------------------------------ statements

    def block(self, statements: tuple[core.Stmt, ...]) -> list[c.CStmt]:
        """Statements under the mask."""
        return [made for s in statements for made in self.statement(s)]

    def statement(self, s: core.Stmt) -> list[c.CStmt]:
        """One statement."""
        if isinstance(s, core.Let):
            return self._let(s)
        if isinstance(s, core.Checked):
            return self._checked(s)
        if isinstance(s, core.Guard):
            return [self.fails(c.Unary("~", self.lane(s.condition)))]
        if isinstance(s, core.Call):
            return self._call(s)
        if isinstance(s, core.Set):
            return self._set(s)
        if isinstance(s, core.If):
            return self._if(s)
        if isinstance(s, core.Loop):
            body = tuple(self.block(s.body))
            return [c.For(self.local(s.variable), int_number(s.low), int_number(s.high), body)]
        if isinstance(s, core.Publish) and s.limit is None:
            changed = self._changed(c.Name(self.outputs[s.output]), s.value.type, s.value)
            has = self.has(s.output)
            return [
                changed,
                *([] if has is None else [c.Assign(has, c.Binary("|", has, self.mask))]),
            ]
        raise NotStraight

    def fails(self, where: c.CExpr) -> c.CStmt:
        """A fault in lanes."""
        return c.Assign(BAD, c.Binary("|", BAD, c.Binary("&", self.mask, where)))

    def _let(self, s: core.Let) -> list[c.CStmt]:
        t, name = s.value.type, self.local(s.name)
        if not s.mutable and not self.lanes.has_lanes(t):
            place = self.place(s.value)
            if place is not None:
                self.places[s.name] = place
                return []
        value, varies = self.expr(s.value)
        if varies or s.mutable:
            value = self.lane(s.value)
            self.varying.add(s.name)
            return [c.Declare(self.lanes.type(t), name, value), c.Unused(name)]
        return [c.Declare(self.types.work(t), name, value, const=True), c.Unused(name)]

    def _checked(self, s: core.Checked) -> list[c.CStmt]:
        """An operation that may fault, in each lane or, on what is the same, in all of them."""
        given = [*s.operands, *([s.limit] if s.op == "index" and s.limit is not None else [])]
        operands = [self.expr(x) for x in given]
        name = self.local(s.name)
        limits: list[c.CExpr] = []
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            limits = [int_number(s.type.low), int_number(s.type.high)]
        if any(varies for _, varies in operands):
            own = (*(self.lane(x) for x in given), *limits, self.mask, c.Unary("&", BAD))
            self.varying.add(s.name)
            call = c.CallExpr(f"soter_lane_{'abs_int' if s.op == 'abs' else s.op}", own)
            return [c.Declare(INT, name, call, const=True), c.Unused(name)]
        fault = c.Name(f"{name}_fault")
        call = c.CallExpr(
            f"soter_{s.op}", (*(x for x, _ in operands), *limits, c.Unary("&", fault))
        )
        failed = c.Binary("!=", fault, c.Name("SOTER_OK"))
        return [
            c.Declare("soter_fault", fault.text, c.Name("SOTER_OK")),
            c.Declare(self.types.work(s.type), name, call, const=True),
            c.Unused(name),
            self.fails(c.CallExpr("soter_lane_all_bool", (failed,))),
        ]

    def _call(self, s: core.Call) -> list[c.CStmt]:
        made = self.lanes.function(s.function)
        arguments = tuple(self.lane(x) for x in s.arguments)
        given = (*arguments, self.mask, c.Unary("&", BAD))
        self.varying.add(s.name)
        name = self.local(s.name)
        call = c.CallExpr(made, given)
        return [c.Declare(self.lanes.type(s.type), name, call), c.Unused(name)]

    def _set(self, s: core.Set) -> list[c.CStmt]:
        if s.name in self.places:
            raise NotStraight
        target: c.CExpr = c.Name(self.local(s.name))
        t = s.type
        own: tuple[c.CExpr, int] | None = None
        for step in s.path:
            if isinstance(step, int):
                assert isinstance(t, RecordType)
                name, t = t.fields[step]
                target = c.Member(target, field_name(name))
                continue
            index, varies = self.expr(step)
            if not isinstance(t, ArrayType) or (varies and own is not None):
                raise NotStraight
            if varies:
                own = index, t.size
                index = c.Name("given_k")
            target, t = c.IndexExpr(c.Member(target, "at"), index), t.element
        if own is None:
            return [self._changed(target, t, s.value)]
        here = c.CallExpr("soter_lane_all_int", (c.Name("given_k"),))
        mask = c.Binary("&", self.mask, c.Cast(BOOL, c.Binary("==", own[0], here)))
        with self._under(mask):
            changed = self._changed(target, t, s.value)
        return [c.For("given_k", c.Number("0"), c.Number(str(own[1])), (changed,))]

    def _changed(self, target: c.CExpr, t: Type, e: core.Expr) -> c.CStmt:
        """An assignment in the lanes of the mask."""
        value = self.lane(e)
        if not self.certain:
            value = c.CallExpr(self.lanes.choice(t), (self.mask, value, target))
        return c.Assign(target, value)

    def _if(self, s: core.If) -> list[c.CStmt]:
        condition, varies = self.expr(s.condition)
        if not varies:
            then, otherwise = self._sides((self.mask, s.then), (self.mask, s.otherwise))
            return [c.IfStmt(condition, tuple(then), tuple(otherwise))]
        self._masks += 1
        on, off = c.Name(f"given_then_{self._masks}"), c.Name(f"given_else_{self._masks}")
        masks: list[c.CStmt] = [  # both of them before either side changes the condition
            c.Declare(BOOL, mask.text, c.Binary("&", self.mask, where), const=True)
            for mask, where, block in (
                (on, condition, s.then),
                (off, c.Unary("~", condition), s.otherwise),
            )
            if block
        ]
        return [
            *masks,
            *(x for made in self._sides((on, s.then), (off, s.otherwise)) for x in made),
        ]

    def _sides(self, *sides: tuple[c.CExpr, tuple[core.Stmt, ...]]) -> Iterator[list[c.CStmt]]:
        """Both sides of a branch; where one of them has no lanes, who takes it goes alone."""
        straight, outer = False, self.mask
        for mask, block in sides:
            before = set(self.varying), dict(self.places), dict(self.loads)
            certain = self.certain and mask == self.mask
            with self._under(mask, certain=certain):
                try:
                    made = self.block(block)
                    straight = True
                    if mask != outer and operations(block, self.lanes.operations) >= SKIPPED:
                        made = [c.IfStmt(c.CallExpr("soter_lane_any", (mask,)), tuple(made))]
                except NotStraight:
                    self.varying, self.places, self.loads = before
                    made = [self.fails(ALL)]
            yield made
        if not straight:
            raise NotStraight

    @contextmanager
    def _under(self, mask: c.CExpr, *, certain: bool = False) -> Iterator[None]:
        before = self.mask, self.certain
        self.mask, self.certain = mask, certain
        try:
            yield
        finally:
            self.mask, self.certain = before

    # ------------------------------------------------------------ around them

    def framed(self, statements: tuple[c.CStmt, ...], outer: c.CExpr) -> tuple[c.CStmt, ...]:
        """The body of a function: what was bad in it is bad outside."""
        *inner, last = statements
        assert isinstance(last, c.Return)
        assert last.value is not None
        return (
            c.Unused("given_mask"),
            c.Declare(BOOL, "given_bad", NOWHERE),
            *inner,
            c.Assign(outer, c.Binary("|", outer, BAD)),
            last,
        )

    def opened(self, type_: str) -> list[c.CStmt]:
        """What a function over states begins with."""
        state = f"{type_}{self.lanes.frame.prefix}_state"
        return [
            c.Do(c.CallExpr("SOTER_LANE_STATES", (c.Name(state),))),
            c.Declare("int64_t", "given_ct", c.Name("given_s[0]->header.ct"), const=True),
            c.Unused("given_ct"),
            c.Declare(BOOL, "given_mask", ALL, const=True),
            c.Unused("given_mask"),
            c.Declare(BOOL, "given_bad", NOWHERE),
            *(
                c.Declare(self.lanes.type(t), name, self.lanes.loaded(place, t), const=True)
                for place, (name, t) in self.loads.items()
            ),
        ]

    def given_up(self) -> c.CStmt:
        """Nothing is changed where a lane faults."""
        return c.IfStmt(c.CallExpr("soter_lane_any", (BAD,)), (c.Return(c.Name("false")),))


def _path(e: c.CExpr) -> str:
    """How a constant, or a part of it, is written; NotStraight for what is none."""
    if isinstance(e, c.Name):
        return e.text
    if isinstance(e, c.Member):
        return f"{_path(e.target)}.{e.name}"
    raise NotStraight
