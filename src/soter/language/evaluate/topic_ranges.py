"""Gives ranges of what code reads, from the sets declared for topics; and limits of signals.

Purpose: `reader_of_sets` turns the set and type of a topic into a `Range` for a place that an
expression reads; `reader_with_limits` also limits ages and some leaves; `constant_truth` and
`truth_by_parts` say whether these ranges decide a condition. For reports `signal_limits` reads
`abs(x.y) < WALL`, also inside of functions that only return it, as two levels of `x.y`.
Non-goals: what steps compute, queues and times (`explore/vacuous_tests.py`); limits of several
signals together, so a report without a limit says nothing.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, all_values
from soter.language.evaluate.ranges import Range
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import conjuncts, nodes, returned
from soter.language.model.typed import Literal, ParamRead, TypedCall
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    FloatType,
    IntType,
    RecordType,
    has_list,
    leaf_name,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.model.system import Bound, Scope, System, Topic
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type

BUDGET = 600
"""Most expressions of a condition and its calls that are evaluated: a millisecond or two."""
PARTS_MAX, CUTS_MAX = 64, 12
"""How many parts of the read values are examined, and how many cuts one number gets at most."""
MOST = sys.float_info.max


def reader_with_limits(
    system: System,
    ages_ns: Mapping[int, int | None],
    leaves_within: Mapping[tuple[int, int], tuple[float, float]] | None = None,
) -> Callable[[ReadPlace], Range]:
    """Gives a reader like `reader_of_sets`, with greatest ages (None: no limit) and leaf ranges."""
    otherwise, within = reader_of_sets(system), leaves_within or {}

    def range_at_place(place: ReadPlace) -> Range:
        if place.kind == "age" and place.index in ages_ns:
            most = ages_ns[place.index]
            return Range(0.0, math.inf if most is None else most / 1e9)
        known = otherwise(place)
        if place.kind != "topic":
            return known
        low, high = within.get(
            (place.index, leaf_index(system.topics[place.index], place.path)),
            (known.low, known.high),
        )
        low, high = max(known.low, low), min(known.high, high)
        return Range(low, high) if low <= high else known

    return range_at_place


def reader_of_sets(system: System) -> Callable[[ReadPlace], Range]:
    """Gives a `read` for a `RangeEvaluator` from the declared sets; TooHardError for lists."""

    def range_at_place(place: ReadPlace) -> Range:
        if place.kind == "topic" and not has_list(system.topics[place.index].type):
            return range_in_set(system.topics[place.index], place)
        known = all_values(place.type)
        if not isinstance(known, Range):
            raise TooHardError
        return known

    return range_at_place


def constant_truth(condition: TypedExpr, system: System, scope: Scope) -> bool | None:
    """Gives the value that a condition always has if topics are in their sets; else None."""
    evaluator = RangeEvaluator(scope, 0, reader_of_sets(system))
    evaluator.left = BUDGET
    try:
        truth = evaluator.bounds(condition)
    except TooHardError:
        return None
    return bool(truth.low) if truth.single and not evaluator.faults.possible else None


def truth_by_parts(
    condition: TypedExpr,
    system: System,
    scope: Scope,
    read: Callable[[ReadPlace], Range] | None = None,
) -> bool | None:
    """Gives the same as `constant_truth`, but cuts the read ranges at the condition's numbers.

    So it recognizes pairs of comparisons that exclude each other, or that cover all cases. `read`
    is a function as from `reader_with_limits`; None: the declared sets.
    """
    read, cuts = read or reader_of_sets(system), _constants_in(condition, scope)
    found: bool | None = None
    parts: list[dict[ReadPlace, Range]] = [{}]
    for _ in range(PARTS_MAX):
        part = dict(parts.pop())

        def range_of_this_part(place: ReadPlace, part: dict[ReadPlace, Range] = part) -> Range:
            return part[place] if place in part else part.setdefault(place, read(place))

        evaluator = RangeEvaluator(scope, 0, range_of_this_part)
        evaluator.left = BUDGET
        try:
            truth = evaluator.bounds(condition)
        except TooHardError:
            return None
        if truth.single and not evaluator.faults.possible:
            if found not in {None, bool(truth.low)}:
                return None
            found = bool(truth.low)
        else:
            pieces = next(((k, p) for k, r in part.items() if len(p := _cut_at(r, cuts)) > 1), None)
            if pieces is None:
                return None
            parts += [{**part, pieces[0]: piece} for piece in pieces[1]]
        if not parts:
            return found
    return None


def _constants_in(condition: TypedExpr, scope: Scope) -> list[float]:
    """Gives the constants in a condition and its calls, with both signs, in rising order."""
    todo: list[object] = [condition]
    called, found = set(), set()
    while todo:
        for n in nodes([todo.pop()]):
            if isinstance(n, TypedCall) and n.fun not in called:
                called.add(n.fun)
                todo += n.fun.body or ()
            value = n.value if isinstance(n, Literal) else None
            value = scope.params.get(n.param) if isinstance(n, ParamRead) else value
            if isinstance(value, (int, float)):
                found |= {value, -value}
            if isinstance(value, int) and isinstance(getattr(n, "type", None), DurationType):
                found.add(value / 1e9)  # `seconds(d)` may be compared with an age
    return sorted(found)


def _cut_at(of: Range, cuts: Sequence[float]) -> list[Range]:
    """Gives the pieces of a range: each cut inside it as one number, and the ranges between."""
    whole = isinstance(of.low, int)
    if whole and of.high - of.low < CUTS_MAX:
        cuts = range(int(of.low), int(of.high) + 1)
    inside = [c for c in cuts if of.holds(c) and c == (int(c) if whole else c)]
    if of.single or len(inside) > CUTS_MAX:
        return [of]
    pieces, low = [], of.low
    for cut in inside:
        c = int(cut) if whole else float(cut)
        before, after = (
            (c - 1, c + 1) if whole else (math.nextafter(c, -math.inf), math.nextafter(c, math.inf))
        )
        pieces += [Range(low, before)] if low < c else []
        pieces.append(Range(c, c))
        low = after
    return [*pieces, Range(low, of.high)] if low <= of.high else pieces


def range_in_set(topic: Topic, place: ReadPlace) -> Range:
    """Gives the range of the values that a topic's set allows at a place; all are finite."""
    return _range_inside(place.type, topic.bounds[leaf_index(topic, place.path)])


def leaf_index(topic: Topic, path: tuple[int, ...]) -> int:
    """Gives the index of a leaf in `Topic.bounds`; all elements of a list share one index."""
    at, of = 0, topic.type
    for index in path:
        parts: Sequence[Type]
        if isinstance(of, RecordType):
            parts = [f for _, f in of.fields]
        else:
            assert isinstance(of, ArrayType)
            parts = [of.element] * (index + 1)
        at += sum(len(list(leaves(p))) for p in parts[:index])
        of = parts[index]
    return at


def _range_inside(of: Type, bound: Bound | None) -> Range:
    if isinstance(of, FloatType):
        low, high = (-MOST, MOST) if bound is None else (bound.low, bound.high)
        return Range(float(low), float(high))
    interval = all_values(of)
    assert isinstance(interval, Range), of
    if bound is None or isinstance(of, BoolType) or not isinstance(of, IntType):
        return interval
    low, high = math.ceil(bound.low), math.floor(bound.high)
    return Range(max(int(interval.low), low), min(int(interval.high), high))


BELOW, ABOVE = {"<", "<="}, {">", ">="}


OPENED_MAX = 8
"""How deep calls of functions inside functions are replaced by what these return."""


@dataclass(frozen=True)
class Limit:
    """A limit that a signal (`motion.x`, `c.x`) must not pass; `by` names the clause."""

    signal: str
    value: float
    by: str


@dataclass(frozen=True)
class _ScaledSignal:
    """The line `scale * signal + offset`; with `folded`, `abs(signal)` replaces the signal."""

    signal: str
    scale: float
    offset: float
    folded: bool = False


def signal_limits(system: System) -> list[Limit]:
    """Gives the limits of signals in each module's `safe` and each `always`, without repetition."""
    demanded = [(m.scope, m.symbol.safe, f"safe of {m.name}") for m in system.modules]
    demanded += [(p.scope, p.condition, "always") for p in system.properties if p.kind == "always"]
    readers = (_LimitReader(system, scope).signal_limits(e, by) for scope, e, by in demanded)
    return list(dict.fromkeys(chain.from_iterable(readers)))


class _LimitReader:
    """Finds limits of signals in predicates of one scope."""

    def __init__(self, system: System, scope: Scope) -> None:
        self.system = system
        self.scope = scope
        self.evaluator = Evaluator.for_scope(scope)

    def signal_limits(self, predicate: typed.TypedExpr, by: str) -> Iterator[Limit]:
        """Yields the limits of single signals in the conjuncts of a predicate; `by`: its name."""
        for part in conjuncts(_inlined_call(predicate)):
            opened = _inlined_call(part)
            parts = conjuncts(opened) if opened is not part else [part]
            for each in parts:
                if isinstance(each, typed.TypedBinary) and each.op in BELOW | ABOVE:
                    yield from self._limits_of_comparison(each, by)

    def _limits_of_comparison(self, e: typed.TypedBinary, by: str) -> Iterator[Limit]:
        left, right = self._line_of(e.left), self._line_of(e.right)
        if left is None or right is None or bool(left.signal) == bool(right.signal):
            return
        line, constant = (left, right.offset) if left.signal else (right, left.offset)
        below = (e.op in BELOW) == bool(left.signal)
        if not line.scale:
            return
        value = (constant - line.offset) / line.scale
        if not line.folded:
            yield Limit(line.signal, value, by)
        elif below == (line.scale > 0) and value >= 0:
            yield Limit(line.signal, -value, by)
            yield Limit(line.signal, value, by)

    def _line_of(self, e: typed.TypedExpr) -> _ScaledSignal | None:
        """Gives an expression as a line over at most one signal; None if it is no line."""
        e = _inlined_call(e)
        constant = self._constant_value(e)
        if constant is not None:
            return _ScaledSignal("", 0.0, constant)
        signal = self._signal_name(e)
        if signal is not None:
            return _ScaledSignal(signal, 1.0, 0.0)
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            return _scaled_line(self._line_of(e.operand), -1.0)
        if isinstance(e, typed.Builtin) and e.name == "abs":
            inner = self._line_of(e.arguments[0])
            plain = inner is not None and not inner.folded and inner.offset == 0.0
            return (
                _ScaledSignal(inner.signal, abs(inner.scale), 0.0, True)
                if inner and plain
                else None
            )
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-", "*"}:
            return self._combined_line(e)
        return None

    def _combined_line(self, e: typed.TypedBinary) -> _ScaledSignal | None:
        left, right = self._line_of(e.left), self._line_of(e.right)
        if left is None or right is None or (left.signal and right.signal):
            return None
        if e.op == "*":
            line, factor = (left, right.offset) if left.signal else (right, left.offset)
            return _scaled_line(line, factor)
        right = right if e.op == "+" else _scaled_line(right, -1.0)
        assert right is not None
        line, other = (left, right) if left.signal else (right, left)
        return _ScaledSignal(line.signal, line.scale, line.offset + other.offset, line.folded)

    def _constant_value(self, e: typed.TypedExpr) -> float | None:
        """Gives the value of an expression that reads only parameters; None for any other."""
        fixed = (
            typed.Literal, typed.ParamRead, typed.TypedUnary, typed.TypedBinary, typed.Builtin,
            typed.TypedField, typed.Index, typed.TypedLength, typed.Conditional, typed.Narrow,
        )  # fmt: skip
        number = isinstance(e.type, (FloatType, IntType))
        if not number or not all(isinstance(n, fixed) for n in nodes([e])):
            return None
        try:
            return float(self.evaluator.compiled(e)(Environment()))
        except StepFault:
            return None

    def _signal_name(self, e: typed.TypedExpr) -> str | None:
        """Gives the name of a leaf of a topic or of the truth of a plant, as reports call it."""
        path: list[str] = []
        while isinstance(e, (typed.TypedField, typed.Index)):
            if isinstance(e, typed.TypedField):
                assert isinstance(e.target.type, RecordType)
                path.insert(0, e.target.type.fields[e.index][0])
            elif isinstance(e.index, typed.Literal):
                path.insert(0, f"[{e.index.value}]")
            else:
                return None
            e = e.target
        if isinstance(e, typed.TopicRead):
            root = self.system.topics[self.scope.topics[e.topic]].name
        elif isinstance(e, typed.TruthRead):
            root = self.system.components[self.scope.plants[e.instance]].name
        else:
            return None
        return leaf_name(root, path)


def _scaled_line(line: _ScaledSignal | None, by: float) -> _ScaledSignal | None:
    if line is None:
        return None
    return _ScaledSignal(line.signal, line.scale * by, line.offset * by, line.folded)


def _inlined_call(e: typed.TypedExpr) -> typed.TypedExpr:
    """Gives the returned expression of a call whose function is a single `return`; else `e`."""
    for _ in range(OPENED_MAX):
        inner = returned(e) if isinstance(e, typed.TypedCall) else None
        if inner is None:
            return e
        e = inner
    return e
