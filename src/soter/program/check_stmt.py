"""Check statements and bodies of functions and nodes.

Purpose: blocks of syntax -> tuples of typed statements; scoping, assignment rules, returns.
Non-goals: expressions (`check_expr.py`), what a body belongs to (`check_decl.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_expr import ExprChecker, error_expr, is_error, plain
from soter.program.types import (
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
from soter.syntax import tree

if TYPE_CHECKING:
    from soter.program.checker import Checker
    from soter.program.context import Context
    from soter.program.types import Type

ASSIGNABLE = {"var", "local"}
MAX_LOOP = 1_000_000


class StmtChecker:
    """Checks statements of one program."""

    def __init__(self, checker: Checker, expressions: ExprChecker) -> None:
        self.checker = checker
        self.expressions = expressions
        self.diagnostics = checker.diagnostics

    def block(self, block: tree.Block, context: Context) -> tuple[typed.Stmt, ...]:
        """All statements of a block in a scope of its own."""
        context.locals.append({})
        statements = [self.statement(s, context) for s in block.statements]
        frame = context.locals.pop()
        self._warn_unused(frame, context)
        return tuple(s for s in statements if s is not None)

    def _warn_unused(self, frame: dict[str, typed.Variable], context: Context) -> None:
        if context.scope.loaded.library:
            return
        for variable in frame.values():
            name = variable.name
            if not variable.used and not name.startswith("_") and variable.kind in {"let", "var"}:
                self.diagnostics.warning(
                    "W001", f"`{name}` is never used", variable.span, "declared here",
                    helps=(f"remove it, or call it `_{name}` to say that this is meant",),
                )

    def declare(
        self, name: tree.Name, t: Type, kind: str, context: Context
    ) -> typed.Variable:
        """Enter a new local; the same name twice in one scope is N002."""
        frame = context.locals[-1]
        first = frame.get(name.text)
        if first is not None:
            self.diagnostics.error(
                "N002",
                f"`{name.text}` is declared twice",
                name.span,
                "declared again here",
                also=((first.span, "first declared here"),),
            )
        variable = typed.Variable(name.text, t, kind, name.span)
        frame[name.text] = variable
        return variable

    def statement(self, s: tree.Stmt, context: Context) -> typed.Stmt | None:
        """One statement, or None when it was too broken to keep."""
        if isinstance(s, (tree.LetStmt, tree.VarStmt)):
            return self._declaration(s, context)
        if isinstance(s, tree.AssignStmt):
            place = self.place(s.place, context)
            value = self.expressions.check(s.value, context, place.type if place else None)
            return typed.Assign(s.span, place, value) if place else None
        if isinstance(s, tree.PushStmt):
            return self._push(s, context)
        if isinstance(s, tree.PublishStmt):
            return self._publish(s, context)
        if isinstance(s, tree.ReturnStmt):
            return self._return(s, context)
        if isinstance(s, tree.AssertStmt):
            condition = self.expressions.check(s.condition, context, BOOL)
            return typed.Assert(s.span, condition, s.message)
        if isinstance(s, tree.IfStmt):
            arms = tuple(
                (self.expressions.check(c, context, BOOL), self.block(b, context))
                for c, b in s.arms
            )
            otherwise = self.block(s.otherwise, context) if s.otherwise else ()
            return typed.If(s.span, arms, otherwise)
        if isinstance(s, tree.ForRangeStmt):
            return self._for_range(s, context)
        if isinstance(s, tree.ForEachStmt):
            return self._for_each(s, context)
        return None

    def _declaration(
        self, s: tree.LetStmt | tree.VarStmt, context: Context
    ) -> typed.Stmt | None:
        t = self.checker.type_of(s.type, context.scope) if s.type is not None else None
        if s.value is None:
            assert t is not None
            value: typed.Expr = (
                error_expr(s.span)
                if isinstance(t, ErrorType)
                else typed.Literal(t, s.span, default_value(t))
            )
        else:
            value = self.expressions.check(s.value, context, t)
        found = t if t is not None else plain(value.type)
        if isinstance(found, DurationType):
            self.diagnostics.error(
                "T014",
                "a duration cannot be computed with at run time",
                s.span,
                helps=("`seconds(d)` gives a float",),
            )
            found = ERROR
        kind = "let" if isinstance(s, tree.LetStmt) else "var"
        variable = self.declare(s.name, found, kind, context)
        return typed.Declare(s.span, variable, value)

    # ------------------------------------------------------------ places

    def place(self, expr: tree.Expr, context: Context) -> typed.Place | None:
        """What stands on the left of `=`, or None after a report."""
        steps: list[tree.Expr] = []
        base = expr
        while isinstance(base, (tree.FieldExpr, tree.IndexExpr)):
            steps.append(base)
            base = base.target
        if not isinstance(base, tree.NameExpr):
            if not isinstance(base, tree.ErrorExpr):
                self.diagnostics.error("T009", "only variables can be assigned", expr.span)
            return None
        variable = context.find_local(base.name.text)
        if variable is None:
            self._not_a_variable(base, context)
            return None
        if variable.kind not in ASSIGNABLE:
            self._not_assignable(variable, base)
            return None
        t = variable.type
        path: list[int | typed.Expr] = []
        for step in reversed(steps):
            if isinstance(t, ErrorType):
                return None
            selected = self._select(step, t, context)
            if selected is None:
                return None
            path.append(selected[0])
            t = selected[1]
        if path:
            variable.used = True
        return typed.Place(variable, tuple(path), t, expr.span)

    def _select(
        self, step: tree.Expr, t: Type, context: Context
    ) -> tuple[int | typed.Expr, Type] | None:
        if isinstance(step, tree.FieldExpr):
            if isinstance(t, RecordType):
                index = t.index(step.field.text)
                if index is not None:
                    return index, t.fields[index][1]
            helps = ("`push` adds an element",) if isinstance(t, ListType) else ()
            self.diagnostics.error(
                "N004",
                f"`{t}` has no field `{step.field.text}` that can be assigned",
                step.field.span,
                helps=helps,
            )
            return None
        assert isinstance(step, tree.IndexExpr)
        index_expr = self.expressions.check(step.index, context, INT)
        if is_error(index_expr):
            return None
        if not isinstance(t, (ArrayType, ListType)):
            self.diagnostics.error("T002", f"`{t}` cannot be indexed", step.span)
            return None
        self.expressions.check_constant_index(t, index_expr)
        return index_expr, t.element

    def _not_a_variable(self, base: tree.NameExpr, context: Context) -> None:
        name = base.name.text
        entry = self.checker.names.find(context.scope, name)
        if entry is None:
            if name not in context.scope.broken:
                more = tuple(n for frame in context.locals for n in frame)
                self.checker.names.unknown(context.scope, name, base.span, more)
            return
        helps = (f"write `publish {name} = ...;`",) if entry.kind == "topic" else ()
        self.diagnostics.error(
            "T009", f"`{name}` is a {entry.kind}: it cannot be assigned", base.span, helps=helps
        )

    def _not_assignable(self, variable: typed.Variable, base: tree.NameExpr) -> None:
        what = {
            "let": "was declared with `let`",
            "parameter": "is a parameter",
            "loop": "is a loop variable",
        }.get(variable.kind, "cannot be assigned here")
        helps = ("declare it with `var`",) if variable.kind == "let" else ()
        self.diagnostics.error(
            "T009",
            f"`{variable.name}` {what}: it never changes",
            base.span,
            also=((variable.span, "declared here"),),
            helps=helps,
        )

    def _push(self, s: tree.PushStmt, context: Context) -> typed.Stmt | None:
        place = self.place(s.place, context)
        t = place.type if place else None
        if place and not isinstance(t, (ListType, ErrorType)):
            self.diagnostics.error(
                "T002", f"`push` needs a bounded list `T[<=n]`, not `{t}`", s.place.span
            )
            place = None
        element = t.element if isinstance(t, ListType) else None
        value = self.expressions.check(s.value, context, element)
        if place is None or is_error(value) or not isinstance(t, ListType):
            return None
        place.variable.used = True
        return typed.Push(s.span, place, value)

    # ------------------------------------------------------------ publish, return, loops

    def _publish(self, s: tree.PublishStmt, context: Context) -> typed.Stmt | None:
        entry = self.checker.names.find_ref(context.scope, s.topic)
        symbol = self.checker.resolve(entry, s.topic.span) if entry else None
        if entry is not None and entry.kind != "topic":
            self.diagnostics.error(
                "N003", f"`{s.topic.text}` is a {entry.kind}, not a topic", s.topic.span
            )
        topic = symbol if isinstance(symbol, typed.TopicSymbol) else None
        value = self.expressions.check(s.value, context, topic.type if topic else None)
        if topic is None:
            return None
        if context.node is None:
            self.diagnostics.error(
                "M009", f"only a node's step publishes, not {context.where}", s.span
            )
            return None
        if topic not in context.node.publishes:
            self.diagnostics.error(
                "M009",
                f"{context.where} does not declare that it publishes `{topic.name}`",
                s.topic.span,
                helps=(f"add `publishes {topic.name};`",),
            )
            return None
        self.checker.published.setdefault(context.node, set()).add(topic)
        return typed.Publish(s.span, topic, value)

    def _return(self, s: tree.ReturnStmt, context: Context) -> typed.Stmt | None:
        if context.result is None:
            self.expressions.check(s.value, context)
            self.diagnostics.error("T005", f"`return` has no meaning in {context.where}", s.span)
            return None
        value = self.expressions.check(s.value, context, context.result)
        return typed.Return(s.span, value)

    def _bound(self, expr: tree.Expr, context: Context) -> int | None:
        value = self.checker.constant(expr, context.scope, INT, "a loop bound", context)
        return value if isinstance(value, int) else None

    def _for_range(self, s: tree.ForRangeStmt, context: Context) -> typed.Stmt | None:
        low, high = self._bound(s.low, context), self._bound(s.high, context)
        if low is not None and high is not None and high - low > MAX_LOOP:
            self.diagnostics.error(
                "T007", f"this loop runs {high - low} times, at most {MAX_LOOP} are allowed",
                s.high.span,
            )
        context.locals.append({})
        variable = self.declare(s.name, INT, "loop", context)
        body = self.block(s.body, context)
        context.locals.pop()
        if low is None or high is None:
            return None
        return typed.ForRange(s.span, variable, low, high, body)

    def _for_each(self, s: tree.ForEachStmt, context: Context) -> typed.Stmt | None:
        sequence = self.expressions.check(s.sequence, context)
        t = sequence.type
        element: Type = ERROR
        if isinstance(t, (ArrayType, ListType)):
            element = t.element
        elif not isinstance(t, ErrorType):
            self.diagnostics.error(
                "T002", f"`for` needs an array or a list, not `{t}`", s.sequence.span,
                helps=("to count, write `for i in 0..10 { ... }`",),
            )
        context.locals.append({})
        variable = self.declare(s.name, element, "loop", context)
        body = self.block(s.body, context)
        context.locals.pop()
        if isinstance(element, ErrorType):
            return None
        return typed.ForEach(s.span, variable, sequence, body)


def always_returns(statements: tuple[typed.Stmt, ...]) -> bool:
    """Whether every path through the statements returns."""
    for s in statements:
        if isinstance(s, typed.Return):
            return True
        if (
            isinstance(s, typed.If)
            and s.otherwise
            and always_returns(s.otherwise)
            and all(always_returns(body) for _, body in s.arms)
        ):
            return True
    return False
