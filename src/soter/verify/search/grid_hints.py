"""Grids to try: which states stand together, over which ranges, on how many cells.

Purpose: `grid_hints` makes `grid` lines of what runs of the model reached (`model_states.py`): a
group for states that move each other or that `safe` compares; ends where `safe` ends, else a little
beyond what was reached; cells by how far a state moves until SC answers.
Non-goals: whether anything is proved on them; levels, which the proof chooses.
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
"""The fewest cells of an axis, and the most times as many as another one has."""
BEYOND = {"near": 0.4, "far": 0.2, "wide": 1.0}
"""By how much of its width an axis reaches beyond what runs reached, at either end."""
WIDE_TO = 2
"""Up to so many axes of a group wide ones are tried, too: there a cell more costs little."""


def groups_to_try(found: ModelStates, named: Collection[int] = ()) -> list[list[int]]:
    """The states that need an axis, in groups: those that move each other or that `safe` compares.

    States that are `named` by a line of the program are left out.
    """
    joined = found.reads | found.reads.T | found.compared
    groups: list[list[int]] = []
    left = {int(s) for s in np.flatnonzero(found.needed)} - {*named}
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
    """Grids to try with their numbers of cells, those with fewer first; none for large groups.

    `named`: the states of which lines of the program have an axis. The second result is how many of
    the first grids are quick, as no more than two axes are in a group.
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
    """The number of cells and the `grid` line of a group."""
    ends = [_ends_of_axis(found, state, reached) for state in group]
    sizes = np.array([high - low for low, high in ends]) / np.maximum(found.steps[group], 1e-12)
    counts = _counts_of_cells(np.sqrt(np.maximum(sizes, 1.0)), min(cells, CELLS[len(group)][-1]))
    axes = [
        f"{found.names[s]} in [{low!r}, {high!r}] / {n}"
        for s, (low, high), n in zip(group, ends, counts, strict=True)
    ]
    return prod(counts), f"grid {', '.join(axes)};"


def _counts_of_cells(weights: Floats, cells: int) -> list[int]:
    """Numbers of cells along axes in proportion to their weights, no more than `cells` in all."""
    weights = np.minimum(weights, LEAST * weights.min())
    scale = (cells / weights.prod()) ** (1.0 / len(weights))
    return [max(LEAST, int(scale * w)) for w in weights]


def _ends_of_axis(found: ModelStates, state: int, reached: str) -> tuple[float, float]:
    low, high = (found.near if reached == "near" else found.far)[:, state]
    more = BEYOND[reached] * (high - low) or float(found.steps[state])
    safe = found.ends[state]
    return (
        float(f"{safe[0]:.9g}") if isfinite(safe[0]) else rounded_outward(low - more, up=False),
        float(f"{safe[1]:.9g}") if isfinite(safe[1]) else rounded_outward(high + more, up=True),
    )
