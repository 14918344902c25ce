"""Grids to try: the groups of states, their ranges, their numbers of cells.

Purpose: `grid_hints` makes `grid` lines from what runs of the model reached (`model_states.py`).
States that move each other, or that `safe` compares, form a group. An axis ends where `safe` ends,
or a little beyond what was reached; its cells depend on how far a state moves until SC answers.
Non-goals: proofs on these grids; levels, which the proof chooses.
"""

from __future__ import annotations

from math import isfinite, prod
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.search.hint_text import Hints
from soter.verify.search.written_numbers import rounded_outward

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from soter.core.layout import Floats
    from soter.verify.search.model_states import ModelStates

CELLS = {1: (400,), 2: (15_000, 60_000), 3: (30_000, 120_000, 270_000), 4: (65_000, 160_000)}
"""The numbers of cells of a group to try, by the number of its axes."""
LEAST = 6
"""The fewest cells of an axis, and the largest ratio between the weights of two axes."""
BEYOND = {"near": 0.4, "far": 0.2, "wide": 1.0}
"""The share of its width by which an axis reaches beyond what runs reached, at each end."""
WIDE_TO = 2
"""For groups of no more axes than this wide grids are tried, too, as cells cost little."""


def groups_to_try(found: ModelStates, named: Collection[int] = ()) -> list[list[int]]:
    """The states that need an axis, in groups that move each other or that `safe` compares.

    States `named` by a `grid` line of the program are left out.
    """
    joined = found.rate_reads | found.rate_reads.T | found.compared_in_safe
    groups: list[list[int]] = []
    left = {int(s) for s in np.flatnonzero(found.needs_axis)} - {*named}
    while left:
        todo, group = [min(left)], set()
        while todo:
            state = todo.pop()
            if state in left:
                left.remove(state)
                group.add(state)
                todo += [s for s in left if joined[state, s]]
        groups.append(sorted(group))
    return groups


def grid_hints(
    found: ModelStates, named: Collection[int] = ()
) -> tuple[list[tuple[int, Hints]], int]:
    """Grids to try, each with its number of cells, smallest first; none for groups of many axes.

    `named` has the states that have an axis in the program. The second result is how many of the
    first grids are quick to try because their groups have few axes.
    """
    groups = groups_to_try(found, named)
    most = max(map(len, groups), default=0)
    hints: dict[Hints, int] = {}
    for cells in CELLS.get(most, ()):
        for reached in BEYOND if most <= WIDE_TO else ("near", "far"):
            lines = [_grid_line(found, group, cells, reached) for group in groups]
            made = Hints(items=tuple(x for _, x in lines), added=bool(named))
            hints.setdefault(made, sum(n for n, _ in lines))
    tries = sorted(((n, h) for h, n in hints.items()), key=lambda each: each[0])
    return tries, len(BEYOND) if most <= WIDE_TO else 0


def _grid_line(
    found: ModelStates, group: Sequence[int], cells: int, reached: str
) -> tuple[int, str]:
    """The number of cells of a grid for a group, and the `grid` line that declares it."""
    ends = [_ends_of_axis(found, state, reached) for state in group]
    sizes = np.array([high - low for low, high in ends]) / np.maximum(
        found.largest_motion_in_hold[group], 1e-12
    )
    counts = _counts_of_cells(np.sqrt(np.maximum(sizes, 1.0)), min(cells, CELLS[len(group)][-1]))
    axes = [
        f"{found.names[s]} in [{low!r}, {high!r}] / {n}"
        for s, (low, high), n in zip(group, ends, counts, strict=True)
    ]
    return prod(counts), f"grid {', '.join(axes)};"


def _counts_of_cells(weights: Floats, cells: int) -> list[int]:
    """The numbers of cells along axes, in proportion to `weights`, with about `cells` in all."""
    weights = np.minimum(weights, LEAST * weights.min())
    scale = (cells / weights.prod()) ** (1.0 / len(weights))
    return [max(LEAST, int(scale * w)) for w in weights]


def _ends_of_axis(found: ModelStates, state: int, reached: str) -> tuple[float, float]:
    low, high = (found.near if reached == "near" else found.far)[:, state]
    more = BEYOND[reached] * (high - low) or float(found.largest_motion_in_hold[state])
    safe = found.ends[state]
    return (
        float(f"{safe[0]:.9g}") if isfinite(safe[0]) else rounded_outward(low - more, up=False),
        float(f"{safe[1]:.9g}") if isfinite(safe[1]) else rounded_outward(high + more, up=True),
    )
