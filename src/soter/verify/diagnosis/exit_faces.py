"""By which end of the grid runs leave, and whether anybody meant that end.

Purpose: a state that goes one way whatever SC does, enclosed over all of C; an axis that should
wrap around; an end of the grid that `safe` does not know of, and what a wider grid would give.
Non-goals: verdicts; finding the runs (`model_runs.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import Cause
from soter.verify.diagnosis.experiments import COARSE, ProblemChange, kept
from soter.verify.diagnosis.model_runs import FALSE, TRUE, StepFaultError
from soter.verify.grid.claims import GridProof

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.claims.results import LeavingRun
    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.diagnosis.model_runs import LeavingSearch, PointModel

    Floats = NDArray[np.float64]

SAME = 1e-9
"""Relative difference up to which two points of an axis count as the same to the plant."""
DIFFERENT = 1e-6
POINTS = 12
TURNS = (2 * math.pi, 360.0)
SHORTER = "by the shorter way round: `clamp(k * wrap_angle(wanted - {}), low, high)`"


def faces(
    case: Case, model: PointModel, failure: Failure, search: LeavingSearch, budget: CpuBudget
) -> Iterator[Cause]:
    """Drift, an axis that wraps around, a wall that nobody meant."""
    yield from _drift(case, model)
    run = search.soonest
    if run is None or run.safe:
        return
    axis = run.names.index(run.axis)
    end = float((model.low, model.high)[run.side > 0][axis])
    width = float(model.high[axis] - model.low[axis])
    turn = next((t for t in TURNS if _periodic(model, axis, t)), None)
    if turn is not None or _wraps(model, axis):
        by = case.problem.turns_read.get(run.axis)
        yield _angle(run, end, width, turn, by, on=search.undisturbed_s is not None)
        return
    yield _wall(case, model, failure, run, axis, end, budget)


def _angle(
    run: LeavingRun, end: float, width: float, turn: float | None, by: str | None, *, on: bool
) -> Cause:
    """An angle that leaves the grid; `on`: SC turns it further, with nothing against it, too.

    `by`: who reads how many turns it has made, where its axis is one.
    """
    name = run.axis.rpartition(".")[2]
    text = f"runs leave at {run.axis} = {end:.6g}, and {run.axis} is an angle: plant and `safe` "
    text += "are the same one turn further. "
    if by is not None:
        text += f"Its axis does not wrap around, as {by} reads how far it has turned"
    else:
        text += "An axis of one turn, [-PI, PI], wraps around where all read the state in `sin`, "
        text += "`cos`, `tan` or `wrap_angle`"
    text += "; beyond the grid counts as unsafe"
    numbers = (("end", end), ("width", width if turn is None else turn))
    if not on:
        hint = f"a grid of more than one turn, or an SC that keeps {run.axis} off {end:.6g}"
        return Cause("wrap_around", text, f"{hint}, {SHORTER.format(name)}", numbers)
    text += f"; SC itself turns {run.axis} on, so no grid holds it"
    hint = f"an SC that comes to one heading, {SHORTER.format(name)}; where it has to circle, a "
    hint += "plant in the distance from the centre and the heading against the bearing from there "
    hint += "(`der r = V * cos(p); der p = turn - V * sin(p) / r;`), in which circling is rest"
    return Cause("wrap_around", text, hint, numbers)


def _wall(
    case: Case,
    model: PointModel,
    failure: Failure,
    run: LeavingRun,
    axis: int,
    end: float,
    budget: CpuBudget,
) -> Cause:
    """The run left the grid where `safe` holds: by a wall that only the grid makes."""
    width = float(model.high[axis] - model.low[axis])
    beyond, other = run.states[-1].copy(), run.states[0].copy()
    beyond[axis] = end + run.side * width
    other[axis] = end - run.side * 1.001 * width
    numbers = (("end", end), ("side", float(run.side)))
    wider, helps = _wider(case, model, failure, axis, run.side, budget)
    if model.safe(beyond) & TRUE and model.safe(other) == FALSE:
        text = (
            f"`safe` bounds {run.axis} on one side only, and runs leave at the grid's other end, "
            f"{run.axis} = {end:.6g}, which counts as unsafe"
        )
        return Cause("one_sided", text + wider, _bound(run, end, helps), numbers)
    text = f"under SC the flow leaves the grid at {run.axis} = {end:.6g}, where `safe` still holds"
    return Cause("drift", text + wider, _bound(run, end, helps), numbers)


def _bound(run: LeavingRun, end: float, helps: bool | None) -> str:
    """`helps`: whether a wider grid has a K; None: not looked at."""
    low = "beyond" if run.side > 0 else "below"
    sc = f"an SC that keeps {run.axis} from getting to {end:.6g}"
    return sc if helps is False else f"a grid that goes {low} {end:.6g}, or {sc}"


def _wider(
    case: Case, model: PointModel, failure: Failure, axis: int, side: int, budget: CpuBudget
) -> tuple[str, bool | None]:
    """What twice the range on that side changes, and whether it does; None: not looked at."""
    grid = failure.proof
    if not isinstance(grid, GridProof) or axis not in grid.engine.axes:
        return "", None
    low, high = float(model.low[axis]), float(model.high[axis])
    ends = (low, high + (high - low)) if side > 0 else (low - (high - low), high)
    outcome = kept(case, grid, ProblemChange(most=COARSE[1], wider={axis: ends}), budget)
    if outcome is None:
        return "", None
    much = f"K is {outcome.share:.1%} of C" if outcome.share else "K is empty as well"
    return f"; with a grid up to {ends[side > 0]:.6g} {much} ({outcome.cells})", outcome.share > 0.0


def _drift(case: Case, model: PointModel) -> Iterator[Cause]:
    """A state that, whatever anybody does, only goes one way: enclosed over all of C."""
    box = case.forms.whole.copy()
    for part in case.sets.groups:
        for k, axis in enumerate(part.group.axes):
            others = tuple(j for j in range(part.allowed.ndim) if j != k)
            at = np.flatnonzero(part.allowed.any(axis=others))
            if len(at):
                box[axis.state] = part.edges[k][at[0]], part.edges[k][at[-1] + 1]
    n = len(model.low)
    rates = _moves(case, box, n) if model.is_map else case.forms.numbers("derivative", box, n)
    if rates is None:
        return
    per = "a step" if model.is_map else "/s"
    for i in range(n):
        low, high = float(rates[i, 0]), float(rates[i, 1])
        if low > 0.0 or high < 0.0:
            name, end = model.problem.quantities.states[i].name, float(box[i, int(low > 0.0)])
            least = low if low > 0.0 else high
            yield Cause(
                "drift_of_all",
                f"the flow leaves at {name} = {end:.6g} whatever SC does: all over C {name} "
                f"{'rises' if low > 0.0 else 'falls'} by {abs(least):.4g} {per} at least",
                f"no set of a state that goes one way is kept: no axis of {name}, or hold it",
                (("end", end), ("rate", least)),
            )


def _moves(case: Case, box: Floats, n: int) -> Floats | None:
    """Bounds of next(x) - x over a box, (n, 2): differences of forms."""
    middle, half = box.mean(axis=1), (box[:, 1] - box[:, 0]) / 2
    forms = np.zeros((len(box), 4 + case.forms.library.inputs))
    forms[:, 0], forms[:, 1], forms[:, 2] = box[:, 0], box[:, 1], middle
    forms[range(len(box)), range(4, 4 + len(box))] = half
    out = case.forms.affine("next", forms, n)
    if out is None:
        return None
    out[:, 2] -= middle[:n]
    out[range(n), range(4, 4 + n)] -= half[:n]
    spread = np.abs(out[:, 4:]).sum(axis=1) + out[:, 3]
    return np.stack([out[:, 2] - spread, out[:, 2] + spread], axis=1)


def _periodic(model: PointModel, axis: int, turn: float) -> bool:
    """Whether plant and `safe` are the same a turn further, and the plant not for every value."""
    chance = np.random.default_rng(0)
    depends = False
    whole = model.forms.whole
    for _ in range(POINTS):
        point = chance.uniform(whole[:, 0], whole[:, 1])
        u, w = point[model.controls], point[model.disturbances]
        seen = []
        for more in (0.0, turn, float(chance.uniform(0.1, 0.4)) * turn):
            x = point[model.states].copy()
            x[axis] += more
            try:
                rate = model.rate(x, u, w)
            except StepFaultError:
                return False
            if model.is_map:
                rate[axis] -= x[axis]
            seen.append((rate, model.safe(x)))
        size = 1e-12 + float(np.abs(seen[0][0]).max())
        if np.abs(seen[0][0] - seen[1][0]).max() > SAME * size or seen[0][1] != seen[1][1]:
            return False
        depends |= bool(np.abs(seen[0][0] - seen[2][0]).max() > DIFFERENT * size)
    return depends


def _wraps(model: PointModel, axis: int) -> bool:
    """Whether plant and `safe` are the same at both ends of an axis, and it is no mere place.

    No mere place: the plant depends on it in between, or its range is a full turn.
    """
    chance = np.random.default_rng(0)
    low, high = float(model.low[axis]), float(model.high[axis])
    turns = [(high - low) / t for t in TURNS]
    is_turn = any(t > 0.5 and abs(t - round(t)) < 1e-3 * t for t in turns)
    depends = False
    whole = model.forms.whole
    for _ in range(POINTS):
        point = chance.uniform(whole[:, 0], whole[:, 1])
        u, w = point[model.controls], point[model.disturbances]
        seen = []
        for value in (low, high, float(chance.uniform(low, high))):
            x = point[model.states].copy()
            x[axis] = value
            try:
                rate = model.rate(x, u, w)
            except StepFaultError:
                return False
            if model.is_map:
                rate[axis] -= value
            seen.append((rate, model.safe(x)))
        size = 1e-12 + float(np.abs(seen[0][0]).max())
        if np.abs(seen[0][0] - seen[1][0]).max() > SAME * size or seen[0][1] != seen[1][1]:
            return False
        depends |= bool(np.abs(seen[0][0] - seen[2][0]).max() > DIFFERENT * size)
    return depends or is_turn
