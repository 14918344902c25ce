"""Check choices: `choose` where a step may leave something open, from finitely many values.

Purpose: `choose` expressions -> `typed.Choose`, with the hidden local of a fair one.
Non-goals: which alternative is taken (`fair_choice.py` and who runs the step).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expression_base import ExprBase, a_type, error_expr, is_error, plain
from soter.language.check.expression_context import Context
from soter.language.evaluate.fair_choice import MAX_FAIR
from soter.language.model import typed
from soter.language.model.types import (
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
)

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.language.model.types import Type
    from soter.language.syntax import tree

MAX_CHOICES = 1_024
"""Alternatives of one choice: each of them is a branch of every execution."""

AGE = IntType(0, 255)


class ChooseChecker(ExprBase):
    """The part of the expression checker that knows `choose`."""

    def choose(
        self, expr: tree.ChooseExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """The typed choice; checked for what it chooses from also where it cannot stand."""
        if context.choices is None:
            self._misplaced(expr.span, context)
        if expr.interval is not None:
            choice = self._between(expr, expr.interval, context)
        elif expr.type is not None:
            choice = self._of_type(expr, expr.type, context)
        else:
            choice = self._among(expr, context, expected)
        if not isinstance(choice, typed.TypedChoose) or context.choices is None:
            return error_expr(expr.span)
        if not self._countable(expr, choice.count):
            return error_expr(expr.span)
        if expr.fair and isinstance(context.owner, typed.PlantSymbol):
            self._fair_in_a_plant(expr.span, context)
            return error_expr(expr.span)
        if expr.fair:
            name = f"fair {len(context.choices) + 1}"
            ages = ArrayType(AGE, choice.count)
            choice.ages = typed.Variable(name, ages, "local", expr.span, used=True)
            context.choices.append(choice.ages)
        return choice

    def _misplaced(self, span: Span, context: Context) -> None:
        note = "what is left open is decided anew in each step of a node or a plant, and only there"
        help_, where = "choose in the `step` of a node", context.where
        if isinstance(context.owner, typed.PlantSymbol):
            where = f"a derivative of {where}"
            note = "a derivative is evaluated several times a step, at the stages of the scheme"
            help_ = "choose in a `let`, which then has one value a step"
        elif context.result is not None:
            help_ = "choose in the step and pass the value as an argument"
        message = f"`choose` cannot stand in {where}"
        self.diagnostics.error("E001", message, span, notes=(note,), helps=(help_,))

    def _fair_in_a_plant(self, span: Span, context: Context) -> None:
        self.diagnostics.error(
            "E014",
            f"`fair choose` cannot stand in {context.where}",
            span,
            notes=("who chooses fairly remembers what it took before, and a plant has its states",),
            helps=("write `choose`, or count in a state",),
        )

    # ------------------------------------------------------------ the three kinds

    def _between(
        self, expr: tree.ChooseExpr, interval: tree.IntervalExpr, context: Context
    ) -> typed.TypedExpr:
        """`choose [low, high]` with constant ints."""
        what = "the bound of a choice"
        constant = Context(context.scope, what, constant="T008", hidden=context)
        ends = [self.check(e, constant) for e in (interval.low, interval.high)]
        if is_error(*ends):
            return error_expr(expr.span)
        if any(isinstance(e.type, FloatType) for e in ends):
            self._infinite("all floats of an interval", interval.span)
            return error_expr(expr.span)
        bounds = [self.shared.evaluate(self.convert(e, INT), what) for e in ends]
        low, high = bounds
        if low is None or high is None:
            return error_expr(expr.span)
        if low > high:
            self._empty(f"[{low}, {high}] is empty", interval.span, (f"write `[{high}, {low}]`",))
            return error_expr(expr.span)
        return typed.TypedChoose(IntType(low, high), expr.span, high - low + 1, low, (), None)

    def _of_type(
        self, expr: tree.ChooseExpr, type_: tree.TypeExpr, context: Context
    ) -> typed.TypedExpr:
        """`choose bool`, `choose Enum`, and a named `int in [a, b]`."""
        t = self.shared.resolve_type(type_, context.scope)
        count, low = 0, 0
        if isinstance(t, BoolType):
            count = 2
        elif isinstance(t, EnumType):
            count = len(t.members)
        elif isinstance(t, IntType) and not t.is_full:
            count, low = t.high - t.low + 1, t.low
        elif not isinstance(t, ErrorType):
            self._infinite(f"the values of `{t}`", type_.span)
        if not count:
            return error_expr(expr.span)
        return typed.TypedChoose(t, expr.span, count, low, (), None)

    def _among(
        self, expr: tree.ChooseExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """`choose { e1, e2 }`: values of one type."""
        if not expr.options:
            self._empty("there is nothing to choose from", expr.span, ())
            return error_expr(expr.span)
        items = [self.check(e, context, expected) for e in expr.options]
        if is_error(*items):
            return error_expr(expr.span)
        t = expected
        if t is None:
            t = plain(items[0].type)
            if any(isinstance(i.type, FloatType) for i in items):
                t = FLOAT
            because = (items[0].span, f"the first one is {a_type(t)}")
            items = [self.convert(i, t, None if i is items[0] else because) for i in items]
        if is_error(*items):
            return error_expr(expr.span)
        return typed.TypedChoose(t, expr.span, len(items), 0, tuple(items), None)

    # ------------------------------------------------------------ what cannot be chosen

    def _empty(self, message: str, span: Span, helps: tuple[str, ...]) -> None:
        self.diagnostics.error(
            "E002",
            message,
            span,
            "an empty choice",
            notes=("a step must be able to go on: a choice has at least one alternative",),
            helps=helps,
        )

    def _infinite(self, what: str, span: Span) -> None:
        self.diagnostics.error(
            "E003",
            f"{what} cannot be tried one by one",
            span,
            notes=("a choice has few alternatives: each of them is explored",),
            helps=("list the values that matter: `choose { a, b, c }`",),
        )

    def _countable(self, expr: tree.ChooseExpr, count: int) -> bool:
        most = MAX_FAIR if expr.fair else MAX_CHOICES
        if count <= most:
            return True
        self.diagnostics.error(
            "E004",
            f"a {'fair ' if expr.fair else ''}choice of {count} alternatives is too wide",
            expr.span,
            f"at most {most} are possible",
            notes=("every alternative is a branch of every execution",),
            helps=("list the values that matter: the ends, the middle, the one that breaks it",),
        )
        return False
