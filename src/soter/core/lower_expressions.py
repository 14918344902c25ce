"""Lowers typed expressions to Core, into the current block; types and vector values in Core.

Purpose: the strict order from left to right made explicit: whatever may fault becomes a statement,
the rest stays a pure expression; names and blocks; records and arrays leaf by leaf.
Non-goals: statements and functions (`lower_statements.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from soter.core import core
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    MODE,
    ArrayType,
    DurationType,
    FloatType,
    IntType,
    RecordType,
    default_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.model import typed
    from soter.language.model.system import Scope, System
    from soter.language.model.types import Type, Value


def core_type(t: Type) -> Type:
    """Gives the type in Core: a duration is the int of its nanoseconds."""
    return INT if isinstance(t, DurationType) else t


def positions_and_types(t: Type) -> list[tuple[tuple[int, ...], Type]]:
    """Gives the positions and type of each leaf of a vector type, in order."""
    if isinstance(t, FloatType):
        return [((), t)]
    selections: list[tuple[tuple[int, ...], Type]] = []
    parts = (
        [(i, f) for i, (_, f) in enumerate(t.fields)]
        if isinstance(t, RecordType)
        else [(i, t.element) for i in range(t.size)]
        if isinstance(t, ArrayType)
        else []
    )
    for i, part in parts:
        selections.extend(((i, *path), leaf) for path, leaf in positions_and_types(part))
    return selections


def select(e: core.Expr, path: tuple[int, ...]) -> core.Expr:
    """Gives the part of `e` at a path of constant indices of fields and elements."""
    for i in path:
        t = e.type
        if isinstance(e, core.Make):
            e = e.elements[i]
        elif isinstance(t, RecordType):
            e = core.Field(t.fields[i][1], e, i)
        else:
            assert isinstance(t, ArrayType)
            e = core.Element(t.element, e, core.Const(INT, i))
    return e


def rebuild(
    t: Type, leaf: Callable[[tuple[int, ...]], core.Expr], path: tuple[int, ...] = ()
) -> core.Expr:
    """Gives a vector value whose leaf at each path is `leaf(path)`."""
    if isinstance(t, RecordType):
        parts = [rebuild(f, leaf, (*path, i)) for i, (_, f) in enumerate(t.fields)]
        return core.Make(t, tuple(parts))
    if isinstance(t, ArrayType):
        parts = [rebuild(t.element, leaf, (*path, i)) for i in range(t.size)]
        return core.Make(t, tuple(parts))
    return leaf(path)


INT_OPS = {"+": "add", "-": "sub", "*": "mul", "/": "div", "%": "mod"}


class Functions(Protocol):
    """The part of `FunctionTable` that expressions use."""

    by_name: dict[str, core.Function]

    def lowered_function(
        self,
        fun: typed.FunSymbol,
        params: Mapping[typed.ParamSymbol, Value],
        maybe_nan: frozenset[typed.TypedExpr] = frozenset(),
    ) -> core.Function:
        """Gives the Core function of a source function for these values of parameters."""


class ExpressionBuilder:
    """Lowers expressions, and keeps the blocks that they emit statements into."""

    def __init__(
        self,
        functions: Functions,
        system: System,
        scope: Scope | None,
        params: Mapping[typed.ParamSymbol, Value] | None = None,
    ) -> None:
        self.functions = functions
        self.system = system
        self.scope = scope
        self.params = scope.params if params is None and scope is not None else params or {}
        self.names: dict[typed.Variable, str] = {}
        self._taken: set[str] = set()
        self._blocks: list[list[core.Stmt]] = [[]]
        self.period_ns = 0
        self.can_fault = False
        self.maybe_nan: frozenset[typed.TypedExpr] = frozenset()
        """Compared operands that are checked for NaN, which is a fault in `ttf` and `safer`."""
        self.published: dict[typed.TopicSymbol, tuple[int | None, str]] = {}
        """Topics that read as what the step publishes: the output's number (None: surely
        published), and the temporary that has it."""

    # ------------------------------------------------------------ names and blocks

    def unused_name(self, base: str) -> str:
        """Gives a name that is not used yet, made from `base`."""
        name, n = base, 2
        while name in self._taken:
            name = f"{base}_{n}"
            n += 1
        self._taken.add(name)
        return name

    def name_variable(self, variable: typed.Variable, name: str | None = None) -> str:
        """Names the temporary of a variable; gives the name."""
        chosen = self.unused_name(name or variable.name.replace(" ", "_"))  # a hidden local's
        self.names[variable] = chosen
        return chosen

    def emit(self, stmt: core.Stmt) -> None:
        """Appends a statement to the current block."""
        if isinstance(stmt, (core.Checked, core.Guard, core.Push)) or (
            isinstance(stmt, core.Call) and self.functions.by_name[stmt.function].can_fault
        ):
            self.can_fault = True
        self._blocks[-1].append(stmt)

    def statements_of(
        self, action: Callable[[], core.Expr | None]
    ) -> tuple[tuple[core.Stmt, ...], core.Expr | None]:
        """Runs `action`; gives the statements it emitted, and the expression it returned."""
        self._blocks.append([])
        value = action()
        return tuple(self._blocks.pop()), value

    def take_statements(self) -> tuple[core.Stmt, ...]:
        """Gives and removes all statements that were emitted at the outermost level."""
        block = tuple(self._blocks[0])
        self._blocks[0] = []
        return block

    def let(self, span: Span, base: str, value: core.Expr, *, mutable: bool = False) -> core.Var:
        """Emits a new temporary that holds `value`, and gives its variable."""
        name = self.unused_name(base)
        self.emit(core.Let(span, name, value, mutable))
        return core.Var(value.type, name)

    def atom(self, e: core.Expr, span: Span, base: str = "t") -> core.Expr:
        """Gives an expression for `e` that code may repeat; emits a temporary if needed."""
        probe = e
        while isinstance(probe, core.Field):
            probe = probe.target
        if isinstance(probe, (core.Var, core.Const)):
            return e
        return self.let(span, base, e)

    # ------------------------------------------------------------ expressions

    def expr(self, e: typed.TypedExpr) -> core.Expr:
        """Gives a pure Core expression for `e`; emits statements for operations that may fault."""
        method = getattr(self, "_lower_" + type(e).__name__.removeprefix("Typed").lower())
        result = method(e)
        assert isinstance(result, core.Expr)
        return result

    def _lower_literal(self, e: typed.Literal) -> core.Expr:
        return core.Const(core_type(e.type), e.value, e.name)

    def _lower_paramread(self, e: typed.ParamRead) -> core.Expr:
        return core.Const(core_type(e.type), self.params[e.param], e.param.name)

    def _lower_varread(self, e: typed.VarRead) -> core.Expr:
        return core.Var(e.type, self.names[e.variable])

    def topic_cell(self, topic: typed.TopicSymbol) -> core.Cell:
        """Gives the state cell of a topic in this scope."""
        assert self.scope is not None
        index = self.scope.topics[topic]
        return core.Cell("topic", index, self.system.topics[index].name)

    def _lower_topicread(self, e: typed.TopicRead) -> core.Expr:
        """Gives the value of a topic; after a step's body what the step published, if anything."""
        old = core.Get(e.type, self.topic_cell(e.topic))
        new = self.published.get(e.topic)
        if new is None or new[0] is None:
            return old if new is None else core.Var(e.type, new[1])
        value = core.Var(e.type, new[1])
        return core.Select(e.type, core.Fact(BOOL, "published", new[0]), value, old)

    def _lower_truthread(self, e: typed.TruthRead) -> core.Expr:
        assert self.scope is not None
        owner = self.scope.plants[e.instance]
        assert isinstance(e.type, RecordType)
        return core.Make(
            e.type, tuple(core.Get(t, core.Cell("state", owner, n)) for n, t in e.type.fields)
        )

    def _lower_moderead(self, e: typed.ModeRead) -> core.Expr:
        assert self.scope is not None
        return core.Fact(e.type, "mode", self.scope.modules[e.module])

    def _lower_marginread(self, e: typed.MarginRead) -> core.Expr:
        """Gives (looks * period - late - age) / 1e9 in mode AC if that is positive, else 0.

        The computation is in whole ns, which floats hold exactly, as a period is below 2^53 ns.
        """
        assert self.scope is not None
        module = self.system.modules[self.scope.modules[e.module]]
        assert module.looked is not None, module.name
        topic = self.system.topics[module.looked]

        def infix(name: str, left: core.Expr, right: float | core.Expr) -> core.Expr:
            other = core.Const(FLOAT, right) if isinstance(right, float) else right
            return core.Binary(BOOL if name == ">" else FLOAT, name, left, other)

        looks = core.Get(topic.type, core.Cell("topic", topic.index, topic.name))
        room = infix("*", core.Unary(FLOAT, "to_float", looks), float(module.period_ns))
        seconds = core.Fact(FLOAT, "age", topic.index)
        age = core.Unary(FLOAT, "floor", infix("+", infix("*", seconds, 1e9), 0.5))
        left = self.atom(infix("-", infix("-", room, float(module.late_ns)), age), e.span, "left")
        mode = core.Fact(MODE, "mode", module.index)
        in_ac = core.Binary(BOOL, "==", mode, core.Const(MODE, MODE.members.index("AC")))
        some = core.Binary(BOOL, "&&", in_ac, infix(">", left, 0.0))
        return core.Select(FLOAT, some, infix("/", left, 1e9), core.Const(FLOAT, 0.0))

    def _lower_incontrol(self, e: typed.InControl) -> core.Expr:
        return core.Fact(e.type, "in_control")

    def _lower_timeread(self, e: typed.TimeRead) -> core.Expr:
        return core.Fact(e.type, "time")

    def _lower_periodread(self, e: typed.PeriodRead) -> core.Expr:
        return core.Const(e.type, float(self.period_ns) / 1e9, "dt")

    def _lower_ageread(self, e: typed.AgeRead) -> core.Expr:
        index = self.topic_cell(e.topic).owner
        source = self.system.topics[index].queue_of  # a queue is as old as its topic
        return core.Fact(e.type, "age", index if source is None else source)

    def _lower_unary(self, e: typed.TypedUnary) -> core.Expr:
        operand = self.expr(e.operand)
        if e.op == "!":
            return core.Unary(BOOL, "not", operand)
        if isinstance(e.type, IntType):
            return self._emit_checked(e.span, "neg", INT, (operand,))
        if isinstance(e.type, FloatType):
            return core.Unary(FLOAT, "neg", operand)
        source = self.atom(operand, e.span, "v")
        return rebuild(e.type, lambda p: core.Unary(FLOAT, "neg", select(source, p)))

    def _emit_checked(
        self,
        span: Span,
        op: str,
        t: Type,
        operands: tuple[core.Expr, ...],
        limit: core.Expr | None = None,
    ) -> core.Expr:
        name = self.unused_name({"index": "i", "narrow": "n"}.get(op, op))
        self.emit(core.Checked(span, name, t, op, operands, limit))
        return core.Var(t, name)

    def _lower_binary(self, e: typed.TypedBinary) -> core.Expr:
        if e.op in {"&&", "||"}:
            return self._lower_short_circuit(e)
        if e.type == BOOL:
            return core.Binary(
                BOOL, e.op, self._checked_for_nan(e.left), self._checked_for_nan(e.right)
            )
        left = self.expr(e.left)
        right = self.expr(e.right)
        if isinstance(e.type, (IntType, DurationType)):
            return self._emit_checked(e.span, INT_OPS[e.op], INT, (left, right))
        if e.op == "/":
            right = self._nonzero_divisor(right, e.right.span)
        return core.Binary(FLOAT, e.op, left, right)

    def _checked_for_nan(self, operand: typed.TypedExpr) -> core.Expr:
        """Gives an operand of a comparison; if it may be NaN, emits a check that faults for NaN."""
        value = self.expr(operand)
        if operand not in self.maybe_nan:
            return value
        if isinstance(operand.type, FloatType):
            return self._emit_checked(operand.span, "number", FLOAT, (value,))
        value = self.atom(value, operand.span, "v")
        for path, _ in positions_and_types(operand.type):
            self._emit_checked(operand.span, "number", FLOAT, (select(value, path),))
        return value

    def _nonzero_divisor(self, right: core.Expr, span: Span) -> core.Expr:
        if isinstance(right, core.Const) and right.value != 0.0:
            return right
        right = self.atom(right, span, "d")
        nonzero = core.Binary(BOOL, "!=", right, core.Const(FLOAT, 0.0))
        self.emit(core.Guard(span, nonzero, FaultKind.DIVIDE))
        return right

    def _lower_short_circuit(self, e: typed.TypedBinary) -> core.Expr:
        left = self.expr(e.left)
        if isinstance(left, core.Const):
            return self.expr(e.right) if left.value == (e.op == "&&") else left
        block, right = self.statements_of(lambda: self.expr(e.right))
        assert right is not None
        if not block:
            return core.Binary(BOOL, e.op, left, right)
        result = self.let(e.span, "both" if e.op == "&&" else "either", left, mutable=True)
        block = (*block, core.Set(e.span, result.name, BOOL, (), right))
        condition: core.Expr = result if e.op == "&&" else core.Unary(BOOL, "not", result)
        self.emit(core.If(e.span, condition, block, ()))
        return result

    def _lower_vector(self, e: typed.Vector) -> core.Expr:
        left = self.atom(self.expr(e.left), e.left.span, "a")
        right_value = self.expr(e.right)
        right_is_scalar = isinstance(e.right.type, FloatType)
        if e.op == "/":
            right = self._nonzero_divisor(right_value, e.right.span)
        else:
            right = self.atom(right_value, e.right.span, "b")
        left_is_scalar = isinstance(e.left.type, FloatType)

        def leaf_of_vector(path: tuple[int, ...]) -> core.Expr:
            a = left if left_is_scalar else select(left, path)
            b = right if right_is_scalar else select(right, path)
            return core.Binary(FLOAT, e.op, a, b)

        return rebuild(e.type, leaf_of_vector)

    def _lower_conditional(self, e: typed.Conditional) -> core.Expr:
        condition = self.expr(e.condition)
        if isinstance(condition, core.Const):
            return self.expr(e.then if condition.value else e.otherwise)
        then_block, then = self.statements_of(lambda: self.expr(e.then))
        else_block, otherwise = self.statements_of(lambda: self.expr(e.otherwise))
        assert then is not None
        assert otherwise is not None
        t = core_type(e.type)
        if not then_block and not else_block:
            return core.Select(t, condition, then, otherwise)
        result = self.let(e.span, "chosen", core.Const(t, default_value(t)), mutable=True)
        set_then = core.Set(e.span, result.name, t, (), then)
        set_else = core.Set(e.span, result.name, t, (), otherwise)
        self.emit(core.If(e.span, condition, (*then_block, set_then), (*else_block, set_else)))
        return result

    def _lower_call(self, e: typed.TypedCall) -> core.Expr:
        arguments = tuple(self.expr(a) for a in e.arguments)
        function = self.functions.lowered_function(e.fun, self.params, self.maybe_nan)
        name = self.unused_name(e.fun.name.rsplit(".", 1)[-1].lower())
        self.emit(core.Call(e.span, name, function.name, arguments, e.type))
        return core.Var(e.type, name)

    def _lower_builtin(self, e: typed.Builtin) -> core.Expr:
        if e.name == "seconds":
            return self._seconds_of_ns(self.expr(e.arguments[0]))
        compares = e.name in {"min", "max", "saturate"}
        arguments = [self._checked_for_nan(a) if compares else self.expr(a) for a in e.arguments]
        first = arguments[0]
        if e.name in {"sqrt", "floor"}:
            return core.Unary(FLOAT, e.name, first)
        if e.name == "abs":
            if isinstance(e.type, IntType):
                return self._emit_checked(e.span, "abs", INT, (first,))
            return core.Unary(FLOAT, "abs", first)
        if e.name in {"min", "max"}:
            a = self.atom(first, e.span, "a")
            b = self.atom(arguments[1], e.span, "b")
            return core.Extreme(e.type, e.name, a, b)
        if e.name == "float":
            return (
                first if isinstance(first.type, FloatType) else core.Unary(FLOAT, "to_float", first)
            )
        if e.name == "int":
            if isinstance(first.type, IntType):
                return first
            return self._emit_checked(e.span, "to_int", INT, (first,))
        if e.name == "dot":
            return self._dot_product(
                self.atom(first, e.span, "a"), self.atom(arguments[1], e.span, "b")
            )
        if e.name == "norm":
            v = self.atom(first, e.span, "v")
            return core.Unary(FLOAT, "sqrt", self._dot_product(v, v))
        assert e.name == "saturate"
        v = self.atom(first, e.span, "v")
        limit = self.atom(arguments[1], e.span, "limit")
        low = self.atom(core.Unary(FLOAT, "neg", limit), e.span, "low")

        def saturated_leaf(path: tuple[int, ...]) -> core.Expr:
            raised = self.let(e.span, "r", core.Extreme(FLOAT, "max", select(v, path), low))
            return core.Extreme(FLOAT, "min", raised, limit)

        return rebuild(e.type, saturated_leaf)

    def _seconds_of_ns(self, ns: core.Expr) -> core.Expr:
        if isinstance(ns, core.Const):
            return core.Const(FLOAT, float(ns.value) / 1e9, ns.name)
        whole = core.Unary(FLOAT, "to_float", ns)
        return core.Binary(FLOAT, "/", whole, core.Const(FLOAT, 1e9))

    def _dot_product(self, a: core.Expr, b: core.Expr) -> core.Expr:
        total: core.Expr | None = None
        for path, _ in positions_and_types(a.type):
            product = core.Binary(FLOAT, "*", select(a, path), select(b, path))
            total = product if total is None else core.Binary(FLOAT, "+", total, product)
        assert total is not None
        return total

    def _lower_field(self, e: typed.TypedField) -> core.Expr:
        target = self.expr(e.target)
        if isinstance(target, core.Make):
            return target.elements[e.index]
        return core.Field(e.type, target, e.index)

    def _lower_index(self, e: typed.Index) -> core.Expr:
        target = self.expr(e.target)
        if not isinstance(target, core.Const):
            target = self._indexable_expr(target, e.target.span)
        index = self.index_inside(target, self.expr(e.index), e.index.span)
        return core.Element(e.type, target, index)

    def _indexable_expr(self, e: core.Expr, span: Span) -> core.Expr:
        """Gives `e` if code can index it directly; else a new temporary that holds its value."""
        probe = e
        while isinstance(probe, (core.Field, core.Element)):
            probe = probe.target
        return e if isinstance(probe, (core.Var, core.Get, core.Const)) else self.let(span, "v", e)

    def index_inside(self, target: core.Expr, index: core.Expr, span: Span) -> core.Expr:
        """Gives an index that is surely inside; emits a check that faults if `index` is outside."""
        t = target.type
        if isinstance(t, ArrayType):
            if isinstance(index, core.Const) and 0 <= index.value < t.size:
                return index
            return self._emit_checked(span, "index", INT, (index,), core.Const(INT, t.size))
        return self._emit_checked(span, "index", INT, (index,), core.Length(INT, target))

    def _lower_length(self, e: typed.TypedLength) -> core.Expr:
        return core.Length(INT, self._indexable_expr(self.expr(e.target), e.span))

    def _lower_aggregate(self, e: typed.Aggregate) -> core.Expr:
        values = [self.expr(x) for x in e.elements]
        if e.order is not None:
            ordered = list(values)
            for position, index in enumerate(e.order):
                ordered[index] = values[position]
            values = ordered
        return core.Make(e.type, tuple(values))

    def _lower_choose(self, e: typed.TypedChoose) -> core.Expr:
        """Gives the choice; first emits the options from left to right, then the choice."""
        options = [self.atom(self.expr(o), o.span, "option") for o in e.options]
        ages = None if e.ages is None else self.names[e.ages]
        t = INT if options else core_type(e.type)
        name = self.unused_name("choice")
        self.emit(core.Choose(e.span, name, t, e.count, 0 if options else e.low, ages))
        chosen = core.Var(t, name)
        if not options:
            return chosen
        value = options[-1]
        for k in range(len(options) - 2, -1, -1):
            is_k = core.Binary(BOOL, "==", chosen, core.Const(INT, k))
            value = core.Select(value.type, is_k, options[k], value)
        return self.let(e.span, "chosen", value)

    def _lower_narrow(self, e: typed.Narrow) -> core.Expr:
        operand = self.expr(e.operand)
        have, want = e.operand.type, e.type
        assert isinstance(have, IntType)
        assert isinstance(want, IntType)
        if want.low <= have.low and have.high <= want.high:
            return operand
        return self._emit_checked(e.span, "narrow", e.type, (operand,))
