"""Whether SC brings the plant anywhere, or only stops it.

Purpose: two undisturbed runs of the model under SC that begin apart along one state: where they end
as far apart, nothing pulls that state back, and what disturbs it moves it for ever.
Non-goals: verdicts; which law would do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import Cause
from soter.verify.diagnosis.model_runs import TRUE, patterns, run

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.diagnosis.model_runs import PointModel

    Floats = NDArray[np.float64]

APART = 0.1
"""Of an axis, so far apart two runs begin."""
KEPT = 0.9
"""Of that distance, so much is left at the end where nothing pulls."""
STILL = 1e-4
"""Of an axis, so little a state moves in the last quarter of a run that has come to rest."""
HOLDS = 600


def no_pull(model: PointModel, middle: Floats, budget: CpuBudget) -> Iterator[Cause]:
    """States that SC lets stay wherever they are. `middle`: (states,), inside C."""
    if not model.problem.controls:
        return
    for axis, state in enumerate(model.problem.quantities.states):
        width = float(model.high[axis] - model.low[axis])
        ends = []
        for side in (-0.5, 0.5):
            x = middle.copy()
            x[axis] += side * APART * width
            end = _end(model, x, axis, budget)
            if end is None:
                break
            ends.append(end)
        if len(ends) == 2 and ends[1] - ends[0] > KEPT * APART * width:
            low, high = (float(middle[axis] + s * APART * width) for s in (-0.5, 0.5))
            text = f"SC brings {state.name} to no place: undisturbed, a run from {low:.4g} ends at "
            text += f"{ends[0]:.4g}, one from {high:.4g} at {ends[1]:.4g}; what disturbs it adds up"
            hint = (
                f"an SC that comes to rest at one place, by a term such as `k * ({middle[axis]:.4g}"
            )
            hint += f" - {state.name.rpartition('.')[2]})`"
            yield Cause("no_pull", text, hint, (("low_ends", ends[0]), ("high_ends", ends[1])))


def _end(model: PointModel, start: Floats, axis: int, budget: CpuBudget) -> float | None:
    """Where a state ends; None where the run leaves, does not come to rest, or time is over."""
    if not model.safe(start) & TRUE or not budget.goes_on():
        return None
    trace = run(
        model, start, next(patterns(model)), HOLDS * model.inputs.period_ns / 1e9, budget.goes_on
    )
    if trace.left or not budget.goes_on():
        return None
    values = np.array(trace.states)[:, axis]
    late = values[3 * len(values) // 4 :]
    return float(values[-1]) if np.ptp(late) <= STILL * (model.high - model.low)[axis] else None
