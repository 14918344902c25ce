"""Straight code over several worlds at once, a world a lane.

Purpose: of a step or predicate without whole numbers that differ from world to world, a second C
function that runs it for as many states as a vector holds (`soter_lanes.h`): both sides of a
branch are computed, and a mask says whose is taken; the operations of a lane are those of the step.
Where anything would fault in any world nothing is changed: the caller lets each step alone.
Non-goals: who calls it, and when (`campaign/c/soter_lockstep.c`); what ships, which has no lanes.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.codegen.body import COMPARISONS, stream_key
from soter.codegen.c import tree as c
from soter.codegen.c.names import Unique, field_name
from soter.codegen.c.types import FAULT, float_number, int_number
from soter.codegen.storage.trivial_comparisons import LOGICAL
from soter.core import core
from soter.core.layout import scalar
from soter.language.model.system import queues_of
from soter.language.model.types import ArrayType, BoolType, FloatType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.codegen.function_context import Frame
    from soter.language.model.system import Bound, Component
    from soter.language.model.types import Type

FLOAT, BOOL = "soter_lane_float", "soter_lane_bool"
CT, BAD, MASK = c.Name("given_ct"), c.Name("given_bad"), c.Name("given_mask")
STATES, VERDICTS, LANE = c.Name("given_states"), c.Name("given_verdicts"), c.Name("given_lane")
ALL = c.CallExpr("soter_lane_all_bool", (c.Name("true"),))
NOWHERE = c.CallExpr("soter_lane_all_bool", (c.Name("false"),))
ZERO = c.Number("0U")
LANE_CALLS = {"sqrt": "soter_lane_sqrt", "floor": "soter_lane_floor", "abs": "soter_lane_abs"}
STEP = (("void *const *", "given_states"), ("const uint32_t *", "flags"), ("uint32_t *", "published"))
VERDICT = (("const void *const *", "given_states"), ("bool *", "given_verdicts"))


class NotStraight(Exception):  # noqa: N818 - nothing is wrong
    """This code has no lanes: it says so to `Lanes`, which leaves it out."""


class Lanes:
    """The lanes of one system; what they need stands in `definitions`, in order."""

    def __init__(self, frame: Frame, functions: tuple[core.Function, ...]) -> None:
        self.frame = frame
        self.functions = {f.name: f for f in functions}
        self.definitions: list[c.CTop] = []
        self._names = Unique()
        self._types: dict[Type, str] = {}
        self._choices: dict[Type, str] = {}
        self._made: dict[str, str | None] = {}

    # ------------------------------------------------------------ what has lanes

    def step(
        self, component: Component, step: core.NodeStep | core.PlantStep, name: str
    ) -> str | None:
        """The name of the step of a component over lanes; None where it has none."""
        if not self._may(component, step):
            return None
        body = self._tried(lambda: _Step(self, component, step).statements())
        if body is None:
            return None
        made = f"{name}_lanes"
        self.definitions.append(c.FunctionDef("bool", made, STEP, body, f"{name}_step"))
        return made

    def verdict(self, p: core.Predicate, name: str, *, negate: bool = False) -> str | None:
        """The name of a predicate over lanes; None where it has none."""
        body = self._tried(lambda: _Verdict(self).statements(p, negate=negate))
        if body is None:
            return None
        made = f"{name}_lanes"
        self.definitions.append(c.FunctionDef("bool", made, VERDICT, body, name))
        return made

    def _tried(self, make: Callable[[], list[c.CStmt]]) -> tuple[c.CStmt, ...] | None:
        """What is made; None, and nothing is left of it, where the code is not straight."""
        known = (self._types, self._choices, self._made)
        before = len(self.definitions), *(dict(x) for x in known)
        try:
            return tuple(make())
        except NotStraight:
            del self.definitions[before[0] :]
            self._types, self._choices, self._made = before[1:]
            return None

    def _may(self, component: Component, step: core.NodeStep | core.PlantStep) -> bool:
        system = self.frame.system
        if component.extern or component.held is not None or queues_of(system, component):
            return False
        if any(f.component == component.index and not f.of_time for f in system.faults):
            return False
        if isinstance(step, core.NodeStep) and step.shield is not None:
            return False
        return not any(o.burst or system.topics[o.topic].queues for o in step.outputs)

    # ------------------------------------------------------------ types and functions

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
        self.definitions.append(_inline(c.FunctionDef(lanes, name, parameters, body)))
        return name

    def function(self, name: str) -> str:
        """The function of this name over lanes."""
        if name not in self._made:
            self._made[name] = None
            f = self.functions[name]
            if f.result is None:
                raise NotStraight
            made = f"{self.frame.body.functions[name][0]}_lanes"
            body = _Code(self)
            parameters = tuple((self.type(p.type), body.local(p.name)) for p in f.parameters)
            body.varying |= {p.name for p in f.parameters}
            statements = (*body.block(f.body), c.Return(body.lane(f.result)))
            if body.loads:
                raise NotStraight
            parameters = (*parameters, (BOOL, "given_mask"), (f"{BOOL} *const ", "outer"))
            inner = body.framed(statements, c.Unary("*", c.Name("outer")))
            made_of = c.FunctionDef(self.type(f.result_type), made, parameters, inner)
            self.definitions.append(_inline(made_of))
            self._made[name] = made
        found = self._made[name]
        if found is None:
            raise NotStraight
        return found


def _inline(f: c.FunctionDef) -> c.FunctionDef:
    """A function that compilers put in where it is called: vectors pass through no call."""
    return c.FunctionDef(
        f"SOTER_LANE_INLINE {f.result}", f.name, f.parameters, f.body, f.doc, static=False
    )


class _Code:
    """Core statements over lanes."""

    def __init__(self, lanes: Lanes) -> None:
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

    def has(self, output: int) -> c.Name | None:
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
        return value if varies else self._spread(e.type, value)

    def _spread(self, t: Type, value: c.CExpr) -> c.CExpr:
        """What is the same in every lane."""
        if isinstance(t, FloatType):
            return c.CallExpr("soter_lane_all", (value,))
        if isinstance(t, BoolType):
            return c.CallExpr("soter_lane_all_bool", (value,))
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            for n, f in t.fields:
                own = field_name(n)
                items.append((own, self._spread(f, c.Member(value, own))))
        elif isinstance(t, ArrayType):
            at = c.Member(value, "at")
            each = [
                (None, self._spread(t.element, c.IndexExpr(at, c.Number(str(k)))))
                for k in range(t.size)
            ]
            items.append(("at", c.Initializer(tuple(each))))
        return c.Initializer(tuple(items), self.lanes.type(t))

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
            return f"{outer}.at[{int(e.index.value)}]"  # type: ignore[call-overload]
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
        return c.Initializer(tuple(items), self.lanes.type(t))

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
        return c.CallExpr({"sqrt": "sqrt", "floor": "floor", "abs": "fabs"}[e.op], (operand,))

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
            return [changed, *([] if has is None else [c.Assign(has, c.Binary("|", has, self.mask))])]
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
                c.Declare(self.lanes.type(t), name, self.loaded(path, t), const=True)
                for path, (name, t) in self.loads.items()
            ),
        ]

    def given_up(self) -> c.CStmt:
        """Nothing is changed where a lane faults."""
        return c.IfStmt(c.CallExpr("soter_lane_any", (BAD,)), (c.Return(c.Name("false")),))


class _Verdict(_Code):
    """A predicate over states."""

    def statements(self, p: core.Predicate, *, negate: bool) -> list[c.CStmt]:
        """What it is in each state; false where one faults."""
        self.in_state = self.certain = True
        inner = self.block(p.body)
        value = self.lane(p.value)
        body: list[c.CStmt] = [*inner, c.Declare(BOOL, "given_verdict", value, const=True)]
        body += [*self.fault_told(), self.given_up()]
        each = c.IndexExpr(c.Name("given_verdict"), LANE)
        op = "==" if negate else "!="
        told = c.Assign(
            c.IndexExpr(VERDICTS, LANE), c.Binary(op, each, c.Number("0"))
        )
        body.append(c.For("given_lane", c.Number("0"), c.Name("SOTER_LANES"), (told,)))
        return [*self.opened("const "), *body, c.Return(c.Name("true"))]


class _Step(_Code):
    """A step over states."""

    def __init__(
        self, lanes: Lanes, component: Component, step: core.NodeStep | core.PlantStep
    ) -> None:
        super().__init__(lanes)
        self.component = component
        self.step = step
        self.in_state = self.certain = True
        self.always = lanes.frame.certain(component, step)

    def has(self, output: int) -> c.Name | None:
        """In which lanes the step published an output; None where it always does."""
        if output in self.always:
            return None
        return c.Name("has_" + self.outputs[output].removeprefix("out_"))

    def statements(self) -> list[c.CStmt]:
        """Load, compute, check, store."""
        step = self.step
        plant = isinstance(step, core.PlantStep)
        copies = step.states if isinstance(step, core.PlantStep) else step.locals
        inner: list[c.CStmt] = []
        for x in copies:
            name = self.local(x.name)
            self.varying.add(x.name)
            there = self._load(self.cell(x.cell), x.type)
            inner += [c.Declare(self.lanes.type(x.type), name, there), c.Unused(name)]
        if isinstance(step, core.PlantStep):
            inner += self._disturbances(step)
        unique = Unique()
        topics = [self.lanes.frame.system.topics[o.topic].name for o in step.outputs]
        self.outputs = tuple(f"out_{unique(n.rpartition('.')[2])}" for n in topics)
        for name, o in zip(self.outputs, step.outputs, strict=True):
            default = self._spread(o.type, self.types.default(o.type))
            inner.append(c.Declare(self.lanes.type(o.type), name, default))
        for k in range(len(step.outputs)):
            has = self.has(k)
            if has is not None:
                inner.append(c.Declare(BOOL, has.text, NOWHERE))
        if isinstance(step, core.PlantStep):
            inner += self.block((*step.choose, *step.integrate, *step.publish))
            inner += self._noise(step)
        else:
            inner += self.block(step.body)
        for k, o in enumerate(step.outputs):
            with self._under(self.has(k) or MASK):
                inner += self._checks(o.type, list(o.bounds), c.Name(self.outputs[k]))
        inner += [*self.fault_told(), self.given_up()]
        for x in copies:
            if x.written:
                inner += self._stored(
                    c.Name("soter_lane_always"), self.cell(x.cell), x.type, c.Name(self.local(x.name)), canonical=True
                )
        inner += self._published(gated=not plant and self.component.role != "node")
        return [*self.opened(""), *inner, c.Return(c.Name("true"))]

    def _draws(self, draws: tuple[core.Draw, ...], at: c.CExpr) -> Iterator[c.CExpr]:
        for d in draws:
            hold = d.hold_ns if d.hold_ns > 0 else self.component.period_ns
            index = c.Binary("/", at, int_number(hold))
            low, high = float_number(d.low), float_number(d.high)
            key = c.CallExpr("SOTER_LANE_BITS", (c.Name("header.seed_key"),))
            yield c.CallExpr("soter_lane_draw", (key, stream_key(d.stream), index, low, high))

    def _disturbances(self, step: core.PlantStep) -> list[c.CStmt]:
        began = c.Binary("-", CT, int_number(self.component.period_ns))
        statements: list[c.CStmt] = []
        for name, t, draws in step.disturbances:
            own = self.local(name)
            self.varying.add(name)
            value = self._assembled(t, iter(list(self._draws(draws, began))))
            statements += [c.Declare(self.lanes.type(t), own, value, const=True), c.Unused(own)]
        return statements

    def _assembled(self, t: Type, values: Iterator[c.CExpr]) -> c.CExpr:
        if isinstance(t, FloatType):
            return next(values)
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            items = [(field_name(n), self._assembled(f, values)) for n, f in t.fields]
        elif isinstance(t, ArrayType):
            each = tuple((None, self._assembled(t.element, values)) for _ in range(t.size))
            items = [("at", c.Initializer(each))]
        else:
            raise NotStraight
        return c.Initializer(tuple(items), self.lanes.type(t))

    def _noise(self, step: core.PlantStep) -> list[c.CStmt]:
        from soter.codegen.faults import leaf_of

        statements: list[c.CStmt] = []
        for output, leaf, draw in step.noise:
            target = leaf_of(c.Name(self.outputs[output]), step.outputs[output].type, leaf)
            (error,) = self._draws((core.Draw(draw.stream, draw.low, draw.high, -1),), CT)
            statements.append(c.Assign(target, c.Binary("+", target, error)))
        return statements

    def _checks(self, t: Type, bounds: list[Bound | None], e: c.CExpr) -> Iterator[c.CStmt]:
        """The gate; it takes the bounds of its leaves off the list."""
        if isinstance(t, FloatType):
            bound = bounds.pop(0)
            yield self.fails(c.CallExpr("soter_lane_not_finite", (e,)))
            if bound is not None:
                ends = (float_number(bound.low), float_number(bound.high))
                yield self.fails(c.CallExpr("soter_lane_outside", (e, *ends)))
        elif isinstance(t, BoolType):
            bounds.pop(0)
        elif isinstance(t, RecordType):
            for n, f in t.fields:
                yield from self._checks(f, bounds, c.Member(e, field_name(n)))
        else:
            assert isinstance(t, ArrayType)
            for k in range(t.size):
                at = c.IndexExpr(c.Member(e, "at"), c.Number(str(k)))
                yield from self._checks(t.element, bounds, at)

    def _stored(
        self, on: c.CExpr, path: str, t: Type, e: c.CExpr, *, canonical: bool
    ) -> Iterator[c.CStmt]:
        """Values on their way into the states."""
        if scalar(t) is not None:
            if canonical and isinstance(t, FloatType):
                e = c.CallExpr("soter_lane_canonical", (e,))
            put = "SOTER_LANE_PUT" if isinstance(t, FloatType) else "SOTER_LANE_PUT_BOOL"
            yield c.Do(c.CallExpr(put, (on, c.Name(path), e)))
        elif isinstance(t, RecordType):
            for n, f in t.fields:
                own_field = field_name(n)
                yield from self._stored(
                    on, f"{path}.{own_field}", f, c.Member(e, own_field), canonical=canonical
                )
        else:
            assert isinstance(t, ArrayType)
            for k in range(t.size):
                at = c.IndexExpr(c.Member(e, "at"), c.Number(str(k)))
                yield from self._stored(on, f"{path}.at[{k}]", t.element, at, canonical=canonical)

    def _published(self, *, gated: bool) -> Iterator[c.CStmt]:
        """Publications (n1: only if OE), and which there were."""
        told: c.CExpr = c.Number(f"{sum(1 << k for k in self.always)}U")
        for k in range(len(self.step.outputs)):
            has = self.has(k)
            if has is not None:
                one = c.Ternary(_not_zero(c.IndexExpr(has, LANE)), c.Number(f"{1 << k}U"), ZERO)
                told = c.Binary("|", told, one)
        body = (c.Assign(c.IndexExpr(c.Name("published"), LANE), told),)
        yield c.For(LANE.text, c.Number("0"), c.Name("SOTER_LANES"), body)
        gate = c.Name("given_gate")
        if gated:
            yield c.Declare(BOOL, gate.text, c.CallExpr("SOTER_LANE_ENABLED", (c.Name("flags"),)))
        else:
            yield c.Unused("flags")
        for k, o in enumerate(self.step.outputs):
            has = self.has(k)
            where: list[c.CExpr] = [*([gate] if gated else []), *([] if has is None else [has])]
            on: c.CExpr = where[0] if where else c.Name("soter_lane_always")
            if len(where) > 1:
                on = c.Binary("&", *where)
            topic = f"topics.{self.lanes.frame.topic_field(o.topic)}"
            yield from self._stored(on, topic, o.type, c.Name(self.outputs[k]), canonical=False)
            stamp = c.Name(f"stamps[{o.topic}]")
            yield c.Do(c.CallExpr("SOTER_LANE_PUT_TIME", (on, stamp, CT)))


def _not_zero(e: c.CExpr) -> c.CExpr:
    return c.Binary("!=", e, c.Number("0"))
