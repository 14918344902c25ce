"""Translates Core expressions and statements to C.

Purpose: `Body` has one method for each kind of Core node; the C keeps the order of the Core.
Non-goals: what surrounds a body (`nodes.py`, `plants_and_inputs.py`, `decisions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name
from soter.codegen.c_types import FAULT, aggregate_initializer, int_number
from soter.codegen.storage_plan import RESULT, has_address, is_leave_check
from soter.codegen.value_locations import LOGICAL, MADE, Places, has_known_result, twice_compared
from soter.core import core
from soter.core.core import output_name
from soter.core.layout import scalar
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.semantics.draws import fnv1a_64

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.c_types import TypeTable
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.types import Type

FAULT_NAMES = {kind: f"SOTER_{kind.name}" for kind in FaultKind}
FAULT_NAMES[FaultKind.EXTERN] = "SOTER_EXTERN_FAULT"
COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
UNARY_CALLS = {"sqrt": "sqrt", "floor": "floor", "abs": "fabs"}


@dataclass(frozen=True)
class StepBranch:
    """One side of an `if` in the step of a component; a branch is numbered by its list position."""

    component: str
    span: Span
    taken: bool
    """Whether it is the side on which the condition holds."""


@dataclass
class BranchChoices:
    """How to draw the choices of a step; `branches` collects the sides of its `if` statements.

    `chance`: choices are random, as the driver's `answer` does not offer them (an extern plant).
    """

    component: str
    branches: list[StepBranch] | None = None
    chance: bool = False


def stream_key(stream: str) -> c.CExpr:
    """The C constant of the FNV-1a hash of a stream's name."""
    return c.Number(f"UINT64_C(0x{fnv1a_64(stream):016x})")


class Body(Places):
    """Translates the bodies of one program's functions and steps to C."""

    def __init__(
        self,
        types: TypeTable,
        functions: dict[str, tuple[str, bool]],
        cell: Callable[[core.Cell], c.CExpr],
    ) -> None:
        super().__init__(types)
        self.functions = functions
        """By the name of a function in Core: its name in C, and whether it may fault."""
        self.cell = cell
        self.choices: BranchChoices | None = None
        """Set while a step is emitted that a driver may answer."""
        self._compared_twice: list[c.CExpr] | None = None
        """Within a condition: the C of values that it compares with several constants."""
        self._leave_flag: str | None = None  # of Core: set as a function returns
        self._return_code: tuple[c.CStmt, ...] = ()

    def output_place(self, output: int) -> c.CExpr:
        """The C place that holds an output's value until the step commits the value."""
        return self.place_of(output_name(output))

    def flag_of(self, output: int) -> c.Name:
        """The C flag that is true if the step has published an output."""
        return c.Name(f"has_{self.outputs[output]}")

    # ------------------------------------------------------------ functions

    def function_statements(self, f: core.Function, result: core.Expr) -> list[c.CStmt]:
        """The C statements of a function that returns the value of `result`."""
        with self.plan_body(self.function_to_plan(f, result)):
            self._leave_flag = f.leave
            last = tuple(self._return_statements(f.result_type, result))
            self._return_code = last if _always_returns(last) else (*last, c.Return(None))
            statements = self.translate_block(f.body, result)
            if not _always_returns(statements):
                statements += last
        self._leave_flag, self._return_code = None, ()
        return statements

    def _return_statements(self, t: Type, result: core.Expr) -> list[c.CStmt]:
        if self.types.is_large(t):
            return self.write_into(MADE, RESULT, t, result)
        value = self.expr(result)
        if self.types.work_type(t) in {"bool", "int64_t", "double"}:
            return [c.Return(value)]
        return [c.Return(self.types.as_stored(t, value))]

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> c.CExpr:
        """The C expression of a Core expression."""
        if isinstance(e, core.Const):
            return self.types.named_constant(e.type, e.value, e.name)
        if isinstance(e, core.Var):
            return c.Name("false") if e.name == self._leave_flag else self.place_of(e.name)
        if isinstance(e, core.Get):
            return self._as_operand(e.type, self.cell(e.cell))
        if isinstance(e, core.Fact):
            return self._fact_expr(e)
        if isinstance(e, core.Unary):
            return self._unary_expr(e)
        if isinstance(e, core.Binary):
            return self._binary_expr(e)
        if isinstance(e, core.Extreme):
            suffix = "_int" if isinstance(e.type, IntType) else ""
            return c.CallExpr(f"soter_{e.op}{suffix}", (self.expr(e.left), self.expr(e.right)))
        if isinstance(e, core.Select):
            return self._choice_expr(e)
        if isinstance(e, core.Field):
            return self._as_operand(e.type, self._field_access(e))
        if isinstance(e, core.Element):
            return self._as_operand(e.type, c.IndexExpr(self._array(e.target), self.expr(e.index)))
        if isinstance(e, core.Length):
            return c.Member(self.expr(e.target), "len")
        assert isinstance(e, core.Make)
        return self._make_expr(e)

    def _field_access(self, e: core.Field) -> c.CExpr:
        t = e.target.type
        assert isinstance(t, RecordType)
        return c.Member(self.expr(e.target), field_name(t.fields[e.index][0]))

    def _as_operand(self, t: Type, e: c.CExpr) -> c.CExpr:
        """A stored value as an operand: a `uint32_t` is cast to `int64_t`.

        C widens narrower integers to `int`, but with a `uint32_t` it would make the other operand
        unsigned.
        """
        s = scalar(t)
        return c.Cast("int64_t", e) if s is not None and s.c_type == "uint32_t" else e

    def _choice_expr(self, e: core.Select) -> c.CExpr:
        """The C `?:` of a choice; casts a nested choice of an enum, as C makes it an `int`."""
        made = c.Ternary(self.expr(e.condition), self.expr(e.then), self.expr(e.otherwise))
        nested = any(isinstance(x, core.Select) for x in (e.then, e.otherwise))
        return (
            self.types.as_stored(e.type, made) if nested and isinstance(e.type, EnumType) else made
        )

    def _binary_expr(self, e: core.Binary) -> c.CExpr:
        outermost = e.op in LOGICAL and self._compared_twice is None
        if outermost:
            self._compared_twice = [self.expr(x) for x in twice_compared(e)]
        left, right = self.expr(e.left), self.expr(e.right)
        if outermost:
            self._compared_twice = None
        if e.op in COMPARISONS and not isinstance(e.left.type, FloatType):
            left_twice, right_twice = (x in (self._compared_twice or ()) for x in (left, right))
            if left == right or left_twice or has_known_result(e.op, e.left, e.right):
                left = c.CallExpr("soter_plain", (left,))
            if right_twice or has_known_result(e.op, e.right, e.left):
                right = c.CallExpr("soter_plain", (right,))
        return c.Binary(e.op, left, right)

    def _array(self, target: core.Expr) -> c.CExpr:
        return c.Member(self.expr(target), "at" if isinstance(target.type, ArrayType) else "items")

    def _fact_expr(self, e: core.Fact) -> c.CExpr:
        s = c.Name("s")
        ct = c.Member(c.Arrow(s, "header"), "ct")
        if e.fact == "time":
            return c.CallExpr("soter_seconds", (ct,))
        if e.fact == "age":
            stamp = c.IndexExpr(c.Arrow(s, "stamps"), c.Number(str(e.index)))
            return c.CallExpr("soter_seconds", (c.Binary("-", ct, stamp),))
        if e.fact == "published":
            return c.Name("true") if e.index in self.certain else self.flag_of(e.index)
        if e.fact == "mode":
            return c.Member(c.IndexExpr(c.Arrow(s, "modules"), c.Number(str(e.index))), "mode")
        enabled = c.Binary("&", c.Name("flags"), c.Name("SOTER_ENABLED"))
        return c.Binary("!=", enabled, c.Number("0U"))

    def _unary_expr(self, e: core.Unary) -> c.CExpr:
        operand = self.expr(e.operand)
        if e.op == "neg":
            return c.Unary("-", operand)
        if e.op == "not":
            return c.Unary("!", operand)
        if e.op == "to_float":
            return c.Cast("double", operand)
        return c.CallExpr(UNARY_CALLS[e.op], (operand,))

    def _make_expr(self, e: core.Make) -> c.CExpr:
        t = e.type
        name = self.types.stored_type(t)

        def stored_element(element_type: Type, element: core.Expr) -> c.CExpr:
            return self.types.as_stored(element_type, self.expr(element))

        return aggregate_initializer(t, e.elements, stored_element, name)

    # ------------------------------------------------------------ statements

    def translate_block(self, statements: tuple[core.Stmt, ...], *after: object) -> list[c.CStmt]:
        """The C of these statements.

        A temporary that neither they nor `after` read is marked as unused, against warnings.
        """
        return list(self._c_block(statements, self.names_used((statements, after))))

    def translate(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        """The C of one statement; `used`: the temporaries that any code reads."""
        made = self._translate_one(s, used)
        return self.with_saved_value(s, made) if self.in_place else made

    def _translate_one(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        if isinstance(s, core.Let):
            return self._translate_let(s, used)
        if isinstance(s, core.Checked):
            return self._with_unused_mark(self._translate_checked(s), s.name, used)
        if isinstance(s, core.Choose):
            return self._with_unused_mark(self._translate_choose(s), s.name, used)
        if isinstance(s, core.Guard):
            kind = c.Name(FAULT_NAMES[s.kind])
            return [c.Do(c.CallExpr("soter_guard", (self.expr(s.condition), kind, FAULT)))]
        if isinstance(s, core.Call):
            return self._translate_call(s, used)
        if isinstance(s, core.Set):
            return self._translate_set(s)
        if isinstance(s, core.Push):
            return self._translate_push(s)
        if isinstance(s, core.If):
            if self._leave_flag is not None and is_leave_check(s.condition, self._leave_flag):
                return list(self._c_block(s.then, used))
            condition = self.expr(s.condition)
            then = (*self._branch_count_call(s, taken=True), *self._c_block(s.then, used))
            otherwise = (
                *self._branch_count_call(s, taken=False),
                *self._c_block(s.otherwise, used),
            )
            return [c.IfStmt(condition, then, otherwise)]
        if isinstance(s, core.Loop):
            body = self._c_block(s.body, used)
            return [c.For(self.c_name(s.variable), int_number(s.low), int_number(s.high), body)]
        assert isinstance(s, core.Publish)
        return self._translate_publish(s)

    def _translate_publish(self, s: core.Publish) -> list[c.CStmt]:
        certain = s.output in self.certain
        has = [] if certain else [c.Assign(self.flag_of(s.output), c.Name("true"))]
        out, root = self.output_place(s.output), output_name(s.output)
        if s.limit is None:
            if self.types.is_large(s.value.type):
                return [*self.write_into(out, root, s.value.type, s.value), *has]
            return [c.Assign(out, self.expr(s.value)), *has]
        return [*self._append_value(out, ListType(s.value.type, s.limit), s.value, root), *has]

    def _translate_let(self, s: core.Let, used: set[str]) -> list[c.CStmt]:
        t, name = s.value.type, self.c_name(s.name)
        if s.name == self._leave_flag:
            return []
        if not self.types.is_large(t):
            declared = self._declaration(s.name, t, self.expr(s.value), const=not s.mutable)
            return self._with_unused_mark(declared, s.name, used)
        if self.is_pointer(s.name):
            if id(s) in self.plan.idle:
                return []
            pointer = f"const {self.types.stored_type(t)} *const "
            return [c.Declare(pointer, name, c.address_of(self.expr(s.value))), c.Unused(name)]
        idle = id(s) in self.plan.idle
        if not self.has_place(s.name):
            return [] if idle else self.write_into(self.place_of(s.name), s.name, t, s.value)
        if idle:
            empty = c.Declare(self.types.stored_type(t), name, None)
            needed = s.mutable or s.name in self.plan.shared
            return [empty, c.Unused(name)] if needed else []
        at_once = has_address(s.value) or not (
            isinstance(s.value, core.Select)
            or (isinstance(t, RecordType) and isinstance(s.value, core.Make))
        )
        if at_once:
            const = not s.mutable and s.name not in self.plan.shared
            declared = self._declaration(s.name, t, self.expr(s.value), const=const)
            return self._with_unused_mark(declared, s.name, used)
        declared = c.Declare(self.types.stored_type(t), name, None)
        value = self.write_into(self.place_of(s.name), s.name, t, s.value)
        return [declared, *value, c.Unused(name)]

    def _translate_call(self, s: core.Call, used: set[str]) -> list[c.CStmt]:
        name, faults = self.functions[s.function]
        statements, arguments = self.c_arguments(s.arguments)
        end = (FAULT,) if faults else ()
        if not self.types.is_large(s.type):
            call = c.CallExpr(name, (*arguments, *end))
            made = self._declaration(s.name, s.type, call, const=True)
            return [*statements, *self._with_unused_mark(made, s.name, used)]
        if self.has_place(s.name):
            statements.append(c.Declare(self.types.stored_type(s.type), self.c_name(s.name), None))
        target = c.address_of(self.place_of(s.name))
        return [*statements, c.Do(c.CallExpr(name, (*arguments, target, *end)))]

    def _translate_set(self, s: core.Set) -> list[c.CStmt]:
        if s.name == self._leave_flag:
            return list(self._return_code)
        if id(s) in self.plan.idle:
            return []
        target, t = self._target_place(s.name, s.type, s.path)
        if self.types.is_large(t):
            return self.write_into(target, s.name, t, s.value) or self._unused_mark(s.name)
        value = self.expr(s.value)
        if value == target:
            return self._unused_mark(s.name)
        return [c.Assign(target, self.types.as_stored(t, value) if s.path else value)]

    def _unused_mark(self, name: str) -> list[c.CStmt]:
        """A mark in place of `x = x`, so that compilers do not warn that `x` is unused."""
        return [c.Unused(self.c_name(name))] if self.has_place(name) else []

    def _branch_count_call(self, s: core.If, *, taken: bool) -> list[c.CStmt]:
        """The C call that counts this side of an `if`; [] without coverage."""
        if self.choices is None or self.choices.branches is None:
            return []
        number = c.Number(f"{len(self.choices.branches)}U")
        self.choices.branches.append(StepBranch(self.choices.component, s.span, taken))
        return [c.Do(c.CallExpr("soter_branch", (c.Name("answer"), FAULT, number)))]

    def _translate_choose(self, s: core.Choose) -> c.CStmt:
        """Declares the value that a driver chooses; after a fault it is the first alternative."""
        assert self.choices is not None
        header = c.Unary("&", c.Arrow(c.Name("s"), "header"))
        key = stream_key(f"{self.choices.component}.choose")
        made = c.Unary("&", c.Name("made"))
        whom = c.Name("NULL" if self.choices.chance else "answer")
        arguments: tuple[c.CExpr, ...] = (header, whom, key, c.Name("release"), made)
        function = "soter_choose"
        if s.ages is not None:
            function = "soter_choose_fair"
            arguments = (*arguments, c.Member(c.Name(self.c_name(s.ages)), "at"))
        call = c.CallExpr(function, (*arguments, c.Number(f"{s.count}U")))
        fine = c.Binary("==", c.Unary("*", FAULT), c.Name("SOTER_OK"))
        value: c.CExpr = c.Ternary(fine, call, c.Number("0U"))
        if isinstance(s.type, BoolType):
            value = c.Binary("!=", value, c.Number("0U"))
        else:
            value = c.Cast("int64_t", value)
            if s.low != 0:
                value = c.Binary("+", int_number(s.low), value)
            value = value if isinstance(s.type, IntType) else self.types.as_stored(s.type, value)
        return self._declaration(s.name, s.type, value, const=True)

    def _c_block(self, statements: tuple[core.Stmt, ...], used: set[str]) -> tuple[c.CStmt, ...]:
        return tuple([made for s in statements for made in self.translate(s, used)])

    def _declaration(self, name: str, t: Type, value: c.CExpr, *, const: bool) -> c.CStmt:
        return c.Declare(self.types.work_type(t), self.c_name(name), value, const)

    def _with_unused_mark(self, s: c.CStmt, name: str, used: set[str]) -> list[c.CStmt]:
        return [s] if name in used else [s, c.Unused(self.c_name(name))]

    def _translate_checked(self, s: core.Checked) -> c.CStmt:
        operands = [self.expr(o) for o in s.operands]
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            operands += [int_number(s.type.low), int_number(s.type.high)]
        elif s.op == "index":
            assert s.limit is not None
            operands.append(self._index_bound(s.limit))
        call = c.CallExpr(f"soter_{s.op}", (*operands, FAULT))
        return self._declaration(s.name, s.type, call, const=True)

    def _index_bound(self, limit: core.Expr) -> c.CExpr:
        """The bound of an index; for a list the length, but at most the capacity, for compilers."""
        e = self.expr(limit)
        if not isinstance(limit, core.Length):
            return e
        assert isinstance(limit.target.type, ListType)
        return c.CallExpr("soter_min_int", (e, c.Number(str(limit.target.type.capacity))))

    def _target_place(
        self, name: str, t: Type, path: tuple[int | core.Expr, ...]
    ) -> tuple[c.CExpr, Type]:
        target = self.place_of(name)
        for step in path:
            if isinstance(step, int):
                assert isinstance(t, RecordType)
                field, t = t.fields[step]
                target = c.Member(target, field_name(field))
            else:
                assert isinstance(t, (ArrayType, ListType))
                items = c.Member(target, "at" if isinstance(t, ArrayType) else "items")
                target = c.IndexExpr(items, self.expr(step))
                t = t.element
        return target, t

    def _translate_push(self, s: core.Push) -> list[c.CStmt]:
        target, t = self._target_place(s.name, s.type, s.path)
        assert isinstance(t, ListType)
        return self._append_value(target, t, s.value, s.name)

    def _append_value(self, target: c.CExpr, t: ListType, e: core.Expr, root: str) -> list[c.CStmt]:
        """Appends a value to a list; a full list raises a capacity fault.

        The C also tests that the length is not negative: if a step compares it with a negative
        number, a compiler would warn of a negative index, which no execution has.
        """
        length = c.Member(target, "len")
        end = c.IndexExpr(c.Member(target, "items"), length)
        some = c.Binary(">=", length, c.Number("0"))
        room = c.Binary("&&", some, c.Binary("<", length, c.Number(str(t.capacity))))
        return [
            c.Do(c.CallExpr("soter_guard", (room, c.Name("SOTER_CAPACITY"), FAULT))),
            c.IfStmt(
                room,
                (
                    *self.write_into(end, root, t.element, e),
                    c.Assign(length, c.Binary("+", length, c.Number("1"))),
                ),
            ),
        ]


def _always_returns(block: list[c.CStmt] | tuple[c.CStmt, ...]) -> bool:
    """Whether a block returns on every path, so that no statement after it runs."""
    if not block:
        return False
    last = block[-1]
    if isinstance(last, c.IfStmt):
        return _always_returns(last.then) and _always_returns(last.otherwise)
    return isinstance(last, c.Return)
