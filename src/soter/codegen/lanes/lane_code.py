"""Core over lanes: both sides of a branch, and a mask that says whose is taken.

Purpose: expressions and statements of straight code. What is the same in every lane stays a number
of C; whole numbers have to be. Where anything faults in any lane, that is noted.
Non-goals: steps and predicates around it (`lane_steps.py`).
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.codegen.body import COMPARISONS, UNARY_CALLS
from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import FAULT, int_number
from soter.codegen.lanes.lane_values import ALL, BOOL, NOWHERE, NotStraight
from soter.codegen.storage.trivial_comparisons import LOGICAL
from soter.core import core
from soter.language.model.types import ArrayType, BoolType, FloatType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.lanes.lane_values import LaneValues
    from soter.language.model.types import Type

CT, BAD, MASK = c.Name("given_ct"), c.Name("given_bad"), c.Name("given_mask")
LANE_CALLS = {"sqrt": "soter_lane_sqrt", "floor": "soter_lane_floor", "abs": "soter_lane_abs"}


class LaneCode:
    """Core statements over lanes; NotStraight for what has none."""

    def __init__(self, lanes: LaneValues) -> None:
        self.lanes = lanes
        self.types = lanes.frame.types
        self.varying: set[str] = set()
        """Temporaries that differ from lane to lane."""
        self.loads: dict[str, tuple[str, Type]] = {}
        """Of each place in the state that is read its name, and the type."""
        self.outputs: tuple[str, ...] = ()
        self.in_state = False
        self.mask: c.CExpr = MASK
        self.certain = False
        """Whether the mask is that of all lanes for certain."""
        self._masks = 0
        self.uses_fault = False

    def has(self, _output: int) -> c.Name | None:
        """In which lanes the step published an output; None where it always does."""
        raise NotStraight

    def local(self, name: str) -> str:
        """The C name of a temporary."""
        return self.lanes.frame.body.local(name)

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> tuple[c.CExpr, bool]:
        """An expression, and whether it differs from lane to lane."""
        if isinstance(e, core.Const):
            return self.types.named_constant(e.type, e.value, e.name), False
        if isinstance(e, core.Var):
            return c.Name(self.local(e.name)), e.name in self.varying
        if isinstance(e, core.Fact):
            if e.fact != "time" or not self.in_state:
                raise NotStraight
            return c.CallExpr("soter_seconds", (CT,)), False
        path = self._place(e)
        if path is not None:
            return self._load(path, e.type), True
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
        if isinstance(e, core.Make):
            return self._make(e)
        raise NotStraight

    def lane(self, e: core.Expr) -> c.CExpr:
        """An expression as it is in each lane."""
        value, varies = self.expr(e)
        return value if varies else self.lanes.spread(e.type, value)

    def _place(self, e: core.Expr) -> str | None:
        """Where in the state a value lies, if it does."""
        if isinstance(e, core.Get):
            if not self.in_state:
                raise NotStraight
            return self.cell(e.cell)
        if isinstance(e, core.Field):
            outer = self._place(e.target)
            assert isinstance(e.target.type, RecordType)
            own = field_name(e.target.type.fields[e.index][0])
            return None if outer is None else f"{outer}.{own}"
        if isinstance(e, core.Element) and isinstance(e.target.type, ArrayType):
            outer = self._place(e.target)
            if outer is None:
                return None
            if not isinstance(e.index, core.Const):
                raise NotStraight
            return f"{outer}.at[{int(e.index.value)}]"
        return None

    def cell(self, cell: core.Cell) -> str:
        """The member of the state that a cell is."""
        frame = self.lanes.frame
        if cell.kind == "topic":
            return f"topics.{frame.topic_field(cell.owner)}"
        return f"{frame.groups[cell.owner]}.{field_name(cell.name)}"

    def _load(self, path: str, t: Type) -> c.CExpr:
        if path not in self.loads:
            self.lanes.type(t)
            self.loads[path] = f"given_{len(self.loads)}", t
        return c.Name(self.loads[path][0])

    def _unary(self, e: core.Unary) -> tuple[c.CExpr, bool]:
        operand, varies = self.expr(e.operand)
        if not varies:
            return self._alone(e, operand), False
        if e.op == "neg":
            return c.Unary("-", operand), True
        if e.op == "not":
            return c.Unary("~", operand), True
        if e.op not in LANE_CALLS:
            raise NotStraight
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
        if isinstance(e.left.type, BoolType) and e.op in {"==", "!="}:
            differ = c.Binary("^", left, right)
            return differ if e.op == "!=" else c.Unary("~", differ), True
        if not isinstance(e.left.type, FloatType):
            raise NotStraight
        return c.Cast(BOOL, c.Binary(e.op, left, right)), True

    def _extreme(self, e: core.Extreme) -> tuple[c.CExpr, bool]:
        (left, a), (right, b) = self.expr(e.left), self.expr(e.right)
        if not a and not b:
            suffix = "_int" if isinstance(e.type, IntType) else ""
            return c.CallExpr(f"soter_{e.op}{suffix}", (left, right)), False
        return c.CallExpr(f"soter_lane_{e.op}", (self.lane(e.left), self.lane(e.right))), True

    def _select(self, e: core.Select) -> tuple[c.CExpr, bool]:
        condition, varies = self.expr(e.condition)
        then, otherwise = self.lane(e.then), self.lane(e.otherwise)
        if not varies:
            condition = c.CallExpr("soter_lane_all_bool", (condition,))
        return c.CallExpr(self.lanes.choice(e.type), (condition, then, otherwise)), True

    def _element(self, e: core.Element) -> tuple[c.CExpr, bool]:
        target, varies = self.expr(e.target)
        index, moves = self.expr(e.index)
        if moves:
            raise NotStraight
        items = "at" if isinstance(e.target.type, ArrayType) else "items"
        return c.IndexExpr(c.Member(target, items), index), varies

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
        value, varies = self.expr(s.value)
        if varies or s.mutable:
            value = self.lane(s.value)
            self.varying.add(s.name)
            return [c.Declare(self.lanes.type(t), name, value), c.Unused(name)]
        return [c.Declare(self.types.work(t), name, value, const=True), c.Unused(name)]

    def _checked(self, s: core.Checked) -> list[c.CStmt]:
        """Of whole numbers that are the same everywhere; a fault is one of all lanes."""
        given = [*s.operands, *([s.limit] if s.op == "index" and s.limit is not None else [])]
        operands = [self.expr(x) for x in given]
        if any(varies for _, varies in operands):
            raise NotStraight
        arguments = [x for x, _ in operands]
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            arguments += [int_number(s.type.low), int_number(s.type.high)]
        self.uses_fault = True
        call = c.CallExpr(f"soter_{s.op}", (*arguments, FAULT))
        name = self.local(s.name)
        return [c.Declare(self.types.work(s.type), name, call, const=True), c.Unused(name)]

    def _call(self, s: core.Call) -> list[c.CStmt]:
        made = self.lanes.function(s.function)
        arguments = tuple(self.lane(x) for x in s.arguments)
        given = (*arguments, self.mask, c.Unary("&", BAD))
        self.varying.add(s.name)
        name = self.local(s.name)
        call = c.CallExpr(made, given)
        return [c.Declare(self.lanes.type(s.type), name, call), c.Unused(name)]

    def _set(self, s: core.Set) -> list[c.CStmt]:
        target: c.CExpr = c.Name(self.local(s.name))
        t = s.type
        for step in s.path:
            if isinstance(step, int):
                assert isinstance(t, RecordType)
                own, t = t.fields[step]
                target = c.Member(target, field_name(own))
            else:
                index, varies = self.expr(step)
                if varies or not isinstance(t, ArrayType):
                    raise NotStraight
                target, t = c.IndexExpr(c.Member(target, "at"), index), t.element
        return [self._changed(target, t, s.value)]

    def _changed(self, target: c.CExpr, t: Type, e: core.Expr) -> c.CStmt:
        """An assignment in the lanes of the mask."""
        value = self.lane(e)
        if not self.certain:
            value = c.CallExpr(self.lanes.choice(t), (self.mask, value, target))
        return c.Assign(target, value)

    def _if(self, s: core.If) -> list[c.CStmt]:
        condition, varies = self.expr(s.condition)
        if not varies:
            then, otherwise = tuple(self.block(s.then)), tuple(self.block(s.otherwise))
            return [c.IfStmt(condition, then, otherwise)]
        self._masks += 1
        on, off = c.Name(f"given_then_{self._masks}"), c.Name(f"given_else_{self._masks}")
        sides = [
            (mask, where, block)
            for mask, where, block in (
                (on, condition, s.then),
                (off, c.Unary("~", condition), s.otherwise),
            )
            if block
        ]
        statements: list[c.CStmt] = [  # both of them before either side changes the condition
            c.Declare(BOOL, mask.text, c.Binary("&", self.mask, where), const=True)
            for mask, where, _ in sides
        ]
        for mask, _, block in sides:
            with self._under(mask):
                statements += self.block(block)
        return statements

    @contextmanager
    def _under(self, mask: c.CExpr) -> Iterator[None]:
        before = self.mask, self.certain
        self.mask, self.certain = mask, False
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
            *self.fault_declared(),
            *inner,
            *self.fault_told(),
            c.Assign(outer, c.Binary("|", outer, BAD)),
            last,
        )

    def fault_declared(self) -> list[c.CStmt]:
        """The fault of what is the same in every lane, if there may be one."""
        if not self.uses_fault:
            return []
        return [
            c.Declare("soter_fault", "status", c.Name("SOTER_OK")),
            c.Declare("soter_fault *const ", "fault", c.Unary("&", c.Name("status"))),
        ]

    def fault_told(self) -> list[c.CStmt]:
        """It is one of every lane."""
        if not self.uses_fault:
            return []
        failed = c.Binary("!=", c.Name("status"), c.Name("SOTER_OK"))
        return [c.IfStmt(failed, (c.Assign(BAD, ALL),))]

    def opened(self, type_: str) -> list[c.CStmt]:
        """What a function over states begins with."""
        state = f"{type_}{self.lanes.frame.prefix}_state"
        return [
            c.Do(c.CallExpr("SOTER_LANE_STATES", (c.Name(state),))),
            c.Declare("int64_t", "given_ct", c.Name("given_s0->header.ct"), const=True),
            c.Unused("given_ct"),
            c.Declare(BOOL, "given_mask", ALL, const=True),
            c.Unused("given_mask"),
            c.Declare(BOOL, "given_bad", NOWHERE),
            *self.fault_declared(),
            *(
                c.Declare(self.lanes.type(t), name, self.lanes.loaded(path, t), const=True)
                for path, (name, t) in self.loads.items()
            ),
        ]

    def given_up(self) -> c.CStmt:
        """Nothing is changed where a lane faults."""
        return c.IfStmt(c.CallExpr("soter_lane_any", (BAD,)), (c.Return(c.Name("false")),))
