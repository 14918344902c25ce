"""The re-checker's reading of the checked tree: steps and predicates become values.

Purpose: evaluate typed expressions and statements once, with numbers where numbers are known and
terms where inputs are involved. Loops are unrolled, functions inlined, both sides of a branch that
depends on inputs are read and joined. Two kinds of terms there are: real ones (`SymbolicReader`,
here) and those of a solver (`certificate/induction/solver_steps.py`); what the language is made
of is read by one `CodeReader`.
Non-goals: operations on values (`symbolic_operations.py`); sharing code with the interpreter, with
the lowering, or with what verifies: this is written from docs/language.md and docs/semantics.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, cast

from soter.certificate.extras import extras
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.reading.symbolic_values import (
    NOT_HERE,
    Rows,
    SymbolicInt,
    Value,
    index_in_range,
    is_known,
    map_leaves,
    scalar_leaves,
    zip_leaves,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.terms import Linear, Proposition, Terms
from soter.language.evaluate import arithmetic
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BOOL, ArrayType, BoolType, DurationType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.language.model.types import Type

    Ranges = Mapping[t.Variable, Sequence[tuple[float, float] | None]]
    """Variable -> the range in which each of its leaves stays; None: nothing is claimed of it."""

STEPS_MAX = 200_000


@dataclass(eq=False)
class CallFrame:
    """The variables of a call, and the condition and value of each topic that it published."""

    variables: dict[t.Variable, Value]
    published: dict[t.TopicSymbol, tuple[Value, Value]] = field(default_factory=dict)
    result: Type = BOOL
    """The result type of the function that is read."""

    def copy(self) -> CallFrame:
        """A copy of the frame for the other side of a branch."""
        return CallFrame(dict(self.variables), dict(self.published), self.result)


class CodeReader:
    """Reads code into values; `operations` gives the operators (`symbolic_operations.py`)."""

    def __init__(self, operations: Any, params: Mapping[t.ParamSymbol, Value]) -> None:  # noqa: ANN401 - of either kind
        self.operations, self.params = operations, params
        self._steps = 0

    def run_under(self, path: Value, run: Callable[[], Value]) -> tuple[bool, Value]:
        """(True, the result of `run` under the condition `path`), or (False, None) if it faults.

        A fault adds the obligation that `path` is false.
        """
        outside, self.operations.path = self.operations.path, path
        try:
            return True, run()
        except arithmetic.StepFault:
            self.operations.add_obligation(truth=False)
            return False, None
        finally:
            self.operations.path = outside

    def _read_both_sides(
        self, c: Value, then: Callable[[], Value], otherwise: Callable[[], Value]
    ) -> tuple[tuple[bool, Value], tuple[bool, Value]]:
        """The `run_under` results of both sides of an undecided branch; StepFault if both fault.

        A variable that only one side has is read by nobody afterwards: the language refuses that.
        """
        path, make = self.operations.path, self.operations
        first = self.run_under(make.and_of(path, c), then)
        second = self.run_under(make.and_of(path, make.negation(c)), otherwise)
        if not (first[0] or second[0]):
            raise arithmetic.StepFault(arithmetic.FaultKind.ASSERT)
        return first, second

    def _count_step(self) -> None:
        self._steps += 1
        if self._steps > STEPS_MAX:
            raise NotRecheckedError("the step is too long to be read as one formula")

    # ------------------------------------------------------------ statements

    def run_block(self, body: Sequence[t.TypedStmt], frame: CallFrame) -> Value | None:
        """Runs statements; gives the value of a `return` among them, or None."""
        todo = list(body)
        while todo:
            self._count_step()
            statement = todo.pop(0)
            if isinstance(statement, t.TypedReturn):
                return self.value_of(statement.value, frame)
            if isinstance(statement, t.TypedIf):
                (condition, then), *more = statement.arms
                otherwise = statement.otherwise
                if more:
                    otherwise = (t.TypedIf(statement.span, tuple(more), otherwise),)
                c = self.value_of(condition, frame)
                if isinstance(c, bool):
                    todo[:0] = then if c else otherwise
                elif any(isinstance(n, t.TypedReturn) for n in nodes([statement])):
                    return self.run_branch(c, (*then, *todo), (*otherwise, *todo), frame)
                else:
                    self.run_branch(c, then, otherwise, frame)
            elif isinstance(statement, (t.ForRange, t.ForEach)):
                todo[:0] = self._unrolled_loop(statement, frame)
            else:
                self._run_simple(statement, frame)
        return None

    def run_branch(
        self,
        c: Value,
        then: Sequence[t.TypedStmt],
        otherwise: Sequence[t.TypedStmt],
        frame: CallFrame,
    ) -> Value | None:
        """Runs both sides of a branch, and joins their variables, publications and results."""
        other = frame.copy()
        (fine, first), (well, second) = self._read_both_sides(
            c, lambda: self.run_block(then, frame), lambda: self.run_block(otherwise, other)
        )
        if not fine:  # an obligation says that the other side is taken
            frame.variables, frame.published = other.variables, other.published
        if not (fine and well):
            return first if fine else second
        join, its = self.operations.choice_of, other.variables
        if first is None or second is None:
            frame.variables = {
                v: join(v.type, c, x, its[v]) for v, x in frame.variables.items() if v in its
            }
        for topic in dict.fromkeys([*frame.published, *other.published]):
            says, x = frame.published.get(topic, (False, None))
            tells, y = other.published.get(topic, (False, x))
            joint = y if x is None else join(topic.type, c, x, y)
            frame.published[topic] = join(BOOL, c, says, tells), joint
        if first is None or second is None:
            return None
        return join(frame.result, c, first, second)

    def _unrolled_loop(self, loop: t.ForRange | t.ForEach, frame: CallFrame) -> list[t.TypedStmt]:
        items: Any = (
            range(loop.low, loop.high)
            if isinstance(loop, t.ForRange)
            else self.value_of(loop.sequence, frame)
        )
        if not isinstance(items, (range, tuple)):
            raise NotRecheckedError(f"such a `for` {NOT_HERE}")
        unrolled: list[t.TypedStmt] = []
        for item in items:
            value = t.Literal(loop.variable.type, loop.span, item)
            unrolled += [t.TypedDeclare(loop.span, loop.variable, value), *loop.body]
        return unrolled

    def _run_simple(self, statement: t.TypedStmt, frame: CallFrame) -> None:
        if isinstance(statement, t.TypedDeclare):
            frame.variables[statement.variable] = self.value_of(statement.value, frame)
        elif isinstance(statement, t.TypedAssign):
            place = statement.place
            keys = [k if isinstance(k, int) else self.value_of(k, frame) for k in place.path]
            new, old = self.value_of(statement.value, frame), frame.variables[place.variable]
            frame.variables[place.variable] = self.replace_part(place.variable.type, old, keys, new)
        elif isinstance(statement, t.TypedPublish):
            frame.published[statement.topic] = True, self.value_of(statement.value, frame)
        elif isinstance(statement, t.Assert):
            self.operations.add_obligation(self.value_of(statement.condition, frame))
        else:
            raise NotRecheckedError(
                f"`{type(statement).__name__.removeprefix('Typed').lower()}` {NOT_HERE}"
            )

    def replace_part(self, of: Type, whole: Value, keys: Sequence[Value], new: Value) -> Value:
        """The value, of type `of`, with the part at these indices replaced by `new`.

        Raises NotRecheckedError for an index that depends on inputs.
        """
        if not keys:
            return new
        at, rest = keys[0], keys[1:]
        if not isinstance(at, int):
            raise NotRecheckedError(f"an assignment at an index that depends on inputs {NOT_HERE}")
        old = whole[index_in_range(at, len(whole))]
        part = self.replace_part(part_type(of, at), old, rest, new)
        return (*whole[:at], part, *whole[at + 1 :])

    # ------------------------------------------------------------ expressions

    def evaluate(
        self, expr: t.TypedExpr, variables: Mapping[t.Variable, Value] | None = None
    ) -> Value:
        """The value of an expression in which these variables are known."""
        return self.value_of(expr, CallFrame(dict(variables or {})))

    def value_of(self, e: t.TypedExpr, frame: CallFrame) -> Value:
        """An expression's value in a call; raises NotRecheckedError for unknown constructs."""
        self._count_step()
        reading = self.readings.get(type(e))
        if reading is None:
            raise NotRecheckedError(f"`{type(e).__name__.removeprefix('Typed')}` {NOT_HERE}")
        return reading(self, e, frame)

    def _variable_value(self, e: t.VarRead, frame: CallFrame) -> Value:
        if e.variable not in frame.variables:
            raise NotRecheckedError(f"`{e.variable.name}` {NOT_HERE} where it is read")
        return frame.variables[e.variable]

    def _unary_value(self, e: t.TypedUnary, frame: CallFrame) -> Value:
        x = self.value_of(e.operand, frame)
        return self.operations.negation(x) if e.op == "!" else map_leaves(self.operations.negate, x)

    def _binary_value(self, e: t.TypedBinary, frame: CallFrame) -> Value:
        a = self.operand(e.left, frame)
        if e.op in ("&&", "||"):
            return self._short_circuit(e, a, frame)
        b = self.operand(e.right, frame)
        if e.op in ("<", "<=", ">", ">=", "==", "!="):
            return self.operations.compare(e.op, a, b)
        return self.operations.arithmetic(e.op, a, b)

    def operand(self, e: t.TypedExpr, frame: CallFrame) -> Value:
        """The value of an operand; subclasses may read operands differently."""
        return self.value_of(e, frame)

    def _short_circuit(self, e: t.TypedBinary, a: Value, frame: CallFrame) -> Value:
        going_on, make = e.op == "&&", self.operations
        if isinstance(a, bool):
            return self.value_of(e.right, frame) if a == going_on else a
        path = make.and_of(make.path, a if going_on else make.negation(a))
        fine, b = self.run_under(path, lambda: self.value_of(e.right, frame))
        if not fine:
            return not going_on
        return make.and_of(a, b) if going_on else make.or_of(a, b)

    def _vector_value(self, e: t.Vector, frame: CallFrame) -> Value:
        a, b = self.value_of(e.left, frame), self.value_of(e.right, frame)
        of = partial(self.operations.arithmetic, e.op)
        if isinstance(a, tuple) and isinstance(b, tuple):
            return zip_leaves(of, a, b)
        return (
            map_leaves(lambda x: of(x, b), a)
            if isinstance(a, tuple)
            else map_leaves(partial(of, a), b)
        )

    def _conditional_value(self, e: t.Conditional, frame: CallFrame) -> Value:
        c = self.value_of(e.condition, frame)
        if isinstance(c, bool):
            return self.value_of(e.then if c else e.otherwise, frame)
        (fine, a), (well, b) = self._read_both_sides(
            c, lambda: self.value_of(e.then, frame), lambda: self.value_of(e.otherwise, frame)
        )
        return self.operations.choice_of(e.type, c, a, b) if fine and well else (a if fine else b)

    def result_of_call(self, fun: t.FunSymbol, arguments: Sequence[Value]) -> Value:
        """Reads a function's body, and returns the result. Raises NotRecheckedError if extern."""
        if fun.body is None:
            raise NotRecheckedError(f"`{fun.name}` is an extern function: its values are unknown")
        inner = CallFrame(dict(zip(fun.parameters, arguments, strict=True)), result=fun.result)
        value = self.run_block(fun.body, inner)
        if value is None:
            raise NotRecheckedError(f"`{fun.name}` {NOT_HERE}")
        return value

    def _builtin_value(self, e: t.Builtin, frame: CallFrame) -> Value:
        x, *others = [self.operand(a, frame) for a in e.arguments]
        make = self.operations
        if e.name in ("dot", "norm"):
            pairs = zip(scalar_leaves(x), scalar_leaves(*others or (x,)), strict=True)
            total, *products = (make.arithmetic("*", a, b) for a, b in pairs)
            for product in products:
                total = make.arithmetic("+", total, product)
            return make.result_of_builtin("sqrt", total) if e.name == "norm" else total
        if e.name == "saturate":
            negative = make.negate(others[0])
            return map_leaves(
                lambda v: make.min_or_max("min", make.min_or_max("max", v, negative), others[0]), x
            )
        if e.name in ("min", "max"):
            return make.min_or_max(e.name, x, others[0])
        return make.result_of_builtin(e.name, x)

    def _length_value(self, e: t.TypedLength, frame: CallFrame) -> Value:
        of = e.target.type
        return of.size if isinstance(of, ArrayType) else len(self.value_of(e.target, frame))

    def _aggregate_value(self, e: t.Aggregate, frame: CallFrame) -> Value:
        values = [self.value_of(x, frame) for x in e.elements]
        for where, value in zip(e.order or (), tuple(values), strict=False):
            values[where] = value
        return tuple(values)

    def _narrowed_value(self, e: t.Narrow, frame: CallFrame) -> Value:
        of = cast("IntType", e.type)
        return self.operations.demand_between(self.value_of(e.operand, frame), of.low, of.high)

    readings: ClassVar[dict[type[t.TypedExpr], Callable[[Any, Any, CallFrame], Value]]] = {
        t.Literal: lambda _, e, __: e.value,
        t.ParamRead: lambda self, e, _: self.params[e.param],
        t.VarRead: _variable_value,
        t.TypedUnary: _unary_value,
        t.TypedBinary: _binary_value,
        t.Vector: _vector_value,
        t.Conditional: _conditional_value,
        t.TypedCall: lambda self, e, frame: self.result_of_call(
            e.fun, [self.value_of(a, frame) for a in e.arguments]
        ),
        t.Builtin: _builtin_value,
        t.TypedField: lambda self, e, frame: self.value_of(e.target, frame)[e.index],
        t.TypedLength: _length_value,
        t.Aggregate: _aggregate_value,
        t.Narrow: _narrowed_value,
    }


# ---------------------------------------------------------------- real numbers


@dataclass(eq=False)
class Surroundings:
    """The values of parameters and topics for code, and the period of its step in seconds."""

    params: Mapping[t.ParamSymbol, Value]
    topics: Mapping[t.TopicSymbol, Value]
    period: float | None = None
    modes: Mapping[t.ModuleSymbol | str, Value] = field(default_factory=dict)
    """Other module -> its mode, where it may be read."""


class SymbolicReader(CodeReader):
    """Reads code into terms; `rounded`: as the machine computes, else as real numbers."""

    def __init__(self, terms: Terms, around: Surroundings, *, rounded: bool = True) -> None:
        super().__init__(Operations(terms, rounded=rounded), around.params)
        self.surroundings = around

    def evaluate(
        self, expr: t.TypedExpr, variables: Mapping[t.Variable, Value] | None = None
    ) -> Value:
        """The value of an expression, with the obligation that its numbers are finite."""
        value = super().evaluate(expr, variables)
        self.operations.demand_finite(*scalar_leaves(value))
        return value

    def published_by_step(
        self,
        body: Sequence[t.TypedStmt],
        variables: Mapping[t.Variable, Value],
        claimed: Ranges = MappingProxyType({}),
    ) -> dict[t.TopicSymbol, Value]:
        """Maps each topic to the value a step publishes; NotRecheckedError if it always faults.

        `claimed`: the ranges in which the step must leave variables, as obligations.
        """
        frame = CallFrame(dict(variables))

        def run_body() -> None:
            self.run_block(body, frame)
            for v, ranges in claimed.items():
                for x, ends in zip(scalar_leaves(frame.variables[v]), ranges, strict=True):
                    if ends is not None:
                        self.operations.demand_finite(self.operations.demand_between(x, *ends))

        if not self.run_under(self.operations.path, run_body)[0]:
            raise NotRecheckedError("SC faults wherever it steps")
        if any(says is not True for says, _ in frame.published.values()):
            raise NotRecheckedError(f"a step that publishes on one side only {NOT_HERE}")
        published = {topic: value for topic, (_, value) in frame.published.items()}
        self.operations.demand_finite(*scalar_leaves(tuple(published.values())))
        return published

    def value_of(self, e: t.TypedExpr, frame: CallFrame, *, rows: bool = False) -> Value:
        """The value of an expression: an int stays an int, and a bool a bool, by its static type.

        With `rows`, a row of a table may stay unread, as one of its numbers is needed next. Raises
        NotRecheckedError for a bool that is neither known nor a proposition.
        """
        value = super().value_of(e, frame)
        if isinstance(value, Rows) and not rows:
            value = extras.array_elements.row_values(self.operations, value)
        if isinstance(e.type, (IntType, DurationType)) and isinstance(value, Linear):
            return value if isinstance(value, SymbolicInt) else self.operations.as_int(value)
        if isinstance(e.type, BoolType) and not isinstance(value, (bool, Proposition)):
            raise NotRecheckedError(f"such a bool {NOT_HERE}")
        return value

    def result_of_call(self, fun: t.FunSymbol, arguments: Sequence[Value]) -> Value:
        """The result of a call; a prelude function of terms is what it means, with its error bound.

        Of known numbers it gives what the machine makes of them, in a flow, too.
        """
        make = self.operations
        if fun.prelude and any(isinstance(x, Linear) for x in arguments):
            if fun.name == "clamp":
                return make.clamp(*arguments)
            meant = extras.prelude_functions.term_of_prelude_call(make, fun.name, arguments)
            if meant is not None:
                return meant
        if not fun.prelude or make.is_rounded or not all(map(is_known, arguments)):
            return super().result_of_call(fun, arguments)
        make.is_rounded = True
        try:
            return super().result_of_call(fun, arguments)
        finally:
            make.is_rounded = False

    def _field_value(self, e: t.TypedField, frame: CallFrame) -> Value:
        target = self.value_of(e.target, frame, rows=True)
        if isinstance(target, Rows):
            column = [row[e.index] for row in target.elements]
            return extras.array_elements.element_at(self.operations, column, target.index)
        return target[e.index]

    def _element_value(self, e: t.Index, frame: CallFrame) -> Value:
        target, index = (self.value_of(e.target, frame, rows=True), self.value_of(e.index, frame))
        if isinstance(target, Rows):
            return extras.array_elements.element_of_table(self.operations, target, index)
        if isinstance(index, Linear):
            return extras.array_elements.element_at(self.operations, target, index)
        return target[index_in_range(index, len(target))]

    def _topic_value(self, e: t.TopicRead, _: CallFrame) -> Value:
        if e.topic not in self.surroundings.topics:
            raise NotRecheckedError(f"topic `{e.topic.name}` is read, but nobody says its values")
        return self.surroundings.topics[e.topic]

    def _period_value(self, _: t.PeriodRead, __: CallFrame) -> Value:
        if self.surroundings.period is None:
            raise NotRecheckedError(f"`dt` {NOT_HERE} here")
        return self.surroundings.period

    def _mode_value(self, e: t.ModeRead, _: CallFrame) -> Value:
        if e.module not in self.surroundings.modes:
            raise NotRecheckedError(f"`mode` {NOT_HERE}")
        return self.surroundings.modes[e.module]

    readings: ClassVar[dict[type[t.TypedExpr], Callable[[Any, Any, CallFrame], Value]]] = {
        **CodeReader.readings,
        t.TopicRead: _topic_value,
        t.PeriodRead: _period_value,
        t.ModeRead: _mode_value,
        t.InControl: lambda *_: True,
        t.TypedField: _field_value,
        t.Index: _element_value,
    }


def part_type(of: Type, index: int) -> Type:
    """The type of a part of a record, an array or a list."""
    return of.fields[index][1] if isinstance(of, RecordType) else cast("ArrayType", of).element


def variables_read(expr: t.TypedExpr) -> set[t.Variable]:
    """The variables that an expression reads."""
    return {n.variable for n in nodes([expr]) if isinstance(n, t.VarRead)}
