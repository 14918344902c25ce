"""By which end of the grid runs leave, and what fails at an end that only the grid makes.

Purpose: `faces`: a state that goes one way whatever SC does, enclosed over all of C; an axis that
should wrap around; an end of the grid that `safe` does not know of, and what a wider grid would
give. `grid_ends`: cells at an end beyond which `safe` still holds, where `ttf`, `safer` or K is
lost, and whether a wider grid shows the inclusion there. Where the flow comes to rest at such an
end no run leaves there, but what encloses it does: whether a longer axis keeps more is measured.
Non-goals: verdicts; finding the runs (`model_runs.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import Cause
from soter.verify.diagnosis.experiments import COARSE, ProblemChange, failing, kept
from soter.verify.diagnosis.model_runs import FALSE, TRUE, StepFaultError
from soter.verify.grid.claims import GridProof

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.claims.results import LeavingRun
    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.diagnosis.model_runs import LeavingSearch, PointModel

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]


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


WIDER, BOTH = 0.25, 2.5
"""Of the axis, so much wider are the grids that are tried: at this end, then at both."""
BEYOND = 0.01
WIDER_S = 2.0
LONGER, MORE = 0.1, 0.05
"""Of the axis, so much longer is what is tried for K; of C, so much more of it has to be kept."""
LOST = "lost_at_end"

Ends = dict[int, tuple[float, float]]
"""By state: where an axis begins and ends."""


def grid_ends(
    case: Case, model: PointModel, failure: Failure, grid: GridProof, budget: CpuBudget
) -> Iterator[Cause]:
    """One cause for each end of the grid at which the predicate fails and `safe` does not end."""
    wrong = failure.cells
    if wrong is None:
        return
    for k, axis in enumerate(grid.group.axes):
        low, high = axis.edges[0], axis.edges[-1]
        for side, end in ((0, low), (1, high)):
            layer = np.take(wrong, -side, axis=k)
            if not layer.any() or axis.open or axis.unbounded or axis.wraps:
                continue
            at = np.argwhere(layer)[len(np.argwhere(layer)) // 2].tolist()
            at.insert(k, wrong.shape[k] - 1 if side else 0)
            x = model.start
            for a, edges, i in zip(grid.group.axes, grid.engine.edges, at, strict=True):
                x[a.state] = (edges[i] + edges[i + 1]) / 2
            x[axis.state] = end + (high - low) * (BEYOND if side else -BEYOND)
            if model.safe(x) == TRUE:
                yield _end(case, failure, grid, k, side, budget)


def _end(
    case: Case, failure: Failure, grid: GridProof, k: int, side: int, budget: CpuBudget
) -> Cause:
    axis = grid.group.axes[k]
    low, high = axis.edges[0], axis.edges[-1]
    end, width = (low, high)[side], high - low
    wrong = failure.cells
    assert wrong is not None
    # the cells next to that end, in one piece
    others = tuple(j for j in range(wrong.ndim) if j != k)
    layers: Bools = np.asarray(wrong.any(axis=others))
    run = int(np.argmin(layers[::-1] if side else layers)) or len(layers)
    first = axis.edges[len(layers) - run] if side else axis.edges[run]
    one = (low, high + WIDER * width) if side else (low - WIDER * width, high)
    tried = None
    for wider in (one, (low - BOTH * width, high + BOTH * width)):
        zone = (first, wider[1]) if side else (wider[0], first)
        change = ProblemChange(wider={axis.state: wider})
        outcome = failing(case, grid, failure.claim, change, (k, *zone), budget.part(WIDER_S))
        tried = tried if outcome is None else (wider, *outcome)
        if outcome is None or not outcome[0]:
            break
    text = f"the grid ends at {axis.name} = {end:.6g}, where `safe` still holds: what gets there "
    text += "counts as unsafe"
    numbers: tuple[tuple[str, float], ...] = (("end", end), ("side", 1.0 if side else -1.0))
    if tried is None:
        return Cause("grid_end", text, "", numbers)
    ends, count, shape = tried
    much = f"{count:,} cells fail there" if count else "no cell fails there"
    text += f"; with one over [{ends[0]:.6g}, {ends[1]:.6g}] {much}"
    numbers += (("cells", float(count)),)
    if count:
        hint = f"keep AC away from {axis.name} = {end:.6g} as from an end of `safe`; or, where the "
        hint += "plant stops by itself, say so in its `der` by "
        hint += f"`{('max', 'min')[side]}(rate, 0.0)` from there on"
        return Cause("grid_end", text, hint, numbers)
    more = ", ".join(
        f"{a.name} in [{a.end(ends[0] if i == k else a.edges[0])}, "
        f"{a.end(ends[1] if i == k else a.edges[-1])}] / {n}"
        for i, (a, n) in enumerate(zip(grid.group.axes, shape, strict=True))
    )
    return Cause("grid_end", text, f"a wider grid: `grid {more};`", numbers)


# ---------------------------------------------------------------- K


def lost_at_ends(
    case: Case, model: PointModel, grid: GridProof, budget: CpuBudget
) -> Iterator[Cause]:
    """The ends without which SC keeps more of the same C, where there are any."""
    sides = list(_sides(model, grid))

    def share(some: list[tuple[int, int]]) -> float | None:
        change = ProblemChange(most=COARSE[1], wider=_longer(grid, some))
        outcome = kept(case, grid, change, budget.part(WIDER_S), declared=True)
        return None if outcome is None else outcome.share

    if not sides:
        return
    before, best = share([]), share(sides)
    if before is None or best is None or best < before + MORE:
        return
    for one in sides if len(sides) > 1 else ():
        fewer = [s for s in sides if s != one]
        without = share(fewer) if fewer else None
        if without is not None and without >= best - MORE and without > before + MORE:
            sides = fewer
    best = share(sides) or best
    axes, ends = grid.group.axes, _longer(grid, sides)
    named = " and ".join(f"{axes[k].name} = {axes[k].edges[-side]:.6g}" for k, side in sides)
    longer = " and ".join(
        f"{a.name} over [{ends[a.state][0]:.6g}, {ends[a.state][1]:.6g}]"
        for a in axes
        if a.state in ends
    )
    text = f"the grid ends at {named}, where `safe` still holds: what may get there counts as "
    text += f"unsafe. With {longer} SC keeps {best:.1%} of the same C, as it is {before:.1%}"
    numbers = [("share_of_C", best), ("before", before)]
    for state, (low, high) in ends.items():
        numbers += [(f"low_{state}", low), (f"high_{state}", high)]
    yield Cause(LOST, text, "", tuple(numbers))


def longer_of(cause: Cause, states: int) -> Ends:
    """The ends that a cause of `lost_at_ends` was measured with."""
    told = dict(cause.numbers)
    return {s: (told[f"low_{s}"], told[f"high_{s}"]) for s in range(states) if f"low_{s}" in told}


def _sides(model: PointModel, grid: GridProof) -> Iterator[tuple[int, int]]:
    """Axis and side (0: low) of ends where K is lost, and beyond which `safe` holds somewhere."""
    lost = grid.found.allowed & ~(grid.found.core > 0)
    for k, axis in enumerate(grid.group.axes):
        if axis.open or axis.unbounded or axis.wraps:
            continue
        far = (axis.edges[-1] - axis.edges[0]) * BEYOND
        for side, end in ((0, axis.edges[0] - far), (1, axis.edges[-1] + far)):
            at = np.argwhere(np.take(lost, -side, axis=k))
            for cell in at[[0, len(at) // 2, -1]] if len(at) else ():
                x, place = model.start, np.insert(cell, k, 0)
                for a, edges, i in zip(grid.group.axes, grid.engine.edges, place, strict=True):
                    x[a.state] = (edges[i] + edges[i + 1]) / 2
                x[axis.state] = end
                if model.safe(x) == TRUE:
                    yield k, side
                    break


def _longer(grid: GridProof, sides: list[tuple[int, int]]) -> Mapping[int, tuple[float, float]]:
    """The axes of these ends, longer there."""
    made = Ends()
    for k, side in sides:
        axis = grid.group.axes[k]
        low, high = made.get(axis.state, (axis.edges[0], axis.edges[-1]))
        more = (axis.edges[-1] - axis.edges[0]) * LONGER
        made[axis.state] = (low, high + more) if side else (low - more, high)
    return made
