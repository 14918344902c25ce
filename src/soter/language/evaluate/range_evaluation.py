"""Evaluates code when all that it reads is known by ranges only.

Purpose: `RangeEvaluator` has a method for each kind of expression and statement of `typed.py`; it
computes sound bounds of the value as a `Range`, and whether the evaluation may fault. A value that
it cannot follow, as one in a list, may be anything of its type.
Non-goals: ranges (`ranges.py`), verdicts (`explore/vacuous_tests.py`, `explore/constant_truth.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate import ranges
from soter.language.evaluate.ranges import ANY_FLOAT, ANY_INT, EITHER, FALSE, TRUE, Faults, Range
from soter.language.model import typed as t
from soter.language.model.tree_walk import are_same_expression
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from soter.language.model.system import Scope
    from soter.language.model.types import Type, Value

    Key = tuple[str, int, tuple[int, ...]]
    """Where a scalar is read: the kind of thing, its number, and the path in it."""
    Known = Any
    """A `Range`, a tuple of such, a `ReadPlace`, or UNKNOWN."""

BUDGET = 20_000
ELEMENTS = 1_024
"""Arrays with more elements than this are unknown."""
ROUNDS = 256
UNKNOWN = object()
COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}


class TooHardError(Exception):
    """An error for code that takes too many operations to evaluate, or cannot be followed."""


@dataclass(frozen=True)
class ReadPlace:
    """A place that code reads, such as a topic, an age or a part; it is read when needed."""

    kind: str
    index: int
    type: Type
    path: tuple[int, ...] = ()


def all_values(of: Type) -> Known:
    """Gives the range of all values of a type, as far as ranges can express them."""
    if isinstance(of, BoolType):
        return EITHER
    if isinstance(of, IntType):
        return Range(of.low, of.high)
    if isinstance(of, EnumType):
        return Range(0, len(of.members) - 1)
    if isinstance(of, FloatType):
        return ANY_FLOAT
    if isinstance(of, DurationType):
        return ANY_INT
    if isinstance(of, RecordType) and of.scalars <= ELEMENTS:
        return tuple([all_values(f) for _, f in of.fields])
    if isinstance(of, ArrayType) and of.size <= ELEMENTS:
        return (all_values(of.element),) * of.size
    return UNKNOWN


def constant_range(of: Type, value: Value) -> Known:
    """Gives the ranges of a constant, each with a single number."""
    if isinstance(of, (RecordType, ArrayType)):
        parts = [f for _, f in of.fields] if isinstance(of, RecordType) else [of.element] * of.size
        return tuple([constant_range(p, v) for p, v in zip(parts, value, strict=True)])
    if isinstance(value, tuple):
        return UNKNOWN
    if isinstance(value, float) and math.isnan(value):
        return ANY_FLOAT
    return Range(int(value), int(value)) if isinstance(value, (bool, int)) else Range(value, value)


class RangeEvaluator:
    """Evaluates code of one scope over ranges; `read` gives the range of a scalar place."""

    def __init__(self, scope: Scope, period_ns: int, read: Callable[[ReadPlace], Range]) -> None:
        self.scope = scope
        self._period_ns = period_ns
        self._read = read
        self.left = BUDGET
        self.variables: dict[t.Variable, Known] = {}
        self.faults = Faults()
        self._literals: dict[t.Literal, Known] = {}

    def evaluate(self, e: t.TypedExpr) -> Known:
        """Gives the range of `e`; `faults` notes whether it may fault. Raises `TooHardError`."""
        self.left -= 1
        if self.left < 0:
            raise TooHardError
        made = self.EXPRESSIONS.get(type(e))
        return all_values(e.type) if made is None else made(self, e)

    def bounds(self, e: t.TypedExpr) -> Range:
        """Gives the range of a scalar expression; may raise TooHardError."""
        return self._range(self.evaluate(e), e.type)

    def bounds_of_part(self, e: t.TypedExpr, place: ReadPlace) -> Range:
        """Gives the range of the scalar at a place in the value of `e`; may raise TooHardError."""
        known = self.evaluate(e)
        for index in place.path:
            known = known[index] if isinstance(known, tuple) else UNKNOWN
        return self._range(known, place.type)

    def _range(self, known: Known, of: Type) -> Range:
        if isinstance(known, ReadPlace):
            known = self._read(known)
        if not isinstance(known, Range):
            known = all_values(of)
        if not isinstance(known, Range):
            raise TooHardError
        return known

    # ------------------------------------------------------------ reads

    def _range_of_literal(self, e: t.Literal) -> Known:
        known = self._literals.get(e)
        if known is None:
            known = self._literals[e] = constant_range(e.type, e.value)
        return known

    def _range_of_param_read(self, e: t.ParamRead) -> Known:
        return constant_range(e.type, self.scope.params[e.param])

    def _range_of_var_read(self, e: t.VarRead) -> Known:
        known = self.variables.get(e.variable)
        return all_values(e.type) if known is None else known

    def _range_of_topic_read(self, e: t.TopicRead) -> Known:
        return ReadPlace("topic", self.scope.topics[e.topic], e.type)

    def _range_of_truth_read(self, e: t.TruthRead) -> Known:
        return ReadPlace("truth", self.scope.plants[e.instance], e.type)

    def _range_of_mode_read(self, e: t.ModeRead) -> Known:
        return ReadPlace("mode", self.scope.modules[e.module], e.type)

    def _range_of_margin_read(self, e: t.MarginRead) -> Known:
        return ReadPlace("margin", self.scope.modules[e.module], e.type)

    def _range_of_time_read(self, e: t.TimeRead) -> Known:
        return ReadPlace("time", 0, e.type)

    def _range_of_age_read(self, e: t.AgeRead) -> Known:
        return ReadPlace("age", self.scope.topics[e.topic], e.type)

    def _range_of_period_read(self, _: t.PeriodRead) -> Known:
        return Range(self._period_ns / 1e9, self._period_ns / 1e9)

    # ------------------------------------------------------------ operations

    def _range_of_unary(self, e: t.TypedUnary) -> Known:
        if e.op == "!":
            return ranges.negated_truth(self.bounds(e.operand))
        if isinstance(e.type, FloatType):
            a = self.bounds(e.operand)
            return Range(-a.high, -a.low, a.nan)
        if isinstance(e.type, (IntType, DurationType)):
            a = self.bounds(e.operand)
            return ranges.int_range(-int(a.high), -int(a.low), self.faults)
        return self._map(self.evaluate(e.operand), e.type, lambda a: Range(-a.high, -a.low, a.nan))

    def _range_of_binary(self, e: t.TypedBinary) -> Known:
        if e.op in {"&&", "||"}:
            return self._range_of_logical(e)
        a, b = self.bounds(e.left), self.bounds(e.right)
        if e.op in COMPARISONS:
            return ranges.comparison_range(e.op, a, b, same=are_same_expression(e.left, e.right))
        if e.op == "-" and are_same_expression(e.left, e.right):
            return ranges.zero_difference(a)
        if not isinstance(e.type, FloatType):
            return ranges.int_operation(e.op, a, b, self.faults)
        if e.op == "/":
            return ranges.float_divide(a, b, self.faults)
        if e.op == "*":
            return ranges.float_multiply(a, b, same=are_same_expression(e.left, e.right))
        return (ranges.float_add if e.op == "+" else ranges.float_subtract)(a, b)

    def _range_of_logical(self, e: t.TypedBinary) -> Known:
        """Gives the range of `&&` or `||`; skips the right side if the left side decides."""
        decides = FALSE if e.op == "&&" else TRUE
        a = self.bounds(e.left)
        if a == decides:
            return decides
        b = self.bounds(e.right)
        return b if a.single else decides if b == decides else EITHER

    def _range_of_vector(self, e: t.Vector) -> Known:
        left, right = self.evaluate(e.left), self.evaluate(e.right)
        if e.op in {"+", "-"}:
            of = ranges.float_add if e.op == "+" else ranges.float_subtract
            pairs = zip(self._leaves(left, e.type), self._leaves(right, e.type), strict=True)
            return self._value_of_leaves(e.type, iter([of(a, b) for a, b in pairs]))
        if isinstance(e.left.type, FloatType):
            x = self._range(left, e.left.type)
            return self._map(right, e.type, lambda a: ranges.float_multiply(x, a))
        x = self._range(right, e.right.type)
        if e.op == "/":
            return self._map(left, e.type, lambda a: ranges.float_divide(a, x, self.faults))
        return self._map(left, e.type, lambda a: ranges.float_multiply(a, x))

    def _range_of_conditional(self, e: t.Conditional) -> Known:
        c = self.bounds(e.condition)
        if c.single:
            return self.evaluate(e.then if c == TRUE else e.otherwise)
        return self._hull(self.evaluate(e.then), self.evaluate(e.otherwise), e.type)

    def _range_of_narrow(self, e: t.Narrow) -> Known:
        assert isinstance(e.type, IntType)
        return ranges.range_in_type(self.bounds(e.operand), e.type.low, e.type.high, self.faults)

    def _range_of_builtin(self, e: t.Builtin) -> Known:
        name, of = e.name, e.arguments[0].type
        if name in {"dot", "norm", "saturate"}:
            return self._range_of_vector_builtin(e)
        a = self.bounds(e.arguments[0])
        if name in {"min", "max"}:
            b = self.bounds(e.arguments[1])
            return ranges.minimum(a, b) if name == "min" else ranges.maximum(a, b)
        if name == "abs":
            magnitude = ranges.absolute_range(a)
            if isinstance(of, FloatType):
                return magnitude
            return ranges.int_range(int(magnitude.low), int(magnitude.high), self.faults)
        if name == "sqrt":
            return ranges.square_root(a)
        if name == "floor":
            ends = [x if math.isinf(x) else float(math.floor(x)) for x in (a.low, a.high)]
            return Range(ends[0], ends[1], a.nan)
        if name == "int":
            return ranges.int_of_float(a, self.faults)
        scale = 1e9 if name == "seconds" else 1.0
        return Range(float(a.low) / scale, float(a.high) / scale)

    def _range_of_vector_builtin(self, e: t.Builtin) -> Known:
        first = self.evaluate(e.arguments[0])
        if e.name == "saturate":
            limit = self.bounds(e.arguments[1])
            below = Range(-limit.high, -limit.low, limit.nan)
            of = e.arguments[0].type
            return self._map(first, of, lambda a: ranges.minimum(ranges.maximum(a, below), limit))
        norm = e.name == "norm"
        second = first if norm else self.evaluate(e.arguments[1])
        total: Range | None = None
        xs, ys = (self._leaves(v, e.arguments[0].type) for v in (first, second))
        for a, b in zip(xs, ys, strict=True):
            product = ranges.float_multiply(a, b, same=norm)
            total = product if total is None else ranges.float_add(total, product)
        if total is None:
            raise TooHardError
        return ranges.square_root(total) if norm else total

    def _range_of_call(self, e: t.TypedCall) -> Known:
        if e.fun.body is None:
            self.faults.possible = True
            return all_values(e.type)
        values = [self.evaluate(a) for a in e.arguments]
        outside, left, faulted = self.variables, self.left, self.faults.possible
        self.variables = dict(zip(e.fun.parameters, values, strict=True))
        try:
            returned, _ = self._run_body(e.fun.body, None, e.type)
        except (RecursionError, TooHardError):
            if not e.fun.prelude:
                raise TooHardError from None
            returned, self.left = None, left
        finally:
            self.variables = outside
        known = all_values(e.type) if returned is None else returned
        if e.fun.prelude:  # none of these faults
            self.faults.possible = faulted
        if not (e.fun.prelude and e.fun.name in ranges.TOTAL):
            return known
        numbers = [self._range(g, a.type) for g, a in zip(values, e.arguments, strict=True)]
        return self._range(known, e.type).overlap(ranges.range_of_prelude(e.fun.name, numbers))

    # ------------------------------------------------------------ structure

    def _range_of_field(self, e: t.TypedField) -> Known:
        return self._part_of(self.evaluate(e.target), e.index, e.type)

    def _range_of_index(self, e: t.Index) -> Known:
        target, at = self.evaluate(e.target), self.bounds(e.index)
        of = e.target.type
        if not isinstance(of, ArrayType) or of.size > ELEMENTS or target is UNKNOWN:
            self.faults.possible = True
            return all_values(e.type)
        self.faults.note_fault_unless(at.low >= 0 and at.high < of.size)
        union: Known = None
        for i in range(max(int(at.low), 0), min(int(at.high), of.size - 1) + 1):
            self.left -= 1
            part = self._part_of(target, i, e.type)
            union = part if union is None else self._hull(union, part, e.type)
        return all_values(e.type) if union is None else union

    def _range_of_length(self, e: t.TypedLength) -> Known:
        of = e.target.type
        size = of.size if isinstance(of, ArrayType) else 0
        return Range(size, size) if size else Range(0, getattr(of, "capacity", 0))

    def _range_of_aggregate(self, e: t.Aggregate) -> Known:
        values = [self.evaluate(x) for x in e.elements]
        if not isinstance(e.type, (RecordType, ArrayType)):
            return UNKNOWN
        if e.order is None:
            return tuple(values)
        position = {field: written for written, field in enumerate(e.order)}
        return tuple([values[position[i]] for i in range(len(values))])

    def _range_of_choose(self, e: t.TypedChoose) -> Known:
        if not e.options:
            return Range(e.low, e.low + e.count - 1)
        return self._hull_of_all(map(self.evaluate, e.options), e.type)

    def _hull_of_all(self, parts: Iterable[Known], of: Type) -> Known:
        """Gives a range that covers all `parts`, of which there is at least one."""
        return reduce(lambda union, part: self._hull(union, part, of), parts)

    def _part_of(self, whole: Known, index: int, of: Type) -> Known:
        if isinstance(whole, ReadPlace):
            return ReadPlace(whole.kind, whole.index, of, (*whole.path, index))
        return whole[index] if isinstance(whole, tuple) else all_values(of)

    def _split(self, whole: Known, of: Type) -> list[tuple[Known, Type]]:
        """Gives the parts of a record or an array, with their types."""
        if isinstance(of, RecordType):
            types = [f for _, f in of.fields]
        elif isinstance(of, ArrayType) and of.size <= ELEMENTS:
            types = [of.element] * of.size
        else:
            raise TooHardError
        self.left -= len(types)
        return [(self._part_of(whole, i, part), part) for i, part in enumerate(types)]

    def _leaves(self, whole: Known, of: Type) -> list[Range]:
        if isinstance(of, (RecordType, ArrayType)):
            return [x for part, at in self._split(whole, of) for x in self._leaves(part, at)]
        return [self._range(whole, of)]

    def _value_of_leaves(self, of: Type, flat: Any) -> Known:  # noqa: ANN401 - an iterator of ranges
        if isinstance(of, (RecordType, ArrayType)):
            return tuple([self._value_of_leaves(at, flat) for _, at in self._split(UNKNOWN, of)])
        return next(flat)

    def _map(self, whole: Known, of: Type, do: Callable[[Range], Range]) -> Known:
        return self._value_of_leaves(of, iter([do(a) for a in self._leaves(whole, of)]))

    def _hull(self, a: Known, b: Known, of: Type) -> Known:
        """Gives a range that covers both `a` and `b`, which have the same type."""
        if a is b or a == b:
            return a
        if isinstance(of, (RecordType, ArrayType)):
            if a is UNKNOWN or b is UNKNOWN:
                return all_values(of)
            return tuple(
                [
                    self._hull(x, y, at)
                    for (x, at), (y, _) in zip(self._split(a, of), self._split(b, of), strict=True)
                ]
            )
        if a is UNKNOWN or b is UNKNOWN:
            return all_values(of)
        return self._range(a, of).union(self._range(b, of))

    # ------------------------------------------------------------ statements

    def _run_body(
        self, body: tuple[t.TypedStmt, ...], returned: Known, of: Type
    ) -> tuple[Known, bool]:
        """Gives the range of returned values, including `returned`, and if the end is reachable."""
        for s in body:
            self.left -= 1
            if self.left < 0:
                raise TooHardError
            if isinstance(s, t.TypedReturn):
                value = self.evaluate(s.value)
                return value if returned is None else self._hull(returned, value, of), False
            if isinstance(s, t.TypedIf):
                returned, falls = self._run_if(s, returned, of)
            elif isinstance(s, (t.ForRange, t.ForEach)):
                returned, falls = self._run_loop(s, returned, of)
            else:
                falls = self._run_plain(s)
            if not falls:
                return returned, False
        return returned, True

    def _run_plain(self, s: t.TypedStmt) -> bool:
        """Runs a statement that contains no other; returns whether the next one is reachable."""
        if isinstance(s, t.TypedDeclare):
            self.variables[s.variable] = self.evaluate(s.value)
        elif isinstance(s, t.TypedAssign):
            for i in s.place.path:
                if not isinstance(i, int):
                    self.faults.possible = True
            value = self.evaluate(s.value)
            variable = s.place.variable
            self.variables[variable] = all_values(variable.type) if s.place.path else value
        elif isinstance(s, t.TypedPush):
            self.faults.possible = True
            self.variables[s.place.variable] = all_values(s.place.variable.type)
        elif isinstance(s, t.Assert):
            held = self.bounds(s.condition)
            self.faults.note_fault_unless(held == TRUE)
            return held != FALSE
        else:
            raise TooHardError
        return True

    def _run_if(self, s: t.TypedIf, returned: Known, of: Type) -> tuple[Known, bool]:
        before, ends = self.variables, []
        open_ = True
        for condition, body in s.arms:
            held = self.bounds(condition)
            if held != FALSE:
                self.variables = dict(before)
                returned, falls = self._run_body(body, returned, of)
                ends += [self.variables] if falls else []
                self.variables = before
            if held == TRUE:
                open_ = False
                break
        if open_:
            self.variables = dict(before)
            returned, falls = self._run_body(s.otherwise, returned, of)
            ends += [self.variables] if falls else []
        self.variables = self._merged_variables(ends, before)
        return returned, bool(ends)

    def _merged_variables(
        self, ends: list[dict[t.Variable, Known]], before: Mapping[t.Variable, Known]
    ) -> dict[t.Variable, Known]:
        if not ends:
            return dict(before)
        merged = dict(ends[0])
        for other in ends[1:]:
            shared = [v for v in merged if v in other]
            merged = {v: self._hull(merged[v], other[v], v.type) for v in shared}
        return merged

    def _run_loop(self, s: t.ForRange | t.ForEach, returned: Known, of: Type) -> tuple[Known, bool]:
        if isinstance(s, t.ForRange):
            rounds: list[Known] = [Range(i, i) for i in range(s.low, s.high)[: ROUNDS + 1]]
        else:
            sequence = self.evaluate(s.sequence)
            rounds = [part for part, _ in self._split(sequence, s.sequence.type)]
        if len(rounds) > ROUNDS:
            raise TooHardError
        for value in rounds:
            self.variables[s.variable] = value
            returned, falls = self._run_body(s.body, returned, of)
            if not falls:
                return returned, False
        return returned, True

    EXPRESSIONS: ClassVar[dict[type[t.TypedExpr], Callable[[RangeEvaluator, Any], Known]]] = {
        t.Literal: _range_of_literal,
        t.ParamRead: _range_of_param_read,
        t.VarRead: _range_of_var_read,
        t.TopicRead: _range_of_topic_read,
        t.TruthRead: _range_of_truth_read,
        t.ModeRead: _range_of_mode_read,
        t.MarginRead: _range_of_margin_read,
        t.TimeRead: _range_of_time_read,
        t.PeriodRead: _range_of_period_read,
        t.AgeRead: _range_of_age_read,
        t.TypedUnary: _range_of_unary,
        t.TypedBinary: _range_of_binary,
        t.Vector: _range_of_vector,
        t.Conditional: _range_of_conditional,
        t.TypedCall: _range_of_call,
        t.Builtin: _range_of_builtin,
        t.TypedField: _range_of_field,
        t.Index: _range_of_index,
        t.TypedLength: _range_of_length,
        t.Aggregate: _range_of_aggregate,
        t.TypedChoose: _range_of_choose,
        t.Narrow: _range_of_narrow,
    }
