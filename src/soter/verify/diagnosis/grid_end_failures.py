"""What fails at an end of the grid that only the grid makes: `ttf`, `safer`, or K is lost there.

Purpose: cells at an end beyond which `safe` still holds, as where the plant stops by itself: what
gets there counts as unsafe. Whether a wider grid shows the inclusion there, measured.
Where the flow comes to rest at such an end no run leaves there, but what encloses it does: whether
a longer axis keeps more is measured, too.
Non-goals: verdicts; ends by which runs leave (`exit_faces.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import Cause
from soter.verify.diagnosis.experiments import COARSE, ProblemChange, failing, kept
from soter.verify.diagnosis.model_runs import TRUE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.diagnosis.model_runs import PointModel
    from soter.verify.grid.claims import GridProof

    Bools = NDArray[np.bool_]

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
