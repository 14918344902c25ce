"""The paper's regions R1 to R5 of a group's cells, and the figure of them.

Purpose: from the sets of a group to one number a cell; the first two axes as a figure.
Non-goals: drawing (`report/proof/regions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof.record import R1, R2, R3, R4, R5, RegionFigure
from soter.verify.claims.cell_boxes import drawn_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.claims.results import GroupSets


def regions(sets: GroupSets) -> NDArray[np.uint8]:
    """R1 to R5 for every cell of a group, in the grid's shape."""
    region_ids = np.full(sets.allowed.shape, R1, dtype=np.uint8)
    region_ids[sets.allowed] = R2
    region_ids[sets.core > 0] = R3
    if sets.free is not None:
        region_ids[sets.free] = R4
        if sets.gives_back is not None:
            region_ids[sets.free & sets.gives_back] = R5
    return region_ids


def figure(sets: GroupSets, note: str) -> RegionFigure:
    """The first two axes; further ones are cut where the state is nearest to the middle."""
    axes, drawn = sets.group.axes, drawn_edges(sets.group.axes)
    region_ids = regions(sets)
    cuts: list[str] = []
    for k, axis in enumerate(axes[2:]):
        edges = np.asarray(axis.edges)
        middle = int(np.argmin(np.abs((edges[:-1] + edges[1:]) / 2.0)))
        region_ids = np.take(region_ids, [middle], axis=2).reshape(
            *region_ids.shape[:2], *region_ids.shape[3:]
        )
        cuts.append(f"{axes[2 + k].name} in [{edges[middle]:.4g}, {edges[middle + 1]:.4g}]")
    text = "; ".join(filter(None, (note, ", ".join(cuts))))
    open_ends = [f"{a.name} goes on to {a.edges[-1]:g}" for a in axes[:2] if a.open]
    text = "; ".join(filter(None, (text, *open_ends)))
    x = drawn[0]
    if len(axes) == 1:
        return RegionFigure(
            axes[0].name, axes[0].name, "", x, np.array([0.0, 1.0]), region_ids[:, None], text
        )
    y = drawn[1]
    title = f"{axes[0].name} and {axes[1].name}"
    return RegionFigure(title, axes[0].name, axes[1].name, x, y, region_ids, text)
