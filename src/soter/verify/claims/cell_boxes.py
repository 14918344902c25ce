"""Boxes of cells: where a claim failed, in a few boxes; which cells hold a box of states.

Purpose: sets of cells as boxes that people can read.
Non-goals: anything that a proof rests on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import Region
from soter.verify.enclose.periodic_states import FAR_TURNS, TURN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.verify.problem.problem import Axis, Interval

    Bools = NDArray[np.bool_]

REGIONS_MAX = 12


def regions_of(
    cells: Bools,
    names: Sequence[str],
    edges: Sequence[NDArray[np.float64]],
    parameters: Sequence[tuple[str, int]] = (),
) -> list[Region]:
    """Boxes that hold all the cells of a set: dense parts first, the rest in one box.

    `cells` has the grid's shape; `edges` are (cells + 1,) for each axis.
    """
    regions: list[Region] = []
    left = cells.copy()
    while left.any() and len(regions) < REGIONS_MAX - 1:
        box = _grown(left)
        regions.append(_region(box, names, edges, parameters))
        left[tuple(slice(a, b) for a, b in box)] = False
    if left.any():
        where = np.argwhere(left)
        box = list(zip(where.min(axis=0).tolist(), (where.max(axis=0) + 1).tolist(), strict=True))
        regions.append(_region(box, names, edges, parameters))
    return regions


def _grown(cells: Bools) -> list[tuple[int, int]]:
    """A box around the first cell, grown while the next layer on some side has one of the set."""
    first = np.unravel_index(int(np.argmax(cells)), cells.shape)
    box = [(int(i), int(i) + 1) for i in first]
    grows = True
    while grows:
        grows = False
        for axis in range(cells.ndim):
            for side in (0, 1):
                low, high = box[axis]
                layer = low - 1 if side == 0 else high
                if not 0 <= layer < cells.shape[axis]:
                    continue
                at = [slice(a, b) for a, b in box]
                at[axis] = slice(layer, layer + 1)
                if cells[tuple(at)].any():
                    box[axis] = (min(low, layer), max(high, layer + 1))
                    grows = True
    return box


def _region(
    box: Sequence[tuple[int, int]],
    names: Sequence[str],
    edges: Sequence[NDArray[np.float64]],
    parameters: Sequence[tuple[str, int]],
) -> Region:
    axes = [
        (name, float(e[a]), float(e[b])) for name, e, (a, b) in zip(names, edges, box, strict=True)
    ]
    return Region(tuple(axes), tuple(parameters))


def holding(edges: NDArray[np.float64], low: float, high: float) -> slice | None:
    """Consecutive cells whose union holds [low, high]; None where it is not inside the grid.

    `edges`: breakpoints of an axis, (cells + 1,), rising.
    """
    if low < edges[0] or high > edges[-1]:
        return None
    first = min(int(np.searchsorted(edges, low, side="right")) - 1, len(edges) - 2)
    last = max(int(np.searchsorted(edges, high, side="left")) - 1, first)
    return slice(first, last + 1)


def mesh_of(
    spans: Sequence[NDArray[np.float64]], turns: Sequence[bool], box: Sequence[Interval]
) -> list[list[int] | None]:
    """On each axis the cells that hold its interval; None where there are none.

    `turns`: whether an axis wraps around.
    """
    cells: list[list[int] | None] = []
    for edges, wraps, i in zip(spans, turns, box, strict=True):
        at = None if wraps else holding(edges, i.low, i.high)
        own = None if at is None else [*range(len(edges) - 1)[at]]
        cells.append(_holding_around(edges, i.low, i.high) if wraps else own)
    return cells


def _holding_around(edges: NDArray[np.float64], low: float, high: float) -> list[int] | None:
    """Of an axis that wraps around: what lies beyond an end is at the other one, up to a turn."""
    if not edges[0] - TURN < low <= high < edges[-1] + TURN:
        return None
    turned = [(low, high)]
    if low < edges[0]:
        turned.append((low + TURN - FAR_TURNS, high + TURN + FAR_TURNS))
    if high > edges[-1]:
        turned.append((low - TURN - FAR_TURNS, high - TURN + FAR_TURNS))
    cells: set[int] = set()
    for a, b in turned:
        at = holding(edges, max(a, edges[0]), min(b, edges[-1]))
        cells |= set(range(len(edges) - 1)[at]) if at is not None else set()
    return sorted(cells)


def drawn_edges(axes: Sequence[Axis]) -> list[NDArray[np.float64]]:
    """Edges of every axis, (n + 1,): the cell before an open end counts like the others."""
    edges_by_axis = []
    for axis in axes:
        edges = np.array(axis.edges)
        if axis.open:
            edges[-1] = edges[-2] + (edges[-2] - edges[0]) / (len(edges) - 2)
        edges_by_axis.append(edges)
    return edges_by_axis


def share(cells: Bools, edges: Sequence[NDArray[np.float64]]) -> float:
    """Share of the grid's volume; `cells` has its shape, `edges` are (cells + 1,) for each axis."""
    weight = cells.astype(np.float64)
    for e in reversed(edges):
        # not `@`: BLAS has a thread a core for that, and they spin for a while afterwards
        weight = np.einsum("...i,i", weight, np.diff(e) / (e[-1] - e[0]))
    return float(weight)
