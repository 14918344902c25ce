"""Why the declared start is not among the states that are proved, and which would be.

Purpose: a start outside the grid, outside K, or from which SC comes too late: which state, its
value, how far the set reaches along that state, and what to write.
Non-goals: verdicts; polytopes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.durations import show_ns
from soter.verify.claims.cell_boxes import mesh_of
from soter.verify.claims.results import Cause
from soter.verify.diagnosis.experiments import axis_names, longest
from soter.verify.diagnosis.model_runs import FALSE, PointModel

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.sets import GridGroup
    from soter.verify.problem.problem import Interval

    Bools = NDArray[np.bool_]


def start_margins(case: Case, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    """Where the start lies, and where it would have to lie."""
    names = axis_names(case, engine)
    ends = [case.problem.initial[s] for s in engine.axes]
    box = mesh_of(engine.edges, engine.turns, ends)
    outside = [k for k, b in enumerate(box) if b is None]
    if outside:
        yield _outside(case, engine, outside)
        return
    at = [b for b in box if b is not None]
    core = part.core > 0
    if not core[np.ix_(*at)].all():
        yield _apart(case, engine, core, at, names, ends)
        return
    h0 = case.problem.times.start
    good = longest(case, engine, core, h0, lambda reach: bool(reach[np.ix_(*at)].all()))
    text = f"the start lies in K, and SC would be in time if it acted within {show_ns(good)}"
    text += f"; it acts within {show_ns(h0)}"
    in_time = engine.safe_for(case.problem.in_horizon(h0), core)
    numbers = (("in_time_s", good / 1e9), ("acts_s", h0 / 1e9))
    moved = _apart(case, engine, in_time, at, names, ends, "it is in time from")
    text += f"; {moved.text}"
    yield Cause("start_late", text, moved.hint, (*numbers, *moved.numbers))


def _outside(case: Case, engine: GridGroup, axes: list[int]) -> Cause:
    """Not even in the grid: whether that is the grid's fault."""
    names = axis_names(case, engine)
    said = []
    for k in axes:
        start, edges = case.problem.initial[engine.axes[k]], engine.edges[k]
        where = f"{names[k]} in [{edges[0]:.6g}, {edges[-1]:.6g}]"
        said.append(f"{_value(names[k], start)}, outside the grid, which is {where}")
    text, grid = "; ".join(said), "a `grid` that holds the start"
    model = PointModel(case)
    if model.safe(model.start) == FALSE:
        text += "; `safe` is false there"
        grid = "a `safe` that holds at the start, with a `grid` that holds it"
    middle = f"{(engine.edges[axes[0]][0] + engine.edges[axes[0]][-1]) / 2:.6g}"
    return Cause("start_outside", text, f"{grid}, or {_written(names[axes[0]], middle)}")


def _apart(
    case: Case,
    engine: GridGroup,
    cells: Bools,
    at: list[list[int]],
    names: list[str],
    ends: list[Interval],
    what: str = "SC was shown to keep `safe` from",
) -> Cause:
    """The start is not in a set of cells: along which state it is nearest, and how far it reaches.

    All other states stay as they start; where that is nowhere in the set, its nearest state.
    """
    best: tuple[float, int, float, float] | None = None
    for k, edges in enumerate(engine.edges):
        others = tuple(j for j in range(cells.ndim) if j != k)
        places = [[*range(len(edges) - 1)] if j == k else b for j, b in enumerate(at)]
        line = cells[np.ix_(*places)].all(axis=others)
        turns = np.flatnonzero(np.diff(np.concatenate(([0], line.astype(np.int8), [0]))))
        for a, b in zip(turns[::2], turns[1::2], strict=True):
            low, high = float(edges[a]), float(edges[b])
            far = max(ends[k].high - high, low - ends[k].low, 0.0) / float(edges[-1] - edges[0])
            if best is None or far < best[0]:
                best = far, k, low, high
    if best is None:
        return _nearest(case, engine, cells)
    _, k, low, high = best
    text = f"{_value(names[k], ends[k])}; with everything else as at the start {what} "
    text += f"{names[k]} in [{low:.6g}, {high:.6g}]"
    # a border belongs to both of its sides, and the declared grid has larger cells than one that
    # was refined around this start: a whole one of those inside
    width = min(float(np.diff(engine.edges[k]).max()), (high - low) / 4)
    inside = min(max(ends[k].low, low + width), high - width)
    hint = (
        f"{_written(names[k], f'{inside:.6g}')} or further inside; an SC that is stronger or sooner"
    )
    numbers = (("low", low), ("high", high), ("inside", inside))
    return Cause("start_not_in_core", text, hint, numbers)


def _nearest(case: Case, engine: GridGroup, core: Bools) -> Cause:
    """No one state brings it there: the nearest state, in widths of the grid."""
    cells = np.argwhere(core)
    if not len(cells):
        return Cause("start_not_in_core", "no start is in time: the set is empty")
    ends = [case.problem.initial[s] for s in engine.axes]
    x = np.array([i.low / 2 + i.high / 2 for i in ends])
    low = np.stack([e[cells[:, k]] for k, e in enumerate(engine.edges)], axis=1)
    high = np.stack([e[cells[:, k] + 1] for k, e in enumerate(engine.edges)], axis=1)
    nearest = np.clip(x, low, high)
    width = np.array([e[-1] - e[0] for e in engine.edges])
    best = nearest[int(np.argmin(np.abs((nearest - x) / width).max(axis=1)))]
    names = axis_names(case, engine)
    here = ", ".join(_value(n, i) for n, i in zip(names, ends, strict=True))
    where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, best, strict=True))
    text = "the start is not in K: SC was not shown to keep `safe` from it "
    return Cause("start_not_in_core", f"{text}({here}); K is nearest at {where}")


def _value(name: str, start: Interval) -> str:
    until = f" to {start.high:.6g}" if start.high > start.low else ""
    return f"{name} starts at {start.low:.6g}{until}"


def _written(name: str, value: str) -> str:
    """What to write: the state's own line in its plant."""
    return f"`state {name.rpartition('.')[2]}: float = {value};` in the plant"
