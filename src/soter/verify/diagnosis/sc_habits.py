"""Where SC brings the plant when nobody disturbs it, and why that keeps no set: runs of the model.

Purpose: `habit` of an SC whose K is empty: it comes to rest outside of C; it drives a state away
from where it is; or it leaves a state where that begins, so that whatever pushes moves it on. What
the runs show lies with SC, so that the advice is about SC.
Non-goals: verdicts, and SC that is merely too weak: then nothing is said here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.diagnosis.model_runs import (
    FALSE,
    NS,
    TRUE,
    pattern_text,
    patterns,
    point_text,
    run,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern, PointModel

    Floats = NDArray[np.float64]

HOLDS = 2000
"""So long a run is followed, in periods of SC."""
STILL = 1e-3
"""Of an axis: a run that moves less in the last quarter of its time has come to rest."""
MOVED = 0.1
"""Of an axis: so far a state is put beside the place of rest."""
LOOKS = 50
"""Places at which `safe` is asked on the way from there to the end of an axis."""


@dataclass(frozen=True)
class Habit:
    """What SC does, a sentence, and what to write in its place."""

    text: str
    hint: str


def habit(model: PointModel, start: Floats, going: Callable[[], bool]) -> Habit | None:
    """Of SC from a state, (states,); None where the runs show none, or there was no time."""
    calm = next(patterns(model))
    until_s = HOLDS * model.inputs.period_ns * NS
    first = run(model, start, calm, until_s, going, beyond=True)
    if not _rests(model, first) or not going():
        return None
    rest = first.states[-1]
    out = (rest < model.low) | (rest > model.high)
    out[model.turning] = False
    if out.any() or model.safe(rest) == FALSE:
        text = (
            f"without any disturbance SC comes to rest outside of C, at {point_text(model, rest)}"
        )
        return Habit(text, "an SC that comes to rest where `safe` holds")
    for axis in (i for i in range(len(rest)) if i not in model.turning):
        for side in (1.0, -1.0):
            found = _beside(model, rest, axis, side, until_s, going)
            if found is not None:
                return found
    return None


def _beside(
    model: PointModel,
    rest: Floats,
    axis: int,
    side: float,
    until_s: float,
    going: Callable[[], bool],
) -> Habit | None:
    """What SC does of one state beside the place where it rests."""
    calm, name, begin = next(patterns(model)), model.names[axis], rest.copy()
    step = side * MOVED * (model.high[axis] - model.low[axis])
    begin[axis] += step
    inside = model.low[axis] <= begin[axis] <= model.high[axis]
    if not (inside and model.safe(begin) == TRUE and going()):
        return None
    trace = run(model, begin, calm, until_s, going)
    end = trace.states[-1]
    moved = (end[axis] - begin[axis]) / step
    if trace.left and moved > 0.0:
        text = f"without any disturbance SC drives {name} away: from {begin[axis]:.4g} it leaves C"
        return Habit(text, f"an SC that brings {name} back: perhaps a sign is wrong")
    if trace.left or abs(moved) > 0.5 or not _rests(model, trace):
        return None
    for pattern in patterns(model):
        pushed = run(model, rest, pattern, until_s / 4, going)
        if not going():
            return None
        speed = (pushed.states[-1][axis] - rest[axis]) / max(pushed.times[-1], NS)
        if abs(speed) * until_s > STILL * abs(step) and _ends_unsafe(model, rest, axis, speed):
            return _drift(model, pattern, name, (begin[axis], end[axis], speed))
    return None


def _drift(
    model: PointModel, pattern: Pattern, name: str, seen: tuple[float, float, float]
) -> Habit:
    """`seen`: where a state began, where SC left it, and how fast it is pushed from rest."""
    begin, end, speed = seen
    by = ", ".join(pattern_text(model, pattern))
    text = (
        f"SC leaves {name} at {end:.4g} where it begins at {begin:.4g}, and does not bring it back:"
        f" with {by} {name} moves on, {speed:.3g} a second, toward where `safe` ends"
    )
    return Habit(text, f"an SC that brings {name} back to a place, and not to a stop alone")


def _ends_unsafe(model: PointModel, rest: Floats, axis: int, speed: float) -> bool:
    """Whether `safe` ends on the way that a state drifts, inside of the grid."""
    x, end = rest.copy(), model.high[axis] if speed > 0.0 else model.low[axis]
    for value in np.linspace(rest[axis], end, LOOKS):
        x[axis] = value
        if model.safe(x) == FALSE:
            return True
    return False


def _rests(model: PointModel, trace: ModelTrace) -> bool:
    """Whether the last quarter of a run moves no state."""
    late = [
        x for t, x in zip(trace.times, trace.states, strict=True) if t >= 0.75 * trace.times[-1]
    ]
    moved = np.max(late, axis=0) - np.min(late, axis=0)
    return bool((moved <= STILL * np.maximum(model.high - model.low, 1e-300)).all())
