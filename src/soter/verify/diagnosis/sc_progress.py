"""Whether SC brings the plant anywhere, or only stops it.

Purpose: two undisturbed runs of the model under SC that begin apart along one state: where they end
as far apart, nothing pulls that state back, and what disturbs it moves it for ever. Of a linear
group the same is read off its matrices, of sums of states, too.
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
    from soter.verify.polytope.claims import PolytopeProof
    from soter.verify.problem.problem import Problem

    Floats = NDArray[np.float64]

APART = 0.1
"""Of an axis, so far apart two runs begin."""
KEPT = 0.9
"""Of that distance, so much is left at the end where nothing pulls."""
STILL = 1e-4
"""Of an axis, so little a state moves in the last quarter of a run that has come to rest."""
HOLDS = 600


SINGULAR = 1e-9
"""Relative to the closed loop's matrix: a sum of states that changes more slowly stays."""
ROUNDED = 1e-6
"""A coefficient of such a sum, the largest of which is 1, that is none."""
FILLED_S = 1e4
"""A sum that its disturbance takes longer to move over its range is none worth telling."""


def adds_up(proof: PolytopeProof, problem: Problem) -> Iterator[Cause]:
    """Sums of states that neither plant nor SC changes, and something disturbs.

    l with l (A + B K) = 0: then (l x)' = l w, whatever x is.
    """
    if proof.found.model is None:
        return
    group = proof.found.model.group
    closed = group.state + group.control @ group.gain
    disturbance = group.drift[1]
    names = [problem.quantities.states[a.state].name for a in proof.group.axes]
    for row in _still(closed):
        rate = float(np.abs(row) @ disturbance)
        if rate * FILLED_S <= float(np.abs(row) @ (group.high - group.low)):
            continue
        sum_ = _sum(row, names)
        text = f"nothing pulls {sum_} back: neither the plant nor SC changes it, and what disturbs "
        text += f"it adds up, by as much as {rate:.3g} a second"
        reached = np.abs(row @ group.control) > SINGULAR * np.abs(row) @ np.abs(group.control)
        hint = "an SC that goes by it" if reached.any() else "no command moves it: a plant that"
        if not reached.any():
            hint += " pulls it back, if the vehicle does (`der v = ... + k * (b - v) + w` where v "
            hint += "follows b), or no disturbance on it"
        yield Cause("adds_up", text, hint, (("rate", rate),))


def _still(closed: Floats) -> Floats:
    """Rows l with l closed = 0, (k, n), in echelon form: each of as few states as can be."""
    left, sizes, _ = np.linalg.svd(closed)
    rows: Floats = left.T[sizes <= SINGULAR * max(1.0, float(sizes.max(initial=0.0)))].copy()
    for i in range(len(rows)):
        k, at = np.unravel_index(int(np.argmax(np.abs(rows[i:]))), rows[i:].shape)
        rows[[i, i + k]] = rows[[i + k, i]]
        rows[i] /= rows[i, at]
        others = [j for j in range(len(rows)) if j != i]
        rows[others] -= np.outer(rows[others, at], rows[i])
    rows[np.abs(rows) < ROUNDED] = 0.0
    return rows


def _sum(row: Floats, names: list[str]) -> str:
    """The sum of states, its first coefficient 1."""
    there = [i for i in range(len(row)) if row[i] != 0.0]
    text = names[there[0]]
    for i in there[1:]:
        factor = float(row[i] / row[there[0]])
        size = "" if round(abs(factor), 6) == 1.0 else f"{abs(factor):.4g} * "
        text += f" {'-' if factor < 0 else '+'} {size}{names[i]}"
    return text if len(there) == 1 else f"`{text}`"


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
            yield Cause("no_pull", text, "", (("low_ends", ends[0]), ("high_ends", ends[1])))


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
