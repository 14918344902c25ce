"""Finds what is wrong with an SC whose K is empty, by runs of the model.

Purpose: `habit_of_sc` looks for three faults of SC: it comes to rest outside of C; it drives a
state away from its place of rest; or it leaves a state where the state starts, so that any push
moves it on. The advice is then about SC. `habit_of_moving_on` finds a fourth one: SC never stops.
Non-goals: verdicts: these are runs of the model; an SC that is merely too weak
(`changed_runs.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.diagnosis.model_runs import (
    FALSE,
    NS,
    TRUE,
    PointModel,
    pattern_text,
    patterns_to_try,
    point_text,
    run_of_sc,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.layout import Floats
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern


HOLDS = 2000
"""The number of periods of SC for which a run is followed."""
EVEN = 0.01
"""The share of a speed by which an even speed may change in a run's last quarter."""
STILL = 1e-3
"""The share of an axis within which a run at rest stays in its last quarter."""
MOVED = 0.1
"""The share of an axis by which a state is moved away from the place of rest."""
LOOKS = 50
"""The number of places on the way to the end of an axis at which `safe` is evaluated."""


@dataclass(frozen=True)
class Habit:
    """A fault of SC in a sentence (`text`), and advice on what to write instead (`hint`)."""

    text: str
    hint: str
    trace: ModelTrace | None = None
    """The undisturbed run that leaves C; None where it does not leave C."""


def habit_of_sc(model: PointModel, start: Floats, going: Callable[[], bool]) -> Habit | None:
    """The habit that SC shows in runs from a start, (states,); None if none is seen in time."""
    calm = next(patterns_to_try(model))
    until_s = HOLDS * model.inputs.period_ns * NS
    first = run_of_sc(model, start, calm, until_s, going, beyond=True)
    if not comes_to_rest(model, first) or not going():
        return None
    rest = first.states[-1]
    if model.is_beyond_ends(rest).any() or model.safe(rest) == FALSE:
        text = (
            f"without any disturbance SC comes to rest outside of C, at {point_text(model, rest)}"
        )
        left = run_of_sc(model, start, calm, until_s, going)
        return Habit(text, "an SC that comes to rest where `safe` holds", left)
    for axis in (i for i in range(len(rest)) if i not in model.turning):
        for side in (1.0, -1.0):
            found = _habit_beside_rest(model, rest, axis, side, until_s, going)
            if found is not None:
                return found
    return None


def _habit_beside_rest(
    model: PointModel,
    rest: Floats,
    axis: int,
    side: float,
    until_s: float,
    going: Callable[[], bool],
) -> Habit | None:
    """The habit of SC that a run from a point near its rest shows; None if SC leads it back."""
    calm, name, begin = next(patterns_to_try(model)), model.state_names[axis], rest.copy()
    step = side * MOVED * (model.high[axis] - model.low[axis])
    begin[axis] += step
    inside = model.low[axis] <= begin[axis] <= model.high[axis]
    if not (inside and model.safe(begin) == TRUE and going()):
        return None
    trace = run_of_sc(model, begin, calm, until_s, going)
    end = trace.states[-1]
    moved = (end[axis] - begin[axis]) / step
    if trace.left and moved > 0.0:
        text = f"without any disturbance SC drives {name} away: from {begin[axis]:.4g} it leaves C"
        return Habit(text, f"an SC that brings {name} back: perhaps a sign is wrong", trace)
    if trace.left or abs(moved) > 0.5 or not comes_to_rest(model, trace):
        return None
    for pattern in patterns_to_try(model):
        pushed = run_of_sc(model, rest, pattern, until_s / 4, going)
        if not going():
            return None
        speed = (pushed.states[-1][axis] - rest[axis]) / max(pushed.times[-1], NS)
        if abs(speed) * until_s > STILL * abs(step) and _drift_ends_unsafe(
            model, rest, axis, speed
        ):
            return _habit_of_drift(model, pattern, name, (begin[axis], end[axis], speed))
    return None


def _habit_of_drift(
    model: PointModel, pattern: Pattern, name: str, seen: tuple[float, float, float]
) -> Habit:
    """The habit of leaving a state; `seen`: its start, its end, its speed when pushed at rest."""
    begin, end, speed = seen
    by = ", ".join(pattern_text(model, pattern))
    text = (
        f"SC leaves {name} at {end:.4g} where it begins at {begin:.4g}, and does not bring it back:"
        f" with {by} {name} moves on, {speed:.3g} a second, toward where `safe` ends"
    )
    return Habit(text, f"an SC that brings {name} back to a place, and not to a stop alone")


def _drift_ends_unsafe(model: PointModel, rest: Floats, axis: int, speed: float) -> bool:
    """Whether a state that drifts loses `safe` before it reaches the end of the grid."""
    x, end = rest.copy(), model.high[axis] if speed > 0.0 else model.low[axis]
    for value in np.linspace(rest[axis], end, LOOKS):
        x[axis] = value
        if model.safe(x) == FALSE:
            return True
    return False


def habit_of_moving_on(model: PointModel, start: Floats, going: Callable[[], bool]) -> Habit | None:
    """The habit of moving on evenly for ever, from a state (states,), until `safe` is lost."""
    until_s = HOLDS * model.inputs.period_ns * NS
    trace = run_of_sc(model, start, next(patterns_to_try(model)), until_s, going, beyond=True)
    times, states = np.array(trace.times), np.array(trace.states)
    since, half = (np.searchsorted(times, share * times[-1]) for share in (0.75, 0.875))
    if not since < half < len(times) - 1 or not going():
        return None
    early = (states[half] - states[since]) / (times[half] - times[since])
    speeds = (states[-1] - states[half]) / (times[-1] - times[half])
    moved = np.abs(states[-1] - states[since]) > STILL * (model.high - model.low)
    if not (np.abs(speeds - early) <= EVEN * np.abs(speeds))[moved].all():
        return None
    for axis in (int(i) for i in np.flatnonzero(moved) if i not in model.turning):
        if _drift_ends_unsafe(model, states[-1], axis, speeds[axis]):
            name = model.state_names[axis]
            text = (
                f"without any disturbance SC does not stop: after {times[-1]:.4g} s {name} still "
                f"moves by {speeds[axis]:.3g} a second, toward where `safe` ends"
            )
            return Habit(text, f"an SC that stops, or that brings {name} back")
    return None


def comes_to_rest(model: PointModel, trace: ModelTrace) -> bool:
    """Whether the last quarter of a run moves no state."""
    late = [
        x for t, x in zip(trace.times, trace.states, strict=True) if t >= 0.75 * trace.times[-1]
    ]
    moved = np.max(late, axis=0) - np.min(late, axis=0)
    return bool((moved <= STILL * np.maximum(model.high - model.low, 1e-300)).all())
