"""The signals of topics and plants: what of a value is drawn over time, with which levels.

Purpose: `value_series` makes the series of whatever was held, for a run and for a counterexample:
numbers and truth values, each with the limits that properties state of it; the true state that a
topic measures shares its panel. `record_array` makes an array of values that are JSON.
Non-goals: reading traces (`simulate/run_report.py`) or replays (`counterexample_page.py`); drawing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.evaluate.topic_ranges import signal_limits
from soter.language.model import typed
from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    RecordType,
    leaf_name,
    leaves,
)
from soter.report.run.record import Series, Threshold

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from soter.language.model.system import System
    from soter.language.model.types import Type


SERIES_MAX = 24
"""The most signals that are drawn below each other."""
ELEMENTS_MAX = 7
"""Arrays that are longer are not drawn; an arm has this many joints."""
SIGNAL_SHARE_MIN = 20
"""A signal keeps at least one part in this many of its panel's height."""
AXES = {"w", "x", "y", "z"}


def record_array(t: Type, values: Sequence[Any]) -> npt.NDArray[Any]:
    """An array (n,) of the JSON values of a type; a value that is no number becomes NaN."""
    return np.array([_row_values(t, value) for value in values], dtype=_numpy_dtype(t))


def _numpy_dtype(t: Type) -> Any:  # noqa: ANN401 - numpy's dtype constructor argument
    if isinstance(t, RecordType):
        return np.dtype([(name, _numpy_dtype(field)) for name, field in t.fields])
    if isinstance(t, ArrayType):
        return np.dtype((_numpy_dtype(t.element), (t.size,)))
    return np.dtype(np.float64)


def _row_values(t: Type, value: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(t, RecordType):
        return tuple([_row_values(field, value[name]) for name, field in t.fields])
    if isinstance(t, ArrayType):
        return [_row_values(t.element, each) for each in value]
    return float(value) if isinstance(t, (FloatType, IntType, BoolType)) else np.nan


def value_series(
    system: System, plants: Mapping[str, Any], topics: Mapping[str, Any]
) -> Iterator[Series]:
    """Yields all signals, (N,) each: first the true states of `plants`, then the topics."""
    demanded = _limits_by_signal(system)
    measured = _measured_states(system)
    compared = frozenset(measured.values())
    alone: set[str] = set()
    states_of = {x.name: x.plant.states for x in system.components if x.plant is not None}
    for name, states in plants.items():
        for state in states_of[name]:
            for each in _signals_of_value(
                f"{name}.{state.name}", state.type, states[state.name], ()
            ):
                shared = each.panel == each.name.rpartition(".")[0]  # of a record
                alone |= {each.name} & compared if not shared else set()
                shown = replace(each, panel=each.name) if each.name in alone else each
                yield _series_with_limits(shown, demanded)
    for topic in system.topics:
        if topic.held or topic.name not in topics:
            continue
        bounds = iter(topic.bounds)
        levels = next(bounds, None)
        marks: tuple[Threshold, ...] = ()
        if isinstance(topic.type, (FloatType, IntType)) and levels is not None:
            marks = (
                Threshold("least declared", levels.low),
                Threshold("greatest declared", levels.high),
            )
        for each in _signals_of_value(topic.name, topic.type, topics[topic.name], marks):
            truth = measured.get(each.name, "")
            held = replace(each, held=True, panel=truth if truth in alone else each.panel)
            yield _series_with_limits(held, demanded)


def sorted_by_interest(system: System, series: Sequence[Series]) -> tuple[Series, ...]:
    """The signals, with those first whose panel has a limit, a margin or a judged state."""
    text = " ".join(p.text for p in system.properties)

    def is_of_interest(s: Series) -> bool:
        plant, _, state = s.name.partition(".")
        return bool(s.thresholds) or "(" in s.name or f"{plant}.truth.{state.split('.')[0]}" in text

    first = {s.panel for s in series if is_of_interest(s)}
    return tuple(sorted(series, key=lambda s: s.panel not in first))


def _limits_by_signal(system: System) -> dict[str, list[Threshold]]:
    """Maps each signal to its limits; a limit that several properties demand appears once."""
    thresholds_by_signal: dict[str, list[Threshold]] = {}
    for limit in signal_limits(system):
        levels = thresholds_by_signal.setdefault(limit.signal, [])
        same = [i for i, t in enumerate(levels) if t.value == limit.value]
        for i in same:
            if limit.by not in levels[i].label.split(", "):
                levels[i] = Threshold(f"{levels[i].label}, {limit.by}", limit.value)
        if not same:
            levels.append(Threshold(limit.by, limit.value))
    return thresholds_by_signal


def _series_with_limits(series: Series, demanded: Mapping[str, list[Threshold]]) -> Series:
    """The signal with those of its limits that are near enough to be drawn."""
    marks = _visible_levels(series.values, tuple(demanded.get(series.name, ())))
    return replace(series, thresholds=(*series.thresholds, *marks)) if marks else series


def _measured_states(system: System) -> dict[str, str]:
    """Maps each signal of a topic to the true state that the signal equals or measures."""
    state_by_signal: dict[str, str] = {}
    for x in system.components:
        if x.plant is None:
            continue
        names = {v: f"{x.name}.{v.name}" for v in x.plant.states}
        for topic, value in x.plant.drives:
            name = system.topics[x.scope.topics[topic]].name
            state_by_signal |= dict(_equal_states(name, value, names))
    return state_by_signal


def _equal_states(
    name: str, e: typed.TypedExpr, names: Mapping[typed.Variable, str]
) -> Iterator[tuple[str, str]]:
    """Yields (signal, state) for each number of a driven topic that equals a plant's state."""
    if isinstance(e, typed.VarRead) and e.variable in names:
        for path, _ in leaves(e.type):
            yield leaf_name(name, path), leaf_name(names[e.variable], path)
    elif isinstance(e, typed.Aggregate) and isinstance(e.type, RecordType):
        order = e.order or range(len(e.elements))
        for i, part in zip(order, e.elements, strict=True):
            yield from _equal_states(f"{name}.{e.type.fields[i][0]}", part, names)
    elif isinstance(e, typed.Aggregate) and isinstance(e.type, ArrayType):
        for i, part in enumerate(e.elements):
            yield from _equal_states(f"{name}[{i}]", part, names)


def _visible_levels(
    numbers: npt.NDArray[np.float64], marks: tuple[Threshold, ...]
) -> tuple[Threshold, ...]:
    """The levels that are drawn; () if the signal would look flat beside them."""
    levels = [m.value for m in marks]
    if not marks or not numbers.size:
        return ()
    low, high = float(np.min(numbers)), float(np.max(numbers))
    whole = max(high, *levels) - min(low, *levels)
    return () if 0 < high - low < whole / SIGNAL_SHARE_MIN else marks


def _signals_of_value(
    name: str, t: Type, values: npt.NDArray[np.void], marks: tuple[Threshold, ...]
) -> Iterator[Series]:
    """Yields a signal for each number or bool (0, 1) in a value; coordinates share a panel."""
    if isinstance(t, (FloatType, IntType, BoolType)):
        unit = "" if isinstance(t, BoolType) else t.unit
        numbers = np.ascontiguousarray(values, dtype=np.float64)
        limits_in_sight, held = _visible_levels(numbers, marks), not isinstance(t, FloatType)
        yield Series(name, unit, numbers, panel=name, thresholds=limits_in_sight, held=held)
    elif isinstance(t, RecordType):
        units = {getattr(field_type, "unit", "") for _, field_type in t.fields}
        together = {name_ for name_, _ in t.fields} <= AXES or (len(units) == 1 and units != {""})
        for name_, field_type in t.fields:
            for series in _signals_of_value(f"{name}.{name_}", field_type, values[name_], ()):
                yield replace(series, panel=name) if together else series
    elif isinstance(t, ArrayType) and t.size <= ELEMENTS_MAX:
        for index in range(t.size):
            for series in _signals_of_value(f"{name}[{index}]", t.element, values[:, index], ()):
                yield replace(series, panel=series.panel.replace(f"[{index}]", "", 1))
