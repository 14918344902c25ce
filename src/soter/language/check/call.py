"""Checks calls: declared functions, built-in operations, `mode(M)`, `age(t)`.

Purpose: decides what may be called with which arguments, and the type of the result.
Non-goals: the operations themselves (`arithmetic.py`), bodies of functions
(`language/check/declarations.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace
from soter.diagnostics.similar_names import likely_name
from soter.language.check import call_hints, unknown_names
from soter.language.check.checker_interface import SPECIALS
from soter.language.check.dots_and_brackets import FieldChecker, find_instance, names_of_chain
from soter.language.check.expression_base import (
    error_expr,
    float_literal,
    has_error,
    unify_literals,
    with_article,
)
from soter.language.model import typed
from soter.language.model.types import (
    FLOAT,
    INT,
    MODE,
    DurationType,
    ErrorType,
    FloatType,
    IntType,
    Type,
    is_vector,
)
from soter.language.syntax import tree
from soter.language.syntax.their_words import THEIRS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Context
    from soter.language.check.scope import Entry


TAKES = {
    "sqrt": "a float",
    "floor": "a float",
    "abs": "a float or an int",
    "min": "two floats or two ints",
    "max": "two floats or two ints",
    "dot": "two vectors of one type",
    "norm": "a vector: a record or an array of floats",
    "saturate": "a float or a vector, and a float",
    "seconds": "a duration",
    "float": "an int",
    "int": "a float",
}
ARITY = {"min": 2, "max": 2, "dot": 2, "saturate": 2}


class CallChecker(FieldChecker):
    """Checks calls; it is one of the base classes of the expression checker."""

    def check_call(
        self, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Checks `callee(arguments)`."""
        callee = expr.callee
        if isinstance(callee, tree.NameExpr):
            name = callee.name.text
            if context.find_local(name) is not None:
                return self._refuse_call("a variable", name, expr, context)
            entry = self.names.find_entry(context.scope, name, callee.span)
            if entry is None and name in SPECIALS:
                return self._refuse_call("a value", name, expr, context)
            if entry is None:
                return self._check_builtin(name, expr, context, expected)
        elif isinstance(callee, tree.FieldExpr) and isinstance(callee.target, tree.NameExpr):
            name = f"{callee.target.name.text}.{callee.field.text}"
            first = callee.target.name.text
            if context.find_local(first) is not None or first in context.scope.entries:
                return self._refuse_call("a field", name, expr, context)
            if first not in context.scope.imports and unknown_names.is_library(first):
                return self._refuse_library_call(expr, context, expected)
            entry = self.names.find_in_import(context.scope, callee.target.name, callee.field)
            if entry is None:
                return self._error_after_arguments(expr, context)
        else:
            return self._refuse_unnamed_callee(expr, context, expected)
        return self._check_declared_call(entry, name, expr, context)

    def _check_declared_call(
        self, entry: Entry, name: str, expr: tree.CallExpr, context: Context
    ) -> typed.TypedExpr:
        """Checks a call of a declared name; reports T004 if the name is no function."""
        if entry.kind == "type":
            return self._refuse_call_of_type(entry, expr)
        if entry.kind != "function":
            return self._refuse_call(f"a {entry.kind}", name, expr, context)
        fun = self.shared.resolve(entry, expr.callee.span)
        if not isinstance(fun, typed.FunSymbol):
            return self._error_after_arguments(expr, context)
        return self._check_function_call(fun, expr, context)

    def _refuse_unnamed_callee(
        self, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Reports T004 for a call of an expression that is neither a name nor `file.name`."""
        callee = expr.callee
        names = names_of_chain(callee)
        if isinstance(callee, tree.ErrorExpr):
            self.names.losses += 1
        elif names and unknown_names.is_library(names[0].text):
            return self._refuse_library_call(expr, context, expected)
        elif isinstance(callee, tree.FieldExpr):
            return self._refuse_call("a field", callee.span.text, expr, context)
        else:
            self.diagnostics.error(
                "T004",
                "only functions can be called",
                callee.span,
                notes=("a call is the name of a function and its arguments",),
            )
        return self._error_after_arguments(expr, context)

    def _error_after_arguments(self, expr: tree.CallExpr, context: Context) -> typed.TypedExpr:
        """Checks the arguments, to report their errors too, and gives an ERROR expression."""
        for argument in expr.arguments:
            self.check(argument, context)
        return error_expr(expr.span)

    def _refuse_library_call(
        self, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Reports N006 for `np.clip(...)`, `random.uniform(...)` and the like."""
        callee = expr.callee
        assert isinstance(callee, tree.FieldExpr)
        helps = self._unknown_call_helps(callee.field.text, callee.span, expr, context, expected)
        self.diagnostics.error(
            "N006",
            f"there is no `{' '.join(callee.span.text.split())}`",
            callee.span,
            notes=("the functions and types of the prelude need no import",),
            helps=helps,
        )
        return error_expr(expr.span) if helps else self._error_after_arguments(expr, context)

    def _unknown_call_helps(
        self, name: str, span: Span, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> tuple[Help, ...]:
        """Gives helps for a call of an unknown function; an edit may replace the name at `span`."""
        helps = (
            call_hints.random_call_helps(name, expr, context)
            or call_hints.foreign_call_helps(name, expr)
            or call_hints.array_call_helps(name, expr, expected)
            or unknown_names.function_helps(expr, name, span)
        )
        ours = THEIRS.get(name, name)
        if not helps and self._arity_of(ours, context) == len(expr.arguments):
            helps = (replace(span, ours),)
        return helps

    def _help_with_similar_function(self, name: str, context: Context) -> tuple[Help, ...]:
        """Gives a help with a function of a similar name, which takes other arguments."""
        public = (n for n in (*context.scope.entries, *self.names.prelude) if n[0] != "_")
        near = likely_name(name, [n for n in public if self._arity_of(n, context) is not None])
        entry = context.scope.entries.get(near or "") or self.names.prelude.get(near or "")
        if entry is None or not isinstance(entry.decl, tree.FunDecl):
            return ()
        parameters = ", ".join(p.text for p, _ in entry.decl.parameters)
        return (f"there is `{near}({parameters})`",)

    def _arity_of(self, name: str, context: Context) -> int | None:
        """Gives how many arguments the function `name` takes; None if no such function exists."""
        if name in TAKES:
            return ARITY.get(name, 1)
        entry = context.scope.entries.get(name) or self.names.prelude.get(name)
        decl = entry.decl if entry is not None else None
        return len(decl.parameters) if isinstance(decl, tree.FunDecl) else None

    def _refuse_call(
        self, kind: str, name: str, expr: tree.CallExpr, context: Context
    ) -> typed.TypedExpr:
        """Reports T004 for a call of a value or a type, and adds helps for the called name."""
        callee = expr.callee
        last = name.rpartition(".")[2]
        helps: tuple[Help, ...] = ()
        if isinstance(callee, tree.FieldExpr) and last in ("size", "length", "len", "count"):
            length = f"{callee.target.span.text}.len"
            helps = (replace(expr.span, length, f"its length is `{length}`"),)
        elif isinstance(callee, tree.FieldExpr) and last in call_hints.ITSELF:
            target = callee.target.span.text
            helps = (replace(expr.span, target),)
        elif (
            isinstance(callee, tree.FieldExpr)
            and context.where != f"function `{last}`"
            and (self._arity_of(last, context) == len(expr.arguments) + 1)
        ):
            helps = call_hints.method_as_function_help(last, expr, callee.target.span)
        else:
            helps = self._value_call_helps(expr, context)
        self.diagnostics.error(
            "T004", f"`{name}` is {kind}, not a function", callee.span, helps=helps
        )
        return self._error_after_arguments(expr, context)

    def _refuse_call_of_type(self, entry: Entry, expr: tree.CallExpr) -> typed.TypedExpr:
        """Reports T004 for a call such as `Vec2(1.0, 2.0)`, and suggests the record literal."""
        symbol = self.shared.resolve(entry, expr.callee.span)
        return self.refuse(
            "T004",
            f"`{expr.callee.span.text}` is a type, not a function",
            expr.callee.span,
            helps=call_hints.type_call_helps(symbol, expr) if isinstance(symbol, Type) else (),
            whole=expr.span,
        )

    def _value_call_helps(self, expr: tree.CallExpr, context: Context) -> tuple[Help, ...]:
        """Gives helps to drop or replace the parentheses after a value; () if it is no value."""
        with self.diagnostics.trial() as sound:
            value = self.check_in_place(expr.callee, context)
        return call_hints.value_call_helps(value, expr) if sound() and not has_error(value) else ()

    def _check_function_call(
        self, fun: typed.FunSymbol, expr: tree.CallExpr, context: Context
    ) -> typed.TypedExpr:
        self.shared.calls.note_call(fun, expr.span)
        if len(expr.arguments) != len(fun.parameters) and fun in self.shared.damaged:
            self.names.losses += 1
            return self._error_after_arguments(expr, context)
        if len(expr.arguments) != len(fun.parameters):
            signature = ", ".join(f"{p.name}: {p.type}" for p in fun.parameters)
            self.diagnostics.error(
                "T003",
                _text_of_wrong_count(fun.name, len(fun.parameters), len(expr.arguments)),
                expr.span,
                also=((fun.span, "declared here"),),
                notes=(f"it is declared as `{fun.name}({signature}): {fun.result}`",),
            )
            return self._error_after_arguments(expr, context)
        arguments = [
            self.check(a, context, p.type, (p.span, f"`{p.name}` is `{p.type}`"))
            for a, p in zip(expr.arguments, fun.parameters, strict=True)
        ]
        if isinstance(fun.result, ErrorType):
            return self.lost_expr(expr.span)
        if has_error(*arguments):
            return error_expr(expr.span)
        return typed.TypedCall(fun.result, expr.span, fun, tuple(arguments))

    # ------------------------------------------------------------ built in

    def _check_builtin(
        self, name: str, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        span = expr.span
        if name in {"mode", "margin", "age"}:
            return self._mode_or_age(name, expr, context)
        if name not in TAKES:
            assert isinstance(expr.callee, tree.NameExpr)
            self._report_unknown_function(expr.callee.name, expr, context, expected)
            return self._error_after_arguments(expr, context)
        arity = ARITY.get(name, 1)
        if not self._has_arity(name, expr, arity, context):
            return self._error_after_arguments(expr, context)
        hint = _expected_argument_type(name, expected)
        arguments = [self.check_unconverted(a, context, hint) for a in expr.arguments]
        if has_error(*arguments):
            return error_expr(span)
        if arity == 2:
            arguments = list(unify_literals(*arguments))
        result = _builtin_result_type(name, arguments)
        if result is None:
            return self._refuse_arguments(name, expr, arguments)
        first = arguments[0]
        if name == "float" and isinstance(first, typed.Literal):
            return typed.Literal(FLOAT, span, float(first.value))
        if name in {"float", "int"} and type(first.type) is type(result):
            return first
        return typed.Builtin(result, span, name, tuple(arguments))

    def _report_unknown_function(
        self, name: tree.Name, expr: tree.CallExpr, context: Context, expected: Type | None
    ) -> None:
        """Reports N001 for an unknown function, with similar ones that take as many arguments."""
        fits = [
            n
            for n in (*TAKES, *context.scope.entries, *self.names.prelude)
            if n[0] != "_" and self._arity_of(n, context) == len(expr.arguments)
        ]
        self.report_unknown(
            name,
            context,
            helps=self._unknown_call_helps(name.text, expr.callee.span, expr, context, expected),
            among=fits,
            otherwise=self._help_with_similar_function(name.text, context),
        )

    def _has_arity(self, name: str, expr: tree.CallExpr, wanted: int, context: Context) -> bool:
        if len(expr.arguments) == wanted:
            return True
        takes = TAKES.get(name, "a topic" if name == "age" else "a module")
        a_range = name == "saturate" and len(expr.arguments) == 3
        helps: tuple[Help, ...] = (replace(expr.callee.span, "clamp"),) if a_range else ()
        if a_range:
            with self.diagnostics.trial() as sound:
                value = self.check_unconverted(expr.arguments[0], context, None)
            if sound() and is_vector(value.type):
                first, _, high = (a.span.text for a in expr.arguments)
                helps = (replace(expr.span, f"saturate({first}, {high})"),)
        if name in {"min", "max"} and len(expr.arguments) > wanted:
            helps = (call_hints.nested_call_help(name, expr),)
        self.diagnostics.error(
            "T003",
            _text_of_wrong_count(name, wanted, len(expr.arguments)),
            expr.span,
            notes=(f"`{name}` takes {takes}",),
            helps=helps,
        )
        return False

    def _refuse_arguments(
        self, name: str, expr: tree.CallExpr, arguments: list[typed.TypedExpr]
    ) -> typed.TypedExpr:
        shown = " and ".join(f"`{a.type}`" for a in arguments)
        kinds = {type(a.type) for a in arguments}
        helps: tuple[Help, ...] = ()
        if name == "abs" and is_vector(arguments[0].type):
            helps = (replace(expr.callee.span, "norm"),)
        elif name in {"min", "max"} and kinds == {IntType, FloatType}:
            helps = ("convert the int: `float(...)`",)
        elif name in {"sqrt", "floor"} and kinds == {IntType}:
            helps = (f"convert the int: `{name}(float(...))`",)
        return self.refuse(
            "T002",
            f"`{name}` does not apply to {shown}",
            expr.span,
            also=tuple(
                (e.span, f"`{a.type}`") for e, a in zip(expr.arguments, arguments, strict=True)
            ),
            notes=(f"`{name}` takes {TAKES[name]}",),
            helps=helps,
        )

    # ------------------------------------------------------------ modes and ages

    def _mode_or_age(self, name: str, expr: tree.CallExpr, context: Context) -> typed.TypedExpr:
        span = expr.span
        if not self._has_arity(name, expr, 1, context):
            return error_expr(span)
        argument = expr.arguments[0]
        if name == "age":
            read = self.check(argument, context)
            if has_error(read):
                return error_expr(span)
            if isinstance(read, typed.TopicRead):
                return typed.AgeRead(FLOAT, span, read.topic)
            return self.refuse(
                "T002",
                "`age` takes a topic",
                argument.span,
                f"this is {with_article(read.type)}",
                notes=("a topic as a whole has an age, a part of it has none",),
                whole=span,
            )
        if not context.has_modes:
            return self.refuse(
                "T013",
                f"`{name}` has no meaning in {context.where}",
                span,
                notes=(f"only nodes, modules and properties see the {name} of a module",),
            )
        module = self._module_of_argument(argument, context, name)
        if module is None:
            return error_expr(span)
        if name == "margin":
            return typed.MarginRead(FLOAT, span, module)
        return typed.ModeRead(MODE, span, module)

    def _module_of_argument(
        self, argument: tree.SyntaxExpr, context: Context, builtin: str
    ) -> typed.ModuleSymbol | str | None:
        names = names_of_chain(argument)
        found = "an expression"
        lost = names is not None and names[0].text in context.lost
        if lost or isinstance(argument, tree.ErrorExpr):
            self.names.losses += 1
            return None
        if names is not None and context.find_local(names[0].text) is not None:
            found = "a variable"
        elif names is not None:
            target, depth = find_instance(context.instances or {}, names)
            if isinstance(target, typed.ModuleSymbol) and depth == len(names):
                return ".".join(n.text for n in names)
            if not depth and len(names) <= 2:
                return self._declared_module(names, argument, context, builtin)
            found = "an instance of something else" if depth else "nothing that is known"
        self._refuse_non_module(builtin, argument.span, found)
        return None

    def _declared_module(
        self, names: Sequence[tree.Name], argument: tree.SyntaxExpr, context: Context, builtin: str
    ) -> typed.ModuleSymbol | None:
        """Gives the module that these names mean; None after a reported error."""
        ref = tree.Ref(names[0] if len(names) > 1 else None, names[-1], argument.span)
        entry = self.names.find_ref(context.scope, ref)
        if entry is None:
            return None
        symbol = self.shared.resolve(entry, argument.span)
        if entry.kind == "module":
            return symbol if isinstance(symbol, typed.ModuleSymbol) else None
        helps = entry.helps_for_other_kind("module", argument.span)
        self._refuse_non_module(builtin, argument.span, f"a {entry.kind}", helps)
        return None

    def _refuse_non_module(
        self, builtin: str, span: Span, found: str, helps: tuple[Help, ...] = ()
    ) -> None:
        """Reports T002 for `mode` or `margin` applied to something that is no module."""
        self.diagnostics.error(
            "T002", f"`{builtin}` takes a module", span, f"this is {found}", helps=helps
        )


def _text_of_wrong_count(name: str, wanted: int, count: int) -> str:
    s = "" if wanted == 1 else "s"
    none = "none are" if count == 0 else f"{count} {'is' if count == 1 else 'are'}"
    return f"`{name}` takes {wanted or 'no'} argument{s}, but {none} given"


_CONVERSIONS: dict[str, tuple[Type, tuple[type[Type], ...]]] = {
    "float": (FLOAT, (IntType, FloatType)),
    "int": (INT, (IntType, FloatType)),
    "seconds": (FLOAT, (DurationType,)),
}


def _builtin_result_type(name: str, arguments: list[typed.TypedExpr]) -> Type | None:
    """Gives the result type of a builtin, or None; int literals in the list may become floats."""
    first = arguments[0].type
    if name in {"sqrt", "floor"}:
        as_float = float_literal(arguments[0])
        if as_float is not None:
            arguments[0] = as_float
            return FLOAT
        return FLOAT if isinstance(first, FloatType) else None
    if name in _CONVERSIONS:
        result, takes = _CONVERSIONS[name]
        return result if isinstance(first, takes) else None
    if name in {"abs", "min", "max"}:
        kinds = {type(a.type) for a in arguments}
        return FLOAT if kinds == {FloatType} else INT if kinds == {IntType} else None
    if name in {"dot", "norm"}:
        return FLOAT if is_vector(first) and first == arguments[-1].type else None
    return _saturate_type(arguments)


def _saturate_type(arguments: list[typed.TypedExpr]) -> Type | None:
    """Gives the result type of `saturate`, or None; an int literal as limit becomes a float."""
    first = arguments[0].type
    bound = float_literal(arguments[1]) or arguments[1]
    if isinstance(bound.type, FloatType) and (is_vector(first) or isinstance(first, FloatType)):
        arguments[1] = bound
        return first
    return None


def _expected_argument_type(name: str, expected: Type | None) -> Type | None:
    """Gives FLOAT if int literals as arguments of the builtin should become floats, else None."""
    keeps = isinstance(expected, FloatType) and name in {"abs", "min", "max"}
    return FLOAT if keeps or name in {"sqrt", "floor"} else None
