"""A second reading of the checked tree: steps and predicates become terms.

Purpose: evaluate typed expressions and statements once, with numbers where numbers are known and
`terms.Linear` or `terms.Truth` where inputs are involved. Loops are unrolled, functions inlined,
both sides of a branch that depends on inputs are read and joined.
Non-goals: sharing code with the interpreter, with the lowering, or with what verifies: this is
written from docs/language.md and docs/semantics.md.

A value is a bool, int or float, a `Linear` (float or int), a `Truth` (bool), or a tuple of values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from soter.prelude.bounds import BOUNDS
from soter.program import arith
from soter.program import typed as t
from soter.program.types import ArrayType, BoolType, DurationType, IntType, default_value
from soter.program.walk import nodes
from soter.recheck.balls import ONE, PRELUDE, TINIEST, UNIT_ROUNDOFF, exact, magnitude
from soter.recheck.terms import (
    FALSE,
    TRUE,
    Linear,
    NotRecheckedError,
    Terms,
    Truth,
    both,
    choice_of_truths,
    either,
    negation,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.program.types import Type

Value: TypeAlias = Any
STEPS_MAX = 200_000
NOT_HERE = "is not rechecked yet"


@dataclass(eq=False)
class Surroundings:
    """What names mean: values of parameters, topics, and the period of the step in seconds."""

    params: Mapping[t.ParamSymbol, Value]
    topics: Mapping[t.TopicSymbol, Value]
    period: float | None = None
    truths: Mapping[str, Value] = field(default_factory=dict)


@dataclass(eq=False)
class _Frame:
    variables: dict[t.Variable, Value]
    published: dict[t.TopicSymbol, Value]

    def copy(self) -> _Frame:
        return _Frame(dict(self.variables), dict(self.published))


class Reader:
    """Reads code into terms. `rounded`: as the machine computes it; else as real numbers."""

    def __init__(self, terms: Terms, around: Surroundings, *, rounded: bool = True) -> None:
        self.terms = terms
        self.around = around
        self.is_rounded = rounded
        self._steps = 0

    # ------------------------------------------------------------ entry points

    def expression(
        self, expr: t.Expr, variables: Mapping[t.Variable, Value] | None = None
    ) -> Value:
        """The value of an expression."""
        return self._expr(expr, _Frame(dict(variables or {}), {}))

    def step(
        self, body: Sequence[t.Stmt], variables: Mapping[t.Variable, Value]
    ) -> dict[t.TopicSymbol, Value]:
        """What a step publishes."""
        frame = _Frame(dict(variables), {})
        if not self._tried(self.terms.path, lambda: self._block(tuple(body), frame))[0]:
            raise NotRecheckedError("SC faults wherever it steps")
        return frame.published

    def _tried(self, path: Truth, run: Callable[[], Value]) -> tuple[bool, Value]:
        """What is computed under a condition; False where it faults: then it must not hold."""
        outside, self.terms.path = self.terms.path, path
        try:
            return True, run()
        except arith.StepFault:
            self.terms.oblige(FALSE)
            return False, None
        finally:
            self.terms.path = outside

    # ------------------------------------------------------------ statements

    def _block(self, body: tuple[t.Stmt, ...], frame: _Frame) -> Value | None:
        """Runs statements; gives what `return` left with, or None."""
        todo = list(body)
        while todo:
            self._steps += 1
            if self._steps > STEPS_MAX:
                raise NotRecheckedError("the step is too long to be read as one formula")
            statement = todo.pop(0)
            if isinstance(statement, t.Return):
                return self._expr(statement.value, frame)
            if isinstance(statement, t.If):
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
        self, c: Truth, then: tuple[t.Stmt, ...], otherwise: tuple[t.Stmt, ...], frame: _Frame
    ) -> Value | None:
        """Both sides of a branch, joined at the single exit."""
        outside, other = self.terms.path, frame.copy()
        fine, first = self._tried(both(outside, c), lambda: self._block(then, frame))
        well, second = self._tried(
            both(outside, negation(c)), lambda: self._block(otherwise, other)
        )
        if not (fine and well):  # an obligation says that the other side is taken
            if not (fine or well):
                raise arith.StepFault(arith.FaultKind.ASSERT)
            if well:
                frame.variables, frame.published = other.variables, other.published
            return first if fine else second
        for table, its in ((frame.variables, other.variables), (frame.published, other.published)):
            joint: dict[Any, Value] = {}
            for key in table.keys() & its.keys():
                joint[key] = self._join(c, table[key], its[key])  # type: ignore[index]
            if table is frame.published and table.keys() != its.keys():
                raise NotRecheckedError(f"a step that publishes on one side only {NOT_HERE}")
            table.clear()
            table.update(joint)
        if first is None or second is None:
            return None
        return self._join(c, first, second)

    def _join(self, c: Truth, a: Value, b: Value) -> Value:
        """C ? a : b, leaf by leaf."""
        if isinstance(a, tuple):
            if len(a) != len(b):
                raise NotRecheckedError(f"a list whose length depends on a branch {NOT_HERE}")
            return tuple(self._join(c, x, y) for x, y in zip(a, b, strict=True))
        if isinstance(a, (bool, Truth)):
            return _plain(choice_of_truths(c, truth_of(a), truth_of(b)))
        if not isinstance(a, Linear) and not isinstance(b, Linear) and _identical(a, b):
            return a
        found = self.terms.choose(c, self._linear(a), self._linear(b))
        whole = any(isinstance(v, (int, _Whole)) for v in (a, b))
        return self._whole(found) if whole else found

    def _unrolled(self, loop: t.ForRange | t.ForEach, frame: _Frame) -> list[t.Stmt]:
        items: Sequence[Value]
        if isinstance(loop, t.ForRange):
            items = range(loop.low, loop.high)
        else:
            items = self._expr(loop.sequence, frame)
        unrolled: list[t.Stmt] = []
        for item in items:
            unrolled.append(_Bind(loop.span, loop.variable, item))
            unrolled.extend(loop.body)
        return unrolled

    def _simple(self, statement: t.Stmt, frame: _Frame) -> None:
        if isinstance(statement, _Bind):
            frame.variables[statement.variable] = statement.value
        elif isinstance(statement, t.Declare):
            frame.variables[statement.variable] = self._expr(statement.value, frame)
        elif isinstance(statement, t.Assign):
            keys = [k if isinstance(k, int) else self._expr(k, frame) for k in statement.place.path]
            if not all(isinstance(k, int) for k in keys):
                raise NotRecheckedError(
                    f"an assignment at an index that depends on inputs {NOT_HERE}"
                )
            value = self._expr(statement.value, frame)
            whole = frame.variables[statement.place.variable]
            frame.variables[statement.place.variable] = _replaced(whole, keys, value)
        elif isinstance(statement, t.Publish):
            frame.published[statement.topic] = self._expr(statement.value, frame)
        elif isinstance(statement, t.Assert):
            self.terms.oblige(truth_of(self._expr(statement.condition, frame)))
        else:
            raise NotRecheckedError(f"`{type(statement).__name__.lower()}` {NOT_HERE}")

    # ------------------------------------------------------------ expressions

    def _expr(self, e: t.Expr, frame: _Frame, *, rows: bool = False) -> Value:
        """`rows`: a row of a table may stay unread, as one of its numbers is asked for next."""
        self._steps += 1
        if self._steps > STEPS_MAX:
            raise NotRecheckedError("the step is too long to be read as one formula")
        reading = _READINGS.get(type(e))
        if reading is None:
            raise NotRecheckedError(f"`{type(e).__name__}` {NOT_HERE}")
        found = reading(self, e, frame)
        if isinstance(found, _Rows) and not rows:
            found = self._row(found)
        return self._typed(e, found)

    def _row(self, rows: _Rows) -> Value:
        """All numbers of a row at an index that depends on inputs."""
        if len({len(row) for row in rows.elements}) != 1:
            raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
        width = range(len(rows.elements[0]))
        return tuple(self._selected([row[k] for row in rows.elements], rows.index) for k in width)

    def _typed(self, e: t.Expr, found: Value) -> Value:
        """By its static type an int stays an int, whatever it went through, and a bool is one."""
        if isinstance(e.type, (IntType, DurationType)) and isinstance(found, Linear):
            return found if isinstance(found, _Whole) else self._whole(found)
        if isinstance(e.type, BoolType) and not isinstance(found, (bool, Truth)):
            raise NotRecheckedError(f"such a bool {NOT_HERE}")
        return found

    def _literal(self, e: t.Literal, _: _Frame) -> Value:
        return e.value

    def _param(self, e: t.ParamRead, _: _Frame) -> Value:
        return self.around.params[e.param]

    def _variable(self, e: t.VarRead, frame: _Frame) -> Value:
        found = frame.variables.get(e.variable, self)
        if found is self:
            raise NotRecheckedError(f"`{e.variable.name}` {NOT_HERE} where it is read")
        return found

    def _topic(self, e: t.TopicRead, _: _Frame) -> Value:
        if e.topic not in self.around.topics:
            raise NotRecheckedError(f"topic `{e.topic.name}` is read, but nobody says its values")
        return self.around.topics[e.topic]

    def _period(self, _: t.PeriodRead, __: _Frame) -> Value:
        if self.around.period is None:
            raise NotRecheckedError(f"`dt` {NOT_HERE} here")
        return self.around.period

    def _in_control(self, _: t.InControl, __: _Frame) -> Value:
        return True

    def _unary(self, e: t.Unary, frame: _Frame) -> Value:
        x = self._expr(e.operand, frame)
        if e.op == "!":
            return (not x) if isinstance(x, bool) else _plain(negation(x))
        return _mapped(self._negated, x)

    def _negated(self, x: Value) -> Value:
        if isinstance(x, Linear):
            found = self.terms.combine(((-ONE, x),))
            return self._whole(found) if isinstance(x, _Whole) else found
        return arith.neg_int(x) if isinstance(x, int) else -x

    def _binary(self, e: t.Binary, frame: _Frame) -> Value:
        a = self._expr(e.left, frame)
        if e.op in ("&&", "||"):
            return self._short_circuit(e, a, frame)
        b = self._expr(e.right, frame)
        if e.op in ("<", "<=", ">", ">=", "==", "!="):
            return self._compared(e.op, a, b)
        return self._operation(e.op, a, b)

    def _short_circuit(self, e: t.Binary, a: Value, frame: _Frame) -> Value:
        going_on = e.op == "&&"
        if isinstance(a, bool):
            return self._expr(e.right, frame) if a == going_on else a
        path = both(self.terms.path, a if going_on else negation(a))
        fine, found = self._tried(path, lambda: self._expr(e.right, frame))
        if not fine:
            return not going_on
        b = truth_of(found)
        return _plain(both(a, b) if going_on else either(a, b))

    def _compared(self, op: str, a: Value, b: Value) -> Value:
        if isinstance(a, Truth) or isinstance(b, Truth):
            equal = choice_of_truths(truth_of(a), truth_of(b), negation(truth_of(b)))
            return _plain(equal if op == "==" else negation(equal))
        if isinstance(a, Linear) or isinstance(b, Linear):
            return _plain(self.terms.compare(op, self._linear(a), self._linear(b)))
        return _COMPARED[op](a, b)

    def _operation(self, op: str, a: Value, b: Value) -> Value:
        """+ - * / % on scalars; on real numbers where this reader does not round."""
        if isinstance(a, int) and isinstance(b, int):
            return _INTS[op](a, b)
        if not isinstance(a, Linear) and not isinstance(b, Linear) and self.is_rounded:
            if op == "/":
                return arith.div_float(a, b)
            return _FLOATS[op](a, b)
        whole = isinstance(a, int) or isinstance(b, int) or self._is_whole(a, b)
        x, y = self._linear(a), self._linear(b)
        if op == "+":
            found = self.terms.add(x, y)
        elif op == "-":
            found = self.terms.subtract(x, y)
        elif op == "*":
            found = self.terms.multiply(x, y)
        elif op == "/" and not whole:
            found = self.terms.divide(x, y)
        else:
            raise NotRecheckedError(f"`{op}` of ints that depend on inputs {NOT_HERE}")
        if whole:
            return self._whole(found)
        return self._as_computed(found)

    def _is_whole(self, a: Value, b: Value) -> bool:
        return any(isinstance(x, _Whole) for x in (a, b))

    def _whole(self, x: Linear) -> Value:
        """An int: exact, and never near the ends of 64 bits."""
        if not (magnitude(x.low) < 2**53 and magnitude(x.high) < 2**53):
            raise NotRecheckedError(f"an int beyond 2^53 that depends on inputs {NOT_HERE}")
        return _Whole(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)

    def _as_computed(self, x: Linear) -> Linear:
        return self.terms.rounded(x) if self.is_rounded else x

    def _linear(self, x: Value) -> Linear:
        if isinstance(x, Linear):
            return x
        if isinstance(x, float) and x - x != 0.0:
            raise NotRecheckedError(f"an infinite or undefined number {NOT_HERE}")
        return self.terms.constant(x)

    def _vector(self, e: t.Vector, frame: _Frame) -> Value:
        a, b = self._expr(e.left, frame), self._expr(e.right, frame)
        if isinstance(a, tuple) and isinstance(b, tuple):
            return _zipped(lambda x, y: self._operation(e.op, x, y), a, b)
        if isinstance(a, tuple):
            return _mapped(lambda x: self._operation(e.op, x, b), a)
        return _mapped(lambda y: self._operation(e.op, a, y), b)

    def _conditional(self, e: t.Conditional, frame: _Frame) -> Value:
        c = self._expr(e.condition, frame)
        if isinstance(c, bool):
            return self._expr(e.then if c else e.otherwise, frame)
        path = self.terms.path
        fine, a = self._tried(both(path, c), lambda: self._expr(e.then, frame))
        well, b = self._tried(both(path, negation(c)), lambda: self._expr(e.otherwise, frame))
        if not (fine or well):
            raise arith.StepFault(arith.FaultKind.ASSERT)
        return self._join(c, a, b) if fine and well else (a if fine else b)

    def _call(self, e: t.Call, frame: _Frame) -> Value:
        arguments = [self._expr(a, frame) for a in e.arguments]
        if e.fun.body is None:
            raise NotRecheckedError(f"`{e.fun.name}` is an extern function: its values are unknown")
        if e.fun.prelude and e.fun.name in PRELUDE and isinstance(arguments[0], Linear):
            return self._prelude(e.fun.name, arguments[0])
        inner = _Frame(dict(zip(e.fun.parameters, arguments, strict=True)), {})
        found = self._block(e.fun.body, inner)
        if found is None:
            raise NotRecheckedError(f"`{e.fun.name}` {NOT_HERE}")
        return found

    def _prelude(self, name: str, x: Linear) -> Linear:
        """A function of the prelude: the exact one within its tested bound (an assumption)."""
        bound = BOUNDS[name]
        assert not bound.relative, name
        low, high = (exact(v) for v in bound.domain[0])
        self.terms.oblige(negation(self.terms.below(self.terms.combine(((ONE, x),), -low))))
        self.terms.oblige(negation(self.terms.below(self.terms.combine(((-ONE, x),), high))))
        value = self.terms.function(name, x)
        largest = magnitude(value.low).max(magnitude(value.high))
        if not largest.is_finite():  # bounded where it is used, or not at all
            relative = self.terms.spread([exact(bound.ulps) * 2 * UNIT_ROUNDOFF], [value])
            found = self.terms.combine(((ONE, value), (ONE, relative)))
            error = exact(bound.ulps) * TINIEST + exact(bound.absolute)
            return replace(found, radius=found.radius + error)
        ulp = 2 * UNIT_ROUNDOFF * largest + TINIEST
        error = exact(bound.ulps) * ulp + exact(bound.absolute)
        if not self.is_rounded:
            error = 0 * error
        return self.terms.widened(value, error, *(exact(v) for v in bound.values))

    def _builtin(self, e: t.Builtin, frame: _Frame) -> Value:
        arguments = [self._expr(a, frame) for a in e.arguments]
        x = arguments[0]
        if e.name in ("dot", "norm"):
            y = x if e.name == "norm" else arguments[1]
            total = self._dot(_flat(x), _flat(y))
            return self._root(total) if e.name == "norm" else total
        if e.name == "saturate":
            limit = arguments[1]
            negative = self._negated(limit)
            return _mapped(
                lambda v: self._extreme("min", self._extreme("max", v, negative), limit), x
            )
        if e.name in ("min", "max"):
            return self._extreme(e.name, x, arguments[1])
        return _UNARY_BUILTINS[e.name](self, x)

    def _dot(self, a: Sequence[Value], b: Sequence[Value]) -> Value:
        total = self._operation("*", a[0], b[0])
        for x, y in zip(a[1:], b[1:], strict=True):
            total = self._operation("+", total, self._operation("*", x, y))
        return total

    def _extreme(self, name: str, a: Value, b: Value) -> Value:
        if not isinstance(a, Linear) and not isinstance(b, Linear):
            return arith.minimum(a, b) if name == "min" else arith.maximum(a, b)
        x, y = self._linear(a), self._linear(b)
        choose = self.terms.minimum if name == "min" else self.terms.maximum
        found = choose(x, y, tight=not self.is_rounded)  # plants: limits keep ends of grids
        whole = any(isinstance(v, (int, _Whole)) for v in (a, b))
        return self._whole(found) if whole else found

    def _root(self, x: Value) -> Value:
        if not isinstance(x, Linear):
            return arith.sqrt(x)
        if not x.nonnegative:
            self.terms.oblige(negation(self.terms.below(x)))
        return self._as_computed(self.terms.function("sqrt", x, nonnegative=True))

    def _absolute(self, x: Value) -> Value:
        if not isinstance(x, Linear):
            return arith.abs_int(x) if isinstance(x, int) else abs(x)
        found = self.terms.function("abs", x, nonnegative=True)
        return self._whole(found) if isinstance(x, _Whole) else found

    def _floor(self, x: Value) -> Value:
        if not isinstance(x, Linear):
            return arith.floor(x)
        return self.terms.function("floor", x)

    def _float(self, x: Value) -> Value:
        if isinstance(x, Linear):
            return Linear(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)
        return float(x)

    def _int(self, x: Value) -> Value:
        """Truncates towards zero."""
        if not isinstance(x, Linear):
            return arith.int_of_float(x)
        if self._is_floor(x):
            return self._whole(x)
        down = self.terms.function("floor", x)
        if x.nonnegative or x.low >= 0:
            return self._whole(down)
        up = self._negated(self.terms.function("floor", self._negated(x)))
        return self._whole(self.terms.choose(self.terms.below(x), up, down))

    def _is_floor(self, x: Linear) -> bool:
        """Whether it is the result of `floor`, a whole number already."""
        if len(x.terms) != 1 or not (x.const.is_zero() and x.radius.is_zero()):
            return False
        ((atom, factor),) = x.terms.items()
        return bool(factor == 1) and self.terms.atoms[atom].kind == "floor"

    def _seconds(self, x: Value) -> Value:
        return arith.seconds(x)

    def _field(self, e: t.Field, frame: _Frame) -> Value:
        target = self._expr(e.target, frame, rows=True)
        if isinstance(target, _Rows):
            return self._selected([row[e.index] for row in target.elements], target.index)
        return target[e.index]

    def _index(self, e: t.Index, frame: _Frame) -> Value:
        target = self._expr(e.target, frame, rows=True)
        index = self._expr(e.index, frame)
        if isinstance(target, _Rows):
            return self._selected_twice(target, index)
        if not isinstance(index, Linear):
            if not 0 <= index < len(target):
                raise NotRecheckedError("an index outside its array")
            return target[index]
        return self._selected(target, index)

    def _selected(self, elements: Sequence[Value], index: Linear) -> Value:
        """An element at an index that depends on inputs."""
        first = elements[0]
        if isinstance(first, tuple) and all(type(x) in (float, int) for x in first):
            return _Rows(elements, index)
        if isinstance(first, tuple):
            parts = range(len(first))
            return tuple(self._selected([e[k] for e in elements], index) for k in parts)
        if not all(type(e) in (float, int) for e in elements):
            raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
        found = self.terms.lookup([float(e) for e in elements], (index,), (len(elements),))
        return self._whole(found) if type(first) is int else found

    def _selected_twice(self, rows: _Rows, index: Value) -> Value:
        """An element of a table with two indices."""
        first = rows.elements[0]
        if len({len(row) for row in rows.elements}) != 1 or len({type(v) for v in first}) != 1:
            raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
        values = [float(v) for row in rows.elements for v in row]
        shape = (len(rows.elements), len(first))
        found = self.terms.lookup(values, (rows.index, self._linear(index)), shape)
        return self._whole(found) if type(first[0]) is int else found

    def _length(self, e: t.Length, frame: _Frame) -> Value:
        of = e.target.type
        return of.size if isinstance(of, ArrayType) else len(self._expr(e.target, frame))

    def _aggregate(self, e: t.Aggregate, frame: _Frame) -> Value:
        values = [self._expr(x, frame) for x in e.elements]
        if e.order is None:
            return tuple(values)
        placed: list[Value] = [None] * len(values)
        for where, value in zip(e.order, values, strict=True):
            placed[where] = value
        return tuple(placed)

    def _narrow(self, e: t.Narrow, frame: _Frame) -> Value:
        x = self._expr(e.operand, frame)
        of = cast("IntType", e.type)
        if not isinstance(x, Linear):
            return arith.narrow(x, of.low, of.high)
        low = self.terms.combine(((ONE, x),), exact(-of.low))
        high = self.terms.combine(((-ONE, x),), exact(of.high))
        self.terms.oblige(negation(self.terms.below(low)))
        self.terms.oblige(negation(self.terms.below(high)))
        return x


@dataclass(eq=False)
class _Whole(Linear):
    """An int that depends on inputs."""


@dataclass(eq=False)
class _Rows:
    """A row of numbers out of several, at an index that depends on inputs."""

    elements: Sequence[tuple[Value, ...]]
    index: Linear


@dataclass(eq=False)
class _Bind(t.Stmt):
    """The next round of a loop: its variable takes a value."""

    variable: t.Variable
    value: Value


_READINGS: dict[type[t.Expr], Callable[[Reader, Any, _Frame], Value]] = {
    t.Literal: Reader._literal,  # noqa: SLF001  a table of its own methods, and below
    t.ParamRead: Reader._param,  # noqa: SLF001
    t.VarRead: Reader._variable,  # noqa: SLF001
    t.TopicRead: Reader._topic,  # noqa: SLF001
    t.PeriodRead: Reader._period,  # noqa: SLF001
    t.InControl: Reader._in_control,  # noqa: SLF001
    t.Unary: Reader._unary,  # noqa: SLF001
    t.Binary: Reader._binary,  # noqa: SLF001
    t.Vector: Reader._vector,  # noqa: SLF001
    t.Conditional: Reader._conditional,  # noqa: SLF001
    t.Call: Reader._call,  # noqa: SLF001
    t.Builtin: Reader._builtin,  # noqa: SLF001
    t.Field: Reader._field,  # noqa: SLF001
    t.Index: Reader._index,  # noqa: SLF001
    t.Length: Reader._length,  # noqa: SLF001
    t.Aggregate: Reader._aggregate,  # noqa: SLF001
    t.Narrow: Reader._narrow,  # noqa: SLF001
}
_UNARY_BUILTINS: dict[str, Callable[[Reader, Value], Value]] = {
    "sqrt": Reader._root,  # noqa: SLF001
    "abs": Reader._absolute,  # noqa: SLF001
    "floor": Reader._floor,  # noqa: SLF001
    "float": Reader._float,  # noqa: SLF001
    "int": Reader._int,  # noqa: SLF001
    "seconds": Reader._seconds,  # noqa: SLF001
}
_COMPARED: dict[str, Callable[[Any, Any], bool]] = {
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
}
_INTS: dict[str, Callable[[int, int], int]] = {
    "+": arith.add_int,
    "-": arith.sub_int,
    "*": arith.mul_int,
    "/": arith.div_int,
    "%": arith.mod_int,
}
_FLOATS: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
}


# ---------------------------------------------------------------- helpers


def _first_arm(s: t.If) -> tuple[t.Expr, tuple[t.Stmt, ...], tuple[t.Stmt, ...]]:
    """`if` with several arms as `if` with two sides."""
    (condition, body), *more = s.arms
    if not more:
        return condition, body, s.otherwise
    return condition, body, (t.If(s.span, tuple(more), s.otherwise),)


def _returns(body: Sequence[t.Stmt]) -> bool:
    """Whether a `return` stands anywhere in it."""
    for s in body:
        if isinstance(s, t.Return):
            return True
        if isinstance(s, t.If) and (any(_returns(b) for _, b in s.arms) or _returns(s.otherwise)):
            return True
        if isinstance(s, (t.ForRange, t.ForEach)) and _returns(s.body):
            return True
    return False


def truth_of(x: bool | Truth) -> Truth:
    """A bool as a proposition."""
    if isinstance(x, Truth):
        return x
    if not isinstance(x, bool):
        raise NotRecheckedError(f"such a bool {NOT_HERE}")
    return TRUE if x else negation(TRUE)


def _plain(x: Truth) -> bool | Truth:
    """A bool where it is decided."""
    return x.value if x.kind == "constant" else x


def _identical(a: Value, b: Value) -> bool:
    return bool(a == b) and repr(a) == repr(b)


def _replaced(whole: Value, keys: Sequence[int], new: Value) -> Value:
    if not keys:
        return new
    at, rest = keys[0], keys[1:]
    if not 0 <= at < len(whole):
        raise NotRecheckedError("an index outside its array")
    return (*whole[:at], _replaced(whole[at], rest, new), *whole[at + 1 :])


def _mapped(f: Callable[[Value], Value], x: Value) -> Value:
    return tuple(_mapped(f, v) for v in x) if isinstance(x, tuple) else f(x)


def _zipped(f: Callable[[Value, Value], Value], a: Value, b: Value) -> Value:
    if isinstance(a, tuple):
        return tuple(_zipped(f, x, y) for x, y in zip(a, b, strict=True))
    return f(a, b)


def _flat(x: Value) -> list[Value]:
    return [leaf for v in x for leaf in _flat(v)] if isinstance(x, tuple) else [x]


def flat(x: Value) -> list[Value]:
    """The scalar leaves of a value without lists, in declared order."""
    return _flat(x)


def filled(of: Type, values: Sequence[Value]) -> Value:
    """The value of a type without lists that has these scalar leaves."""
    left = list(values)

    def build(template: Value) -> Value:
        if isinstance(template, tuple):
            return tuple(build(x) for x in template)
        return left.pop(0)

    found = build(default_value(of))
    if left:
        raise NotRecheckedError(f"a list on a topic or in a state {NOT_HERE}")
    return found


def whole(x: Linear) -> Linear:
    """A term that is a whole number."""
    return _Whole(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)


def variables_in(expr: t.Expr) -> set[t.Variable]:
    """The variables that an expression reads: a `let` is only read where they are known."""
    return {n.variable for n in nodes([expr]) if isinstance(n, t.VarRead)}
