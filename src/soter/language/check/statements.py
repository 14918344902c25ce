"""Checks statements, and so the bodies of functions and nodes.

Purpose: turns blocks of syntax into typed statements; checks scopes, assignments and returns.
Non-goals: expressions (`language/check/expr.py`), what a body belongs to (`declarations.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import append, insert, replace
from soter.language.check import unknown_names
from soter.language.check.checker_interface import SPECIALS
from soter.language.check.dots_and_brackets import index_help, may_be_in_range
from soter.language.check.expression_base import CheckerPart, error_expr, has_error, plain_type
from soter.language.check.scope import BUILTIN_FUNCTIONS, FieldOf
from soter.language.model import typed
from soter.language.model.types import (
    BOOL,
    ERROR,
    INT,
    ArrayType,
    DurationType,
    ErrorType,
    ListType,
    RecordType,
    default_value,
)
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.check.checker_interface import Context, Shared
    from soter.language.check.expr import ExprChecker
    from soter.language.model.types import Type

ASSIGNABLE = {"var", "local"}
MAX_LOOP = 1_000_000


class StmtChecker(CheckerPart):
    """Checks statements of one program."""

    def __init__(self, shared: Shared, expressions: ExprChecker) -> None:
        super().__init__(shared)
        self.expressions = expressions

    def check_block(self, block: tree.Block, context: Context) -> tuple[typed.TypedStmt, ...]:
        """Gives the typed statements of a block, for which it opens a new scope."""
        context.locals.append({})
        statements = [self.check_statement(s, context) for s in block.statements]
        frame = context.locals.pop()
        context.gone.update(frame)
        if not context.scope.loaded.library:
            self.shared.unused.warn_of_variables(list(frame.values()))
        return tuple(s for s in statements if s is not None)

    def enter_local(self, name: tree.Name, t: Type, kind: str, context: Context) -> typed.Variable:
        """Enters a new local; reports N002 for the same name twice in one scope."""
        frame = context.locals[-1]
        first = frame.get(name.text)
        if first is not None:
            self.shared.names.report_duplicate(name.text, name.span, first.span)
            first.used = True
        variable = typed.Variable(name.text, t, kind, name.span)
        self.shared.names.note_meaning(name.span, variable)
        frame[name.text] = variable
        if kind in ("let", "var"):
            self._warn_of_shadowing(name, context.node, context)
        return variable

    def _warn_of_shadowing(
        self, name: tree.Name, node: typed.NodeSymbol | None, context: Context
    ) -> None:
        """Warns W017 of a local named like a constant, or like a topic that the node reads."""
        entry = context.scope.entries.get(name.text)
        if entry is not None and entry.kind in ("constant", "parameter"):
            self.diagnostics.warning(
                "W017",
                f"`{name.text}` hides the {entry.kind} of the same name",
                name.span,
                f"a local of {context.where}",
                also=((entry.decl.name.span, f"the {entry.kind}"),),
                helps=(f"give it another name, such as `own_{name.text.lower()}`",),
            )
            return
        topics = [] if node is None else [s.topic for s in node.subscribes]
        hidden = next((t for t in topics if entry is not None and t is entry.symbol), None)
        if hidden is not None:
            self.diagnostics.warning(
                "W017",
                f"`{name.text}` hides the topic of the same name",
                name.span,
                "a local of the step",
                also=((hidden.span, "the topic"),),
                helps=(f"give it another name, such as `{name.text}_now`",),
            )

    def check_statement(self, s: tree.SyntaxStmt, context: Context) -> typed.TypedStmt | None:
        """Gives the typed statement, or None if it has too many errors to be kept."""
        return self._STATEMENTS[type(s)](self, s, context)

    def _check_assert(self, s: tree.AssertStmt, context: Context) -> typed.TypedStmt:
        return typed.Assert(s.span, self.expressions.check(s.condition, context, BOOL), s.message)

    def _check_if(self, s: tree.IfStmt, context: Context) -> typed.TypedStmt:
        arms = tuple(
            (self.expressions.check(c, context, BOOL), self.check_block(b, context))
            for c, b in s.arms
        )
        otherwise = self.check_block(s.otherwise, context) if s.otherwise else ()
        return typed.TypedIf(s.span, arms, otherwise)

    def _check_declaration(
        self, s: tree.LetStmt | tree.VarStmt, context: Context
    ) -> typed.TypedStmt | None:
        t = self.shared.resolve_type(s.type, context.scope, context) if s.type else None
        if s.value is None:
            value = error_expr(s.span)
            if t is not None and not isinstance(t, ErrorType):
                value = typed.Literal(t, s.span, default_value(t))
        else:
            because = (s.type.span, f"declared as `{t}`") if s.type is not None else None
            value = self.expressions.check(s.value, context, t, because)
        variable_type = t if t is not None else plain_type(value.type)
        if isinstance(variable_type, DurationType):
            report_stored_duration(value.span, self.diagnostics)
            variable_type = ERROR
        kind = "let" if isinstance(s, tree.LetStmt) else "var"
        variable = self.enter_local(s.name, variable_type, kind, context)
        return typed.TypedDeclare(s.span, variable, value)

    # ------------------------------------------------------------ places

    def _check_assign(self, s: tree.AssignStmt, context: Context) -> typed.TypedStmt | None:
        place = self.assigned_place(s.place, context)
        because = None
        if place is not None and not place.path:
            variable = place.variable
            because = (variable.span, f"`{variable.name}` is `{variable.type}`")
        value = self.expressions.check(s.value, context, place.type if place else None, because)
        return typed.TypedAssign(s.span, place, value) if place else None

    def assigned_place(self, expr: tree.SyntaxExpr, context: Context) -> typed.Place | None:
        """Gives the variable left of `=`, or the part of it; None after a reported error."""
        steps: list[tree.FieldExpr | tree.IndexExpr] = []
        base = expr
        while isinstance(base, (tree.FieldExpr, tree.IndexExpr)):
            steps.append(base)
            base = base.target
        if not isinstance(base, tree.NameExpr):
            if isinstance(base, tree.ErrorExpr):
                self.shared.names.losses += 1
            else:
                self.diagnostics.error("T009", "only variables can be assigned", expr.span)
            return None
        variable = context.find_local(base.name.text)
        if variable is None:
            self._report_no_variable(base, steps, context)
            return None
        self.shared.names.note_meaning(base.span, variable)
        if variable.kind not in ASSIGNABLE:
            self._report_not_assignable(variable, base)
            return None
        t = variable.type
        path: list[int | typed.TypedExpr] = []
        for step in reversed(steps):
            if isinstance(t, ErrorType):
                self.shared.names.losses += 1
                return None
            selected = self._select_part(step, t, context)
            if selected is None:
                return None
            path.append(selected[0])
            t = selected[1]
        if path or variable.kind == "local":
            variable.used = True
        return typed.Place(variable, tuple(path), t, expr.span)

    def _select_part(
        self, step: tree.FieldExpr | tree.IndexExpr, t: Type, context: Context
    ) -> tuple[int | typed.TypedExpr, Type] | None:
        if isinstance(step, tree.FieldExpr):
            return self._select_field(step, t)
        index_expr = self.expressions.check(step.index, context, INT)
        if has_error(index_expr):
            return None
        if not isinstance(t, (ArrayType, ListType)):
            self.diagnostics.error(
                "T002",
                f"`{t}` cannot be indexed",
                step.target.span,
                f"this is `{t}`",
                notes=("only arrays and lists have elements",),
                helps=index_help(t, step.span, step.target.span.text, index_expr),
            )
            return None
        may_be_in_range(self.diagnostics, t, index_expr, step.target.span.text)
        return index_expr, t.element

    def _select_field(self, step: tree.FieldExpr, t: Type) -> tuple[int, Type] | None:
        name = step.field.text
        notes: tuple[str, ...] = ()
        helps: tuple[Help, ...] = ()
        if isinstance(t, RecordType):
            index = t.index(name)
            if index is not None:
                self.shared.names.note_meaning(step.field.span, FieldOf(t, name))
                return index, t.fields[index][1]
            fields = [n for n, _ in t.fields]
            notes = (f"its fields are {', '.join(f'`{n}`' for n in fields)}",)
            helps = self.diagnostics.did_you_mean(name, fields, step.field.span)
        elif isinstance(t, (ListType, ArrayType)) and name == "len":
            notes = ("the length follows from the elements",)
            helps = ("`push list, value;` adds one",) if isinstance(t, ListType) else ()
        self.diagnostics.error(
            "N004",
            f"`{t}` has no field `{name}` that could be assigned",
            step.field.span,
            notes=notes,
            helps=helps,
        )
        return None

    def _report_no_variable(
        self, base: tree.NameExpr, steps: list[tree.FieldExpr | tree.IndexExpr], context: Context
    ) -> None:
        name = base.name.text
        entry = self.shared.names.find_entry(context.scope, name, base.span)
        if entry is None and name in (*BUILTIN_FUNCTIONS, *SPECIALS):
            why = "built in" if name in BUILTIN_FUNCTIONS else "read only"
            self.diagnostics.error(
                "T009", f"`{name}` is {why}: it cannot be assigned", base.span, "assigned here"
            )
            return
        if entry is None:
            helps: tuple[Help, ...] = ()
            otherwise = () if steps else unknown_names.help_to_declare(base.name)
            if steps and isinstance(steps[-1], tree.FieldExpr):
                helps = unknown_names.helps_for_foreign_qualifier(base.name, steps[-1].field)
            self.expressions.report_unknown(base.name, context, helps=helps, otherwise=otherwise)
            return
        if self.shared.resolve(entry, base.span) is None:
            return
        helps = ()
        symbol = entry.symbol
        if isinstance(symbol, typed.TopicSymbol) and symbol.input:
            helps = ("an input topic is set by the environment alone: keep the value in a `var`",)
        elif entry.kind == "topic":
            helps = (insert(base.span, "publish ", f"write `publish {name} = ...;`"),)
        elif entry.kind == "constant":
            helps = ("what changes is a `var`: declare one, with this for its first value",)
        self.diagnostics.error(
            "T009",
            f"`{name}` is a {entry.kind}: it cannot be assigned",
            base.span,
            also=((entry.decl.name.span, "declared here"),),
            helps=helps,
        )

    def _report_not_assignable(self, variable: typed.Variable, base: tree.NameExpr) -> None:
        why = {
            "let": "was declared with `let`",
            "parameter": "is an argument",
            "loop": "is the variable of a loop",
        }.get(variable.kind, "cannot be assigned here")
        word = variable.span.source.text[: variable.span.start].rstrip()
        let = Span(variable.span.source, len(word) - len("let"), len(word))
        helps: tuple[Help, ...] = ()
        if variable.kind == "let":
            helps = (replace(let, "var", "declare it with `var`"),)
        elif variable.kind == "parameter":
            helps = (f"copy it first: `var {variable.name}_now = {variable.name};`",)
        self.diagnostics.error(
            "T009",
            f"`{variable.name}` {why}: it never changes",
            base.span,
            "assigned here",
            also=((variable.span, "declared here"),),
            helps=helps,
        )

    def _check_push(self, s: tree.PushStmt, context: Context) -> typed.TypedStmt | None:
        place = self.assigned_place(s.place, context)
        t = place.type if place else None
        if place is not None and not isinstance(t, (ListType, ErrorType)):
            self.diagnostics.error(
                "T002",
                f"`push` does not apply to `{t}`",
                s.place.span,
                f"this is `{t}`",
                notes=("only bounded lists `T[<=n]` grow",),
            )
            place = None
        element = t.element if isinstance(t, ListType) else None
        value = self.expressions.check(s.value, context, element)
        if place is None or has_error(value) or not isinstance(t, ListType):
            return None
        return typed.TypedPush(s.span, place, value)

    # ------------------------------------------------------------ publish, return, loops

    def _check_publish(self, s: tree.PublishStmt, context: Context) -> typed.TypedStmt | None:
        topic = self.shared.topic_of_ref(s.topic, context.scope)
        because = (topic.span, f"topic `{topic.name}` is `{topic.type}`") if topic else None
        value = self.expressions.check(s.value, context, topic.type if topic else None, because)
        if topic is None:
            return None
        if context.node is None:
            self.diagnostics.error(
                "M009",
                f"{context.where} cannot publish",
                s.span,
                notes=("only the step of a node publishes",),
                helps=("return the value, and publish it in the step",)
                if context.result is not None
                else (),
            )
            return None
        if topic not in context.node.publishes and context.node in self.shared.damaged:
            self.shared.names.losses += 1
            return None
        if topic not in context.node.publishes:
            self.diagnostics.error(
                "M009",
                f"{context.where} does not declare that it publishes `{topic.name}`",
                s.topic.span,
                also=((context.node.span, "the node"),),
                helps=unknown_names.publishing_helps(
                    (e.decl for e in context.scope.entries.values()),
                    s.topic.text,
                    context.node.span,
                ),
            )
            return None
        self.shared.published.setdefault(context.node, set()).add(topic)
        return typed.TypedPublish(s.span, topic, value, context.node.bursts.get(topic))

    def _check_return(self, s: tree.ReturnStmt, context: Context) -> typed.TypedStmt | None:
        if context.result is None:
            self.expressions.check(s.value, context)
            self.diagnostics.error(
                "T013",
                f"`return` has no meaning in {context.where}",
                s.span,
                notes=("only functions return a value; a step publishes, and runs to its end",),
                helps=("to skip the rest of it, put the rest into an `else`",),
            )
            return None
        at = context.result_span
        because = None if at is None else (at, f"returns `{context.result}`")
        value = self.expressions.check(s.value, context, context.result, because)
        return typed.TypedReturn(s.span, value)

    def _loop_bound(self, expr: tree.SyntaxExpr, context: Context) -> int | None:
        value = self.shared.const_value(
            expr, context.scope, INT, "the bound of a loop", context, "T007"
        )
        return value if isinstance(value, int) else None

    def _check_for_range(self, s: tree.ForRangeStmt, context: Context) -> typed.TypedStmt | None:
        low, high = self._loop_bound(s.low, context), self._loop_bound(s.high, context)
        if low is not None and high is not None and high - low > MAX_LOOP:
            self.diagnostics.error(
                "T007",
                f"this loop runs {high - low} times",
                s.low.span.to(s.high.span),
                f"at most {MAX_LOOP} rounds are possible",
            )
            low = None
        context.locals.append({})
        variable = self.enter_local(s.name, INT, "loop", context)
        body = self.check_block(s.body, context)
        context.locals.pop()
        if low is None or high is None:
            return None
        return typed.ForRange(s.span, variable, low, high, body)

    def _check_for_each(self, s: tree.ForEachStmt, context: Context) -> typed.TypedStmt | None:
        counted = unknown_names.range_helps(s.sequence)
        if counted and isinstance(s.sequence, tree.CallExpr):
            self.diagnostics.error(
                "T002", "a loop counts over a range", s.sequence.span, helps=counted
            )
            sequence = error_expr(s.sequence.span)
        else:
            sequence = self.expressions.check_in_place(s.sequence, context)
        t = sequence.type
        element: Type = ERROR
        if isinstance(t, (ArrayType, ListType)):
            element = t.element
        elif not isinstance(t, ErrorType):
            self.diagnostics.error(
                "T002",
                f"`for` does not apply to `{t}`",
                s.sequence.span,
                f"this is `{t}`",
                notes=("a loop goes through an array, a list, or from one int to another",),
                helps=_loop_helps(sequence, context),
            )
        context.locals.append({})
        variable = self.enter_local(s.name, element, "loop", context)
        body = self.check_block(s.body, context)
        context.locals.pop()
        if isinstance(element, ErrorType):
            return None
        return typed.ForEach(s.span, variable, sequence, body)

    _STATEMENTS: ClassVar[
        dict[type[tree.SyntaxStmt], Callable[[StmtChecker, Any, Context], typed.TypedStmt | None]]
    ] = {
        tree.LetStmt: _check_declaration,
        tree.VarStmt: _check_declaration,
        tree.AssignStmt: _check_assign,
        tree.PushStmt: _check_push,
        tree.PublishStmt: _check_publish,
        tree.ReturnStmt: _check_return,
        tree.AssertStmt: _check_assert,
        tree.IfStmt: _check_if,
        tree.ForRangeStmt: _check_for_range,
        tree.ForEachStmt: _check_for_each,
    }


def _loop_helps(sequence: typed.TypedExpr, context: Context) -> tuple[Help, ...]:
    """Gives helps for a loop over no list: a queue for a topic, the range `0..e` for a number."""
    if isinstance(sequence, typed.TopicRead) and context.node is not None:
        for s in context.node.subscribes:
            if s.topic is sequence.topic and s.queue is None:
                title = f"a queue makes it a list: `subscribes {s.span.text} queue 8`"
                return (append(s.span, " queue 8", title),)
    return ("to count, write `for i in 0..10 { ... }`",)


def report_stored_duration(span: Span, diagnostics: Diagnostics) -> None:
    """Reports T014 for a duration that a running program would have to store."""
    diagnostics.error(
        "T014",
        "a running program has no durations",
        span,
        "this is a `duration`",
        notes=("durations are for constants and parameters: periods and the like",),
        helps=("`seconds(...)` gives the time as a `float`",),
    )


def always_returns(statements: tuple[typed.TypedStmt, ...]) -> bool:
    """Whether every path through the statements ends in a `return`."""
    for s in statements:
        if isinstance(s, typed.TypedReturn):
            return True
        if (
            isinstance(s, typed.TypedIf)
            and s.otherwise
            and always_returns(s.otherwise)
            and all(always_returns(body) for _, body in s.arms)
        ):
            return True
    return False
