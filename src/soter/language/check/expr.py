"""Checks expressions: names and types; makes conversions explicit.

Purpose: turns an expression of the syntax, with its context, into a typed one; on a mistake it
reports one diagnostic and returns an expression of type ERROR, about which nothing more is
reported. This file has literals, names, records and lists; its base classes have the rest.
Non-goals: evaluation, declarations, statements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from soter.diagnostics.fixes import replace
from soter.language.check import unknown_names
from soter.language.check.call import CallChecker
from soter.language.check.checker_interface import SPECIALS
from soter.language.check.dots_and_brackets import quoted
from soter.language.check.expression_base import error_expr, float_literal, has_error, plain_type
from soter.language.check.operators_and_choices import ChooseChecker, OperatorChecker
from soter.language.check.scope import BUILTIN_FUNCTIONS, FieldOf
from soter.language.model import typed
from soter.language.model.types import (
    BOOL,
    DURATION,
    FLOAT,
    INT,
    INT_MAX,
    ArrayType,
    FloatType,
    ListType,
    RecordType,
    Type,
    leaf_count,
)
from soter.language.model.values import VALUE_MAX, Table
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Context
    from soter.language.check.scope import Entry

__all__ = ["ExprChecker", "error_expr", "float_literal", "has_error", "plain_type"]


class ExprChecker(CallChecker, OperatorChecker, ChooseChecker):
    """Checks expressions of one program."""

    def check_unconverted(
        self, expr: tree.SyntaxExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Gives the typed expression, not yet converted; number literals get type `expected`."""
        typed_expr = self._check_by_kind(expr, context, expected)
        if not isinstance(typed_expr, typed.Literal) or not isinstance(typed_expr.value, Table):
            return typed_expr
        return self.refuse(
            "T021",
            f"the table `{typed_expr.name}` is too large to be a value",
            expr.span,
            f"{leaf_count(typed_expr.type)} numbers",
            notes=(f"what is passed on is copied, and has at most {VALUE_MAX} numbers",),
            helps=("read elements of it: `TABLE[i]`, `TABLE.len`, `for x in TABLE { ... }`",),
        )

    def check_in_place(self, expr: tree.SyntaxExpr, context: Context) -> typed.TypedExpr:
        """Gives a typed expression that may be a large table, as only a part of it will be read."""
        return self._check_by_kind(expr, context, None)

    def _check_by_kind(
        self, expr: tree.SyntaxExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        method = self._METHODS.get(type(expr))
        if method is None:  # the parser could not read it
            return self.lost_expr(expr.span)
        return method(self, expr, context, expected)

    # ------------------------------------------------------------ literals

    def _int_literal(self, expr: tree.IntLit, _: Context, expected: Type | None) -> typed.TypedExpr:
        if isinstance(expected, FloatType):
            return typed.Literal(FLOAT, expr.span, float(expr.value))
        # -2^63 is written as a negated 2^63, which does not fit itself: see `check_unary`
        if expr.value > INT_MAX:
            return self.refuse(
                "T016",
                f"{expr.value} does not fit into 64 bits",
                expr.span,
                f"the largest int is {INT_MAX}",
                helps=(f"as a float it is `{float(expr.value)!r}`",) if expected is None else (),
            )
        return typed.Literal(INT, expr.span, expr.value)

    def _float_literal(self, expr: tree.FloatLit, _: Context, __: Type | None) -> typed.TypedExpr:
        return typed.Literal(FLOAT, expr.span, expr.value)

    def _bool_literal(self, expr: tree.BoolLit, _: Context, __: Type | None) -> typed.TypedExpr:
        return typed.Literal(BOOL, expr.span, expr.value)

    def _duration_literal(
        self, expr: tree.DurationLit, _: Context, __: Type | None
    ) -> typed.TypedExpr:
        if expr.value_ns is None or expr.value_ns > INT_MAX:
            return self.refuse(
                "C005",
                f"`{expr.text}` is not a whole number of nanoseconds",
                expr.span,
                notes=("time is counted in whole nanoseconds, so that calendars are exact",),
            )
        return typed.Literal(DURATION, expr.span, expr.value_ns)

    # ------------------------------------------------------------ names

    def _check_name(self, expr: tree.NameExpr, context: Context, _: Type | None) -> typed.TypedExpr:
        name, span = expr.name.text, expr.span
        local = context.find_local(name)
        if local is not None:
            local.used = True
            self.names.note_meaning(span, local)
            if has_error(read := typed.VarRead(local.type, span, local)):
                self.names.losses += 1
            return read
        if context.hidden is not None:
            hidden = context.hidden.find_local(name)
            if hidden is not None:
                hidden.used = True
                self.names.note_meaning(span, hidden)
                return self._refuse_in_constant(f"`{name}`", span, hidden.span, context)
        if name in context.private:
            context.private[name].used = True
            return self.refuse(
                "T013",
                f"`{name}` has no meaning in {context.where}",
                span,
                also=((context.private[name].span, "a local of the node"),),
                notes=("a contract speaks about what a node reads and publishes",),
                helps=("check it in the step: `assert ...;`",),
            )
        entry = self.names.find_entry(context.scope, name, span)
        if entry is not None:
            return self.entry_value(entry, span, context)
        if name in SPECIALS:
            return self._check_special(name, span, context)
        if name in context.lost:
            return self.lost_expr(span)
        if context.instances is not None and name in context.instances:
            return self.refuse_instance(context.instances[name].what, name, span)
        if name in BUILTIN_FUNCTIONS and not context.broken:
            self.diagnostics.error(
                "N003",
                f"`{name}` is a function, not a value",
                span,
                helps=(f"call it: `{name}(...)`",),
            )
        else:
            self.report_unknown(
                expr.name, context, SPECIALS, helps=self._state_helps(name, span, context)
            )
        return error_expr(span)

    def _state_helps(self, name: str, span: Span, context: Context) -> tuple[Help, ...]:
        """Gives the help `c.truth.x` for `x` in a system, if exactly one plant has a state `x`."""
        owners = [
            path
            for path, instance in (context.instances or {}).items()
            if isinstance(instance.what, typed.PlantSymbol)
            and instance.what.truth.index(name) is not None
        ]
        if len(owners) != 1 or context.constant:
            return ()
        return (replace(span, f"{owners[0]}.truth.{name}"),)

    def _check_special(self, name: str, span: Span, context: Context) -> typed.TypedExpr:
        if context.constant:
            return self._refuse_in_constant(f"`{name}`", span, None, context)
        if name == "in_control" and context.node is not None:
            return typed.InControl(BOOL, span)
        if name == "time" and context.has_time:
            return typed.TimeRead(FLOAT, span)
        if name == "dt" and context.has_period:
            return typed.PeriodRead(FLOAT, span)
        return self.refuse(
            "T013",
            f"`{name}` has no meaning in {context.where}",
            span,
            notes=(SPECIALS[name],),
            helps=("pass it as an argument",) if context.result is not None else (),
        )

    def _refuse_in_constant(
        self, subject: str, span: Span, declared: Span | None, context: Context
    ) -> typed.TypedExpr:
        """Reports T008, or T007 for a loop's bound, if a constant reads a value of the run."""
        step = context.constant == "T007" and context.where == "the bound of a loop"
        what_runs = context.constant == "T007" and not step
        return self.refuse(
            context.constant or "T008",
            f"{context.where} cannot depend on {subject}",
            span,
            "known only when the program runs",
            also=((declared, "declared here"),) if declared is not None else (),
            notes=("every step must end within a bound that is known beforehand",)
            if step
            else ("it is computed when the program is compiled",),
            helps=("loop up to a constant maximum, and leave out rounds with `if` inside",)
            if step
            else ("how many there are is for a `const` to say",)
            if what_runs
            else (),
        )

    def entry_value(self, entry: Entry, span: Span, context: Context) -> typed.TypedExpr:
        """Gives the typed expression for a declaration that is used as a value."""
        symbol = self.shared.resolve(entry, span)
        if symbol is None:
            return error_expr(span)
        if isinstance(symbol, typed.ConstSymbol):
            return typed.Literal(symbol.type, span, symbol.value, symbol.name)
        if isinstance(symbol, typed.ParamSymbol):
            self.shared.calls.note_param(symbol, span)
            if context.constant:
                subject = f"the parameter `{symbol.name}`"
                return self._refuse_in_constant(subject, span, symbol.span, context)
            return typed.ParamRead(symbol.type, span, symbol)
        if isinstance(symbol, typed.TopicSymbol):
            return self.topic_read(symbol, span, context)
        return self.refuse(
            "N003",
            f"`{entry.decl.name.text}` is a {entry.kind}, not a value",
            span,
            also=((entry.decl.name.span, "declared here"),),
            helps=self._helps_for_non_value(entry, symbol, span, context),
        )

    def _helps_for_non_value(
        self, entry: Entry, symbol: object, span: Span, context: Context
    ) -> tuple[Help, ...]:
        """Gives helps with a value, for a function, module, plant, node or type used as a value."""
        name = entry.decl.name.text
        if isinstance(symbol, typed.FunSymbol):
            arguments = ", ".join(p.name for p in symbol.parameters)
            title = f"call it: `{name}({arguments})`"
            return (title if arguments else replace(span, f"{name}()", title),)
        if isinstance(symbol, typed.ModuleSymbol):
            return (f"its mode is `mode({name})`",)
        if isinstance(symbol, typed.PlantSymbol) and context.instances is not None:
            mine = [i for i, s in context.instances.items() if s.what is symbol]
            if mine and span.source.text[span.end :].startswith(".truth"):
                return (replace(span, mine[0]),)
            return (f"its state is `{mine[0]}.truth`",) if mine else ()
        if entry.kind in ("node", "plant") and not context.constant:
            return entry.helps_for_other_kind("value", span)
        return self.value_helps(entry.decl.name, context) if entry.kind == "type" else ()

    def topic_read(self, topic: typed.TopicSymbol, span: Span, context: Context) -> typed.TypedExpr:
        """Gives the typed read of a topic; reports an error if this place may not read it."""
        if context.constant:
            return self._refuse_in_constant(f"topic `{topic.name}`", span, topic.span, context)
        if context.topics is None:
            in_function = context.result is not None
            return self.refuse(
                "M010",
                f"topic `{topic.name}` cannot be read in {context.where}",
                span,
                notes=("functions see their arguments, constants and parameters only",)
                if in_function
                else ("this is computed before the program runs",),
                helps=("pass its value as an argument",) if in_function else (),
            )
        if context.topics != "any" and topic not in context.topics:
            return self._report_not_subscribed(topic, span, context)
        context.topics_read.setdefault(topic)
        queue = context.queues.get(topic)
        t = topic.type if queue is None else ListType(topic.type, queue)
        return typed.TopicRead(t, span, topic)

    def _report_not_subscribed(
        self, topic: typed.TopicSymbol, span: Span, context: Context
    ) -> typed.TypedExpr:
        if context.owner in self.shared.damaged:  # it may be the one that could not be read
            return self.lost_expr(span)
        if context.node is not None and topic in context.node.publishes:
            message = f"{context.where} publishes `{topic.name}` and cannot read it back"
            helps: tuple[Help, ...] = ("keep the value in a local `var`",)
        else:
            verb = "read" if context.inputs == "reads" else "subscribe to"
            message = f"{context.where} does not {verb} `{topic.name}`"
            helps = (f"add `{topic.name}` to `{context.inputs}`",)
            if isinstance(context.owner, (typed.NodeSymbol, typed.PlantSymbol)):
                helps = (unknown_names.listing_fix(context.inputs, span.text, context.owner.span),)
        return self.refuse("M010", message, span, helps=helps)

    # ------------------------------------------------------------ records and lists

    def _record_literal(
        self, expr: tree.RecordExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        target = expected if isinstance(expected, RecordType) else None
        wanted = dict(target.fields) if target else {}
        values: dict[str, typed.TypedExpr] = {}
        first: dict[str, Span] = {}
        failed = False
        for name, value in expr.fields:
            checked = self.check(value, context, wanted.get(name.text))
            failed = failed or has_error(checked)
            if name.text in values:
                self.diagnostics.error(
                    "T010",
                    f"field `{name.text}` is given twice",
                    name.span,
                    "given again here",
                    also=((first[name.text], "first given here"),),
                )
                failed = True
            elif target and name.text not in wanted:
                self.diagnostics.error(
                    "N004",
                    f"`{target}` has no field `{name.text}`",
                    name.span,
                    notes=(f"its fields are {quoted(list(wanted))}",),
                    helps=self.diagnostics.did_you_mean(name.text, wanted, name.span),
                )
                failed = True
            elif target:
                self.names.note_meaning(name.span, FieldOf(target, name.text))
            values[name.text] = checked
            first[name.text] = name.span
        missing = [n for n in wanted if n not in values]
        if target and missing and len(values) < len(wanted):
            self.diagnostics.error(
                "T010",
                f"`{target}` needs {quoted(missing)} too",
                expr.span,
                f"without {quoted(missing)}",
                notes=("a record is given with all of its fields",),
            )
            failed = True
        if failed:
            return error_expr(expr.span)
        made = _ordered_literal(expr, values, target)
        if target is None and isinstance(made.type, RecordType):
            self.names.note_syntax_of_fields(made.type.fields, expr)
        return made

    def _list_literal(
        self, expr: tree.ListExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        element = expected.element if isinstance(expected, (ArrayType, ListType)) else None
        items = [self.check(e, context, element) for e in expr.elements]
        count = len(items)
        if isinstance(expected, ListType):
            if count > expected.capacity:
                self._report_wrong_count(
                    f"{count} elements do not fit into `{expected}`",
                    expr.elements[expected.capacity].span,
                    f"element number {expected.capacity + 1}",
                )
                return error_expr(expr.span)
            target: Type = expected
        elif isinstance(expected, ArrayType):
            if count != expected.size:
                are = f"{count} {'is' if count == 1 else 'are'} given"
                self._report_wrong_count(
                    f"`{expected}` has {expected.size} elements, but {are}", expr.span, ""
                )
                return error_expr(expr.span)
            target = expected
        elif not items:
            return self.refuse(
                "T019",
                "an empty list needs a type",
                expr.span,
                helps=("say it where it is declared: `var xs: float[<=8] = [];`",),
            )
        else:
            floats = any(isinstance(i.type, FloatType) for i in items)
            first = FLOAT if floats else plain_type(items[0].type)
            items = [self.convert(i, first) for i in items]
            target = ArrayType(first, count)
        if has_error(*items):
            return error_expr(expr.span)
        return typed.Aggregate(target, expr.span, tuple(items))

    def _report_wrong_count(self, message: str, span: Span, label: str) -> None:
        self.diagnostics.error("T019", message, span, label)

    _METHODS: ClassVar[
        dict[type[tree.SyntaxExpr], Callable[[Any, Any, Context, Any], typed.TypedExpr]]
    ] = {
        tree.NameExpr: _check_name,
        tree.IntLit: _int_literal,
        tree.FloatLit: _float_literal,
        tree.BoolLit: _bool_literal,
        tree.DurationLit: _duration_literal,
        tree.FieldExpr: CallChecker.check_field,
        tree.IndexExpr: CallChecker.check_index,
        tree.CallExpr: CallChecker.check_call,
        tree.UnaryExpr: OperatorChecker.check_unary,
        tree.BinaryExpr: OperatorChecker.check_binary,
        tree.ConditionalExpr: OperatorChecker.check_conditional,
        tree.RecordExpr: _record_literal,
        tree.ListExpr: _list_literal,
        tree.ChooseExpr: ChooseChecker.check_choose,
    }


def _ordered_literal(
    expr: tree.RecordExpr, values: dict[str, typed.TypedExpr], target: RecordType | None
) -> typed.TypedExpr:
    if target is None:
        target = RecordType(tuple((n, plain_type(v.type)) for n, v in values.items()))
    names = [n for n, _ in target.fields]
    order = tuple(names.index(n) for n in values)
    straight = order == tuple(range(len(names)))
    elements = tuple(values.values())
    return typed.Aggregate(target, expr.span, elements, None if straight else order)
