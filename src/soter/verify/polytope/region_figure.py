"""The paper's regions R1 to R5 of a polytope group, by points.

Purpose: a figure of the first two states.
Non-goals: drawing (`report/proof/page.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof.record import R1, R2, R3, R4, R5, RegionFigure
from soter.verify.polytope.half_spaces import inner_point

if TYPE_CHECKING:
    from soter.verify.claims.results import PolytopePart

PIXELS = 160
"""Points a side of a figure."""


def figures(part: PolytopePart, note: str) -> list[RegionFigure]:
    """A polytope's regions over its first two states, the others in the middle of K."""
    sets, axes = part.sets, part.group.axes
    if sets is None or (centre := inner_point(sets.core)) is None:
        return []
    edges = [np.linspace(a.edges[0], a.edges[-1], PIXELS + 1) for a in axes[:2]]
    middles = [(e[:-1] + e[1:]) / 2 for e in edges]
    points = np.tile(centre, (PIXELS ** len(edges), 1))
    for k, values in enumerate(np.meshgrid(*middles, indexing="ij")):
        points[:, k] = values.ravel()
    region_ids = np.full(len(points), R1, dtype=np.uint8)
    low, high = np.array(part.limits).T
    region_ids[((points >= low) & (points <= high)).all(axis=1)] = R2
    for region, p in ((R3, sets.core), (R4, sets.free)):
        region_ids[p.contains(points)] = region
    if sets.allowed:
        region_ids[sets.free.contains(points) & sets.safer.contains(points)] = R5
    cuts = [
        f"{a.name} = {x:.4g} {a.unit}".rstrip() for a, x in zip(axes[2:], centre[2:], strict=True)
    ]
    text = "; ".join(filter(None, (note, ", ".join(cuts), "drawn from half-spaces, by points")))
    regions = region_ids.reshape([PIXELS] * len(edges))
    names, units = [a.name for a in axes], [a.unit for a in axes]
    if len(axes) == 1:
        y = np.array([0.0, 1.0])
        one = regions[:, None]
        return [RegionFigure(names[0], names[0], "", edges[0], y, one, text, x_unit=units[0])]
    title = f"{names[0]} and {names[1]}"
    figure = RegionFigure(title, names[0], names[1], edges[0], edges[1], regions, text)
    return [replace(figure, x_unit=units[0], y_unit=units[1])]
