"""The run of the model that leaves C soonest, as figures of a report.

Purpose: the axis by which it leaves over time, and where its group has two axes or more the plane
of two of them; C as of the cells in which the run starts.
Non-goals: finding the run (`model_runs.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof.record import R1, R2, RegionFigure, Trajectory
from soter.verify.grid.region_figure import regions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from soter.verify.claims.results import GroupSets, LeavingRun, ModuleResult

    Floats = NDArray[np.float64]

ROOM = 0.06
"""Drawn beyond the grid, as a share of it: there the run ends."""


def leaving_figures(m: ModuleResult, run: LeavingRun) -> Iterator[RegionFigure]:
    """One figure over time; a second one, in the plane of two states, where there is one."""
    axis = run.names.index(run.axis)
    sets = next(
        (g for c in m.cases if c.parameter == run.parameter for g in c.groups if _has(g, axis)),
        None,
    )
    if sets is None:
        extent = m.problem.states[axis]
        edges, inside = np.array([extent.low, extent.high]), np.array([R2], dtype=np.uint8)
    else:
        k = [a.state for a in sets.group.axes].index(axis)
        edges = np.asarray(sets.group.axes[k].edges)
        inside = np.moveaxis(regions(sets), k, 0)
        inside = _cut(inside, 1, _at_start(sets, run, (k,)))
    edges, inside = _padded(edges, inside)
    end = float(run.time_s[-1])
    time = np.array([0.0, end * (1 + ROOM)])
    states = np.clip(run.states[:, axis], edges[0], edges[-1])
    none = np.zeros(len(states), dtype=np.bool_)
    drawn = Trajectory(run.time_s, states, none, leaves=True)
    yield RegionFigure(
        title=f"{run.axis} over time",
        x_name="time",
        x_unit="s",
        y_name=run.axis,
        y_unit=m.problem.quantities.states[axis].unit,
        x_edges=time,
        y_edges=edges,
        regions=inside[None, :],
        note="",
        trajectory=drawn,
    )
    if sets is not None and len(sets.group.axes) > 1:
        yield _plane(sets, run, axis)


def _has(sets: GroupSets, state: int) -> bool:
    return any(a.state == state for a in sets.group.axes)


def _at_start(sets: GroupSets, run: LeavingRun, without: tuple[int, ...]) -> tuple[int, ...]:
    """Cells of the start along the axes that are not drawn."""
    indices = []
    for k, a in enumerate(sets.group.axes):
        if k not in without:
            i = int(np.searchsorted(a.edges, run.states[0][a.state], side="right")) - 1
            indices.append(min(max(i, 0), len(a.edges) - 2))
    return tuple(indices)


def _cut(cells: NDArray[np.uint8], axis: int, at: tuple[int, ...]) -> NDArray[np.uint8]:
    """The slice through these cells of the axes from `axis` on."""
    for i in at:
        cells = np.take(cells, i, axis=axis)
    return cells


def _padded(edges: Floats, cells: NDArray[np.uint8]) -> tuple[Floats, NDArray[np.uint8]]:
    """A margin outside the grid, along the first axis of the cells."""
    room = ROOM * (edges[-1] - edges[0])
    outside = np.full((1, *cells.shape[1:]), R1, dtype=np.uint8)
    wider = np.concatenate([[edges[0] - room], edges, [edges[-1] + room]])
    return wider, np.concatenate([outside, cells, outside])


def _plane(sets: GroupSets, run: LeavingRun, axis: int) -> RegionFigure:
    """The axis by which it leaves, and the first other one of its group."""
    axes = sets.group.axes
    k = [a.state for a in axes].index(axis)
    other = 0 if k else 1
    first, second = sorted((k, other))
    cells = np.moveaxis(regions(sets), (first, second), (0, 1))
    cells = _cut(cells, 2, _at_start(sets, run, (first, second)))
    x, cells = _padded(np.asarray(axes[first].edges), cells)
    y, turned = _padded(np.asarray(axes[second].edges), cells.T)
    xs = np.clip(run.states[:, axes[first].state], x[0], x[-1])
    ys = np.clip(run.states[:, axes[second].state], y[0], y[-1])
    none = np.zeros(len(xs), dtype=np.bool_)
    names = axes[first].name, axes[second].name
    title, drawn = f"{names[0]} and {names[1]}", Trajectory(xs, ys, none, leaves=True)
    return RegionFigure(
        title, *names, x, y, turned.T, trajectory=drawn, x_unit=axes[first].unit,
        y_unit=axes[second].unit,
    )  # fmt: skip
