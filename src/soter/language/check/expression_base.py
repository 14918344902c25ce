"""The base class of all parts of the expression checker, and helpers.

Purpose: errors as expressions, explicit conversions, int literals as floats, helps for wrong types.
Non-goals: any particular kind of expression.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import chain
from typing import TYPE_CHECKING, TypeVar

from soter.diagnostics.fixes import append, replace
from soter.language.model import typed
from soter.language.model.types import (
    ERROR,
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    write_ns,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Because, Context, Shared
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type
    from soter.language.syntax import tree

    _Symbol = TypeVar("_Symbol")


SECONDS_MAX = 1e6
"""The largest number that a help takes for a time in seconds."""


def error_expr(span: Span) -> typed.TypedExpr:
    """Gives an expression of type ERROR, to replace an expression whose error was reported."""
    return typed.Literal(ERROR, span, None)


def has_error(*exprs: typed.TypedExpr) -> bool:
    """Whether an error has been reported for at least one of the expressions."""
    return any(isinstance(e.type, ErrorType) for e in exprs)


def unless_error(expr: typed.TypedExpr | None) -> typed.TypedExpr | None:
    """Gives the expression, or None if an error has been reported for it."""
    return None if expr is None or has_error(expr) else expr


def with_article(t: Type) -> str:
    """Gives a type in words with its article: a `float`, an `int`."""
    return f"an `{t}`" if str(t).startswith(("int", "A", "E", "I", "O")) else f"a `{t}`"


def plain_type(t: Type) -> Type:
    """Gives the type that a new variable gets from a value: ranged ints become plain ints."""
    return INT if isinstance(t, IntType) else t


def float_literal(expr: typed.TypedExpr) -> typed.TypedExpr | None:
    """Gives an unnamed int literal, or a sum or product of such literals, as float; else None."""
    if not isinstance(expr.type, IntType):
        return None
    if isinstance(expr, typed.Literal) and expr.name is None:
        return typed.Literal(FLOAT, expr.span, float(expr.value))
    if isinstance(expr, typed.TypedBinary) and expr.op in {"+", "-", "*"}:
        left, right = float_literal(expr.left), float_literal(expr.right)
        if left is not None and right is not None:
            return typed.TypedBinary(FLOAT, expr.span, expr.op, left, right)
    return None


def unify_literals(
    left: typed.TypedExpr, right: typed.TypedExpr
) -> tuple[typed.TypedExpr, typed.TypedExpr]:
    """Gives both operands; if one is a float, an int literal beside it becomes a float."""
    if isinstance(left.type, FloatType):
        return left, float_literal(right) or right
    if isinstance(right.type, FloatType):
        return float_literal(left) or left, right
    return left, right


def difference_note(expected: Type, actual: Type) -> str:
    """Gives a note on the part in which two records or lists differ; "" if it has none to give."""
    if isinstance(expected, RecordType) and isinstance(actual, RecordType):
        have, want = dict(actual.fields), dict(expected.fields)
        for name, t in want.items():
            if name not in have:
                return f"`{expected}` has a field `{name}`, `{actual}` has none"
            if have[name] != t:
                deeper = difference_note(t, have[name])
                return deeper or f"the field `{name}` is `{have[name]}` instead of `{t}`"
        extra = [n for n in have if n not in want]
        if extra:
            return f"`{expected}` has no field `{extra[0]}`"
        return "the fields stand in another order"
    for kind in (ArrayType, ListType):
        if isinstance(expected, kind) and isinstance(actual, kind):
            return difference_note(expected.element, actual.element)
    return ""


class CheckerPart:
    """The base of checkers of one kind of syntax, which reach the others through `shared`."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self.diagnostics = shared.diagnostics

    def referred_symbol(
        self,
        ref: tree.Ref,
        scope: FileScope,
        kind: str,
        symbol_class: type[_Symbol],
        *,
        helps: tuple[Help, ...] = (),
        otherwise: tuple[Help, ...] = (),
        notes: tuple[str, ...] = (),
    ) -> _Symbol | None:
        """Gives the symbol of class `symbol_class` that a reference means; None after an error.

        A declaration of another `kind` is reported as N003, with `helps` and `notes`. An unknown
        name is reported as N001, with `otherwise`, or as N006.
        """
        entry = self.shared.names.find_ref(scope, ref, kind, otherwise)
        if entry is None:
            return None
        if entry.kind != kind:
            self.diagnostics.error(
                "N003",
                f"`{ref.text}` is a {entry.kind}, not a {kind}",
                ref.span,
                also=((entry.decl.name.span, "declared here"),),
                notes=notes,
                helps=helps or entry.helps_for_other_kind(kind, ref.span),
            )
            return None
        symbol = self.shared.resolve(entry, ref.span)
        return symbol if isinstance(symbol, symbol_class) else None

    def check_number_if_given(
        self,
        expr: tree.SyntaxExpr | None,
        context: Context,
        expected: Type,
        subject: str,
        because: Because | None = None,
    ) -> typed.TypedExpr | None:
        """Gives the typed expression of a number; None if `expr` is None or has errors."""
        if expr is None:
            return None
        return unless_error(self.shared.check_number(expr, context, expected, subject, because))


class ExprBase(CheckerPart, ABC):
    """The base class of the expression checkers, with entry points and conversions."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self.names = shared.names

    def refuse(
        self,
        code: Code,
        message: str,
        span: Span,
        label: str = "",
        *,
        whole: Span | None = None,
        also: tuple[tuple[Span, str], ...] = (),
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
    ) -> typed.TypedExpr:
        """Reports an error at `span`; gives an ERROR expression for `whole` (default: `span`)."""
        self.diagnostics.error(code, message, span, label, also=also, notes=notes, helps=helps)
        return error_expr(span if whole is None else whole)

    def lost_expr(self, span: Span) -> typed.TypedExpr:
        """Gives the ERROR expression for syntax that cannot be checked after an earlier error."""
        self.names.losses += 1
        return error_expr(span)

    def report_unknown(
        self,
        name: tree.Name,
        context: Context,
        more: Iterable[str] = (),
        *,
        dotted: bool = False,
        helps: tuple[Help, ...] = (),
        otherwise: tuple[Help, ...] = (),
        among: Iterable[str] | None = None,
    ) -> None:
        """Reports N001, unless the parser may have lost the declaration of the name.

        `helps`, `otherwise` and `among` are as in `Names.report_unknown`.
        """
        if context.broken:
            self.names.losses += 1
            return
        elements = [n for n in context.instances or () if n.startswith(f"{name.text}[")]
        if elements:
            self.diagnostics.error(
                "N001",
                f"`{name.text}` is an array of instances",
                name.span,
                "which of them is not said",
                helps=(replace(name.span, elements[0]),),
            )
            return
        gone = context.gone.get(name.text)
        if gone is not None and not helps:
            self.names.report_unknown(
                context.scope,
                name.text,
                name.span,
                where=context.where,
                helps=(f"declare it before the block: `var {name.text}: {gone.type};`",),
                also=((gone.span, "declared here, for the block it stands in"),),
            )
            return
        known = chain(context.local_names(), more, context.instances or ())
        self.names.report_unknown(
            context.scope,
            name.text,
            name.span,
            known,
            where=context.where,
            dotted=dotted,
            helps=helps,
            otherwise=otherwise,
            among=among,
        )

    def value_helps(self, name: tree.Name, context: Context) -> tuple[Help, ...]:
        """Gives helps with a local or topic named nearly like `name`, where a type is wanted."""
        values = [n for n, e in context.scope.entries.items() if e.kind != "type"]
        for other in chain(context.local_names(), values):
            if other != name.text and other.casefold() == name.text.casefold():
                return (replace(name.span, other, f"did you mean `{other}`?"),)
        return ()

    @abstractmethod
    def check_unconverted(
        self, expr: tree.SyntaxExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Gives the typed expression, not yet converted; number literals get type `expected`."""

    @abstractmethod
    def check_in_place(self, expr: tree.SyntaxExpr, context: Context) -> typed.TypedExpr:
        """Gives a typed expression that may be a large table, as only a part of it will be read."""

    def check(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None = None,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """Gives the typed expression, of type `expected` if set; ERROR after a reported error.

        `because` says where the program asks for that type.
        """
        result = self.check_unconverted(expr, context, expected)
        if expected is None or has_error(result):
            return result
        return self.convert(result, expected, because)

    def convert(
        self, expr: typed.TypedExpr, expected: Type, because: Because | None = None
    ) -> typed.TypedExpr:
        """Gives the expression converted to type `expected`; ERROR after reporting T001."""
        if isinstance(expected, ErrorType) or has_error(expr) or expr.type == expected:
            return expr
        if isinstance(expected, IntType) and isinstance(expr.type, IntType):
            return self._narrowed_int(expr, expected, because)
        if isinstance(expected, FloatType):
            as_float = float_literal(expr)
            if as_float is not None:
                return as_float
        why = difference_note(expected, expr.type)
        return self.refuse(
            "T001",
            f"expected `{expected}`, found `{expr.type}`",
            expr.span,
            f"this is `{expr.type}`",
            also=_type_labels(expr, because),
            notes=(why,) if why else (),
            helps=list_helps(expr, expected) or _conversion_helps(expected, expr),
        )

    def _narrowed_int(
        self, expr: typed.TypedExpr, expected: IntType, because: Because | None
    ) -> typed.TypedExpr:
        if not isinstance(expr, typed.Literal):
            return typed.Narrow(expected, expr.span, expr)
        if expected.low <= expr.value <= expected.high:
            return typed.Literal(expected, expr.span, expr.value, expr.name)
        return self.refuse(
            "T015",
            f"{expr.value} does not fit into `{expected}`",
            expr.span,
            f"{expected.low} to {expected.high} are allowed",
            also=(because,) if because else (),
        )


def list_helps(expr: typed.TypedExpr, wanted: Type) -> tuple[Help, ...]:
    """Gives helps for a list or an array, such as a queue, that is used as an element."""
    t = expr.type
    if not isinstance(t, (ListType, ArrayType)) or type(t.element) is not type(wanted):
        return ()
    text = expr.span.text
    loop = f"for {'x' if text != 'x' else 'each'} in {text} {{ ... }}"
    if isinstance(expr, typed.TopicRead) and isinstance(t, ListType) and expr.topic.type != t:
        return (
            f"its queue makes `{text}` a list: `{loop}`",
            "or subscribe to it without a queue: then it is the last value",
        )
    return (f"look at each of its elements: `{loop}`",)


def member_helps(enum: EnumType, expr: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives a help with the enum member for a number: `Gear.Drive` for 1, or else the first."""
    name = enum.name.rpartition(".")[2]
    is_number = isinstance(expr, typed.Literal) and isinstance(expr.type, IntType)
    if isinstance(expr, typed.Literal) and is_number and 0 <= expr.value < len(enum.members):
        return (replace(expr.span, f"{name}.{enum.members[expr.value]}"),)
    return tuple(f"a case of it is named: `{name}.{member}`" for member in enum.members[:1])


def _type_labels(expr: typed.TypedExpr, because: Because | None) -> tuple[tuple[Span, str], ...]:
    """Gives labels for the place that asks for a type, and for a parameter's declaration."""
    also = (because,) if because else ()
    if isinstance(expr, typed.ParamRead):
        return (*also, (expr.param.span, f"declared as `{expr.type}` here"))
    return also


def _conversion_helps(expected: Type, expr: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives helps that convert a value to the expected type, mostly as edits."""
    actual, span = expr.type, expr.span
    text = span.text
    if isinstance(expected, FloatType) and isinstance(actual, (IntType, BoolType, DurationType)):
        return _float_helps(expr)
    if isinstance(expected, IntType) and isinstance(actual, FloatType):
        title = "convert it: `int(...)` cuts off what is behind the point"
        return (replace(span, f"int({text})", title),)
    if isinstance(expected, EnumType) and not isinstance(actual, EnumType):
        return member_helps(expected, expr)
    if isinstance(expected, BoolType):
        return _bool_helps(expr)
    if isinstance(expected, DurationType):
        return _duration_helps(expr)
    if isinstance(expr, typed.Aggregate) and isinstance(expected, RecordType):
        return _record_helps(expected, expr)
    if isinstance(expected, (ArrayType, ListType)) and expected.element == actual:
        return (replace(span, f"[{text}]", "put it into brackets: `[...]`"),)
    return ()


def _float_helps(expr: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives helps that convert an int, a time or a bool to a float."""
    span, text = expr.span, expr.span.text
    if isinstance(expr.type, IntType):
        return (replace(span, f"float({text})", "convert it: `float(...)`"),)
    if isinstance(expr.type, DurationType):
        return (replace(span, f"seconds({text})", f"convert it: `seconds({text})`"),)
    if isinstance(expr, typed.Literal):
        return (replace(span, "1.0" if expr.value else "0.0"),)
    return (replace(span, f"({text} ? 1.0 : 0.0)", "convert it: `b ? 1.0 : 0.0`"),)


def _bool_helps(expr: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives helps that turn an enum member or a number into a bool by a comparison."""
    actual, span = expr.type, expr.span
    text = span.text
    if isinstance(actual, EnumType):
        name = f"{actual.name.rpartition('.')[2]}.{actual.members[-1]}"
        return (append(span, f" == {name}", f"compare it: `{text} == {name}`"),)
    if not isinstance(actual, IntType):
        return ()
    if isinstance(expr, typed.Literal):
        known = expr.value in (0, 1)
        return (replace(span, "true" if expr.value else "false"),) if known else ()
    if isinstance(expr, typed.TypedBinary):
        return (replace(span, f"({text}) != 0", "compare it: `... != 0`"),)
    return (append(span, " != 0", f"write `{text} != 0`"),)


def _duration_helps(expr: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives helps that turn seconds into a duration, for a named number at its declaration."""
    param = expr.param if isinstance(expr, typed.ParamRead) else None
    named = param is not None or (isinstance(expr, typed.Literal) and expr.name is not None)
    value = param.default if param is not None else expr
    seconds = value.value if isinstance(value, typed.Literal) else None
    if not isinstance(seconds, float) or not 0 < seconds < SECONDS_MAX:
        return ("write a time with its unit, such as `10ms`",)
    time = write_ns(round(seconds * 1e9))
    if named:
        word = "param" if param is not None else "const"
        return (f"declare it as a time: `{word} {expr.span.text}: duration = {time};`",)
    return (f"write a time with its unit, such as `{time}`",)


def _record_helps(expected: RecordType, expr: typed.Aggregate) -> tuple[Help, ...]:
    """Gives help that writes a list as a record: `{ x: 0.0, y: 1.0 }` for `[0.0, 1.0]`."""
    fields, elements = expected.fields, expr.elements
    pairs = list(zip(fields, elements, strict=False))
    fits = all(
        e.type == t or (isinstance(t, FloatType) and float_literal(e)) for (_, t), e in pairs
    )
    if len(elements) != len(fields) or not fits or isinstance(expr.type, RecordType):
        shown = ", ".join(f"{name}: ..." for name, _ in fields)
        return (f"write its fields: `{{ {shown} }}`",)
    shown = ", ".join(f"{name}: {e.span.text}" for (name, _), e in pairs)
    return (replace(expr.span, f"{{ {shown} }}"),)
