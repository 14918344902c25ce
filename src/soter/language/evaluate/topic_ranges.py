"""What a scalar of a topic may be, by what the program declares of it.

Purpose: the set and the type of a topic as a `Range`, for a place that an expression reads;
`always`: whether that decides a condition.
Non-goals: what steps compute, queues and times (`explore/vacuity/value_domains.py`).
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, anything
from soter.language.evaluate.ranges import Range
from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    RecordType,
    has_list,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.model.system import Bound, Scope, System, Topic
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type

BUDGET = 600
"""Expressions of a condition and of what it calls: a millisecond or two."""
MOST = sys.float_info.max


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
