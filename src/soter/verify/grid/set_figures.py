"""Figures of the sets of a grid, which show the paper's regions R1 to R5.

Purpose: `region_of_each_cell` gives each cell of a group its region, and `figure_of_regions` makes
a figure of the first two axes, with slices through the third. `deepest_cell` finds a state deep in
C. `volume_share` is the part of a grid that some cells have.
Non-goals: anything that a proof rests on; drawing (`report/proof_page.py`). Symbols: `sets.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof_page import R1, R2, R3, R4, R5, RegionFigure, RegionSlice

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Bools
    from soter.verify.claims.results import GroupSets
    from soter.verify.problem.problem import Axis


def drawn_edges(axes: Sequence[Axis]) -> list[NDArray[np.float64]]:
    """The edges (n + 1,) of each axis; an open end's cell is drawn as long as the mean cell."""
    edges_by_axis = []
    for axis in axes:
        edges = np.array(axis.edges)
        if axis.open:
            edges[-1] = edges[-2] + (edges[-2] - edges[0]) / (len(edges) - 2)
        edges_by_axis.append(edges)
    return edges_by_axis


def volume_share(cells: Bools, edges: Sequence[NDArray[np.float64]]) -> float:
    """The volume of the set `cells` as a share of the grid's; `edges` are (cells + 1,) per axis."""
    weight = cells.astype(np.float64)
    for e in reversed(edges):
        # not `@`: BLAS has a thread a core for that, and they spin for a while afterwards
        weight = np.einsum("...i,i", weight, np.diff(e) / (e[-1] - e[0]))
    return float(weight)


def deepest_cell(part: GroupSets) -> dict[int, float]:
    """The middle of a cell far inside C, as a value for each state; empty if C is empty."""
    left = part.allowed
    while True:
        inner = left.copy()
        for axis in range(inner.ndim):
            n = inner.shape[axis]
            if n < 3:
                continue
            inner &= np.roll(left, 1, axis) & np.roll(left, -1, axis)
            edge = np.moveaxis(inner, axis, 0)  # a view
            edge[[0, n - 1]] = False
        if not inner.any() or np.array_equal(inner, left):
            break  # axes of one or two cells have no inside, and take nothing away
        left = inner
    if not left.any():
        return {}
    cells = np.argwhere(left)
    at = cells[np.abs(cells - cells.mean(axis=0)).sum(axis=1).argmin()]
    every = zip(part.group.axes, part.edges, at, strict=True)
    return {a.state: (e[i] + e[i + 1]) / 2 for a, e, i in every}


SLICES_MAX = 24
"""The most slices of a figure with three axes; each takes some kB of the page."""


def region_of_each_cell(sets: GroupSets) -> NDArray[np.uint8]:
    """The region (R1 to R5) of every cell of a group, in the grid's shape."""
    region_ids = np.full(sets.allowed.shape, R1, dtype=np.uint8)
    region_ids[sets.allowed] = R2
    region_ids[sets.core > 0] = R3
    if sets.free is not None:
        region_ids[sets.free] = R4
        if sets.gives_back is not None:
            region_ids[sets.free & sets.gives_back] = R5
    return region_ids


def figure_of_regions(sets: GroupSets, note: str) -> RegionFigure:
    """A figure of the first two axes, at that place on further axes where most cells may be AC's.

    A third axis has up to `SLICES_MAX` slices.
    """
    axes, drawn = sets.group.axes, drawn_edges(sets.group.axes)
    cells, lets_ac = region_of_each_cell(sets), sets.lets_ac
    at = place_that_shows_most(cells)
    fourth = [_cell_in_words(a, i) for a, i in zip(axes[3:], at[1:], strict=True)]
    open_ends = [f"{a.name} goes on to {a.edges[-1]:g}" for a in axes[:2] if a.open]
    text = "; ".join(filter(None, (note, ", ".join(fourth), *open_ends)))
    x, unit = drawn[0], axes[0].unit
    if len(axes) == 1:
        y = np.array([0.0, 1.0])
        return RegionFigure(
            axes[0].name,
            axes[0].name,
            "",
            x,
            y,
            cells[:, None],
            text,
            x_unit=unit,
            lets_ac=None if lets_ac is None else lets_ac[:, None],
        )
    cut: tuple[slice | int, ...] = (slice(None), slice(None), slice(None), *at[1:])
    through = cells[cut] if at else cells
    ttf = None if lets_ac is None else lets_ac[cut] if at else lets_ac

    def ac_at(i: int) -> NDArray[np.bool_] | None:
        return None if ttf is None else ttf[:, :, i]

    indices = _slice_numbers(cells.shape[2], at[0]) if at else []
    return RegionFigure(
        title=f"{axes[0].name} and {axes[1].name}",
        x_name=axes[0].name,
        y_name=axes[1].name,
        x_edges=x,
        y_edges=drawn[1],
        regions=through[:, :, at[0]] if at else cells,
        note=text,
        x_unit=unit,
        y_unit=axes[1].unit,
        across=axes[2].name if at else "",
        slices=tuple(
            RegionSlice(_cell_in_words(axes[2], i), through[:, :, i], ac_at(i)) for i in indices
        ),
        shown=indices.index(at[0]) if at else 0,
        lets_ac=ac_at(at[0]) if at else ttf,
    )


def place_that_shows_most(cells: NDArray[np.uint8]) -> tuple[int, ...]:
    """The indices, from the third axis on, at which most cells of the first two may be AC's.

    Places where AC gets control back come first, so that no region that has cells is left out.
    Among equals the place with most cells in K counts, then in C, then the one nearest the middle.
    `cells`: the regions, in the grid's shape.
    """
    if cells.ndim < 3:
        return ()
    counts = [np.count_nonzero(cells >= least, axis=(0, 1)) for least in (R2, R3, R4)]
    places = np.indices(counts[0].shape).reshape(len(counts[0].shape), -1)
    middle = (np.array(counts[0].shape)[:, None] - 1) / 2
    off = np.abs(places - middle).sum(axis=0)
    back = np.any(cells >= R5, axis=(0, 1)).ravel()
    best = np.lexsort((-off, *(c.ravel() for c in counts), back))[-1]
    return tuple(int(i) for i in places[:, best])


def _slice_numbers(count: int, shown: int) -> list[int]:
    """The numbers of the slices to draw, out of `count`; both ends and `shown` are included."""
    even = np.linspace(0, count - 1, min(count, SLICES_MAX)).round().astype(int)
    return sorted({*even.tolist(), shown})


def _cell_in_words(axis: Axis, index: int) -> str:
    """The range of a cell of an axis, in words."""
    unit = f" {axis.unit}" if axis.unit else ""
    return f"{axis.name} in [{axis.edges[index]:.4g}, {axis.edges[index + 1]:.4g}]{unit}"
