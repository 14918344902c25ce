"""Translates Core expressions and statements to C.

Purpose: `Body` has one method for each kind of Core node; the C keeps the order of the Core.
Non-goals: what surrounds a body (`nodes.py`, `plants_and_inputs.py`, `decisions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name
from soter.codegen.c_types import FAULT, aggregate, int_number
from soter.codegen.storage_plan import RESULT, has_address, is_still_here
from soter.codegen.value_locations import LOGICAL, MADE, Places, compared_twice, has_known_result
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

FAULT_NAMES = {
    FaultKind.OVERFLOW: "SOTER_OVERFLOW",
    FaultKind.INDEX: "SOTER_INDEX",
    FaultKind.DIVIDE: "SOTER_DIVIDE",
    FaultKind.CONVERT: "SOTER_CONVERT",
    FaultKind.ASSERT: "SOTER_ASSERT",
    FaultKind.CAPACITY: "SOTER_CAPACITY",
    FaultKind.NONFINITE: "SOTER_NONFINITE",
    FaultKind.RANGE: "SOTER_RANGE",
    FaultKind.EXTERN: "SOTER_EXTERN_FAULT",
    FaultKind.SHIELD: "SOTER_SHIELD",
}
COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
UNARY_CALLS = {"sqrt": "sqrt", "floor": "floor", "abs": "fabs"}


@dataclass(frozen=True)
class StepBranch:
    """One side of an `if` in the step of a component; its position in the list is its number."""

    component: str
    span: Span
    taken: bool
    """Whether it is the side on which the condition holds."""


@dataclass
class BranchChoices:
    """How choices of the step being emitted are drawn; `branches` collects its `if` sides.

    `chance`: the generator draws, since the driver's `answer` is then that of an extern plant.
    """

    component: str
    branches: list[StepBranch] | None = None
    chance: bool = False


def stream_key(stream: str) -> c.CExpr:
    """The FNV-1a of a stream's name."""
    return c.Number(f"UINT64_C(0x{fnv1a_64(stream):016x})")


class Body(Places):
    """Emits the C of every function and step body of one generated program."""

    def __init__(
        self,
        types: TypeTable,
        functions: dict[str, tuple[str, bool]],
        cell: Callable[[core.Cell], c.CExpr],
    ) -> None:
        super().__init__(types)
        self.functions = functions
        """Core function name -> C name, may fault."""
        self.cell = cell
        self.choices: BranchChoices | None = None
        """Set while a step is emitted that a driver may answer."""
        self._at_odds: list[c.CExpr] | None = None
        """Within a condition: the C of values that it compares with several constants."""
        self._leave: str | None = None
        self._leaving: tuple[c.CStmt, ...] = ()

    def out(self, output: int) -> c.CExpr:
        """The C place that holds an output's value until the step commits."""
        return self.place(output_name(output))

    def has(self, output: int) -> c.Name:
        """The C flag that says whether the step published an output."""
        return c.Name(f"has_{self.outputs[output]}")

    # ------------------------------------------------------------ functions

    def function(self, f: core.Function, result: core.Expr) -> list[c.CStmt]:
        """The C statements of a function's body; `result` is the value that it returns."""
        with self.planned(self.task(f, result)):
            self._leave = f.leave
            last = tuple(self._returned(f.result_type, result))
            self._leaving = last if _leaves(last) else (*last, c.Return(None))
            statements = self.block(f.body, result)
            if not _leaves(statements):
                statements += last
        self._leave, self._leaving = None, ()
        return statements

    def _returned(self, t: Type, result: core.Expr) -> list[c.CStmt]:
        if self.types.is_large(t):
            return self.into(MADE, RESULT, t, result)
        value = self.expr(result)
        if self.types.work(t) in {"bool", "int64_t", "double"}:
            return [c.Return(value)]
        return [c.Return(self.types.to_store(t, value))]

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> c.CExpr:
        """Translates a pure Core expression to a C expression."""
        if isinstance(e, core.Const):
            return self.types.named_constant(e.type, e.value, e.name)
        if isinstance(e, core.Var):
            return c.Name("false") if e.name == self._leave else self.place(e.name)
        if isinstance(e, core.Get):
            return self._read(e.type, self.cell(e.cell))
        if isinstance(e, core.Fact):
            return self._fact(e)
        if isinstance(e, core.Unary):
            return self._unary(e)
        if isinstance(e, core.Binary):
            return self._binary(e)
        if isinstance(e, core.Extreme):
            suffix = "_int" if isinstance(e.type, IntType) else ""
            return c.CallExpr(f"soter_{e.op}{suffix}", (self.expr(e.left), self.expr(e.right)))
        if isinstance(e, core.Select):
            return self._select(e)
        if isinstance(e, core.Field):
            return self._read(e.type, self._member(e))
        if isinstance(e, core.Element):
            return self._read(e.type, c.IndexExpr(self._items(e.target), self.expr(e.index)))
        if isinstance(e, core.Length):
            return c.Member(self.expr(e.target), "len")
        assert isinstance(e, core.Make)
        return self._make(e)

    def _member(self, e: core.Field) -> c.CExpr:
        t = e.target.type
        assert isinstance(t, RecordType)
        return c.Member(self.expr(e.target), field_name(t.fields[e.index][0]))

    def _read(self, t: Type, e: c.CExpr) -> c.CExpr:
        """Reads a stored value as an operand; a `uint32_t` is cast to `int64_t`.

        C widens narrower integers to `int` without harm, but a `uint32_t` would turn the other
        operand unsigned.
        """
        s = scalar(t)
        return c.Cast("int64_t", e) if s is not None and s.c_type == "uint32_t" else e

    def _select(self, e: core.Select) -> c.CExpr:
        """A `?:`; nested ones of enum members are cast back, since C makes them `int`."""
        made = c.Ternary(self.expr(e.condition), self.expr(e.then), self.expr(e.otherwise))
        nested = any(isinstance(x, core.Select) for x in (e.then, e.otherwise))
        return (
            self.types.to_store(e.type, made) if nested and isinstance(e.type, EnumType) else made
        )

    def _binary(self, e: core.Binary) -> c.CExpr:
        outermost = e.op in LOGICAL and self._at_odds is None
        if outermost:
            self._at_odds = [self.expr(x) for x in compared_twice(e)]
        left, right = self.expr(e.left), self.expr(e.right)
        if outermost:
            self._at_odds = None
        if e.op in COMPARISONS and not isinstance(e.left.type, FloatType):
            left_at_odds, right_at_odds = (x in (self._at_odds or ()) for x in (left, right))
            if left == right or left_at_odds or has_known_result(e.op, e.left, e.right):
                left = c.CallExpr("soter_plain", (left,))
            if right_at_odds or has_known_result(e.op, e.right, e.left):
                right = c.CallExpr("soter_plain", (right,))
        return c.Binary(e.op, left, right)

    def _items(self, target: core.Expr) -> c.CExpr:
        return c.Member(self.expr(target), "at" if isinstance(target.type, ArrayType) else "items")

    def _fact(self, e: core.Fact) -> c.CExpr:
        s = c.Name("s")
        ct = c.Member(c.Arrow(s, "header"), "ct")
        if e.fact == "time":
            return c.CallExpr("soter_seconds", (ct,))
        if e.fact == "age":
            stamp = c.IndexExpr(c.Arrow(s, "stamps"), c.Number(str(e.index)))
            return c.CallExpr("soter_seconds", (c.Binary("-", ct, stamp),))
        if e.fact == "published":
            return c.Name("true") if e.index in self.certain else self.has(e.index)
        if e.fact == "mode":
            return c.Member(c.IndexExpr(c.Arrow(s, "modules"), c.Number(str(e.index))), "mode")
        enabled = c.Binary("&", c.Name("flags"), c.Name("SOTER_ENABLED"))
        return c.Binary("!=", enabled, c.Number("0U"))

    def _unary(self, e: core.Unary) -> c.CExpr:
        operand = self.expr(e.operand)
        if e.op == "neg":
            return c.Unary("-", operand)
        if e.op == "not":
            return c.Unary("!", operand)
        if e.op == "to_float":
            return c.Cast("double", operand)
        return c.CallExpr(UNARY_CALLS[e.op], (operand,))

    def _make(self, e: core.Make) -> c.CExpr:
        t = e.type
        name = self.types.stored(t)

        def part(of: Type, element: core.Expr) -> c.CExpr:
            return self.types.to_store(of, self.expr(element))

        return aggregate(t, e.elements, part, name)

    # ------------------------------------------------------------ statements

    def block(self, statements: tuple[core.Stmt, ...], *after: object) -> list[c.CStmt]:
        """Translates a sequence of statements.

        A temporary that neither it nor `after` reads is marked as unused, against warnings.
        """
        return list(self._inner(statements, self.used((statements, after))))

    def statement(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        """Translates one statement; `used` has the temporaries that something reads."""
        made = self._statement(s, used)
        return self.changing(s, made) if self.in_place else made

    def _statement(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        if isinstance(s, core.Let):
            return self._let(s, used)
        if isinstance(s, core.Checked):
            return self._marked(self._checked(s), s.name, used)
        if isinstance(s, core.Choose):
            return self._marked(self._choose(s), s.name, used)
        if isinstance(s, core.Guard):
            kind = c.Name(FAULT_NAMES[s.kind])
            return [c.Do(c.CallExpr("soter_guard", (self.expr(s.condition), kind, FAULT)))]
        if isinstance(s, core.Call):
            return self._call(s, used)
        if isinstance(s, core.Set):
            return self._set(s)
        if isinstance(s, core.Push):
            return self._push(s)
        if isinstance(s, core.If):
            if self._leave is not None and is_still_here(s.condition, self._leave):
                return list(self._inner(s.then, used))
            condition = self.expr(s.condition)
            then = (*self._branch(s, taken=True), *self._inner(s.then, used))
            otherwise = (*self._branch(s, taken=False), *self._inner(s.otherwise, used))
            return [c.IfStmt(condition, then, otherwise)]
        if isinstance(s, core.Loop):
            body = self._inner(s.body, used)
            return [c.For(self.local(s.variable), int_number(s.low), int_number(s.high), body)]
        assert isinstance(s, core.Publish)
        return self._publish(s)

    def _publish(self, s: core.Publish) -> list[c.CStmt]:
        certain = s.output in self.certain
        has = [] if certain else [c.Assign(self.has(s.output), c.Name("true"))]
        out, root = self.out(s.output), output_name(s.output)
        if s.limit is None:
            if self.types.is_large(s.value.type):
                return [*self.into(out, root, s.value.type, s.value), *has]
            return [c.Assign(out, self.expr(s.value)), *has]
        return [*self._append(out, ListType(s.value.type, s.limit), s.value, root), *has]

    def _let(self, s: core.Let, used: set[str]) -> list[c.CStmt]:
        t, name = s.value.type, self.local(s.name)
        if s.name == self._leave:
            return []
        if not self.types.is_large(t):
            declared = self._declare(s.name, t, self.expr(s.value), const=not s.mutable)
            return self._marked(declared, s.name, used)
        if self.refers(s.name):
            if id(s) in self.plan.idle:
                return []
            pointer = f"const {self.types.stored(t)} *const "
            return [c.Declare(pointer, name, c.address(self.expr(s.value))), c.Unused(name)]
        idle = id(s) in self.plan.idle
        if not self.is_own(s.name):
            return [] if idle else self.into(self.place(s.name), s.name, t, s.value)
        if idle:
            empty = c.Declare(self.types.stored(t), name, None)
            needed = s.mutable or s.name in self.plan.shared
            return [empty, c.Unused(name)] if needed else []
        at_once = has_address(s.value) or not (
            isinstance(s.value, core.Select)
            or (isinstance(t, RecordType) and isinstance(s.value, core.Make))
        )
        if at_once:
            const = not s.mutable and s.name not in self.plan.shared
            declared = self._declare(s.name, t, self.expr(s.value), const=const)
            return self._marked(declared, s.name, used)
        declared = c.Declare(self.types.stored(t), name, None)
        value = self.into(self.place(s.name), s.name, t, s.value)
        return [declared, *value, c.Unused(name)]

    def _call(self, s: core.Call, used: set[str]) -> list[c.CStmt]:
        name, faults = self.functions[s.function]
        statements, arguments = self.arguments(s.arguments)
        end = (FAULT,) if faults else ()
        if not self.types.is_large(s.type):
            call = c.CallExpr(name, (*arguments, *end))
            made = self._declare(s.name, s.type, call, const=True)
            return [*statements, *self._marked(made, s.name, used)]
        if self.is_own(s.name):
            statements.append(c.Declare(self.types.stored(s.type), self.local(s.name), None))
        target = c.address(self.place(s.name))
        return [*statements, c.Do(c.CallExpr(name, (*arguments, target, *end)))]

    def _set(self, s: core.Set) -> list[c.CStmt]:
        if s.name == self._leave:
            return list(self._leaving)
        if id(s) in self.plan.idle:
            return []
        target, t = self._target(s.name, s.type, s.path)
        if self.types.is_large(t):
            return self.into(target, s.name, t, s.value) or self._not_set(s.name)
        value = self.expr(s.value)
        if value == target:
            return self._not_set(s.name)
        return [c.Assign(target, self.types.to_store(t, value) if s.path else value)]

    def _not_set(self, name: str) -> list[c.CStmt]:
        """`x = x` emits no assignment, only a mark that keeps compilers from warning of `x`."""
        return [c.Unused(self.local(name))] if self.is_own(name) else []

    def _branch(self, s: core.If, *, taken: bool) -> list[c.CStmt]:
        """Emits the call that counts this side of an `if` for coverage, if coverage is wanted."""
        if self.choices is None or self.choices.branches is None:
            return []
        number = c.Number(f"{len(self.choices.branches)}U")
        self.choices.branches.append(StepBranch(self.choices.component, s.span, taken))
        return [c.Do(c.CallExpr("soter_branch", (c.Name("answer"), FAULT, number)))]

    def _choose(self, s: core.Choose) -> c.CStmt:
        """Declares a chosen value; after a fault the step asks nobody and takes the first."""
        assert self.choices is not None
        header = c.Unary("&", c.Arrow(c.Name("s"), "header"))
        key = stream_key(f"{self.choices.component}.choose")
        made = c.Unary("&", c.Name("made"))
        whom = c.Name("NULL" if self.choices.chance else "answer")
        arguments: tuple[c.CExpr, ...] = (header, whom, key, c.Name("release"), made)
        function = "soter_choose"
        if s.ages is not None:
            function = "soter_choose_fair"
            arguments = (*arguments, c.Member(c.Name(self.local(s.ages)), "at"))
        call = c.CallExpr(function, (*arguments, c.Number(f"{s.count}U")))
        fine = c.Binary("==", c.Unary("*", FAULT), c.Name("SOTER_OK"))
        value: c.CExpr = c.Ternary(fine, call, c.Number("0U"))
        if isinstance(s.type, BoolType):
            value = c.Binary("!=", value, c.Number("0U"))
        else:
            value = c.Cast("int64_t", value)
            if s.low != 0:
                value = c.Binary("+", int_number(s.low), value)
            value = value if isinstance(s.type, IntType) else self.types.to_store(s.type, value)
        return self._declare(s.name, s.type, value, const=True)

    def _inner(self, statements: tuple[core.Stmt, ...], used: set[str]) -> tuple[c.CStmt, ...]:
        return tuple([made for s in statements for made in self.statement(s, used)])

    def _declare(self, name: str, t: Type, value: c.CExpr, *, const: bool) -> c.CStmt:
        return c.Declare(self.types.work(t), self.local(name), value, const)

    def _marked(self, s: c.CStmt, name: str, used: set[str]) -> list[c.CStmt]:
        return [s] if name in used else [s, c.Unused(self.local(name))]

    def _checked(self, s: core.Checked) -> c.CStmt:
        operands = [self.expr(o) for o in s.operands]
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            operands += [int_number(s.type.low), int_number(s.type.high)]
        elif s.op == "index":
            assert s.limit is not None
            operands.append(self._limit(s.limit))
        call = c.CallExpr(f"soter_{s.op}", (*operands, FAULT))
        return self._declare(s.name, s.type, call, const=True)

    def _limit(self, limit: core.Expr) -> c.CExpr:
        """The bound of an index: a list's length, visibly to compilers at most its capacity."""
        e = self.expr(limit)
        if not isinstance(limit, core.Length):
            return e
        assert isinstance(limit.target.type, ListType)
        return c.CallExpr("soter_min_int", (e, c.Number(str(limit.target.type.capacity))))

    def _target(
        self, name: str, t: Type, path: tuple[int | core.Expr, ...]
    ) -> tuple[c.CExpr, Type]:
        target = self.place(name)
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

    def _push(self, s: core.Push) -> list[c.CStmt]:
        target, t = self._target(s.name, s.type, s.path)
        assert isinstance(t, ListType)
        return self._append(target, t, s.value, s.name)

    def _append(self, target: c.CExpr, t: ListType, e: core.Expr, root: str) -> list[c.CStmt]:
        """Appends a value to a list; a full list raises a capacity fault.

        The C also tests that the length is not negative: a step may compare it with a negative
        number, and a compiler would then warn of an index that no execution has.
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
                    *self.into(end, root, t.element, e),
                    c.Assign(length, c.Binary("+", length, c.Number("1"))),
                ),
            ),
        ]


def _leaves(block: list[c.CStmt] | tuple[c.CStmt, ...]) -> bool:
    """Whether control never comes to the end of a block."""
    if not block:
        return False
    last = block[-1]
    if isinstance(last, c.IfStmt):
        return _leaves(last.then) and _leaves(last.otherwise)
    return isinstance(last, c.Return)
