"""Checks that Core keeps what the head of `core.py` promises.

Purpose: `broken_promises` names every place where Core breaks one, by rules that know nothing of
how it was lowered: expressions are pure, and of the right types; what may fault is checked before
(divisors, indices, operations on ints); temporaries are defined once, and before they are used; a
function stands before its calls, so that none recurs; loops have constant ends; once a function has
left, nothing has an effect. What lowers functions, steps and predicates asserts that none is
broken: every proof, run and test is of Core that was checked.
Non-goals: whether Core means what the program means (the interpreter is compared with it);
whether an int that is stored lies in its range, which gates ask; footprints.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_text import changed_part
from soter.core.core_walks import walk, written_names
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    MODE,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.language.model.values import Table, is_value

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import TypeAlias

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import System
    from soter.language.model.types import Type

    Part: TypeAlias = core.Function | core.NodeStep | core.PlantStep | core.Predicate
    Rule: TypeAlias = tuple[Type | None, list[tuple[core.Expr, Type | None]]]
    """The type that an expression should have, and each part with its own; None: there is none."""

ARITHMETIC, ORDER = frozenset("+-*/"), frozenset(("<", "<=", ">", ">="))
UNARY = dict.fromkeys(("neg", "sqrt", "floor", "abs"), (FLOAT, FLOAT)) | {
    "not": (BOOL, BOOL),
    "to_float": (INT, FLOAT),
}
"""Operator -> type of its operand, of its value."""
CHECKED: dict[str, tuple[tuple[Type, ...], Type]] = {
    **dict.fromkeys(("add", "sub", "mul", "div", "mod"), ((INT, INT), INT)),
    **dict.fromkeys(("neg", "abs", "narrow", "index"), ((INT,), INT)),
    "to_int": ((FLOAT,), INT),
    "number": ((FLOAT,), FLOAT),
}
"""Operation that may fault -> types of its operands, of its value."""
ZERO = core.Const(INT, 0)
FACTS = {"time": FLOAT, "age": FLOAT, "in_control": BOOL, "published": BOOL, "mode": MODE}


def broken_promises(
    system: System, functions: Mapping[str, core.Function], part: Part
) -> list[str]:
    """Gives a sentence for each promise that a part breaks; `functions`: those it may call."""
    body = _Body(system, functions)
    if isinstance(part, core.Function):
        body.check_function(part)
    elif isinstance(part, core.NodeStep):
        body.check_node(part)
    elif isinstance(part, core.PlantStep):
        body.check_plant(part)
    else:
        body.span = part.span
        body.check_block(part.body)
        body.check_value(part.value, FLOAT if part.value.type == FLOAT else BOOL)
    return body.found


def fits_into(have: Type, want: Type | None) -> bool:
    """Whether every value of type `have` is one of type `want`; ints by their ranges."""
    if isinstance(have, IntType) and isinstance(want, IntType):
        return want.low <= have.low and have.high <= want.high
    return have == want


def part_types(t: Type, count: int = 0) -> list[Type]:
    """Gives the types of a value's parts; for a list, of `count` elements or as many as fit."""
    if isinstance(t, RecordType):
        return [f for _, f in t.fields]
    if isinstance(t, ListType):
        return [t.element] * min(count, t.capacity)
    return [t.element] * t.size if isinstance(t, ArrayType) else []


def _comparison(left: core.Expr, op: str, right: core.Expr) -> core.Expr:
    return core.Binary(BOOL, op, left, right)


@dataclass
class _Body:
    """Checks the code of one function, step or predicate."""

    system: System
    functions: Mapping[str, core.Function]
    found: list[str] = field(default_factory=list)
    span: Span | None = None
    scope: dict[str, Type] = field(default_factory=dict)
    mutable: set[str] = field(default_factory=set)
    taken: set[str] = field(default_factory=set)
    facts: set[core.Expr] = field(default_factory=set)
    """Conditions that hold here unless the step has already faulted."""
    outputs: tuple[core.Output, ...] = ()
    pure: bool = False
    """Whether the code may read its parameters only, as functions do."""

    def require(self, holds: bool, message: str) -> None:
        """Adds the message to the broken promises, unless `holds`."""
        if not holds:
            where = f"{self.span.source.name}:{self.span.line}: " if self.span else ""
            self.found.append(where + message)

    # ------------------------------------------------------------ functions, steps, predicates

    def check_function(self, f: core.Function) -> None:
        """Checks a function, which reads its parameters only and has one exit."""
        self.pure, self.span = True, f.span
        for p in f.parameters:
            self.define_temporary(p.name, p.type)
        self.check_block(f.body)
        if f.result is not None:
            self.check_value(f.result, f.result_type)
        self.require(f.result is not None or not f.body, "a body without a result")
        called = [self.functions.get(s.function) for s in walk(f.body) if isinstance(s, core.Call)]
        fault = any(isinstance(s, (core.Checked, core.Guard, core.Push)) for s in walk(f.body))
        fault = fault or any(g is not None and g.can_fault for g in called)
        self.require(f.can_fault or not fault, "it may fault and does not say so")
        if f.leave is not None:
            self.may_have_left(f.body, f.leave, left=False)

    def check_node(self, step: core.NodeStep) -> None:
        """Checks the step of a node: its takeover block, body and shield."""
        self.outputs, self.span = step.outputs, step.span
        self.define_copies(step.locals, (*step.takeover, *step.body))
        self.check_inner_block(step.takeover)
        self.check_block(step.body)
        if step.shield is not None:
            for k, o in enumerate(step.outputs):
                self.define_temporary(core.output_name(k), o.type, mutable=True)
            self.check_block(step.shield.body)

    def check_plant(self, step: core.PlantStep) -> None:
        """Checks one release of a plant."""
        self.outputs, self.span = step.outputs, step.span
        self.define_copies(step.states, step.integrate)
        for name, t, _ in step.disturbances:
            self.define_temporary(name, t)
        self.check_block(step.choose)
        self.check_inner_block(step.integrate)
        self.check_block(step.publish)

    def define_copies(
        self, copies: tuple[core.LocalCopy, ...], code: tuple[core.Stmt, ...]
    ) -> None:
        """Defines the temporaries that copy cells; those that the code changes must be stored."""
        changed = written_names(code)
        for c in copies:
            self.define_temporary(c.name, c.type, mutable=True)
            self.require(c.written or c.name not in changed, f"`{c.name}` is changed, not stored")

    # ------------------------------------------------------------ statements

    def define_temporary(self, name: str, t: Type, *, mutable: bool = False) -> None:
        self.require(name not in self.taken, f"`{name}` is defined twice")
        self.taken.add(name)
        self.scope[name] = t
        if mutable:
            self.mutable.add(name)

    def check_block(self, statements: tuple[core.Stmt, ...]) -> None:
        """Checks statements one after the other."""
        for s in statements:
            rule = getattr(self, f"_check_{type(s).__name__.lower()}", None)
            if isinstance(s, core.Stmt) and rule is not None:
                self.span = s.span
                rule(s)
            else:
                self.require(False, f"{type(s).__name__} is no statement")

    def check_inner_block(self, statements: tuple[core.Stmt, ...], *facts: core.Expr) -> None:
        """Checks a block whose temporaries end with it, and in which `facts` hold."""
        scope, before = dict(self.scope), set(self.facts)
        self.facts |= set(facts)
        self.check_block(statements)
        self.scope, self.facts = scope, before
        self.forget_facts(written_names(statements))

    def forget_facts(self, names: set[str]) -> None:
        self.facts = {
            fact
            for fact in self.facts
            if not any(isinstance(e, core.Var) and e.name in names for e in walk(fact))
        }

    def _check_let(self, s: core.Let) -> None:
        self.check_expr(s.value)
        self.define_temporary(s.name, s.value.type, mutable=s.mutable)

    def _check_checked(self, s: core.Checked) -> None:
        operands, result = CHECKED.get(s.op, ((), None))
        self.require(len(operands) == len(s.operands), f"`{s.op}` of {len(s.operands)} operands")
        for e, t in zip(s.operands, operands, strict=False):
            self.check_value(e, t)
        self.require(fits_into(s.type, result), f"`{s.op}` gives no {s.type}")
        self.require((s.op == "index") == (s.limit is not None), f"the limit of `{s.op}`")
        self.define_temporary(s.name, s.type)
        if s.limit is not None:
            self.check_value(s.limit, INT)
            index = core.Var(s.type, s.name)
            self.facts |= {_comparison(index, "<", s.limit), _comparison(index, ">=", ZERO)}

    def _check_choose(self, s: core.Choose) -> None:
        known = isinstance(s.type, (BoolType, EnumType, IntType)) and s.count > 0
        self.require(known and not self.pure, f"a choice among {s.count} of {s.type}")
        if s.ages is not None:
            self.require_variable(s.ages)
        self.define_temporary(s.name, s.type)

    def _check_guard(self, s: core.Guard) -> None:
        self.check_value(s.condition, BOOL)
        self.facts.add(s.condition)

    def _check_call(self, s: core.Call) -> None:
        f = self.functions.get(s.function)
        if f is None:
            self.require(False, f"`{s.function}` does not stand before its call")
        else:
            types = [p.type for p in f.parameters]
            self.require(len(types) == len(s.arguments), f"arguments of `{f.name}`")
            for e, t in zip(s.arguments, types, strict=False):
                self.check_value(e, t)
            self.require(s.type == f.result_type, f"`{f.name}` gives no {s.type}")
        self.define_temporary(s.name, s.type)

    def _check_set(self, s: core.Set) -> None:
        place = changed_part(s)
        self.check_expr(place)
        self.check_value(s.value, place.type)
        self.require_variable(s.name)

    def _check_push(self, s: core.Push) -> None:
        place = changed_part(s)
        self.check_expr(place)
        self.check_value(s.value, place.type.element if isinstance(place.type, ListType) else None)
        self.require_variable(s.name)

    def _check_if(self, s: core.If) -> None:
        self.check_value(s.condition, BOOL)
        self.check_inner_block(s.then, s.condition)
        self.check_inner_block(s.otherwise)

    def _check_loop(self, s: core.Loop) -> None:
        constant = type(s.low) is int and type(s.high) is int and s.low <= s.high
        self.require(constant, f"ends {s.low!r} and {s.high!r} of a loop")
        self.forget_facts(written_names(s.body))
        scope = dict(self.scope)
        self.define_temporary(s.variable, INT)
        index = core.Var(INT, s.variable)
        facts = (_comparison(index, "<", core.Const(INT, s.high)), _comparison(index, ">=", ZERO))
        self.check_inner_block(s.body, *(facts if constant and s.low >= 0 else ()))
        self.scope = scope

    def _check_publish(self, s: core.Publish) -> None:
        known = not self.pure and 0 <= s.output < len(self.outputs)
        t = self.outputs[s.output].type if known else None
        if s.limit is not None and t is not None:
            known = isinstance(t, ListType) and t.capacity == s.limit
            t = t.element if isinstance(t, ListType) else None
        burst = known and self.outputs[s.output].burst
        self.require(known and burst == (s.limit is not None), f"output {s.output}, its limit")
        self.check_value(s.value, t)

    def require_variable(self, name: str) -> None:
        known = name in self.scope and name in self.mutable
        self.require(known, f"`{name}` is changed, which is no variable here")
        self.forget_facts({name})

    # ------------------------------------------------------------ expressions

    def check_value(self, e: core.Expr, t: Type | None) -> None:
        """Checks that an expression has type `t`; None means that no type was found: an error."""
        self.check_expr(e)
        if isinstance(e, core.Expr):
            ints = isinstance(e.type, IntType) and isinstance(t, IntType)
            self.require(ints or e.type == t, f"{type(e).__name__} is {e.type}, not {t}")

    def check_expr(self, e: core.Expr) -> None:
        """Checks that an expression is pure, with parts and a value of the right types."""
        rule = getattr(self, f"_check_{type(e).__name__.lower()}", None)
        if not isinstance(e, core.Expr) or rule is None:
            self.require(False, f"{type(e).__name__} is no pure expression")
            return
        t, parts = rule(e)
        self.require(
            t is not None and fits_into(t, e.type), f"{type(e).__name__} is {t}, not {e.type}"
        )
        for part, wanted in parts:
            self.check_value(part, wanted)

    def _check_const(self, e: core.Const) -> Rule:
        table = isinstance(e.value, Table) and e.value.element == getattr(e.type, "element", None)
        return (e.type if table or is_value(e.type, e.value) else None), []

    def _check_var(self, e: core.Var) -> Rule:
        self.require(e.name in self.scope, f"`{e.name}` is used before it is defined")
        return self.scope.get(e.name, e.type), []

    def _check_get(self, e: core.Get) -> Rule:
        self.require(not self.pure, "a function reads a state cell")
        if e.cell.kind == "topic":
            topic = self.system.topics[e.cell.owner]
            return (topic.type if topic.name == e.cell.name else None), []
        plant = self.system.components[e.cell.owner].plant
        states = () if plant is None or e.cell.kind != "state" else plant.states
        return next((v.type for v in states if v.name == e.cell.name), None), []

    def _check_fact(self, e: core.Fact) -> Rule:
        self.require(not self.pure, f"a function reads `{e.fact}`")
        return FACTS.get(e.fact), []

    def _check_unary(self, e: core.Unary) -> Rule:
        operand, result = UNARY.get(e.op, (None, None))
        return result, [(e.operand, operand)]

    def _check_binary(self, e: core.Binary) -> Rule:
        t: Type | None = INT if isinstance(e.left.type, IntType) else e.left.type
        if e.op in ARITHMETIC:
            t = FLOAT
        elif e.op in ("&&", "||"):
            t = BOOL
        elif e.op in ORDER:
            t = t if t in (INT, FLOAT) else None
        elif e.op not in ("==", "!="):
            t = None
        if e.op == "/" and not (isinstance(e.right, core.Const) and e.right.value != 0.0):
            guarded = _comparison(e.right, "!=", core.Const(FLOAT, 0.0)) in self.facts
            self.require(guarded, "a divisor that was not guarded")
        return FLOAT if e.op in ARITHMETIC else BOOL, [(e.left, t), (e.right, t)]

    def _check_extreme(self, e: core.Extreme) -> Rule:
        number = e.op in ("min", "max") and isinstance(e.type, (IntType, FloatType))
        return (e.type if number else None), [(e.left, e.type), (e.right, e.type)]

    def _check_select(self, e: core.Select) -> Rule:
        return e.type, [(e.condition, BOOL), (e.then, e.type), (e.otherwise, e.type)]

    def _check_field(self, e: core.Field) -> Rule:
        t = e.target.type
        known = isinstance(t, RecordType) and 0 <= e.index < len(t.fields)
        return (part_types(t)[e.index] if known else None), [(e.target, t)]

    def _check_element(self, e: core.Element) -> Rule:
        t = e.target.type
        self.require(self.is_inside(e.index, e.target), "an index that may be outside")
        element = t.element if isinstance(t, (ArrayType, ListType)) else None
        return element, [(e.target, t), (e.index, INT)]

    def is_inside(self, index: core.Expr, target: core.Expr) -> bool:
        """Whether facts show that an index is inside an array or list."""
        t = target.type
        if isinstance(t, ArrayType) and isinstance(index, core.Const):
            return bool(0 <= index.value < t.size)
        size = t.size if isinstance(t, ArrayType) else 0
        below = _comparison(index, "<", core.Length(INT, target)) in self.facts or any(
            fact == _comparison(index, "<", core.Const(INT, fact.right.value))
            and fact.right.value <= size
            for fact in self.facts
            if isinstance(fact, core.Binary) and isinstance(fact.right, core.Const)
        )
        return below and _comparison(index, ">=", ZERO) in self.facts

    def _check_length(self, e: core.Length) -> Rule:
        return (INT if isinstance(e.target.type, ListType) else None), [(e.target, e.target.type)]

    def _check_make(self, e: core.Make) -> Rule:
        types = part_types(e.type, len(e.elements))
        known = len(types) == len(e.elements)
        return (e.type if known else None), list(zip(e.elements, types, strict=False))

    # ------------------------------------------------------------ one exit

    def may_have_left(self, statements: tuple[core.Stmt, ...], leave: str, *, left: bool) -> bool:
        """Whether the function may have returned after these statements; checks those behind."""
        still_here = core.Unary(BOOL, "not", core.Var(BOOL, leave))
        for s in statements:
            if isinstance(s, core.If):
                then = self.may_have_left(s.then, leave, left=left and s.condition != still_here)
                left = self.may_have_left(s.otherwise, leave, left=left) or then or left
            elif isinstance(s, core.Loop):
                left = left or leave in written_names(s.body)
                self.may_have_left(s.body, leave, left=left)
            else:
                harmless = isinstance(s, core.Let) and not s.mutable
                self.require(harmless or not left, "a statement after `return` has an effect")
                left = left or (isinstance(s, core.Set) and s.name == leave)
        return left
