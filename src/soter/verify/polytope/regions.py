"""Regions of polytope groups: where predicates hold, on boxes and on states that are drawn.

Purpose: `box_where_true` finds ranges over which a predicate surely holds, `box_outside_free` a box
where it may let AC have control outside R(H). `shares` says how large the sets are, for people;
`figures` decides the paper's region, R1 to R5, of points over the group's first two states.
Non-goals: proofs about sets (`proofs.py`); drawing (`report/proof_page.py`).

A predicate is compared with R(H) on boxes: for a linear function the worst point of a box is one of
its corners, so that a box inside all half-spaces lies in R(H); others are halved.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof_page import R1, R2, R3, R4, R5, RegionFigure
from soter.verify.claims.product_sets import points_to_try
from soter.verify.claims.results import Region
from soter.verify.polytope.half_spaces import LinearProgram, inner_point
from soter.verify.polytope.matrices import centred, exact, up_product, up_sum
from soter.verify.polytope.tables import drawn_states

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.layout import Floats
    from soter.verify.claims.results import PolytopePart
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.polytope.half_spaces import Polytope
    from soter.verify.problem.problem import Problem

    Box = dict[int, tuple[float, float]]


BISECTIONS = 50
BOXES_MAX = 60_000
"""The most boxes that are examined to compare a predicate with R(H)."""
SMALLEST = 2.0**-14
"""A box that is still undecided at this share of the group's ranges is where the claim fails."""
SAMPLES_OF_PREDICATES = 4_000
MAY = {"ttf": 1, "safer": 2}
"""The bit of a predicate's truth that means: an estimate may let AC have control."""


def box_where_true(
    forms: CompiledEnclosures, problem: Problem, predicate: str, ends: Box
) -> Box | None:
    """Ranges inside `ends` over which a predicate surely holds, all else at a point; None: none."""
    n = len(problem.states)
    for point in points_to_try(problem):
        base = forms.whole.copy()
        base[:n, 0] = base[:n, 1] = point
        box_outside_free = any(not low <= point[s] <= high for s, (low, high) in ends.items())
        if box_outside_free or not forms.true(predicate, base):
            continue

        def fine(ranges: Box, base: Floats = base) -> bool:
            box = base.copy()
            for s, r in ranges.items():
                box[s] = r
            return forms.true(predicate, box)

        inner_ranges: Box = {}
        for s, (low, high) in ends.items():
            p = float(point[s])
            inner_ranges[s] = (
                _bisected(p, low, lambda x, s=s, p=p: fine({s: (x, p)})),  # type: ignore[misc]
                _bisected(p, high, lambda x, s=s, p=p: fine({s: (p, x)})),  # type: ignore[misc]
            )

        def part(share: float, inner_ranges: Box = inner_ranges, point: Floats = point) -> Box:
            return {
                s: (point[s] + share * (a - point[s]), point[s] + share * (b - point[s]))
                for s, (a, b) in inner_ranges.items()
            }

        if fine(inner_ranges):
            return inner_ranges
        share = _bisected(0.0, 1.0, lambda x: fine(part(x)))
        if share > 0.0:
            return part(share)
    return None


def _bisected(start: float, end: float, fine: Callable[[float], bool]) -> float:
    """The farthest point found from `start` towards `end` at which a test holds, as at `start`."""
    if fine(end):
        return end
    good, bad = start, end
    for _ in range(BISECTIONS):
        middle = good / 2 + bad / 2
        good, bad = (middle, bad) if fine(middle) else (good, middle)
    return good


def box_outside_free(
    forms: CompiledEnclosures, problem: Problem, part: PolytopePart, predicate: str
) -> Region | None:
    """A box of C where a predicate may let AC have control and R(H) was not shown, if any."""
    assert part.sets is not None
    names = problem.quantities.states
    own = [a.state for a in part.group.axes]
    rows, limits = part.sets.free.faces
    sizes, balls = np.abs(rows), exact(rows)
    first = np.array(part.limits, dtype=np.float64)
    width = np.maximum(first[:, 1] - first[:, 0], 1e-300)
    todo = [(first, 0)]
    looked = 0
    while todo:
        box, depth = todo.pop()
        looked += 1
        whole = forms.whole.copy()
        whole[own] = box
        if not forms.truth(predicate, whole) & MAY[predicate]:
            continue
        centre, radius = centred(box[:, 0], box[:, 1])
        flat = (balls @ exact(centre[:, None])).upper()[:, 0]
        excess = up_sum(flat, up_product(sizes, radius)) - limits
        if (excess <= 0).all():
            continue
        shares = (box[:, 1] - box[:, 0]) / width
        if looked > BOXES_MAX or shares.max() < SMALLEST:
            ends = zip(own, box, strict=True)
            return Region(tuple((names[s].name, float(a), float(b)) for s, (a, b) in ends))
        weight = sizes[int(np.argmax(excess))] * radius if depth % 2 else shares
        weight = np.where(shares >= SMALLEST, weight, -1.0)
        k = int(np.argmax(weight))
        middle = box[k, 0] / 2 + box[k, 1] / 2
        for end in (1, 0):
            half = box.copy()
            half[k, end] = middle
            todo.append((half, depth + 1))
    part.boxes[predicate] = looked
    return None


def shares(forms: CompiledEnclosures, problem: Problem, part: PolytopePart) -> dict[str, float]:
    """The shares of a group's ranges that its sets have, by samples; empty without a K."""
    if part.sets is None:
        return {}
    points = drawn_states(part.group)
    share_by_name = {
        "core": float(part.sets.core.contains(points).mean()),
        "free": float(part.sets.free.contains(points).mean()),
    }
    if part.deployed is not None:
        for name, s in zip(("lets_ac", "gives_back"), part.deployed, strict=True):
            share_by_name[name] = float(s.contains(points).mean())
        share_by_name["estimates"] = share_by_name["lets_ac"]
    elif not problem.computed:
        few = points[:SAMPLES_OF_PREDICATES]
        share_by_name["lets_ac"] = _share_of_points(forms, part, "ttf", few)
        share_by_name["gives_back"] = _share_of_points(forms, part, "safer", few)
    return share_by_name


def _share_of_points(
    forms: CompiledEnclosures, part: PolytopePart, predicate: str, points: Floats
) -> float:
    """The share of points at whose estimates a predicate may let AC have control."""
    own = [a.state for a in part.group.axes]
    box = forms.whole.copy()
    count = 0
    for point in points:
        box[own, 0] = box[own, 1] = point
        count += bool(forms.truth(predicate, box) & MAY[predicate])
    return count / len(points)


def random_points(p: Polytope, chance: np.random.Generator, count: int) -> Floats:
    """Random points (count, n) of a polytope: uniform if possible, else mixtures of extremes."""
    low, high = np.maximum(p.low, -1e300), np.minimum(p.high, 1e300)
    points = chance.uniform(low, high, (50 * count, len(low)))
    random_points = points[p.contains(points)][:count]
    if len(random_points) == count:
        return np.asarray(random_points)
    program, eye = LinearProgram(p), np.eye(len(low))
    extremes = np.array([program.greatest(row)[1] for row in np.concatenate([eye, -eye, p.rows])])
    weights = chance.dirichlet(np.full(len(extremes), 0.3), count)
    return np.asarray(weights @ extremes)


PIXELS = 160
"""How many points a side of a figure has."""


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
