"""The big-step meaning of typed statements and functions; expressions are in `expressions.py`.

Purpose: the checker's evaluation of constants and the reference interpreter both run this. A typed
tree is compiled once into Python closures, because a step may run a thousand times; each closure is
the meaning of one kind of node and reads like its docstring in `typed.py`. `python_function` lets
tests, tables and figures call a program's own functions.
Non-goals: when a step runs and what becomes of its publications (`semantics/`), speed beyond that,
C (`core/` and `codegen/` are the other meaning, on purpose written apart from this one), externs (a
call of one faults).

Evaluation is pure but for the `Environment`: values are immutable, an assignment rebuilds the
value of its variable. A statement gives None, or the value a `return` left with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.expressions import ExpressionEvaluator, checked_index
from soter.language.model import typed as t
from soter.language.model.types import leaf_count
from soter.language.model.values import from_python, to_python

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from typing_extensions import Self

    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.model.system import Scope
    from soter.language.model.typed import FunSymbol, TypedProgram
    from soter.language.model.types import Value

    Executed = Callable[[Environment], Value | None]

__all__ = ["BudgetExceeded", "Environment", "Evaluator"]


class Evaluator(ExpressionEvaluator):
    """Compiles typed trees of one scope into closures, each tree once.

    `params`, `topics`, `plants` and `modules` give the meanings of names, as in `system.Scope`.
    `externs` maps extern functions to Python callables, which take and give Python values
    (`values.py`); a call of a missing extern faults, and `unbound` contains it. With a `budget`,
    `value` raises `BudgetExceeded` if a constant needs more operations (statements, calls, loop
    rounds, and components moved).
    """

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
        super().__init__(params, externs, budget, topics=topics, plants=plants, modules=modules)
        self._bodies: dict[t.FunSymbol, Executed] = {}

    @classmethod
    def for_scope(cls, scope: Scope, externs: Mapping[t.FunSymbol, Extern] | None = None) -> Self:
        """Gives an evaluator for the code of one instance in a system."""
        return cls(
            scope.params,
            externs,
            topics=scope.topics,
            plants=scope.plants,
            modules=scope.modules,
        )

    # ------------------------------------------------------------ functions and blocks

    def closure_of(self, fun: t.FunSymbol) -> Callable[[Environment, Sequence[Value]], Value]:
        """Gives `(environment, arguments) -> value` for a function with a body."""
        if fun not in self._bodies:
            assert fun.body is not None, fun.name
            self._bodies[fun] = self.compiled_block(fun.body)
        body, parameters = self._bodies[fun], fun.parameters

        def call_function(env: Environment, arguments: Sequence[Value]) -> Value:
            outside = env.variables
            env.variables = dict(zip(parameters, arguments, strict=True))
            try:
                return body(env)
            finally:
                env.variables = outside

        return call_function

    def compiled_block(self, statements: Iterable[t.TypedStmt]) -> Executed:
        """Gives `environment -> returned value or None`, which also changes the environment."""
        compiled = [self._STATEMENTS[type(s)](self, s) for s in statements]
        if len(compiled) == 1:
            return compiled[0]

        def run_statements(env: Environment) -> Value | None:
            for statement in compiled:
                result = statement(env)
                if result is not None:
                    return result
            return None

        return run_statements

    # ------------------------------------------------------------ statements

    def _compile_declare(self, stmt: t.TypedDeclare) -> Executed:
        return self._with_cost(1, _compile_store(stmt.variable, self._compile(stmt.value)))

    def _compile_assign(self, stmt: t.TypedAssign) -> Executed:
        place, value = stmt.place, self._compile(stmt.value)
        if not place.path:
            return self._with_cost(1, _compile_store(place.variable, value))
        keys, variable = self._path_reader(place), place.variable

        def assign_part(env: Environment) -> None:
            path = keys(env)
            new = value(env)
            env.variables[variable] = with_part(env.variables[variable], path, new)

        return self._with_cost(_components_copied_at_most(place), assign_part)

    def _compile_push(self, stmt: t.TypedPush) -> Executed:
        place, value, span = stmt.place, self._compile(stmt.value), stmt.span
        keys, variable = self._path_reader(place), place.variable
        capacity: int = place.type.capacity  # type: ignore[attr-defined]

        def push_value(env: Environment) -> None:
            path = keys(env)
            new = value(env)
            whole = current = env.variables[variable]
            for key in path:
                current = current[key]
            if len(current) >= capacity:
                raise StepFault(FaultKind.CAPACITY, span)
            env.variables[variable] = with_part(whole, path, (*current, new))

        return self._with_cost(_components_copied_at_most(place) + capacity, push_value)

    def _path_reader(self, place: t.Place) -> Callable[[Environment], list[int]]:
        """Gives `environment -> positions on a place's path`; raises StepFault for a bad index."""
        steps = [(p, None) if isinstance(p, int) else (0, self._compile(p)) for p in place.path]
        variable, span = place.variable, place.span

        def positions_on_path(env: Environment) -> list[int]:
            path = []
            current = env.variables[variable]
            for field, index in steps:
                key = field if index is None else checked_index(index(env), current, span)
                path.append(key)
                current = current[key]
            return path

        return positions_on_path

    def _compile_publish(self, stmt: t.TypedPublish) -> Executed:
        index, value = self._topics[stmt.topic], self._compile(stmt.value)
        limit, span = stmt.limit, stmt.span

        def publish_value(env: Environment) -> None:
            env.published[index] = value(env)

        if limit is None:
            return self._with_cost(1, publish_value)

        def append_message(env: Environment) -> None:
            new = value(env)
            earlier = env.published.get(index, ())
            if len(earlier) >= limit:
                raise StepFault(FaultKind.CAPACITY, span, f"more than {limit} messages")
            env.published[index] = (*earlier, new)

        return self._with_cost(1, append_message)

    def _compile_return(self, stmt: t.TypedReturn) -> Executed:
        return self._with_cost(1, self._compile(stmt.value))

    def _compile_assert(self, stmt: t.Assert) -> Executed:
        condition, span, message = self._compile(stmt.condition), stmt.span, stmt.message

        def check_condition(env: Environment) -> None:
            if not condition(env):
                raise StepFault(FaultKind.ASSERT, span, message or "")

        return self._with_cost(1, check_condition)

    def _compile_if(self, stmt: t.TypedIf) -> Executed:
        arms = [(self._compile(c), self.compiled_block(body)) for c, body in stmt.arms]
        otherwise = self.compiled_block(stmt.otherwise)

        def run_chosen_arm(env: Environment) -> Value | None:
            for condition, body in arms:
                if condition(env):
                    return body(env)
            return otherwise(env)

        return self._with_cost(1, run_chosen_arm)

    def _compile_for_range(self, stmt: t.ForRange) -> Executed:
        rounds = range(stmt.low, stmt.high)
        return self._compile_loop(stmt.variable, lambda _: rounds, stmt.body)

    def _compile_for_each(self, stmt: t.ForEach) -> Executed:
        return self._compile_loop(stmt.variable, self._compile(stmt.sequence), stmt.body)

    def _compile_loop(
        self, variable: t.Variable, sequence: Compiled, statements: tuple[t.TypedStmt, ...]
    ) -> Executed:
        body = self._with_cost(1, self.compiled_block(statements))

        def run_rounds(env: Environment) -> Value | None:
            for item in sequence(env):
                env.variables[variable] = item
                result = body(env)
                if result is not None:
                    return result
            return None

        return self._with_cost(1, run_rounds)

    _STATEMENTS: ClassVar[dict[type[t.TypedStmt], Callable[[Evaluator, Any], Executed]]] = {
        t.TypedDeclare: _compile_declare,
        t.TypedAssign: _compile_assign,
        t.TypedPush: _compile_push,
        t.TypedPublish: _compile_publish,
        t.TypedReturn: _compile_return,
        t.Assert: _compile_assert,
        t.TypedIf: _compile_if,
        t.ForRange: _compile_for_range,
        t.ForEach: _compile_for_each,
    }


# ---------------------------------------------------------------- helpers


def _compile_store(variable: t.Variable, value: Compiled) -> Executed:
    def store_value(env: Environment) -> None:
        env.variables[variable] = value(env)

    return store_value


def with_part(whole: Value, path: Sequence[int], new: Value) -> Value:
    """Gives `whole` with `new` in place of the part at `path`, which consists of positions."""
    if not path:
        return new
    at, *rest = path
    return (*whole[:at], with_part(whole[at], rest, new), *whole[at + 1 :])


def _components_copied_at_most(place: t.Place) -> int:
    """Gives the greatest number of components that an assignment to the place copies."""
    return leaf_count(place.variable.type)


def python_function(program: TypedProgram, fun: FunSymbol) -> Callable[..., Any]:
    """Gives a Python callable for `fun`, with the default values of the program's parameters."""
    basic = Evaluator({})
    evaluator = Evaluator({p: basic.value(p.default) for p in program.params.values()})
    compiled = evaluator.closure_of(fun)

    def call_with_python_values(*arguments: object) -> Any:  # noqa: ANN401 - any Soter value
        if len(arguments) != len(fun.parameters):
            msg = f"{fun.name} takes {len(fun.parameters)} arguments, not {len(arguments)}"
            raise TypeError(msg)
        values = tuple(
            from_python(p.type, a, p.name) for p, a in zip(fun.parameters, arguments, strict=True)
        )
        return to_python(fun.result, compiled(Environment(), values))

    call_with_python_values.__name__ = fun.name
    return call_with_python_values
