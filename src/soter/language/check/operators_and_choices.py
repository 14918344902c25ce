"""Checks operators (unary, binary, conditional) and `choose` among finitely many values.

Purpose: decides which operators apply to which types, and their results; turns a `choose` into a
`typed.TypedChoose`, with the hidden local of a fair one.
Non-goals: the arithmetic (`evaluate/arithmetic.py`); which alternative is taken
(`evaluate/environment.py` and the caller of the step).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Span, help_texts
from soter.diagnostics.fixes import replace
from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import (
    ExprBase,
    error_expr,
    float_literal,
    has_error,
    list_helps,
    member_helps,
    plain_type,
    unify_literals,
    with_article,
)
from soter.language.evaluate.environment import MAX_FAIR
from soter.language.model import typed
from soter.language.model.types import (
    BOOL,
    DURATION,
    FLOAT,
    INT,
    INT_MIN,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    is_vector,
)
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Help
    from soter.language.model.types import Type


MAX_CHOICES = 1_024
"""Most alternatives of one choice: each of them is a branch of every execution."""

AGE = IntType(0, 255)


class ChooseChecker(ExprBase):
    """Checks `choose`; it is one of the base classes of the expression checker."""

    def check_choose(
        self, expr: tree.ChooseExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Gives the typed choice; also checks the alternatives of a `choose` in a wrong place."""
        if context.choices is None:
            self._report_misplaced(expr.span, context)
        if expr.interval is not None:
            choice = self._choice_from_interval(expr, expr.interval, context)
        elif expr.type is not None:
            choice = self._choice_of_type(expr, expr.type, context)
        else:
            choice = self._choice_of_values(expr, context, expected)
        if not isinstance(choice, typed.TypedChoose) or context.choices is None:
            return error_expr(expr.span)
        if not self._has_few_alternatives(expr, choice.count):
            return error_expr(expr.span)
        if expr.fair and isinstance(context.owner, typed.PlantSymbol):
            note = "who chooses fairly remembers what it took before, and a plant has its states"
            return self.refuse(
                "E014",
                f"`fair choose` cannot stand in {context.where}",
                expr.span,
                notes=(note,),
                helps=("write `choose`, or count in a state",),
            )
        if expr.fair:
            name = f"fair {len(context.choices) + 1}"
            ages = ArrayType(AGE, choice.count)
            choice.ages = typed.Variable(name, ages, "local", expr.span, used=True)
            context.choices.append(choice.ages)
        return choice

    def _report_misplaced(self, span: Span, context: Context) -> None:
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

    # ------------------------------------------------------------ the three forms of a choice

    def _choice_from_interval(
        self, expr: tree.ChooseExpr, interval: tree.IntervalExpr, context: Context
    ) -> typed.TypedExpr:
        """Checks `choose [low, high]` with constant ints."""
        subject = "the bound of a choice"
        constant = Context(context.scope, subject, constant="T008", hidden=context)
        ends = [self.check(e, constant) for e in (interval.low, interval.high)]
        if has_error(*ends):
            return error_expr(expr.span)
        if any(isinstance(e.type, FloatType) for e in ends):
            return self._refuse_infinite("all floats of an interval", interval.span, expr.span)
        bounds = [self.shared.evaluate(self.convert(e, INT), subject) for e in ends]
        low, high = bounds
        if low is None or high is None:
            return error_expr(expr.span)
        if low > high:
            turned = (f"write `[{high}, {low}]`",)
            return self._refuse_empty(f"[{low}, {high}] is empty", interval.span, turned, expr.span)
        return typed.TypedChoose(IntType(low, high), expr.span, high - low + 1, low, (), None)

    def _choice_of_type(
        self, expr: tree.ChooseExpr, type_: tree.TypeExpr, context: Context
    ) -> typed.TypedExpr:
        """Checks `choose bool`, `choose Enum`, and `choose` of a named `int in [a, b]`."""
        t = self.shared.resolve_type(type_, context.scope)
        count, low = 0, 0
        if isinstance(t, BoolType):
            count = 2
        elif isinstance(t, EnumType):
            count = len(t.members)
        elif isinstance(t, IntType) and not t.is_full:
            count, low = t.high - t.low + 1, t.low
        elif not isinstance(t, ErrorType):
            return self._refuse_infinite(f"the values of `{t}`", type_.span, expr.span)
        if not count:
            return error_expr(expr.span)
        return typed.TypedChoose(t, expr.span, count, low, (), None)

    def _choice_of_values(
        self, expr: tree.ChooseExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Checks `choose { e1, e2 }`, a choice between values of one type."""
        if not expr.options:
            return self._refuse_empty("there is nothing to choose from", expr.span, (), expr.span)
        items = [self.check(e, context, expected) for e in expr.options]
        if has_error(*items):
            return error_expr(expr.span)
        t = expected
        if t is None:
            floats = any(isinstance(i.type, FloatType) for i in items)
            t = FLOAT if floats else plain_type(items[0].type)
            because = (items[0].span, f"the first one is {with_article(t)}")
            items = [self.convert(i, t, None if i is items[0] else because) for i in items]
        if has_error(*items):
            return error_expr(expr.span)
        return typed.TypedChoose(t, expr.span, len(items), 0, tuple(items), None)

    # ------------------------------------------------------------ what cannot be chosen

    def _refuse_empty(
        self, message: str, span: Span, helps: tuple[str, ...], whole: Span
    ) -> typed.TypedExpr:
        return self.refuse(
            "E002",
            message,
            span,
            "an empty choice",
            notes=("a step must be able to go on: a choice has at least one alternative",),
            helps=helps,
            whole=whole,
        )

    def _refuse_infinite(self, subject: str, span: Span, whole: Span) -> typed.TypedExpr:
        return self.refuse(
            "E003",
            f"{subject} cannot be tried one by one",
            span,
            notes=("a choice has few alternatives: each of them is explored",),
            helps=("list the values that matter: `choose { a, b, c }`",),
            whole=whole,
        )

    def _has_few_alternatives(self, expr: tree.ChooseExpr, count: int) -> bool:
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


COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}


class OperatorChecker(ExprBase):
    """Checks operators; it is one of the base classes of the expression checker."""

    def check_unary(
        self, expr: tree.UnaryExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Checks `-e` and `!e`."""
        if expr.op == "!":
            operand = self.check(expr.operand, context, BOOL)
            return (
                operand if has_error(operand) else typed.TypedUnary(BOOL, expr.span, "!", operand)
            )
        if (
            isinstance(expr.operand, tree.IntLit)
            and expr.operand.value == -INT_MIN
            and not isinstance(expected, FloatType)
        ):
            return typed.Literal(INT, expr.span, INT_MIN)  # 2^63 is no int, but -2^63 is
        operand = self.check_unconverted(expr.operand, context, _expected_operand_type(expected))
        if has_error(operand):
            return operand
        t = operand.type
        if isinstance(operand, typed.Literal) and operand.name is None:
            if isinstance(t, FloatType):
                return typed.Literal(FLOAT, expr.span, -operand.value)
            if isinstance(t, IntType) and operand.value != INT_MIN:
                return typed.Literal(INT, expr.span, -operand.value)
        if isinstance(t, IntType):
            return typed.TypedUnary(INT, expr.span, "-", operand)
        if isinstance(t, FloatType) or is_vector(t):
            return typed.TypedUnary(t, expr.span, "-", operand)
        return self._refuse_negation(expr, t)

    def _refuse_negation(self, expr: tree.UnaryExpr, t: Type) -> typed.TypedExpr:
        """Reports T002 for `-` before a bool, a time or anything else that is no number."""
        helps: tuple[Help, ...] = ()
        sign = Span(expr.span.source, expr.span.start, expr.operand.span.start)
        if isinstance(t, BoolType):
            helps = (replace(sign, "!", "for the opposite of a bool write `!`"),)
        elif isinstance(t, DurationType):
            helps = (replace(sign, "", f"no time is below 0: write `{expr.operand.span.text}`"),)
        return self.refuse(
            "T002",
            f"`-` does not apply to `{t}`",
            expr.operand.span,
            f"this is `{t}`",
            helps=helps,
            whole=expr.span,
        )

    def check_binary(
        self, expr: tree.BinaryExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Checks all operators with two operands."""
        op = expr.op
        if op in {"&&", "||"}:
            left = self.check(expr.left, context, BOOL)
            right = self.check(expr.right, context, BOOL)
            if has_error(left, right):
                return error_expr(expr.span)
            return typed.TypedBinary(BOOL, expr.span, op, left, right)
        hint = None
        if op in {"+", "-"}:
            hint = _expected_operand_type(expected)
        elif op in {"*", "/"} and isinstance(expected, FloatType):
            hint = expected
        left = self.check_unconverted(expr.left, context, hint)
        right = self.check_unconverted(expr.right, context, hint)
        if has_error(left, right):
            return error_expr(expr.span)
        left, right = unify_literals(left, right)
        result = (_typed_comparison if op in COMPARISONS else _typed_calculation)(expr, left, right)
        if result is None:
            lt, rt = left.type, right.type
            return self.refuse(
                "T002",
                f"`{op}` does not apply to `{lt}` and `{rt}`",
                expr.span,
                also=((expr.left.span, f"`{lt}`"), (expr.right.span, f"`{rt}`")),
                helps=list_helps(left, rt)
                or list_helps(right, lt)
                or _help_beside_number(left, right, expected)
                or _operator_help(expr, lt, rt, expected),
            )
        if op == "/":
            self._warn_of_zero_quotient(expr, left, right)
        return result

    def _warn_of_zero_quotient(
        self, expr: tree.BinaryExpr, left: typed.TypedExpr, right: typed.TypedExpr
    ) -> None:
        """Warns W030 of `1 / 2` of ints, which gives 0; beside a float it would give 0.5."""
        pair = [x.value for x in (left, right) if isinstance(x, typed.Literal) and x.name is None]
        ints = isinstance(left.type, IntType) and isinstance(right.type, IntType)
        if len(pair) != 2 or not ints or not 0 < abs(pair[0]) < abs(pair[1]):
            return
        a, b = float(pair[0]), float(pair[1])
        self.diagnostics.warning(
            "W030",
            f"an integer division: `{expr.span.text}` is 0",
            expr.span,
            "two ints: what is behind the point is cut off",
            helps=(f"two floats keep it: `{a!r} / {b!r}`",),
        )

    def check_conditional(
        self, expr: tree.ConditionalExpr, context: Context, expected: Type | None
    ) -> typed.TypedExpr:
        """Checks `c ? a : b`."""
        condition = self.check(expr.condition, context, BOOL)
        then = self.check(expr.then, context, expected)
        otherwise = self.check(expr.otherwise, context, expected)
        if has_error(condition, then, otherwise):
            return error_expr(expr.span)
        then, otherwise = unify_literals(then, otherwise)
        t = then.type
        if isinstance(t, IntType) and isinstance(otherwise.type, IntType):
            t = t if t == otherwise.type else INT
        elif t != otherwise.type:
            return self.refuse(
                "T001",
                f"the two sides of `?:` differ: `{t}` and `{otherwise.type}`",
                expr.span,
                also=((then.span, f"`{t}`"), (otherwise.span, f"`{otherwise.type}`")),
            )
        return typed.Conditional(t, expr.span, condition, then, otherwise)


def _expected_operand_type(expected: Type | None) -> Type | None:
    """Gives the type that operands of `+` and `-` should have: `expected` if it is of floats."""
    if isinstance(expected, FloatType) or (expected is not None and is_vector(expected)):
        return expected
    return None


_ARITHMETIC_TYPES: Mapping[tuple[type[Type], str, type[Type]], Type] = {
    **{(IntType, op, IntType): INT for op in "+-*/%"},
    **{(FloatType, op, FloatType): FLOAT for op in "+-*/"},
    **{(DurationType, op, DurationType): DURATION for op in "+-"},
    **{(DurationType, op, IntType): DURATION for op in "*/"},
    (IntType, "*", DurationType): DURATION,
}
"""(left type, operator, right type) of scalars -> type of the result."""


def _typed_comparison(
    expr: tree.BinaryExpr, left: typed.TypedExpr, right: typed.TypedExpr
) -> typed.TypedExpr | None:
    lt, rt = left.type, right.type
    ordered = isinstance(lt, (IntType, FloatType, DurationType))
    same = type(lt) is type(rt) and (not isinstance(lt, EnumType) or lt == rt)
    equality = expr.op in {"==", "!="} and isinstance(lt, (BoolType, EnumType))
    if same and (ordered or equality):
        return typed.TypedBinary(BOOL, expr.span, expr.op, left, right)
    return None


def _typed_calculation(
    expr: tree.BinaryExpr, left: typed.TypedExpr, right: typed.TypedExpr
) -> typed.TypedExpr | None:
    op, lt, rt, span = expr.op, left.type, right.type, expr.span
    result = _ARITHMETIC_TYPES.get((type(lt), op, type(rt)))
    if result is not None:
        return typed.TypedBinary(result, span, op, left, right)
    if is_vector(lt) and lt == rt and op in {"+", "-"}:
        return typed.Vector(lt, span, op, left, right)
    if is_vector(rt) and op == "*" and (scalar := _float_factor(left)) is not None:
        return typed.Vector(rt, span, op, scalar, right)
    if is_vector(lt) and op in {"*", "/"} and (scalar := _float_factor(right)) is not None:
        return typed.Vector(lt, span, op, left, scalar)
    return None


def _float_factor(factor: typed.TypedExpr) -> typed.TypedExpr | None:
    """Gives a vector's factor as a float; None if it is neither a float nor an int literal."""
    return factor if isinstance(factor.type, FloatType) else float_literal(factor)


def _help_beside_number(
    left: typed.TypedExpr, right: typed.TypedExpr, expected: Type | None
) -> tuple[Help, ...]:
    """Gives helps for an enum, bool or record beside a number, such as `b ? 1 : 0` for `b`."""
    for one, other in ((left, right), (right, left)):
        if isinstance(one.type, EnumType) and isinstance(other.type, (IntType, FloatType)):
            return member_helps(one.type, other)
        if isinstance(one.type, BoolType) and isinstance(other.type, (IntType, FloatType)):
            values = "1.0 : 0.0" if isinstance(other.type, FloatType) else "1 : 0"
            text = one.span.text
            text = text if text.startswith("(") else f"({text})"
            if isinstance(expected, BoolType):
                return ()
            return (replace(one.span, f"({text} ? {values})", f"as a number: `b ? {values}`"),)
        if isinstance(one.type, RecordType) and isinstance(other.type, (IntType, FloatType)):
            names = [n for n, t in one.type.fields if type(t) is type(other.type)]
            if names and isinstance(one, (typed.TopicRead, typed.VarRead, typed.TypedField)):
                return (f"name one of its fields: `{one.span.text}.{names[0]}`",)
    return ()


def _components_help(expr: tree.BinaryExpr, t: Type) -> Help:
    """Gives a help that applies an operator by components: `{ x: a.x * b.x, ... }` for `a * b`."""
    names = [name for name, _ in t.fields] if isinstance(t, RecordType) else []
    a, b = expr.left, expr.right
    plain = isinstance(a, (tree.NameExpr, tree.FieldExpr)) and isinstance(
        b, (tree.NameExpr, tree.FieldExpr)
    )
    left, right = (a.span.text, b.span.text) if plain else ("a", "b")
    fields = ", ".join(f"{n}: {left}.{n} {expr.op} {right}.{n}" for n in names)
    result = f"{{ {fields} }}" if names else f"[{left}[0] {expr.op} {right}[0], ...]"
    title = f"by components: `{result}`"
    return replace(expr.span, result, title) if plain and names else title


def _operator_help(
    expr: tree.BinaryExpr, lt: Type, rt: Type, expected: Type | None
) -> tuple[Help, ...]:
    op, kinds = expr.op, {type(lt), type(rt)}
    if op == "+" and isinstance(lt, ListType) and isinstance(rt, (ListType, ArrayType)):
        return (_push_help(expr),)
    if is_vector(lt) and is_vector(rt):
        return _vector_operator_help(expr, lt, rt, expected)
    if kinds <= {IntType, FloatType, DurationType}:
        return _number_operator_help(expr, lt, rt)
    if op in COMPARISONS and kinds <= {RecordType, ArrayType, ListType}:
        return ("compare the parts one by one",)
    if op in COMPARISONS and kinds <= {BoolType, EnumType} and lt == rt:
        return ("only `==` and `!=` compare these",)
    return ()


def _push_help(expr: tree.BinaryExpr) -> str:
    one = expr.right.elements if isinstance(expr.right, tree.ListExpr) else ()
    pushed = one[0].span.text if len(one) == 1 else "x"
    loop = "" if len(one) == 1 else f" in a loop, `for x in {expr.right.span.text} {{ ... }}`"
    return f"a statement adds to a list: `push {expr.left.span.text}, {pushed};`{loop}"


def _vector_operator_help(
    expr: tree.BinaryExpr, lt: Type, rt: Type, expected: Type | None
) -> tuple[Help, ...]:
    """Gives helps for an operator between vectors: the scalar product or a result by components."""
    op = expr.op
    if op in "*/" and expected is not None and lt == rt == expected:
        return (_components_help(expr, lt),)
    if op == "*" and lt == rt and (expected is None or isinstance(expected, FloatType)):
        title = "for the scalar product write `dot(a, b)`"
        if expected is None:
            return (title, help_texts([_components_help(expr, lt)])[0])
        product = f"dot({expr.left.span.text}, {expr.right.span.text})"
        return (replace(expr.span, product, title),)
    if op in {"+", "-"}:
        return ("both sides must be vectors of one type",)
    comparable = op in COMPARISONS and {type(lt), type(rt)} <= {RecordType, ArrayType}
    return ("compare the parts one by one",) if comparable else ()


def _number_operator_help(expr: tree.BinaryExpr, lt: Type, rt: Type) -> tuple[Help, ...]:
    """Gives helps that convert one side of an operator between numbers or times of two types."""
    op, left, right, kinds = expr.op, expr.left.span, expr.right.span, {type(lt), type(rt)}
    if kinds == {IntType, FloatType}:
        side = left if isinstance(lt, IntType) else right
        return (replace(side, f"float({side.text})", "convert the int: `float(...)`"),)
    if op == "%" and kinds == {FloatType}:
        x, y = left.text, right.text
        rest = f"({x}) - floor(({x}) / ({y})) * ({y})"
        return (replace(expr.span, rest, "for floats write `x - floor(x / y) * y`"),)
    if DurationType not in kinds:
        return ()
    title = "`seconds(d)` is a time as a `float`"
    if op in "*/%" or kinds != {DurationType, FloatType}:
        return (title,)
    side = left if isinstance(lt, DurationType) else right
    return (replace(side, f"seconds({side.text})", title),)
