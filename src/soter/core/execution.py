"""Runs Core over values of another domain than numbers.

Purpose: the domains are intervals (`verify/enclose/core_enclosure.py`), terms of a solver
(`verify/induction/step_terms.py`) and expressions of tubes (`verify/tubes/module_expressions.py`).
`Execution` has what they share: the order of evaluation, temporaries, unrolled loops, inlined
functions, and both sides of an undecided branch on copies that are joined after it. A subclass says
what a constant, an operator, a fault and a join are, and how values round.
Non-goals: what code reads and writes (`core_walks.py`); C (`codegen/body.py`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from soter.core import core
from soter.language.model.types import BOOL, INT

V = TypeVar("V")

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import TypeAlias

    from soter.language.model.types import Type

    Output: TypeAlias = tuple[V, V, Type]
    """An output of a step so far: whether it is published, its last value, its type."""
    Join: TypeAlias = Callable[[V | None, V | None, Type], V]
    """One value of both sides of a branch; None for a side that has none."""


STATEMENTS_MAX = 20_000
"""Statements of one step or predicate at most, functions inlined and loops unrolled."""
YES, NO = core.Const(BOOL, True), core.Const(BOOL, False)


class TooManyStatementsError(Exception):
    """A step or predicate has more statements than `statements_max`."""


@dataclass
class Frame(Generic[V]):
    """The temporaries of one function or step, and the outputs that it has published."""

    variables: dict[str, V] = field(default_factory=dict)
    types: dict[str, Type] = field(default_factory=dict)
    outputs: dict[int, Output[V]] = field(default_factory=dict)

    def copy(self) -> Frame[V]:
        """Gives a copy of the frame, for one side of a branch."""
        return Frame(dict(self.variables), self.types, dict(self.outputs))


class Execution(ABC, Generic[V]):
    """One step or predicate, executed over a domain of values."""

    where: Any
    """The place of statements, such as the condition under which they run, or their block of C."""

    def __init__(
        self, functions: Mapping[str, core.Function], statements_max: float = STATEMENTS_MAX
    ) -> None:
        self.functions = functions
        self.left = statements_max
        self.frame: Frame[V] = Frame()

    def bind(self, name: str, t: Type, value: V) -> None:
        """Gives a temporary its value."""
        self.frame.variables[name], self.frame.types[name] = value, t

    # ------------------------------------------------------------ statements

    def run(self, statements: tuple[core.Stmt, ...]) -> None:
        """Runs statements; raises `TooManyStatementsError`."""
        for s in statements:
            self.left -= 1
            if self.left < 0:
                raise TooManyStatementsError
            self._run_statement(s)

    def _run_statement(self, s: core.Stmt) -> None:
        if isinstance(s, core.Let):
            self.bind(s.name, s.value.type, self.expr(s.value))
        elif isinstance(s, core.Checked):
            operands = [self.expr(o) for o in s.operands]
            limit = None if s.limit is None else self.expr(s.limit)
            self.bind(s.name, s.type, self._checked_value(s, operands, limit))
        elif isinstance(s, core.Choose):
            self.bind(s.name, s.type, self._chosen_value(s))
        elif isinstance(s, core.Guard):
            self._guard(self.expr(s.condition))
        elif isinstance(s, core.Call):
            arguments = tuple([self.expr(a) for a in s.arguments])
            self.bind(s.name, s.type, self.result_of(self.functions[s.function], arguments))
        elif isinstance(s, (core.Set, core.Push)):
            path = [p if isinstance(p, int) else self.expr(p) for p in s.path]
            old = self.frame.variables[s.name]
            self.bind(s.name, s.type, self._with_part(s, old, path, self.expr(s.value)))
        elif isinstance(s, core.If):
            self._run_if(s)
        elif isinstance(s, core.Loop):
            self._run_loop(s)
        else:
            assert isinstance(s, core.Publish), s
            self._publish(s, self.expr(s.value))

    def _publish(self, s: core.Publish, value: V) -> None:
        self.frame.outputs[s.output] = (self.expr(YES), value, s.value.type)

    def result_of(self, f: core.Function, arguments: tuple[V, ...]) -> V:
        """Gives the result of a function of the program by executing its body."""
        assert f.result is not None
        outer, self.frame = self.frame, Frame()
        for p, a in zip(f.parameters, arguments, strict=True):
            self.bind(p.name, p.type, a)
        self.run(f.body)
        result = self.expr(f.result)
        self.frame = outer
        return result

    def _run_loop(self, s: core.Loop) -> None:
        for k in range(s.low, s.high):
            self.bind(s.variable, INT, self.expr(core.Const(INT, k)))
            self.run(s.body)

    def _run_if(self, s: core.If) -> None:
        condition = self._branch_condition(self.expr(s.condition))
        known = self._decided_truth(condition)
        if known is not None:
            self.run(s.then if known else s.otherwise)
            return
        self.branch(
            condition,
            lambda: self._run_where(s.condition, s.then, truth=True),
            lambda: self._run_where(s.condition, s.otherwise, truth=False),
        )

    def _branch_condition(self, condition: V) -> V:
        """Gives the condition in a form for both sides of a branch and for their join."""
        return condition

    def _run_where(self, _: core.Expr, body: tuple[core.Stmt, ...], *, truth: bool) -> None:  # noqa: ARG002
        """Runs the body of one side of a branch, where the condition is `truth`."""
        self.run(body)

    def branch(self, condition: V, then: Callable[[], None], otherwise: Callable[[], None]) -> None:
        """Runs both sides on copies of the frame, and joins the copies afterwards."""
        before, where = self.frame, self.where
        ends, sides = [], []
        for truth, action in ((True, then), (False, otherwise)):
            self.frame, self.where = before.copy(), self._where_in_side(where, condition, truth)
            action()
            ends.append(self.frame)
            sides.append(self.where)
        self.frame, self.where = before.copy(), where
        yes, no = ends
        join = self._join_function(condition, *sides)
        for name in before.variables:
            a, b = yes.variables[name], no.variables[name]
            self.frame.variables[name] = a if a is b else join(a, b, before.types[name])
        for k in {**yes.outputs, **no.outputs}:
            self.frame.outputs[k] = self._joined_output(yes.outputs.get(k), no.outputs.get(k), join)

    def _joined_output(
        self, then: Output[V] | None, otherwise: Output[V] | None, join: Join[V]
    ) -> Output[V]:
        """Gives an output after a branch from the outputs of its sides; None: not published."""
        one = then or otherwise
        assert one is not None
        value = join(then and then[1], otherwise and otherwise[1], one[2])
        a, b = (self.expr(NO) if p is None else p[0] for p in (then, otherwise))
        return join(a, b, BOOL), value, one[2]

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> V:
        """Gives the value of an expression."""
        if isinstance(e, core.Var):
            return self.frame.variables[e.name]
        if isinstance(e, core.Select):
            condition = self.expr(e.condition)
            known = self._decided_truth(condition)
            if known is not None:
                return self.expr(e.then if known else e.otherwise)
            return self._operation_value(e, condition, self.expr(e.then), self.expr(e.otherwise))
        if isinstance(e, core.Unary):
            return self._operation_value(e, self.expr(e.operand))
        if isinstance(e, (core.Binary, core.Extreme)):
            return self._operation_value(e, self.expr(e.left), self.expr(e.right))
        if isinstance(e, (core.Field, core.Length)):
            return self._operation_value(e, self.expr(e.target))
        if isinstance(e, core.Element):
            return self._operation_value(e, self.expr(e.target), self.expr(e.index))
        if isinstance(e, (core.Const, core.Get, core.Fact)):
            return self._operation_value(e)
        assert isinstance(e, core.Make), e
        return self._operation_value(e, *[self.expr(x) for x in e.elements])

    # ------------------------------------------------------------ the domain

    @abstractmethod
    def _operation_value(self, e: core.Expr, *operands: V) -> V:
        """Gives the value of an expression, which is no `Var`, from its parts' values in order."""

    @abstractmethod
    def _decided_truth(self, condition: V) -> bool | None:
        """Gives the truth of a condition; None if it is not decided."""

    @abstractmethod
    def _where_in_side(self, where: Any, condition: V, truth: bool) -> Any:  # noqa: ANN401
        """Gives the `where` inside the side of a branch on which the condition is `truth`."""

    @abstractmethod
    def _join_function(self, condition: V, *where: Any) -> Join[V]:  # noqa: ANN401
        """Gives the function that joins the values of both sides; each side has a `where`."""

    @abstractmethod
    def _checked_value(self, s: core.Checked, operands: list[V], limit: V | None) -> V: ...
    @abstractmethod
    def _chosen_value(self, s: core.Choose) -> V: ...
    @abstractmethod
    def _guard(self, condition: V) -> None: ...
    @abstractmethod
    def _with_part(self, s: core.Set | core.Push, old: V, path: list[int | V], value: V) -> V: ...
