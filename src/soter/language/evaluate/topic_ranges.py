"""What a scalar of a topic may be, by what the program declares of it.

Purpose: the set and the type of a topic as a `Range`, for a place that an expression reads;
`always`, `always_by_parts`: whether that decides a condition; `narrowed`: ages, and what of a topic
is known to be less.
Non-goals: what steps compute, queues and times (`explore/vacuous_tests.py`).
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, anything
from soter.language.evaluate.ranges import Range
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import Literal, ParamRead, TypedCall
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    FloatType,
    IntType,
    RecordType,
    has_list,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.model.system import Bound, Scope, System, Topic
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type

BUDGET = 600
"""Expressions of a condition and of what it calls: a millisecond or two."""
PARTS_MAX, CUTS_MAX = 64, 12
"""So many parts of what a condition reads are looked at, and so many cuts made of one number."""
MOST = sys.float_info.max


def narrowed(
    system: System,
    ages_ns: Mapping[int, int | None],
    leaves_within: Mapping[tuple[int, int], tuple[float, float]] | None = None,
) -> Callable[[ReadPlace], Range]:
    """`declared`, with the greatest age of topics in ns, and ranges of some (topic, leaf)."""
    otherwise, within = declared(system), leaves_within or {}

    def read(place: ReadPlace) -> Range:
        if place.kind == "age" and place.index in ages_ns:
            most = ages_ns[place.index]
            return Range(0.0, math.inf if most is None else most / 1e9)
        known = otherwise(place)
        if place.kind != "topic":
            return known
        low, high = within.get(
            (place.index, _leaf(system.topics[place.index], place.path)), (known.low, known.high)
        )
        low, high = max(known.low, low), min(known.high, high)
        return Range(low, high) if low <= high else known

    return read


def declared(system: System) -> Callable[[ReadPlace], Range]:
    """What a `RangeEvaluator` asks for the ranges of all that is read: `TooHardError` of lists."""

    def read(place: ReadPlace) -> Range:
        if place.kind == "topic" and not has_list(system.topics[place.index].type):
            return published(system.topics[place.index], place)
        known = anything(place.type)
        if not isinstance(known, Range):
            raise TooHardError
        return known

    return read


def always(condition: TypedExpr, system: System, scope: Scope) -> bool | None:
    """What a condition is wherever it is judged, as the declared sets say; None if they do not."""
    evaluator = RangeEvaluator(scope, 0, declared(system))
    evaluator.left = BUDGET
    try:
        truth = evaluator.number(condition)
    except TooHardError:
        return None
    return bool(truth.low) if truth.single and not evaluator.faults.possible else None


def always_by_parts(
    condition: TypedExpr,
    system: System,
    scope: Scope,
    read: Callable[[ReadPlace], Range] | None = None,
) -> bool | None:
    """The same, of each part by itself: what is read is cut at the numbers of the condition.

    So comparisons that exclude each other, or leave nothing out, are known as that. `read`: as
    `narrowed` gives it; None: the declared sets.
    """
    read, cuts = read or declared(system), _numbers(condition, scope)
    found: bool | None = None
    parts: list[dict[ReadPlace, Range]] = [{}]
    for _ in range(PARTS_MAX):
        part = dict(parts.pop())

        def known(place: ReadPlace, part: dict[ReadPlace, Range] = part) -> Range:
            return part[place] if place in part else part.setdefault(place, read(place))

        evaluator = RangeEvaluator(scope, 0, known)
        evaluator.left = BUDGET
        try:
            truth = evaluator.number(condition)
        except TooHardError:
            return None
        if truth.single and not evaluator.faults.possible:
            if found not in {None, bool(truth.low)}:
                return None
            found = bool(truth.low)
        else:
            pieces = next(((k, p) for k, r in part.items() if len(p := _cut(r, cuts)) > 1), None)
            if pieces is None:
                return None
            parts += [{**part, pieces[0]: piece} for piece in pieces[1]]
        if not parts:
            return found
    return None


def _numbers(condition: TypedExpr, scope: Scope) -> list[float]:
    """What a condition, and what it calls, may compare with: its constants, of either sign."""
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
                found.add(value / 1e9)  # as `seconds` gives it, to an age
    return sorted(found)


def _cut(of: Range, cuts: Sequence[float]) -> list[Range]:
    """A range in pieces: each of the cuts inside by itself, and what is between them."""
    whole = isinstance(of.low, int)
    if whole and of.high - of.low < CUTS_MAX:
        cuts = range(int(of.low), int(of.high) + 1)
    inside = [c for c in cuts if of.has(c) and c == (int(c) if whole else c)]
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


def published(topic: Topic, place: ReadPlace) -> Range:
    """All values that may be published there: what is not finite never is."""
    return _inside(place.type, topic.bounds[_leaf(topic, place.path)])


def _leaf(topic: Topic, path: tuple[int, ...]) -> int:
    """The number of a leaf, as bounds are counted: all elements of a list share those of one."""
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


def _inside(of: Type, bound: Bound | None) -> Range:
    if isinstance(of, FloatType):
        low, high = (-MOST, MOST) if bound is None else (bound.low, bound.high)
        return Range(float(low), float(high))
    interval = anything(of)
    assert isinstance(interval, Range), of
    if bound is None or isinstance(of, BoolType) or not isinstance(of, IntType):
        return interval
    low, high = math.ceil(bound.low), math.floor(bound.high)
    return Range(max(int(interval.low), low), min(int(interval.high), high))
