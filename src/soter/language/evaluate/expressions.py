"""The meaning of typed expressions: each becomes a Python closure, `environment -> value`.

Purpose: one method for each kind of expression in `typed.py`, in the order they stand there.
Non-goals: statements and function bodies (`statements.py`), the arithmetic itself
(`arithmetic.py`).
"""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate import arithmetic, environment
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.model import typed as t
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    FloatType,
    IntType,
    leaf_count,
)
from soter.language.model.values import from_python, to_python

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.types import Type, Value

    Compiled = Callable[[Environment], Value]
    Extern = Callable[..., object]


_COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}

_INT_OPERATIONS: dict[str, Callable[[int, int, Span | None], int]] = {
    "+": arithmetic.add_int,
    "-": arithmetic.sub_int,
    "*": arithmetic.mul_int,
    "/": arithmetic.div_int,
    "%": arithmetic.mod_int,
}

_FLOAT_OPERATIONS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}

_FLOAT_FUNCTIONS: dict[str, Callable[[Any], float]] = {
    "sqrt": arithmetic.sqrt,
    "floor": arithmetic.floor,
    "abs": abs,
    "float": float,
    "seconds": arithmetic.seconds,
}


SLICE = 250_000
"""Operations (a twentieth of a second) after which the budget is checked again."""


class ExpressionEvaluator(ABC):
    """Compiles expressions of one scope; `Evaluator` explains the arguments."""

    def __init__(
        self,
        params: Mapping[t.ParamSymbol, Value],
        externs: Mapping[t.FunSymbol, Extern] | None = None,
        budget: int | None = None,
        *,
        topics: Mapping[t.TopicSymbol, int] | None = None,
        plants: Mapping[str, int] | None = None,
        modules: Mapping[t.ModuleSymbol | str, int] | None = None,
    ) -> None:
        self._params = params
        self._externs = {} if externs is None else externs
        self._budget = budget
        self._left = self._reserve = 0
        self.tell: Callable[[int], None] | None = None
        """Called again and again while a value is computed, with the operations taken so far."""
        self._topics = {} if topics is None else topics
        self._plants = {} if plants is None else plants
        self._modules = {} if modules is None else modules
        self._expressions: dict[t.TypedExpr, Compiled] = {}
        self.unbound: set[t.FunSymbol] = set()

    @abstractmethod
    def closure_of(self, fun: t.FunSymbol) -> Callable[[Environment, Sequence[Value]], Value]:
        """Gives `(environment, arguments) -> value` for a function with a body."""

    def value(self, expr: t.TypedExpr, env: Environment | None = None) -> Value:
        """Gives the value of an expression in `env`, which may be None if nothing is read.

        Raises `StepFault`, and `BudgetExceeded` also for calls nested deeper than Python's stack.
        """
        self._left, self._reserve = 0, self._budget or 0
        try:
            return self.compiled(expr)(env or Environment())
        except RecursionError:
            raise BudgetExceeded from None

    def set_budget(self, operations: int) -> None:
        """Sets the most operations per later call of `value`; the evaluator must have a budget."""
        assert self._budget is not None
        self._budget = operations

    @property
    def operations_spent(self) -> int:
        """Gives how many operations the last call of `value` took."""
        return (self._budget or 0) - self._reserve - self._left

    def compiled(self, expr: t.TypedExpr) -> Compiled:
        """Gives `environment -> value` for an expression; the closure raises `StepFault`."""
        compiled = self._expressions.get(expr)
        if compiled is None:
            compiled = self._expressions[expr] = self._compile(expr)
        return compiled

    # ------------------------------------------------------------ budget

    def _spend(self, operations: int) -> None:
        self._left -= operations
        if self._left < 0:
            self._refill_from_reserve()

    def _refill_from_reserve(self) -> None:
        """Takes operations from the budget's reserve; tells the progress. Raises BudgetExceeded."""
        if self.tell is not None and self.operations_spent > SLICE:
            self.tell(self.operations_spent)
        more = min(self._reserve, SLICE - self._left)
        self._left += more
        self._reserve -= more
        if self._left < 0:
            raise BudgetExceeded

    def _with_cost(self, operations: int, compiled: Compiled) -> Compiled:
        """Gives a closure like `compiled`, which also spends `operations` in each call."""
        if self._budget is None:
            return compiled

        def spend_and_evaluate(env: Environment) -> Value:
            self._spend(operations)
            return compiled(env)

        return spend_and_evaluate

    # ------------------------------------------------------------ expressions: reads

    def _compile(self, expr: t.TypedExpr) -> Compiled:
        return self._EXPRESSIONS[type(expr)](self, expr)

    def _compile_literal(self, expr: t.Literal) -> Compiled:
        value = expr.value
        return lambda _: value

    def _compile_param_read(self, expr: t.ParamRead) -> Compiled:
        value = self._params[expr.param]
        return lambda _: value

    def _compile_var_read(self, expr: t.VarRead) -> Compiled:
        variable = expr.variable
        return lambda env: env.variables[variable]

    def _compile_topic_read(self, expr: t.TopicRead) -> Compiled:
        index = self._topics[expr.topic]
        return lambda env: env.topics[index]

    def _compile_truth_read(self, expr: t.TruthRead) -> Compiled:
        index = self._plants[expr.instance]

        def read_truth(env: Environment) -> Value:
            assert env.truth is not None
            return env.truth(index)

        return read_truth

    def _compile_mode_read(self, expr: t.ModeRead) -> Compiled:
        index = self._modules[expr.module]

        def read_mode(env: Environment) -> Value:
            assert env.mode is not None
            return env.mode(index)

        return read_mode

    def _compile_margin_read(self, expr: t.MarginRead) -> Compiled:
        index = self._modules[expr.module]

        def read_margin(env: Environment) -> Value:
            assert env.margin_ns is not None
            return arithmetic.seconds(env.margin_ns(index))

        return read_margin

    def _compile_in_control(self, _: t.InControl) -> Compiled:
        return lambda env: env.in_control

    def _compile_time_read(self, _: t.TimeRead) -> Compiled:
        return lambda env: arithmetic.seconds(env.time_ns)

    def _compile_period_read(self, _: t.PeriodRead) -> Compiled:
        return lambda env: arithmetic.seconds(env.period_ns)

    def _compile_age_read(self, expr: t.AgeRead) -> Compiled:
        index = self._topics[expr.topic]
        return lambda env: arithmetic.seconds(env.time_ns - env.stamps[index])

    # ------------------------------------------------------------ expressions: operations

    def _compile_unary(self, expr: t.TypedUnary) -> Compiled:
        operand = self._compile(expr.operand)
        span = expr.span
        if expr.op == "!":
            return lambda env: not operand(env)
        if isinstance(expr.type, FloatType):
            return lambda env: -operand(env)
        if _has_int_arithmetic(expr.type):
            return lambda env: arithmetic.neg_int(operand(env), span)
        each = arithmetic.function_on_components(expr.type)
        return lambda env: each(operator.neg, operand(env))

    def _compile_binary(self, expr: t.TypedBinary) -> Compiled:
        left, right = self._compile(expr.left), self._compile(expr.right)
        if expr.op == "&&":
            return lambda env: left(env) and right(env)
        if expr.op == "||":
            return lambda env: left(env) or right(env)
        op, span = expr.op, expr.span
        if op in _COMPARISONS:
            return _binary_closure(_COMPARISONS[op], left, right)
        if not isinstance(expr.type, FloatType):
            return _checked_binary_closure(_INT_OPERATIONS[op], left, right, span)
        if op == "/":
            return _checked_binary_closure(arithmetic.div_float, left, right, span)
        return _binary_closure(_FLOAT_OPERATIONS[op], left, right)

    def _compile_vector(self, expr: t.Vector) -> Compiled:
        left, right = self._compile(expr.left), self._compile(expr.right)
        op, span = expr.op, expr.span
        if op in ("+", "-"):
            zipped, operation = arithmetic.function_on_pairs(expr.type), _FLOAT_OPERATIONS[op]
            compiled: Compiled = lambda env: zipped(operation, left(env), right(env))  # noqa: E731
            return self._with_cost(leaf_count(expr.type), compiled)

        each = arithmetic.function_on_components(expr.type)
        scalar_first = isinstance(expr.left.type, FloatType)

        def scaled_vector(env: Environment) -> Value:
            a, b = left(env), right(env)
            if op == "/":
                return each(lambda x: arithmetic.div_float(x, b, span), a)
            if scalar_first:
                return each(lambda x: a * x, b)
            return each(lambda x: x * b, a)

        return self._with_cost(leaf_count(expr.type), scaled_vector)

    def _compile_conditional(self, expr: t.Conditional) -> Compiled:
        condition = self._compile(expr.condition)
        then, otherwise = self._compile(expr.then), self._compile(expr.otherwise)
        return lambda env: then(env) if condition(env) else otherwise(env)

    def _compile_narrow(self, expr: t.Narrow) -> Compiled:
        operand, span = self._compile(expr.operand), expr.span
        assert isinstance(expr.type, IntType)
        low, high = expr.type.low, expr.type.high
        return lambda env: arithmetic.require_in_range(operand(env), low, high, span)

    # ------------------------------------------------------------ expressions: calls

    def _compile_call(self, expr: t.TypedCall) -> Compiled:
        arguments = [self._compile(a) for a in expr.arguments]
        if expr.fun.extern:
            return self._compile_call_extern(expr, arguments)
        call = self.closure_of(expr.fun)
        compiled: Compiled = lambda env: call(env, [a(env) for a in arguments])  # noqa: E731
        return self._with_cost(1, compiled)

    def _compile_call_extern(self, expr: t.TypedCall, arguments: list[Compiled]) -> Compiled:
        fun, span = expr.fun, expr.span
        extern = self._externs.get(fun)
        if extern is None:
            self.unbound.add(fun)
        types = [p.type for p in fun.parameters]

        def call_extern(env: Environment) -> Value:
            values = [a(env) for a in arguments]
            if extern is None:
                raise StepFault(FaultKind.EXTERN, span, f"`{fun.name}` is not bound")
            try:
                result = extern(*map(to_python, types, values))
                return from_python(fun.result, result)
            except Exception as error:
                detail = f"`{fun.name}`: {type(error).__name__}: {error}"
                raise StepFault(FaultKind.EXTERN, span, detail) from error

        return call_extern

    def _compile_builtin(self, expr: t.Builtin) -> Compiled:
        arguments = [self._compile(a) for a in expr.arguments]
        first, span = arguments[0], expr.span
        of = expr.arguments[0].type
        name = expr.name
        if name in ("min", "max"):
            return _binary_closure(
                arithmetic.minimum if name == "min" else arithmetic.maximum, first, arguments[1]
            )
        if name == "abs" and _has_int_arithmetic(of):
            return lambda env: arithmetic.abs_int(first(env), span)
        if name == "int":
            return lambda env: arithmetic.int_of_float(first(env), span)
        if name in ("dot", "norm"):
            return self._compile_dot(name, of, arguments)
        if name == "saturate":
            each, limit = arithmetic.function_on_components(of), arguments[1]

            def saturated_value(env: Environment) -> Value:
                x, most = first(env), limit(env)
                return each(lambda component: arithmetic.saturate(component, most), x)

            return self._with_cost(leaf_count(of), saturated_value)
        operation = _FLOAT_FUNCTIONS[name]
        return lambda env: operation(first(env))

    def _compile_dot(self, name: str, of: Type, arguments: list[Compiled]) -> Compiled:
        flat, first = arithmetic.leaves_function(of), arguments[0]
        if name == "norm":

            def norm_of_value(env: Environment) -> Value:
                x = flat(first(env))
                return arithmetic.sqrt(arithmetic.dot(x, x))

            return self._with_cost(leaf_count(of), norm_of_value)
        second = arguments[1]
        compiled: Compiled = lambda env: arithmetic.dot(flat(first(env)), flat(second(env)))  # noqa: E731
        return self._with_cost(leaf_count(of), compiled)

    # ------------------------------------------------------------ expressions: structure

    def _compile_field(self, expr: t.TypedField) -> Compiled:
        target, index = self._compile(expr.target), expr.index
        return lambda env: target(env)[index]

    def _compile_index(self, expr: t.Index) -> Compiled:
        target, index, span = self._compile(expr.target), self._compile(expr.index), expr.span

        def checked_element(env: Environment) -> Value:
            sequence = target(env)
            return sequence[checked_index(index(env), sequence, span)]

        return checked_element

    def _compile_length(self, expr: t.TypedLength) -> Compiled:
        of = expr.target.type
        if isinstance(of, ArrayType):
            return lambda _: of.size
        target = self._compile(expr.target)
        return lambda env: len(target(env))

    def _compile_aggregate(self, expr: t.Aggregate) -> Compiled:
        elements = [self._compile(e) for e in expr.elements]
        if expr.order is None:
            compiled: Compiled = lambda env: tuple([e(env) for e in elements])  # noqa: E731
            return self._with_cost(len(elements), compiled)
        position = {field: written for written, field in enumerate(expr.order)}
        declared = [position[i] for i in range(len(elements))]

        def values_in_declared_order(env: Environment) -> Value:
            values = [e(env) for e in elements]
            return tuple([values[i] for i in declared])

        return self._with_cost(len(elements), values_in_declared_order)

    def _compile_choose(self, expr: t.TypedChoose) -> Compiled:
        """Gives the closure that evaluates all options, then asks `choose` for one of them."""
        options = [self._compile(o) for o in expr.options]
        count, low, ages = expr.count, expr.low, expr.ages
        boolean = isinstance(expr.type, BoolType)

        def chosen_value(env: Environment) -> Value:
            values = [o(env) for o in options]
            if ages is None:
                pick = env.choose(count)
            else:
                before = env.variables[ages]
                allowed = environment.allowed_picks(before)
                pick = allowed[env.choose(len(allowed))]
                env.variables[ages] = environment.ages_after(before, pick)
            if values:
                return values[pick]
            return bool(pick) if boolean else low + pick

        return chosen_value

    _EXPRESSIONS: ClassVar[
        dict[type[t.TypedExpr], Callable[[ExpressionEvaluator, Any], Compiled]]
    ] = {
        t.Literal: _compile_literal,
        t.ParamRead: _compile_param_read,
        t.VarRead: _compile_var_read,
        t.TopicRead: _compile_topic_read,
        t.TruthRead: _compile_truth_read,
        t.ModeRead: _compile_mode_read,
        t.MarginRead: _compile_margin_read,
        t.InControl: _compile_in_control,
        t.TimeRead: _compile_time_read,
        t.PeriodRead: _compile_period_read,
        t.AgeRead: _compile_age_read,
        t.TypedUnary: _compile_unary,
        t.TypedBinary: _compile_binary,
        t.Vector: _compile_vector,
        t.Conditional: _compile_conditional,
        t.TypedCall: _compile_call,
        t.Builtin: _compile_builtin,
        t.TypedField: _compile_field,
        t.Index: _compile_index,
        t.TypedLength: _compile_length,
        t.Aggregate: _compile_aggregate,
        t.TypedChoose: _compile_choose,
        t.Narrow: _compile_narrow,
    }


# ---------------------------------------------------------------- helpers


def _has_int_arithmetic(of: Type) -> bool:
    """Whether the type is an int or a duration, whose arithmetic has 64 bits."""
    return isinstance(of, (IntType, DurationType))


def _binary_closure(op: Callable[[Any, Any], Value], left: Compiled, right: Compiled) -> Compiled:
    return lambda env: op(left(env), right(env))


def _checked_binary_closure(
    op: Callable[[Any, Any, Span | None], Value], left: Compiled, right: Compiled, span: Span
) -> Compiled:
    return lambda env: op(left(env), right(env), span)


def checked_index(index: int, sequence: tuple[Value, ...], span: Span) -> int:
    """Gives `index` if `sequence` has it; raises StepFault (an index fault) otherwise."""
    if 0 <= index < len(sequence):
        return index
    raise StepFault(FaultKind.INDEX, span)
