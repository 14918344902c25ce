"""Guesses what a call was meant to be if nothing of that name can be called.

Purpose: makes helps for values called as functions (`time()`, `rays(1)`), types (`Vec2(1.0, 2.0)`),
methods (`v.norm()`), chance (`randint(0, 1)`), literals (`zeros(3)`) and nearly right names. It
compares every edit with the types at this place, and offers none that would be an error again.
Non-goals: reporting (`language/check/call.py`); words that only another language has
(`unknown_names.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace
from soter.language.model import typed
from soter.language.model.types import ArrayType, EnumType, FloatType, ListType, RecordType
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Context
    from soter.language.model.types import Type


RANDOM = frozenset(
    ["random", "rand", "randint", "randrange", "randn", "uniform", "gauss", "normal", "choice",
     "drand48", "unifrnd", "noise", "gaussian", "randi", "normalvariate", "sample", "integers"]
)  # fmt: skip
FILLED = {"zeros": "0.0", "ones": "1.0", "zeros_like": "0.0", "empty": "0.0"}
WRAPPED = ("array", "asarray", "list", "tuple", "vector", "matrix")
ELEMENTS_MAX = 16


def value_call_helps(
    value: typed.TypedExpr, expr: tree.CallExpr, subject: str = "it is"
) -> tuple[Help, ...]:
    """Gives helps for a value called as a function, such as `rays[0]` for `rays(1)`."""
    text = expr.callee.span.text
    if isinstance(value.type, (ArrayType, ListType)) and len(expr.arguments) == 1:
        index = expr.arguments[0]
        if isinstance(index, tree.IntLit) and index.value > 0:
            first = f"{text}[{index.value - 1}]"
            return (replace(expr.span, first, f"indices begin at 0: `{first}`"),)
        return (replace(expr.span, f"{text}[{index.span.text}]"),)
    if not expr.arguments:
        return (replace(expr.span, text, f"{subject} a value, without parentheses: `{text}`"),)
    return ()


def type_call_helps(called: Type, expr: tree.CallExpr) -> tuple[Help, ...]:
    """Gives helps for a type that is called, such as `Vec2(1.0, 2.0)`: a literal or a member."""
    if isinstance(called, EnumType):
        return (f"name the case: `{expr.callee.span.text}.{called.members[0]}`",)
    if not isinstance(called, RecordType):
        return ("a value is of its type by itself: leave the name out",)
    names = [name for name, _ in called.fields]
    values = _value_by_field(expr.arguments, names)
    if values is None:
        shown = ", ".join(f"{n}: ..." for n in names[:ELEMENTS_MAX])
        return (f"a record is written with its fields: `{{ {shown} }}`",)
    if set(values) != set(names):
        return ()
    fields = ", ".join(f"{n}: {values[n]}" for n in names)
    return (replace(expr.span, f"{{ {fields} }}"),)


def _value_by_field(
    arguments: Sequence[tree.SyntaxExpr], names: Sequence[str]
) -> dict[str, str] | None:
    """Gives field -> text of its argument, by name or by position; None if they do not match."""
    values = [_field_and_value(a, names) for a in arguments]
    if len(values) != len(names) or None in values:
        return None
    fields = dict(v for v in values if v is not None and v[0])
    return fields or dict(zip(names, [a.span.text for a in arguments], strict=True))


def _field_and_value(argument: tree.SyntaxExpr, names: Sequence[str]) -> tuple[str, str] | None:
    """Gives field and value of an argument `lamp=x`, parsed as `==`; ("", "x") for a bare `x`."""
    if not isinstance(argument, tree.BinaryExpr) or argument.op != "==":
        return "", argument.span.text
    name = argument.left
    if not isinstance(name, tree.NameExpr) or name.name.text not in names:
        return None
    return name.name.text, argument.right.span.text


def random_call_helps(name: str, expr: tree.CallExpr, context: Context) -> tuple[Help, ...]:
    """Gives helps for calls such as `randint(0, 1)`: `choose` or a disturbance instead."""
    if name not in RANDOM:
        return ()
    bounds = [a.span.text for a in expr.arguments[:2]] if len(expr.arguments) == 2 else []
    if isinstance(context.owner, typed.PlantSymbol):
        low, high = bounds or ("-0.1", "0.1")
        return (
            f"chance in a plant is declared: `disturbance w: float in [{low}, {high}];`, read `w`",
        )
    if context.choices is None:
        return ("only steps and plants leave something open: pass what is drawn as an argument",)
    if len(bounds) == 2 and all(_is_int_literal(a) for a in expr.arguments):
        return (replace(expr.span, f"choose [{bounds[0]}, {bounds[1]}]"),)
    return (
        "a step leaves open which of several values: `choose { -1.0, 0.0, 1.0 }`",
        "what is drawn from an interval is an input: `input topic noise: float in [-1.0, 1.0];`",
    )


def _is_int_literal(e: tree.SyntaxExpr) -> bool:
    if isinstance(e, tree.UnaryExpr) and e.op == "-":
        e = e.operand
    return isinstance(e, tree.IntLit)


def array_call_helps(name: str, expr: tree.CallExpr, expected: Type | None) -> tuple[Help, ...]:
    """Gives helps with a literal for calls that make arrays, such as `zeros(3)`."""
    arguments = expr.arguments
    if name in WRAPPED and len(arguments) == 1:
        return (replace(expr.span, arguments[0].span.text),)
    if name not in FILLED:
        return ()
    if expected is not None:
        text = repeated_literal(expected, FILLED[name])
        return (replace(expr.span, text),) if text else ()
    count = arguments[0].value if arguments and isinstance(arguments[0], tree.IntLit) else 0
    if not 0 < count <= ELEMENTS_MAX:
        return ("a list is written out: `[0.0, 0.0, 0.0]`",)
    return (replace(expr.span, f"[{', '.join([FILLED[name]] * count)}]"),)


def repeated_literal(t: Type, value: str) -> str:
    """Gives the text of a literal of type `t` whose floats are all `value`; "" for other types."""
    if isinstance(t, FloatType):
        return value
    if isinstance(t, ArrayType) and t.size <= ELEMENTS_MAX:
        part = repeated_literal(t.element, value)
        return f"[{', '.join([part] * t.size)}]" if part else ""
    if isinstance(t, RecordType):
        parts = [repeated_literal(f, value) for _, f in t.fields]
        pairs = zip(t.fields, parts, strict=True)
        return f"{{ {', '.join(f'{n}: {p}' for (n, _), p in pairs)} }}" if all(parts) else ""
    return ""


def method_as_function_help(name: str, expr: tree.CallExpr, target: Span) -> tuple[Help, ...]:
    """Gives help that writes a method as a function: `norm(v)` for `v.norm()`."""
    arguments = [target.text, *(a.span.text for a in expr.arguments)]
    return (replace(expr.span, f"{name}({', '.join(arguments)})"),)


def foreign_call_helps(name: str, expr: tree.CallExpr) -> tuple[Help, ...]:
    """Gives helps for functions that other languages have: `round(x)`, `ceil(x)`, `sum(xs)`."""
    if name in ("mod", "fmod", "rem") and len(expr.arguments) == 2:
        a, b = (x.span.text for x in expr.arguments)
        return (replace(expr.span, f"({a}) % {b}"),)
    if name == "round" and len(expr.arguments) == 2:
        return ("a number keeps all its digits: leave `round` out, or `floor(x + 0.5)`",)
    if len(expr.arguments) != 1:
        return ()
    text = expr.arguments[0].span.text
    if name in ("round", "rint", "nearbyint"):
        return (replace(expr.span, f"floor({text} + 0.5)"),)
    if name in ("ceil", "ceiling"):
        return (replace(expr.span, f"-floor(-({text}))"),)
    if name in ("sum", "mean", "average", "avg", "any", "all"):
        return (f"a loop looks at each of them: `for x in {text} {{ ... }}`",)
    return ()


ITSELF = frozenset(
    ["iter", "iter_mut", "into_iter", "cloned", "clone", "copy", "to_vec", "items", "values",
     "tolist", "as_slice", "data", "begin"]
)  # fmt: skip
"""Methods of other languages that return the value they are called on."""


def nested_call_help(name: str, expr: tree.CallExpr) -> Help:
    """Gives help that nests a call with too many arguments: `max(a, max(b, c))`."""
    *rest, nested = [a.span.text for a in expr.arguments]
    for text in reversed(rest):
        nested = f"{name}({text}, {nested})"
    return replace(expr.span, nested)
