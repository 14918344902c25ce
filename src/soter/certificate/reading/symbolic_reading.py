"""A second reading of the checked tree: steps and predicates become terms.

Purpose: evaluate typed expressions and statements once, with numbers where numbers are known and
`terms.Linear` or `terms.Truth` where inputs are involved. Loops are unrolled, functions inlined,
both sides of a branch that depends on inputs are read and joined.
Non-goals: operations on values (`symbolic_operations.py`); sharing code with the interpreter, with
the lowering, or with what verifies: this is written from docs/language.md and docs/semantics.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.reading.symbolic_values import (
    NOT_HERE,
    Rows,
    SymbolicInt,
    Value,
    flat,
    mapped,
    plain,
    replaced,
    truth_of,
    zipped,
)
from soter.certificate.terms.arb_balls import ONE, PRELUDE, exact
from soter.certificate.terms.terms import (
    FALSE,
    Linear,
    NotRecheckedError,
    Proposition,
    Terms,
    both,
    either,
    negation,
)
from soter.language.evaluate import arithmetic
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes
from soter.language.model.types import ArrayType, BoolType, DurationType, IntType

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


STEPS_MAX = 200_000


@dataclass(eq=False)
class Surroundings:
    """What names mean: values of parameters, topics, and the period of the step in seconds."""

    params: Mapping[t.ParamSymbol, Value]
    topics: Mapping[t.TopicSymbol, Value]
    period: float | None = None
    truths: Mapping[str, Value] = field(default_factory=dict)
    modes: Mapping[t.ModuleSymbol | str, Value] = field(default_factory=dict)
    """Of other modules, where they may be read."""


@dataclass(eq=False)
class _CallFrame:
    variables: dict[t.Variable, Value]
    published: dict[t.TopicSymbol, Value]

    def copy(self) -> _CallFrame:
        return _CallFrame(dict(self.variables), dict(self.published))


class SymbolicReader:
    """Reads code into terms. `rounded`: as the machine computes it; else as real numbers."""

    def __init__(self, terms: Terms, around: Surroundings, *, rounded: bool = True) -> None:
        self.terms = terms
        self.around = around
        self.operations = Operations(terms, rounded=rounded)
        self._steps = 0

    # ------------------------------------------------------------ entry points

    def expression(
        self, expr: t.TypedExpr, variables: Mapping[t.Variable, Value] | None = None
    ) -> Value:
        """The value of an expression."""
        return self._expr(expr, _CallFrame(dict(variables or {}), {}))

    def step(
        self, body: Sequence[t.TypedStmt], variables: Mapping[t.Variable, Value]
    ) -> dict[t.TopicSymbol, Value]:
        """What a step publishes; NotRecheckedError where it always faults."""
        frame = _CallFrame(dict(variables), {})
        if not self._tried(self.terms.path, lambda: self._block(tuple(body), frame))[0]:
            raise NotRecheckedError("SC faults wherever it steps")
        return frame.published

    def _tried(self, path: Proposition, run: Callable[[], Value]) -> tuple[bool, Value]:
        """What is computed under a condition; False where it faults: then it must not hold."""
        outside, self.terms.path = self.terms.path, path
        try:
            return True, run()
        except arithmetic.StepFault:
            self.terms.oblige(FALSE)
            return False, None
        finally:
            self.terms.path = outside

    # ------------------------------------------------------------ statements

    def _block(self, body: tuple[t.TypedStmt, ...], frame: _CallFrame) -> Value | None:
        """Runs statements; gives what `return` left with, or None."""
        todo = list(body)
        while todo:
            self._steps += 1
            if self._steps > STEPS_MAX:
                raise NotRecheckedError("the step is too long to be read as one formula")
            statement = todo.pop(0)
            if isinstance(statement, t.TypedReturn):
                return self._expr(statement.value, frame)
            if isinstance(statement, t.TypedIf):
                condition, then, otherwise = _first_arm(statement)
                c = self._expr(condition, frame)
                if isinstance(c, bool):
                    todo[:0] = then if c else otherwise
                    continue
                if _returns(then) or _returns(otherwise):
                    rest = tuple(todo)
                    return self._both_ways(c, (*then, *rest), (*otherwise, *rest), frame)
                self._both_ways(c, then, otherwise, frame)
                continue
            if isinstance(statement, (t.ForRange, t.ForEach)):
                todo[:0] = self._unrolled(statement, frame)
                continue
            self._simple(statement, frame)
        return None

    def _both_ways(
        self,
        c: Proposition,
        then: tuple[t.TypedStmt, ...],
        otherwise: tuple[t.TypedStmt, ...],
        frame: _CallFrame,
    ) -> Value | None:
        """Both sides of a branch, joined at the single exit."""
        outside, other = self.terms.path, frame.copy()
        fine, first = self._tried(both(outside, c), lambda: self._block(then, frame))
        well, second = self._tried(
            both(outside, negation(c)), lambda: self._block(otherwise, other)
        )
        if not (fine and well):  # an obligation says that the other side is taken
            if not (fine or well):
                raise arithmetic.StepFault(arithmetic.FaultKind.ASSERT)
            if well:
                frame.variables, frame.published = other.variables, other.published
            return first if fine else second
        for table, its in ((frame.variables, other.variables), (frame.published, other.published)):
            joint: dict[Any, Value] = {}
            for key in table.keys() & its.keys():
                joint[key] = self.operations.join(c, table[key], its[key])  # type: ignore[index]
            if table is frame.published and table.keys() != its.keys():
                raise NotRecheckedError(f"a step that publishes on one side only {NOT_HERE}")
            table.clear()
            table.update(joint)
        if first is None or second is None:
            return None
        return self.operations.join(c, first, second)

    def _unrolled(self, loop: t.ForRange | t.ForEach, frame: _CallFrame) -> list[t.TypedStmt]:
        items: Sequence[Value]
        if isinstance(loop, t.ForRange):
            items = range(loop.low, loop.high)
        else:
            items = self._expr(loop.sequence, frame)
        unrolled: list[t.TypedStmt] = []
        for item in items:
            unrolled.append(_Bind(loop.span, loop.variable, item))
            unrolled.extend(loop.body)
        return unrolled

    def _simple(self, statement: t.TypedStmt, frame: _CallFrame) -> None:
        if isinstance(statement, _Bind):
            frame.variables[statement.variable] = statement.value
        elif isinstance(statement, t.TypedDeclare):
            frame.variables[statement.variable] = self._expr(statement.value, frame)
        elif isinstance(statement, t.TypedAssign):
            keys = [k if isinstance(k, int) else self._expr(k, frame) for k in statement.place.path]
            if not all(isinstance(k, int) for k in keys):
                raise NotRecheckedError(
                    f"an assignment at an index that depends on inputs {NOT_HERE}"
                )
            value = self._expr(statement.value, frame)
            whole = frame.variables[statement.place.variable]
            frame.variables[statement.place.variable] = replaced(whole, keys, value)
        elif isinstance(statement, t.TypedPublish):
            frame.published[statement.topic] = self._expr(statement.value, frame)
        elif isinstance(statement, t.Assert):
            self.terms.oblige(truth_of(self._expr(statement.condition, frame)))
        else:
            raise NotRecheckedError(
                f"`{type(statement).__name__.removeprefix('Typed').lower()}` {NOT_HERE}"
            )

    # ------------------------------------------------------------ expressions

    def _expr(self, e: t.TypedExpr, frame: _CallFrame, *, rows: bool = False) -> Value:
        """`rows`: a row of a table may stay unread, as one of its numbers is asked for next."""
        self._steps += 1
        if self._steps > STEPS_MAX:
            raise NotRecheckedError("the step is too long to be read as one formula")
        reading = _READINGS.get(type(e))
        if reading is None:
            raise NotRecheckedError(f"`{type(e).__name__.removeprefix('Typed')}` {NOT_HERE}")
        value = reading(self, e, frame)
        if isinstance(value, Rows) and not rows:
            value = self.operations.row(value)
        return self._typed(e, value)

    def _typed(self, e: t.TypedExpr, value: Value) -> Value:
        """By its static type an int stays an int, whatever it went through, and a bool is one."""
        if isinstance(e.type, (IntType, DurationType)) and isinstance(value, Linear):
            return value if isinstance(value, SymbolicInt) else self.operations.whole(value)
        if isinstance(e.type, BoolType) and not isinstance(value, (bool, Proposition)):
            raise NotRecheckedError(f"such a bool {NOT_HERE}")
        return value

    def _literal(self, e: t.Literal, _: _CallFrame) -> Value:
        return e.value

    def _param(self, e: t.ParamRead, _: _CallFrame) -> Value:
        return self.around.params[e.param]

    def _variable(self, e: t.VarRead, frame: _CallFrame) -> Value:
        value = frame.variables.get(e.variable, self)
        if value is self:
            raise NotRecheckedError(f"`{e.variable.name}` {NOT_HERE} where it is read")
        return value

    def _topic(self, e: t.TopicRead, _: _CallFrame) -> Value:
        if e.topic not in self.around.topics:
            raise NotRecheckedError(f"topic `{e.topic.name}` is read, but nobody says its values")
        return self.around.topics[e.topic]

    def _period(self, _: t.PeriodRead, __: _CallFrame) -> Value:
        if self.around.period is None:
            raise NotRecheckedError(f"`dt` {NOT_HERE} here")
        return self.around.period

    def _mode(self, e: t.ModeRead, _: _CallFrame) -> Value:
        if e.module not in self.around.modes:
            raise NotRecheckedError(f"`mode` {NOT_HERE}")
        return self.around.modes[e.module]

    def _in_control(self, _: t.InControl, __: _CallFrame) -> Value:
        return True

    def _unary(self, e: t.TypedUnary, frame: _CallFrame) -> Value:
        x = self._expr(e.operand, frame)
        if e.op == "!":
            return (not x) if isinstance(x, bool) else plain(negation(x))
        return mapped(self.operations.negated, x)

    def _binary(self, e: t.TypedBinary, frame: _CallFrame) -> Value:
        a = self._expr(e.left, frame)
        if e.op in ("&&", "||"):
            return self._short_circuit(e, a, frame)
        b = self._expr(e.right, frame)
        if e.op in ("<", "<=", ">", ">=", "==", "!="):
            return self.operations.compared(e.op, a, b)
        return self.operations.arithmetic(e.op, a, b)

    def _short_circuit(self, e: t.TypedBinary, a: Value, frame: _CallFrame) -> Value:
        going_on = e.op == "&&"
        if isinstance(a, bool):
            return self._expr(e.right, frame) if a == going_on else a
        path = both(self.terms.path, a if going_on else negation(a))
        fine, right_value = self._tried(path, lambda: self._expr(e.right, frame))
        if not fine:
            return not going_on
        b = truth_of(right_value)
        return plain(both(a, b) if going_on else either(a, b))

    def _vector(self, e: t.Vector, frame: _CallFrame) -> Value:
        a, b = self._expr(e.left, frame), self._expr(e.right, frame)
        if isinstance(a, tuple) and isinstance(b, tuple):
            return zipped(lambda x, y: self.operations.arithmetic(e.op, x, y), a, b)
        if isinstance(a, tuple):
            return mapped(lambda x: self.operations.arithmetic(e.op, x, b), a)
        return mapped(lambda y: self.operations.arithmetic(e.op, a, y), b)

    def _conditional(self, e: t.Conditional, frame: _CallFrame) -> Value:
        c = self._expr(e.condition, frame)
        if isinstance(c, bool):
            return self._expr(e.then if c else e.otherwise, frame)
        path = self.terms.path
        fine, a = self._tried(both(path, c), lambda: self._expr(e.then, frame))
        well, b = self._tried(both(path, negation(c)), lambda: self._expr(e.otherwise, frame))
        if not (fine or well):
            raise arithmetic.StepFault(arithmetic.FaultKind.ASSERT)
        return self.operations.join(c, a, b) if fine and well else (a if fine else b)

    def _call(self, e: t.TypedCall, frame: _CallFrame) -> Value:
        arguments = [self._expr(a, frame) for a in e.arguments]
        if e.fun.body is None:
            raise NotRecheckedError(f"`{e.fun.name}` is an extern function: its values are unknown")
        if e.fun.prelude and e.fun.name in PRELUDE and isinstance(arguments[0], Linear):
            return self.operations.prelude(e.fun.name, arguments[0])
        inner = _CallFrame(dict(zip(e.fun.parameters, arguments, strict=True)), {})
        value = self._block(e.fun.body, inner)
        if value is None:
            raise NotRecheckedError(f"`{e.fun.name}` {NOT_HERE}")
        return value

    def _builtin(self, e: t.Builtin, frame: _CallFrame) -> Value:
        arguments = [self._expr(a, frame) for a in e.arguments]
        x = arguments[0]
        if e.name in ("dot", "norm"):
            y = x if e.name == "norm" else arguments[1]
            total = self.operations.dot(flat(x), flat(y))
            return self.operations.root(total) if e.name == "norm" else total
        if e.name == "saturate":
            limit = arguments[1]
            extreme, negative = self.operations.extreme, self.operations.negated(limit)
            return mapped(lambda v: extreme("min", extreme("max", v, negative), limit), x)
        if e.name in ("min", "max"):
            return self.operations.extreme(e.name, x, arguments[1])
        return self.operations.builtin(e.name, x)

    def _field(self, e: t.TypedField, frame: _CallFrame) -> Value:
        target = self._expr(e.target, frame, rows=True)
        if isinstance(target, Rows):
            return self.operations.selected([row[e.index] for row in target.elements], target.index)
        return target[e.index]

    def _index(self, e: t.Index, frame: _CallFrame) -> Value:
        target = self._expr(e.target, frame, rows=True)
        index = self._expr(e.index, frame)
        if isinstance(target, Rows):
            return self.operations.selected_twice(target, index)
        if not isinstance(index, Linear):
            if not 0 <= index < len(target):
                raise NotRecheckedError("an index outside its array")
            return target[index]
        return self.operations.selected(target, index)

    def _length(self, e: t.TypedLength, frame: _CallFrame) -> Value:
        of = e.target.type
        return of.size if isinstance(of, ArrayType) else len(self._expr(e.target, frame))

    def _aggregate(self, e: t.Aggregate, frame: _CallFrame) -> Value:
        values = [self._expr(x, frame) for x in e.elements]
        if e.order is None:
            return tuple(values)
        placed: list[Value] = [None] * len(values)
        for where, value in zip(e.order, values, strict=True):
            placed[where] = value
        return tuple(placed)

    def _narrow(self, e: t.Narrow, frame: _CallFrame) -> Value:
        x = self._expr(e.operand, frame)
        of = cast("IntType", e.type)
        if not isinstance(x, Linear):
            return arithmetic.narrow(x, of.low, of.high)
        low = self.terms.combine(((ONE, x),), exact(-of.low))
        high = self.terms.combine(((-ONE, x),), exact(of.high))
        self.terms.oblige(negation(self.terms.below(low)))
        self.terms.oblige(negation(self.terms.below(high)))
        return x


@dataclass(eq=False)
class _Bind(t.TypedStmt):
    """The next round of a loop: its variable takes a value."""

    variable: t.Variable
    value: Value


_READINGS: dict[type[t.TypedExpr], Callable[[SymbolicReader, Any, _CallFrame], Value]] = {
    t.Literal: SymbolicReader._literal,  # noqa: SLF001  a table of its own methods, and below
    t.ParamRead: SymbolicReader._param,  # noqa: SLF001
    t.VarRead: SymbolicReader._variable,  # noqa: SLF001
    t.TopicRead: SymbolicReader._topic,  # noqa: SLF001
    t.PeriodRead: SymbolicReader._period,  # noqa: SLF001
    t.ModeRead: SymbolicReader._mode,  # noqa: SLF001
    t.InControl: SymbolicReader._in_control,  # noqa: SLF001
    t.TypedUnary: SymbolicReader._unary,  # noqa: SLF001
    t.TypedBinary: SymbolicReader._binary,  # noqa: SLF001
    t.Vector: SymbolicReader._vector,  # noqa: SLF001
    t.Conditional: SymbolicReader._conditional,  # noqa: SLF001
    t.TypedCall: SymbolicReader._call,  # noqa: SLF001
    t.Builtin: SymbolicReader._builtin,  # noqa: SLF001
    t.TypedField: SymbolicReader._field,  # noqa: SLF001
    t.Index: SymbolicReader._index,  # noqa: SLF001
    t.TypedLength: SymbolicReader._length,  # noqa: SLF001
    t.Aggregate: SymbolicReader._aggregate,  # noqa: SLF001
    t.Narrow: SymbolicReader._narrow,  # noqa: SLF001
}


# ---------------------------------------------------------------- helpers


def _first_arm(
    s: t.TypedIf,
) -> tuple[t.TypedExpr, tuple[t.TypedStmt, ...], tuple[t.TypedStmt, ...]]:
    """`if` with several arms as `if` with two sides."""
    (condition, body), *more = s.arms
    if not more:
        return condition, body, s.otherwise
    return condition, body, (t.TypedIf(s.span, tuple(more), s.otherwise),)


def _returns(body: Sequence[t.TypedStmt]) -> bool:
    """Whether a `return` stands anywhere in it."""
    for s in body:
        if isinstance(s, t.TypedReturn):
            return True
        if isinstance(s, t.TypedIf) and (
            any(_returns(b) for _, b in s.arms) or _returns(s.otherwise)
        ):
            return True
        if isinstance(s, (t.ForRange, t.ForEach)) and _returns(s.body):
            return True
    return False


def variables_in(expr: t.TypedExpr) -> set[t.Variable]:
    """The variables that an expression reads: a `let` is only read where they are known."""
    return {n.variable for n in nodes([expr]) if isinstance(n, t.VarRead)}
