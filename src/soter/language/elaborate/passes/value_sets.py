"""Computes the value set of a topic: a bound for each of its leaves.

Purpose: makes bounds under the parameters of a system, with the first value inside them, reports
values outside a set (V002, V005), and asks that wired topics have the same sets (V010).
Non-goals: topics (`topics.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.language.model.system import Bound
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
    is_vector_part,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.elaborate.passes.flattening import Bounds, Flattening
    from soter.language.model import typed
    from soter.language.model.system import Topic
    from soter.language.model.types import Type, Value


def set_and_default(flat: Flattening, symbol: typed.TopicSymbol) -> tuple[Bounds, bool, Value]:
    """Gives the bounds of a topic's leaves, whether each number has one, and the first value."""
    key = symbol, id(flat.params)
    if key not in flat.sets:
        bounds, declared = _bounds_of_leaves(flat, symbol)
        flat.sets[key] = bounds, declared, _first_value(flat, symbol, bounds)
    return flat.sets[key]


def _bounds_of_leaves(flat: Flattening, symbol: typed.TopicSymbol) -> tuple[Bounds, bool]:
    """Gives a bound for each leaf, and whether every number has one."""
    description = f"the set of `{symbol.name}`"
    resolved: dict[tuple[str, ...], Bound] = {}
    for path, values in symbol.values.items():
        interval = flat.interval(values.low, values.high, values.span, description)
        if interval is not None:
            resolved[path] = Bound(*interval)
        else:  # consequences of the error are not reported
            flat.program.damaged.add(symbol)
    bounds, declared = _Bounder(resolved).bounds_of_leaves(symbol.type)
    if any(b is not None and b.low > b.high for b in bounds):
        flat.diagnostics.error(
            "V001", f"{description} holds no value of its type `{symbol.type}`", symbol.span
        )
        flat.program.damaged.add(symbol)
    return bounds, declared


def _first_value(flat: Flattening, symbol: typed.TopicSymbol, bounds: Bounds) -> Value:
    """Gives the first value of a topic; reports V002 if it lies outside the set."""
    written = symbol.default
    description = f"the default of `{symbol.name}`"
    value = flat.value_of(written, description)
    if value is None:
        value = default_value(symbol.type)
    if symbol in flat.program.damaged:
        return value
    if written is None and (not any(bounds) or _all_allow_zeros(symbol.type, bounds)):
        return value
    outside = first_outside(symbol.type, value, bounds)
    if outside is not None:
        leaf, number, bound = outside
        where = f" (`{leaf}`)" if leaf else ""
        sets = tuple((r.span, "its set") for r in symbol.values.values())
        flat.diagnostics.error(
            "V002",
            f"{description}{where} is {text_of_number_outside(number, bound)}",
            written.span if written is not None else symbol.span,
            f"starts at {number!r}" if written is None else "",
            also=sets if len(sets) == 1 else (),
            notes=()
            if written is not None
            else ("without `= ...` a topic starts at the default of its type",),
            helps=(f"give it a first value in {bound_text(bound)}: `= ...`",)
            if written is None
            else (),
        )
    return value


def require_in_set(
    flat: Flattening,
    topic: Topic,
    value: Value,
    expr: typed.TypedExpr,
    subject: str,
    notes: tuple[str, ...] = (),
) -> None:
    """Reports V005 if a value is outside its topic's set; the message begins with `subject`."""
    outside = first_outside(topic.type, value, topic.bounds)
    if outside is None or topic.symbol in flat.program.damaged:
        return
    leaf, number, bound = outside
    where = f" (`{leaf}`)" if leaf else ""
    flat.diagnostics.error(
        "V005",
        f"{subject}{where} is {text_of_number_outside(number, bound)}",
        expr.span,
        also=((topic.symbol.span, "the topic"),),
        notes=notes,
    )


def _all_allow_zeros(t: Type, bounds: Bounds) -> bool:
    """Whether zero is inside all bounds; does not make a value of zeros, which may be large."""
    return is_vector_part(t) and all(b is None or b.low <= 0.0 <= b.high for b in set(bounds))


def bound_text(bound: Bound) -> str:
    """Gives the bound as text: `[low, high]`."""
    return f"[{bound.low!r}, {bound.high!r}]"


def text_of_number_outside(number: float, bound: Bound) -> str:
    """Gives the end of a sentence about a number that is outside its bound."""
    if math.isfinite(number):
        return f"{number!r}, outside {bound_text(bound)}"
    return f"{number!r}, which no topic may hold"


class _Bounder:
    """Finds the bound of each leaf of a type: the innermost declared set that covers it."""

    def __init__(self, sets: dict[tuple[str, ...], Bound]) -> None:
        self.sets = sets
        self._known: dict[tuple[int, Bound | None], tuple[Bounds, bool]] = {}

    def bounds_of_leaves(
        self, t: Type, path: tuple[str, ...] = (), outer: Bound | None = None
    ) -> tuple[Bounds, bool]:
        """Gives a bound or None for each leaf of `t`, and whether every number has one."""
        outer = self.sets.get(path, outer)
        if isinstance(t, (RecordType, ArrayType, ListType)):
            if any(len(p) > len(path) and p[: len(path)] == path for p in self.sets):
                return self._bounds_of_parts(t, path, outer)
            key = id(t), outer  # one type may occur inside another many times
            if key not in self._known:
                self._known[key] = self._bounds_of_parts(t, path, outer)
            return self._known[key]
        if not isinstance(t, (FloatType, IntType)):
            return (None,), True
        if isinstance(t, IntType):
            outer = _bound_within_type(outer, t)
        return (outer,), outer is not None

    def _bounds_of_parts(
        self, t: RecordType | ArrayType | ListType, path: tuple[str, ...], outer: Bound | None
    ) -> tuple[Bounds, bool]:
        if isinstance(t, RecordType):
            parts = [self.bounds_of_leaves(f, (*path, n), outer) for n, f in t.fields]
            return tuple(b for bounds, _ in parts for b in bounds), all(d for _, d in parts)
        bounds, declared = self.bounds_of_leaves(t.element, (*path, ""), outer)
        return bounds * (t.size if isinstance(t, ArrayType) else 1), declared


def _bound_within_type(bound: Bound | None, t: IntType) -> Bound | None:
    """Gives the bound of an int, limited to its type's range, as draws and the gate need it."""
    if bound is None:
        return None if t.is_full else Bound(t.low, t.high)
    return Bound(max(bound.low, t.low), min(bound.high, t.high))


def first_outside(t: Type, value: Value, bounds: Bounds) -> tuple[str, float, Bound] | None:
    """Gives path, value and bound of the first leaf outside its bound; None if none is outside."""
    violation, _ = _first_outside_and_next(t, value, bounds, 0, "")
    return violation


def _typed_parts(
    t: RecordType | ArrayType, value: Value, path: str
) -> Iterator[tuple[Type, Value, str]]:
    """Yields type, value and path of each field or element of a value."""
    if isinstance(t, RecordType):
        for (name, part_type), part in zip(t.fields, value, strict=True):
            yield part_type, part, f"{path}.{name}" if path else name
    else:
        yield from ((t.element, part, f"{path}[{i}]") for i, part in enumerate(value))


def _first_outside_and_next(
    t: Type, value: Value, bounds: Bounds, at: int, path: str
) -> tuple[tuple[str, float, Bound] | None, int]:
    """Gives the first leaf outside its bound, and the index of the next bound after the value."""
    if isinstance(t, (RecordType, ArrayType)):
        for part_type, part, where in _typed_parts(t, value, path):
            violation, at = _first_outside_and_next(part_type, part, bounds, at, where)
            if violation is not None:
                return violation, at
        return None, at
    if isinstance(t, ListType):
        after = at + len(_Bounder({}).bounds_of_leaves(t.element)[0])
        for i, e in enumerate(value):
            violation, _ = _first_outside_and_next(t.element, e, bounds, at, f"{path}[{i}]")
            if violation is not None:
                return violation, after
        return None, after
    bound = bounds[at]
    if bound is None and isinstance(t, FloatType) and not math.isfinite(value):
        bound = Bound(-math.inf, math.inf)
    if bound is None or isinstance(t, (BoolType, EnumType)):
        return None, at + 1
    if bound.low <= value <= bound.high and math.isfinite(value):
        return None, at + 1
    return (path, value, bound), at + 1
