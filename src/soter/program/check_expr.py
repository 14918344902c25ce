"""Check expressions: names, types, conversions made explicit.

Purpose: syntax expression + context -> typed expression; on a mistake one diagnostic and an
expression of ERROR type, which keeps everything above it silent.
Non-goals: evaluation, declarations, statements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.scope import BUILTIN_FUNCTIONS, Entry, suggestion
from soter.program.types import (
    BOOL,
    DURATION,
    ERROR,
    FLOAT,
    INT,
    INT_MAX,
    INT_MIN,
    MODE,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    is_vector,
)
from soter.syntax import tree

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.checker import Checker
    from soter.program.context import Context

COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}
SPECIALS = ("in_control", "time", "dt")


def error_expr(span: Span) -> typed.Expr:
    """An expression that was already reported."""
    return typed.Literal(ERROR, span, None)


def is_error(*exprs: typed.Expr) -> bool:
    """Whether any of them was already reported."""
    return any(isinstance(e.type, ErrorType) for e in exprs)


class ExprChecker:
    """Checks expressions of one program."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        self.diagnostics: Diagnostics = checker.diagnostics

    # ------------------------------------------------------------ entry points

    def check(self, expr: tree.Expr, context: Context, expected: Type | None = None) -> typed.Expr:
        """The typed expression; where `expected` is given it has that type (or ERROR)."""
        result = self._dispatch(expr, context, expected)
        if expected is None or is_error(result):
            return result
        return self.convert(result, expected)

    def convert(self, expr: typed.Expr, expected: Type) -> typed.Expr:
        """Fit an expression into a place of type `expected`, or report T001."""
        if isinstance(expected, ErrorType) or is_error(expr):
            return expr
        if expr.type == expected:
            return expr
        if isinstance(expected, IntType) and isinstance(expr.type, IntType):
            return self._narrow(expr, expected)
        if isinstance(expected, FloatType):
            as_float = float_literal(expr)
            if as_float is not None:
                return as_float
        helps: tuple[str, ...] = ()
        if isinstance(expected, FloatType) and isinstance(expr.type, IntType):
            helps = ("convert it: `float(...)`",)
        elif isinstance(expected, IntType) and isinstance(expr.type, FloatType):
            helps = ("convert it: `int(...)` truncates",)
        elif isinstance(expected, DurationType):
            helps = ("write a time with its unit, such as `10ms`",)
        self.diagnostics.error(
            "T001",
            f"expected `{expected}`, found `{expr.type}`",
            expr.span,
            f"this is `{expr.type}`",
            helps=helps,
        )
        return error_expr(expr.span)

    def _narrow(self, expr: typed.Expr, expected: IntType) -> typed.Expr:
        if isinstance(expr, typed.Literal) and not expected.low <= expr.value <= expected.high:
            self.diagnostics.error(
                "T015",
                f"{expr.value} does not fit into `{expected}`",
                expr.span,
                f"allowed: {expected.low} to {expected.high}",
            )
            return error_expr(expr.span)
        assert isinstance(expr.type, IntType)
        if isinstance(expr, typed.Literal) or (
            expected.low <= expr.type.low and expr.type.high <= expected.high
        ):
            if isinstance(expr, typed.Literal):
                return typed.Literal(expected, expr.span, expr.value, expr.name)
            return typed.Narrow(expected, expr.span, expr)
        return typed.Narrow(expected, expr.span, expr)

    # ------------------------------------------------------------ dispatch

    def _dispatch(self, expr: tree.Expr, context: Context, expected: Type | None) -> typed.Expr:
        if isinstance(expr, tree.NameExpr):
            return self._name(expr, context)
        if isinstance(expr, tree.IntLit):
            return self._int(expr, expected)
        if isinstance(expr, tree.FloatLit):
            if expr.value in (float("inf"), float("-inf")):
                self.diagnostics.error(
                    "T016", f"`{expr.text}` is larger than any float", expr.span
                )
                return error_expr(expr.span)
            return typed.Literal(FLOAT, expr.span, expr.value)
        if isinstance(expr, tree.BoolLit):
            return typed.Literal(BOOL, expr.span, expr.value)
        if isinstance(expr, tree.DurationLit):
            return self._duration(expr)
        if isinstance(expr, tree.FieldExpr):
            return self._field(expr, context)
        if isinstance(expr, tree.IndexExpr):
            return self._index(expr, context)
        if isinstance(expr, tree.CallExpr):
            return self._call(expr, context, expected)
        if isinstance(expr, tree.UnaryExpr):
            return self._unary(expr, context, expected)
        if isinstance(expr, tree.BinaryExpr):
            return self._binary(expr, context, expected)
        if isinstance(expr, tree.ConditionalExpr):
            return self._conditional(expr, context, expected)
        if isinstance(expr, tree.RecordExpr):
            return self._record(expr, context, expected)
        if isinstance(expr, tree.ListExpr):
            return self._list(expr, context, expected)
        return error_expr(expr.span)

    def _int(self, expr: tree.IntLit, expected: Type | None) -> typed.Expr:
        if isinstance(expected, FloatType):
            return typed.Literal(FLOAT, expr.span, float(expr.value))
        # 2^63 alone is too large, but -2^63 is written as a negated 2^63: see _unary
        if expr.value > INT_MAX:
            self.diagnostics.error(
                "T016", f"{expr.value} does not fit into 64 bits", expr.span
            )
            return error_expr(expr.span)
        return typed.Literal(INT, expr.span, expr.value)

    def _duration(self, expr: tree.DurationLit) -> typed.Expr:
        if expr.value_ns is None or expr.value_ns > INT_MAX:
            self.diagnostics.error(
                "C005",
                f"`{expr.text}` is not a whole number of nanoseconds that fits 64 bits",
                expr.span,
            )
            return error_expr(expr.span)
        return typed.Literal(DURATION, expr.span, expr.value_ns)

    # ------------------------------------------------------------ names

    def _name(self, expr: tree.NameExpr, context: Context) -> typed.Expr:
        name, span = expr.name.text, expr.span
        local = context.find_local(name)
        if local is not None:
            local.used = True
            return typed.VarRead(local.type, span, local)
        entry = self.checker.names.find(context.scope, name)
        if entry is not None:
            return self._entry(entry, span, context)
        special = self._special(name, span, context)
        if special is not None:
            return special
        if context.instances is not None and name in context.instances:
            self.diagnostics.error(
                "N003",
                f"`{name}` is an instance, not a value",
                span,
                helps=(f"a plant's state is `{name}.truth`, a module's mode `mode({name})`",),
            )
            return error_expr(span)
        if name not in context.scope.broken:
            more = [n for frame in context.locals for n in frame]
            helps = (
                (f"`{name}` is a function: call it",) if name in BUILTIN_FUNCTIONS else ()
            )
            if helps:
                self.diagnostics.error("N003", f"`{name}` is not a value", span, helps=helps)
            else:
                self.checker.names.unknown(context.scope, name, span, (*more, *SPECIALS))
        return error_expr(span)

    def _special(self, name: str, span: Span, context: Context) -> typed.Expr | None:
        if name not in SPECIALS:
            return None
        if name == "in_control" and context.node is not None:
            return typed.InControl(BOOL, span)
        if name == "time" and context.has_time:
            return typed.TimeRead(FLOAT, span)
        if name == "dt" and context.has_period:
            return typed.PeriodRead(FLOAT, span)
        self.diagnostics.error(
            "T013", f"`{name}` has no meaning in {context.where}", span
        )
        return error_expr(span)

    def _entry(self, entry: Entry, span: Span, context: Context) -> typed.Expr:
        symbol = self.checker.resolve(entry, span)
        if symbol is None:
            return error_expr(span)
        if isinstance(symbol, typed.ConstSymbol):
            return typed.Literal(symbol.type, span, symbol.value, symbol.name)
        if isinstance(symbol, typed.ParamSymbol):
            if context.constant:
                self.diagnostics.error(
                    "T008",
                    f"`{symbol.name}` is a parameter, but a constant is needed here",
                    span,
                    notes=("sizes and loop bounds are fixed when the program is compiled",),
                )
                return error_expr(span)
            return typed.ParamRead(symbol.type, span, symbol)
        if isinstance(symbol, typed.TopicSymbol):
            return self.topic_read(symbol, span, context)
        helps: tuple[str, ...] = ()
        if isinstance(symbol, typed.FunSymbol):
            helps = (f"call it: `{symbol.name}(...)`",)
        elif isinstance(symbol, typed.ModuleSymbol):
            helps = (f"its mode is `mode({symbol.name})`",)
        self.diagnostics.error(
            "N003", f"`{entry.decl.name.text}` is a {entry.kind}, not a value", span, helps=helps
        )
        return error_expr(span)

    def topic_read(self, topic: typed.TopicSymbol, span: Span, context: Context) -> typed.Expr:
        """A read of a topic, if this place may read it."""
        if context.topics is None:
            self.diagnostics.error(
                "M010",
                f"topic `{topic.name}` cannot be read in {context.where}",
                span,
                helps=("pass its value as an argument",) if context.result else (),
            )
            return error_expr(span)
        if context.topics != "any" and topic not in context.topics:
            published = context.node is not None and topic in context.node.publishes
            self.diagnostics.error(
                "M010",
                f"{context.where} does not subscribe to `{topic.name}`",
                span,
                "published here, but outputs cannot be read back" if published else "",
                helps=() if published else (f"add `{topic.name}` to `subscribes`",),
            )
            return error_expr(span)
        if topic not in context.topics_read:
            context.topics_read.append(topic)
        return typed.TopicRead(topic.type, span, topic)

    # ------------------------------------------------------------ fields

    def _field(self, expr: tree.FieldExpr, context: Context) -> typed.Expr:
        base, name = expr.target, expr.field
        if isinstance(base, tree.NameExpr) and context.find_local(base.name.text) is None:
            text = base.name.text
            if context.instances is not None and text in context.instances:
                return self._instance_field(expr, context)
            entry = self.checker.names.find(context.scope, text)
            if entry is None and text in context.scope.imports:
                found = self.checker.names.find_in_import(context.scope, base.name, name)
                return self._entry(found, expr.span, context) if found else error_expr(expr.span)
            if entry is not None and entry.kind == "type":
                return self._member(self.checker.resolve(entry, base.span), name, expr.span)
            if entry is None and text == "Mode":
                return self._member(MODE, name, expr.span)
        elif isinstance(base, tree.FieldExpr):
            special = self._deep_field(expr, base, context)
            if special is not None:
                return special
        target = self.check(base, context)
        if is_error(target):
            return error_expr(expr.span)
        return self._select(target, name, expr.span)

    def _deep_field(
        self, expr: tree.FieldExpr, base: tree.FieldExpr, context: Context
    ) -> typed.Expr | None:
        root = base.target
        if not isinstance(root, tree.NameExpr):
            if isinstance(root, tree.FieldExpr):
                names = flat_names(expr)
                if names and context.instances is not None and names[0].text in context.instances:
                    return self._instance_field(expr, context)
            return None
        text = root.name.text
        if context.find_local(text) is not None:
            return None
        if context.instances is not None and text in context.instances:
            return self._instance_field(expr, context)
        if text in context.scope.imports and text not in context.scope.entries:
            child = context.scope.imports[text]
            entry = child.entries.get(base.field.text) if child else None
            if entry is not None and entry.kind == "type":
                entry.used = True
                context.scope.used_imports.add(text)
                return self._member(self.checker.resolve(entry, base.span), expr.field, expr.span)
        return None

    def _instance_field(self, expr: tree.FieldExpr, context: Context) -> typed.Expr:
        """`plant.truth...`, `sub.topic...`, `sub.plant.truth...` inside a system."""
        names = flat_names(expr)
        if names is None:
            target = self.check(expr.target, context)
            return error_expr(expr.span) if is_error(target) else self._select(
                target, expr.field, expr.span
            )
        assert context.instances is not None
        instances = context.instances
        prefix: list[str] = []
        position = 0
        what: object = None
        while position < len(names) and names[position].text in instances:
            instance = instances[names[position].text]
            prefix.append(names[position].text)
            position += 1
            what = instance.what
            if isinstance(what, typed.SystemSymbol):
                instances = {i.name: i for i in what.instances}
                continue
            break
        rest = names[position:]
        here = expr.span
        if isinstance(what, typed.PlantSymbol):
            if rest and rest[0].text == "truth":
                value: typed.Expr = typed.TruthRead(what.truth, here, ".".join(prefix))
                return self._select_all(value, rest[1:], here)
            self.diagnostics.error(
                "N004",
                f"a plant has no `{rest[0].text if rest else ''}`",
                rest[0].span if rest else here,
                helps=(f"its state is `{'.'.join(prefix)}.truth`",),
            )
            return error_expr(here)
        if isinstance(what, typed.SystemSymbol) and rest:
            topic = self.checker.subsystem_topic(what, prefix, rest[0])
            if topic is not None:
                value = self.topic_read(topic, here, context)
                return value if is_error(value) else self._select_all(value, rest[1:], here)
        self.diagnostics.error(
            "N004",
            f"`{'.'.join(prefix)}` has no `{rest[0].text if rest else ''}` that can be read",
            rest[0].span if rest else here,
        )
        return error_expr(here)

    def _select_all(self, value: typed.Expr, names: list[tree.Name], span: Span) -> typed.Expr:
        for name in names:
            if is_error(value):
                return value
            value = self._select(value, name, span)
        return value

    def _select(self, target: typed.Expr, name: tree.Name, span: Span) -> typed.Expr:
        t = target.type
        if isinstance(t, RecordType):
            index = t.index(name.text)
            if index is not None:
                return typed.Field(t.fields[index][1], span, target, index)
            self.diagnostics.error(
                "N004",
                f"`{t}` has no field `{name.text}`",
                name.span,
                notes=("its fields are " + ", ".join(f"`{n}`" for n, _ in t.fields),),
                helps=suggestion(name.text, [n for n, _ in t.fields]),
            )
        elif isinstance(t, (ListType, ArrayType)) and name.text == "len":
            if isinstance(t, ArrayType):
                return typed.Literal(INT, span, t.size)
            return typed.Length(INT, span, target)
        else:
            self.diagnostics.error(
                "N004", f"`{t}` has no field `{name.text}`", name.span
            )
        return error_expr(span)

    def _member(self, t: object, name: tree.Name, span: Span) -> typed.Expr:
        if t is None or isinstance(t, ErrorType):
            return error_expr(span)
        if isinstance(t, EnumType):
            if name.text in t.members:
                return typed.Literal(t, span, t.members.index(name.text), f"{t.name}.{name.text}")
            self.diagnostics.error(
                "N004",
                f"`{t}` has no member `{name.text}`",
                name.span,
                notes=("its members are " + ", ".join(f"`{m}`" for m in t.members),),
                helps=suggestion(name.text, t.members),
            )
        else:
            self.diagnostics.error("N003", f"type `{t}` is not a value", span)
        return error_expr(span)

    def _index(self, expr: tree.IndexExpr, context: Context) -> typed.Expr:
        target = self.check(expr.target, context)
        index = self.check(expr.index, context, INT)
        if is_error(target, index):
            return error_expr(expr.span)
        if not isinstance(target.type, (ArrayType, ListType)):
            self.diagnostics.error(
                "T002", f"`{target.type}` cannot be indexed", expr.target.span
            )
            return error_expr(expr.span)
        self.check_constant_index(target.type, index)
        return typed.Index(target.type.element, expr.span, target, index)

    def check_constant_index(self, t: ArrayType | ListType, index: typed.Expr) -> None:
        """Report a literal index that can never be right."""
        if not isinstance(index, typed.Literal):
            return
        limit = t.size if isinstance(t, ArrayType) else t.capacity
        if not 0 <= index.value < limit:
            self.diagnostics.error(
                "T017",
                f"index {index.value} is outside `{t}`",
                index.span,
                f"allowed: 0 to {limit - 1}",
            )

    # ------------------------------------------------------------ operators

    def _unary(self, expr: tree.UnaryExpr, context: Context, expected: Type | None) -> typed.Expr:
        if (
            expr.op == "-"
            and isinstance(expr.operand, tree.IntLit)
            and expr.operand.value == -INT_MIN
            and not isinstance(expected, FloatType)
        ):
            return typed.Literal(INT, expr.span, INT_MIN)
        if expr.op == "!":
            operand = self.check(expr.operand, context, BOOL)
            return operand if is_error(operand) else typed.Unary(BOOL, expr.span, "!", operand)
        hint = expected if isinstance(expected, FloatType) or (
            expected is not None and is_vector(expected)
        ) else None
        operand = self._dispatch(expr.operand, context, hint)
        if is_error(operand):
            return operand
        t = operand.type
        if isinstance(operand, typed.Literal) and operand.name is None:
            if isinstance(t, FloatType):
                return typed.Literal(FLOAT, expr.span, -operand.value)
            if isinstance(t, IntType) and operand.value != INT_MIN:
                return typed.Literal(INT, expr.span, -operand.value)
        if isinstance(t, IntType):
            return typed.Unary(INT, expr.span, "-", operand)
        if isinstance(t, FloatType) or is_vector(t):
            return typed.Unary(t, expr.span, "-", operand)
        self.diagnostics.error("T002", f"`-` does not apply to `{t}`", expr.span)
        return error_expr(expr.span)

    def _binary(self, expr: tree.BinaryExpr, context: Context, expected: Type | None) -> typed.Expr:
        op = expr.op
        if op in {"&&", "||"}:
            left = self.check(expr.left, context, BOOL)
            right = self.check(expr.right, context, BOOL)
            if is_error(left, right):
                return error_expr(expr.span)
            return typed.Binary(BOOL, expr.span, op, left, right)
        arithmetic = op not in COMPARISONS
        hint = expected if arithmetic and isinstance(expected, FloatType) else None
        left = self._dispatch(expr.left, context, hint)
        right = self._dispatch(expr.right, context, hint)
        if is_error(left, right):
            return error_expr(expr.span)
        left, right = unify_literals(left, right)
        lt, rt = left.type, right.type
        if arithmetic:
            return self._arithmetic(expr, left, right)
        ordered = isinstance(lt, (IntType, FloatType, DurationType))
        same = type(lt) is type(rt) and (not isinstance(lt, EnumType) or lt == rt)
        if same and (ordered or (op in {"==", "!="} and isinstance(lt, (BoolType, EnumType)))):
            return typed.Binary(BOOL, expr.span, op, left, right)
        self._operator_error(expr, lt, rt)
        return error_expr(expr.span)

    def _arithmetic(
        self, expr: tree.BinaryExpr, left: typed.Expr, right: typed.Expr
    ) -> typed.Expr:
        op, lt, rt, span = expr.op, left.type, right.type, expr.span
        if isinstance(lt, IntType) and isinstance(rt, IntType):
            return typed.Binary(INT, span, op, left, right)
        if isinstance(lt, FloatType) and isinstance(rt, FloatType) and op != "%":
            return typed.Binary(FLOAT, span, op, left, right)
        if isinstance(lt, DurationType) and isinstance(rt, DurationType) and op in {"+", "-"}:
            return typed.Binary(DURATION, span, op, left, right)
        if isinstance(lt, DurationType) and isinstance(rt, IntType) and op in {"*", "/"}:
            return typed.Binary(DURATION, span, op, left, right)
        if isinstance(lt, IntType) and isinstance(rt, DurationType) and op == "*":
            return typed.Binary(DURATION, span, op, left, right)
        if is_vector(lt) and lt == rt and op in {"+", "-"}:
            return typed.Vector(lt, span, op, left, right)
        scalar_left = left if isinstance(lt, FloatType) else float_literal(left)
        scalar_right = right if isinstance(rt, FloatType) else float_literal(right)
        if is_vector(rt) and scalar_left is not None and op == "*":
            return typed.Vector(rt, span, op, scalar_left, right)
        if is_vector(lt) and scalar_right is not None and op in {"*", "/"}:
            return typed.Vector(lt, span, op, left, scalar_right)
        self._operator_error(expr, lt, rt)
        return error_expr(span)

    def _operator_error(self, expr: tree.BinaryExpr, lt: Type, rt: Type) -> None:
        helps: tuple[str, ...] = ()
        kinds = {type(lt), type(rt)}
        if kinds == {IntType, FloatType}:
            helps = ("convert the int: `float(...)`",)
        elif is_vector(lt) and is_vector(rt) and expr.op == "*":
            helps = ("for the scalar product write `dot(a, b)`",)
        elif expr.op == "%" and kinds == {FloatType}:
            helps = ("for floats write `x - floor(x / y) * y`",)
        elif kinds == {RecordType} or kinds == {ArrayType}:
            helps = ("compare the fields one by one",) if expr.op in COMPARISONS else ()
        self.diagnostics.error(
            "T002",
            f"`{expr.op}` does not apply to `{lt}` and `{rt}`",
            expr.span,
            also=((expr.left.span, f"`{lt}`"), (expr.right.span, f"`{rt}`")),
            helps=helps,
        )

    def _conditional(
        self, expr: tree.ConditionalExpr, context: Context, expected: Type | None
    ) -> typed.Expr:
        condition = self.check(expr.condition, context, BOOL)
        then = self.check(expr.then, context, expected)
        otherwise = self.check(expr.otherwise, context, expected)
        if is_error(condition, then, otherwise):
            return error_expr(expr.span)
        then, otherwise = unify_literals(then, otherwise)
        if isinstance(then.type, IntType) and isinstance(otherwise.type, IntType):
            return typed.Conditional(
                then.type if then.type == otherwise.type else INT,
                expr.span, condition, then, otherwise,
            )
        if then.type != otherwise.type:
            self.diagnostics.error(
                "T001",
                f"the two sides differ: `{then.type}` and `{otherwise.type}`",
                expr.span,
                also=(
                    (then.span, f"`{then.type}`"),
                    (otherwise.span, f"`{otherwise.type}`"),
                ),
            )
            return error_expr(expr.span)
        return typed.Conditional(then.type, expr.span, condition, then, otherwise)

    # ------------------------------------------------------------ aggregates

    def _record(self, expr: tree.RecordExpr, context: Context, expected: Type | None) -> typed.Expr:
        target = expected if isinstance(expected, RecordType) else None
        wanted = dict(target.fields) if target else {}
        values: dict[str, typed.Expr] = {}
        failed = False
        for name, value in expr.fields:
            checked = self.check(value, context, wanted.get(name.text))
            failed = failed or is_error(checked)
            if name.text in values:
                self.diagnostics.error(
                    "T010", f"field `{name.text}` is given twice", name.span
                )
                failed = True
            elif target and name.text not in wanted:
                self.diagnostics.error(
                    "N004",
                    f"`{target}` has no field `{name.text}`",
                    name.span,
                    helps=suggestion(name.text, list(wanted)),
                )
                failed = True
            values[name.text] = checked
        if target:
            missing = [n for n in wanted if n not in values]
            if missing:
                self.diagnostics.error(
                    "T010",
                    f"`{target}` needs " + ", ".join(f"`{n}`" for n in missing),
                    expr.span,
                    "missing here",
                )
                failed = True
        if failed:
            return error_expr(expr.span)
        if target is None:
            target = RecordType(tuple((n, plain(v.type)) for n, v in values.items()))
        names = [n for n, _ in target.fields]
        order = tuple(names.index(n) for n in values)
        straight = order == tuple(range(len(names)))
        return typed.Aggregate(
            target, expr.span, tuple(values.values()), None if straight else order
        )

    def _list(self, expr: tree.ListExpr, context: Context, expected: Type | None) -> typed.Expr:
        element = expected.element if isinstance(expected, (ArrayType, ListType)) else None
        items = [self.check(e, context, element) for e in expr.elements]
        if is_error(*items):
            return error_expr(expr.span)
        if isinstance(expected, ListType):
            if len(items) > expected.capacity:
                self.diagnostics.error(
                    "T011",
                    f"{len(items)} elements do not fit into `{expected}`",
                    expr.span,
                )
                return error_expr(expr.span)
            return typed.Aggregate(expected, expr.span, tuple(items))
        if isinstance(expected, ArrayType):
            if len(items) != expected.size:
                self.diagnostics.error(
                    "T011",
                    f"`{expected}` has {expected.size} elements, here are {len(items)}",
                    expr.span,
                )
                return error_expr(expr.span)
            return typed.Aggregate(expected, expr.span, tuple(items))
        if not items:
            self.diagnostics.error(
                "T011", "an empty list needs a type", expr.span,
                helps=("declare the variable with its type: `var xs: float[<=8] = [];`",),
            )
            return error_expr(expr.span)
        first = plain(items[0].type)
        if any(isinstance(i.type, FloatType) for i in items):
            first = FLOAT
        items = [self.convert(i, first) for i in items]
        if is_error(*items):
            return error_expr(expr.span)
        return typed.Aggregate(ArrayType(first, len(items)), expr.span, tuple(items))

    # ------------------------------------------------------------ calls

    def _call(self, expr: tree.CallExpr, context: Context, expected: Type | None) -> typed.Expr:
        callee = expr.callee
        if isinstance(callee, tree.ErrorExpr):
            return error_expr(expr.span)
        entry: Entry | None = None
        name = ""
        if isinstance(callee, tree.NameExpr):
            name = callee.name.text
            entry = self.checker.names.find(context.scope, name)
            if entry is None and context.find_local(name) is None:
                return self._builtin(name, expr, context, expected)
        elif isinstance(callee, tree.FieldExpr) and isinstance(callee.target, tree.NameExpr):
            name = f"{callee.target.name.text}.{callee.field.text}"
            if callee.target.name.text in context.scope.imports:
                entry = self.checker.names.find_in_import(
                    context.scope, callee.target.name, callee.field
                )
                if entry is None:
                    return error_expr(expr.span)
        if entry is None or entry.kind != "function":
            what = f"`{name}` is a {entry.kind}" if entry else "this"
            self.diagnostics.error(
                "T004", f"{what}{', ' if entry else ' is '}not a function", callee.span
            )
            return error_expr(expr.span)
        fun = self.checker.resolve(entry, callee.span)
        if not isinstance(fun, typed.FunSymbol):
            for a in expr.arguments:
                self.check(a, context)
            return error_expr(expr.span)
        return self._call_fun(fun, expr, context)

    def _call_fun(
        self, fun: typed.FunSymbol, expr: tree.CallExpr, context: Context
    ) -> typed.Expr:
        if not self._count(fun.name, expr, len(fun.parameters)):
            return error_expr(expr.span)
        arguments = [
            self.check(a, context, p.type)
            for a, p in zip(expr.arguments, fun.parameters, strict=True)
        ]
        self.checker.note_call(fun, expr.span)
        if is_error(*arguments) or isinstance(fun.result, ErrorType):
            return error_expr(expr.span)
        return typed.Call(fun.result, expr.span, fun, tuple(arguments))

    def _count(self, name: str, expr: tree.CallExpr, wanted: int) -> bool:
        found = len(expr.arguments)
        if found == wanted:
            return True
        s = "" if wanted == 1 else "s"
        self.diagnostics.error(
            "T003", f"`{name}` takes {wanted} argument{s}, here are {found}", expr.span
        )
        return False

    def _builtin(
        self, name: str, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> typed.Expr:
        span = expr.span
        if name in {"mode", "age"}:
            return self._mode_or_age(name, expr, context)
        if name not in {*BUILTIN_FUNCTIONS, "float", "int"}:
            if name not in context.scope.broken:
                self.checker.names.unknown(context.scope, name, expr.callee.span)
            return error_expr(span)
        arity = 2 if name in {"min", "max", "dot", "saturate"} else 1
        if not self._count(name, expr, arity):
            return error_expr(span)
        hint = expected if isinstance(expected, FloatType) and name in {"abs", "min", "max"} else None
        if name in {"sqrt", "floor"}:
            hint = FLOAT
        arguments = [self._dispatch(a, context, hint) for a in expr.arguments]
        if is_error(*arguments):
            return error_expr(span)
        if arity == 2:
            arguments = list(unify_literals(*arguments))
        result = self._builtin_type(name, arguments)
        if result is None:
            shown = ", ".join(f"`{a.type}`" for a in arguments)
            self.diagnostics.error("T002", f"`{name}` does not apply to {shown}", span)
            return error_expr(span)
        if name == "float" and isinstance(arguments[0], typed.Literal):
            return typed.Literal(FLOAT, span, float(arguments[0].value))
        return typed.Builtin(result, span, name, tuple(arguments))

    def _builtin_type(self, name: str, arguments: list[typed.Expr]) -> Type | None:
        """Result type of a builtin, None when it does not apply; may convert literals in place."""
        first = arguments[0].type
        if name in {"sqrt", "floor"}:
            as_float = float_literal(arguments[0])
            if as_float is not None:
                arguments[0] = as_float
                return FLOAT
            return FLOAT if isinstance(first, FloatType) else None
        if name == "float":
            return FLOAT if isinstance(first, (IntType, FloatType)) else None
        if name == "int":
            return INT if isinstance(first, (FloatType, IntType)) else None
        if name == "seconds":
            return FLOAT if isinstance(first, DurationType) else None
        if name in {"abs", "min", "max"}:
            if all(isinstance(a.type, FloatType) for a in arguments):
                return FLOAT
            return INT if all(isinstance(a.type, IntType) for a in arguments) else None
        if name == "dot":
            return FLOAT if is_vector(first) and first == arguments[1].type else None
        if name == "norm":
            return FLOAT if is_vector(first) else None
        bound = float_literal(arguments[1]) or arguments[1]  # saturate
        if isinstance(bound.type, FloatType) and (is_vector(first) or isinstance(first, FloatType)):
            arguments[1] = bound
            return first
        return None

    def _mode_or_age(self, name: str, expr: tree.CallExpr, context: Context) -> typed.Expr:
        span = expr.span
        if not self._count(name, expr, 1):
            return error_expr(span)
        argument = expr.arguments[0]
        if name == "age":
            read = self.check(argument, context)
            if is_error(read):
                return read
            if isinstance(read, typed.TopicRead):
                return typed.AgeRead(FLOAT, span, read.topic)
            self.diagnostics.error("T002", "`age` takes a topic", argument.span)
            return error_expr(span)
        if not context.has_modes:
            self.diagnostics.error("T013", f"`mode` has no meaning in {context.where}", span)
            return error_expr(span)
        module = self._module(argument, context)
        return error_expr(span) if module is None else typed.ModeRead(MODE, span, module)

    def _module(self, argument: tree.Expr, context: Context) -> typed.ModuleSymbol | str | None:
        names = flat_names(argument)
        if names is None:
            if not isinstance(argument, tree.ErrorExpr):
                self.diagnostics.error("T002", "`mode` takes a module", argument.span)
            return None
        if context.instances is not None and names[0].text in context.instances:
            instances, what = context.instances, None
            for n in names:
                what = instances[n.text].what if n.text in instances else None
                instances = (
                    {i.name: i for i in what.instances}
                    if isinstance(what, typed.SystemSymbol)
                    else {}
                )
            if isinstance(what, typed.ModuleSymbol):
                return ".".join(n.text for n in names)
        elif len(names) <= 2:
            ref = tree.Ref(names[0] if len(names) == 2 else None, names[-1], argument.span)
            entry = self.checker.names.find_ref(context.scope, ref)
            if entry is None:
                return None
            if entry.kind == "module":
                symbol = self.checker.module_handle(entry, argument.span)
                return symbol if isinstance(symbol, typed.ModuleSymbol) else None
        self.diagnostics.error("T002", "`mode` takes a module", argument.span)
        return None


# ---------------------------------------------------------------- helpers


def flat_names(expr: tree.Expr) -> list[tree.Name] | None:
    """The names of a dotted chain `a.b.c`, or None when it is something else."""
    names: list[tree.Name] = []
    while isinstance(expr, tree.FieldExpr):
        names.append(expr.field)
        expr = expr.target
    if not isinstance(expr, tree.NameExpr):
        return None
    names.append(expr.name)
    names.reverse()
    return names


def plain(t: Type) -> Type:
    """The type a fresh variable gets from a value: ranged ints become plain ints."""
    return INT if isinstance(t, IntType) else t


def float_literal(expr: typed.Expr) -> typed.Expr | None:
    """An unnamed int literal (or + - * of such) read as a float, else None."""
    if not isinstance(expr.type, IntType):
        return None
    if isinstance(expr, typed.Literal) and expr.name is None:
        return typed.Literal(FLOAT, expr.span, float(expr.value))
    if isinstance(expr, typed.Binary) and expr.op in {"+", "-", "*"}:
        left, right = float_literal(expr.left), float_literal(expr.right)
        if left is not None and right is not None:
            return typed.Binary(FLOAT, expr.span, expr.op, left, right)
    return None


def unify_literals(left: typed.Expr, right: typed.Expr) -> tuple[typed.Expr, typed.Expr]:
    """Read an int literal beside a float as a float."""
    if isinstance(left.type, FloatType):
        return left, float_literal(right) or right
    if isinstance(right.type, FloatType):
        return float_literal(left) or left, right
    return left, right
