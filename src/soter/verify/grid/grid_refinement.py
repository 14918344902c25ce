"""Cells of grids: boxes of cells, finer or coarser grids, an estimate of the proof's time.

Purpose: `regions_of` gives boxes around a set of cells, for people; `cells_around_box` the cells
that hold a box of states. `refined_groups` splits the cells near those where claims fail.
`finer_problem` halves all cells, `coarser_problem` merges them.
`announce_work` measures the first case on two grids of merged cells, and from them estimates the
time for the declared grid. A user who sees progress is told it if it is long.
Non-goals: verdicts (another grid is only a new attempt); sets (`verify/grid/sets.py`). The
estimate leaves out finer grids, and what follows the sets, such as counterexamples.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from itertools import islice
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.current_phase import announce, lasting, passing_phase
from soter.verify.claims.results import Region
from soter.verify.enclose.enclosed_operations import FAR_TURNS, TURN
from soter.verify.grid.group_model import UnboundedError
from soter.verify.problem.extract import parameter_cases

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Bools
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Axis, Group, Interval, Problem

    Settle = Callable[[Problem, tuple[int, ...]], object]


REGIONS_MAX = 12


def regions_of(
    cells: Bools,
    names: Sequence[str],
    edges: Sequence[NDArray[np.float64]],
    parameters: Sequence[tuple[str, int]] = (),
) -> list[Region]:
    """Boxes that together hold all cells of a set; the last box may hold other cells, too.

    `cells` has the grid's shape; `edges` are (cells + 1,) for each axis.
    """
    regions: list[Region] = []
    left = cells.copy()
    while left.any() and len(regions) < REGIONS_MAX - 1:
        box = _grown_box(left)
        regions.append(_region_of_box(box, names, edges, parameters))
        left[tuple(slice(a, b) for a, b in box)] = False
    if left.any():
        where = np.argwhere(left)
        box = list(zip(where.min(axis=0).tolist(), (where.max(axis=0) + 1).tolist(), strict=True))
        regions.append(_region_of_box(box, names, edges, parameters))
    return regions


def _grown_box(cells: Bools) -> list[tuple[int, int]]:
    """A box around the first cell of a set; it grows while a neighbouring layer has a cell."""
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
                slices = [slice(a, b) for a, b in box]
                slices[axis] = slice(layer, layer + 1)
                if cells[tuple(slices)].any():
                    box[axis] = (min(low, layer), max(high, layer + 1))
                    grows = True
    return box


def _region_of_box(
    box: Sequence[tuple[int, int]],
    names: Sequence[str],
    edges: Sequence[NDArray[np.float64]],
    parameters: Sequence[tuple[str, int]],
) -> Region:
    axes = [
        (name, float(e[a]), float(e[b])) for name, e, (a, b) in zip(names, edges, box, strict=True)
    ]
    return Region(tuple(axes), tuple(parameters))


def cells_around_interval(edges: NDArray[np.float64], low: float, high: float) -> slice | None:
    """The consecutive cells that cover [low, high]; None if the interval leaves the grid.

    `edges` has the increasing breakpoints of an axis, of shape (cells + 1,).
    """
    if low < edges[0] or high > edges[-1]:
        return None
    first = min(int(np.searchsorted(edges, low, side="right")) - 1, len(edges) - 2)
    last = max(int(np.searchsorted(edges, high, side="left")) - 1, first)
    return slice(first, last + 1)


def cells_around_box(
    spans: Sequence[NDArray[np.float64]], turns: Sequence[bool], box: Sequence[Interval]
) -> list[list[int] | None]:
    """The cells of each axis that hold its interval of `box`; None where it leaves the grid.

    `spans`: edges of each axis, (cells + 1,); `turns`: whether an axis wraps around.
    """
    cells: list[list[int] | None] = []
    for edges, wraps, i in zip(spans, turns, box, strict=True):
        at = None if wraps else cells_around_interval(edges, i.low, i.high)
        cells_on_axis = None if at is None else [*range(len(edges) - 1)[at]]
        cells.append(_cells_around_wrapping(edges, i.low, i.high) if wraps else cells_on_axis)
    return cells


def _cells_around_wrapping(edges: NDArray[np.float64], low: float, high: float) -> list[int] | None:
    """The cells that hold [low, high] on an axis whose ends meet; None: it is too far out."""
    if not edges[0] - TURN < low <= high < edges[-1] + TURN:
        return None
    turned = [(low, high)]
    if low < edges[0]:
        turned.append((low + TURN - FAR_TURNS, high + TURN + FAR_TURNS))
    if high > edges[-1]:
        turned.append((low - TURN - FAR_TURNS, high - TURN + FAR_TURNS))
    cells: set[int] = set()
    for a, b in turned:
        at = cells_around_interval(edges, max(a, edges[0]), min(b, edges[-1]))
        cells |= set(range(len(edges) - 1)[at]) if at is not None else set()
    return sorted(cells)


CELLS_MAX = 4_000_000
"""The most cells that a refined group may have."""
BORDER_MAX = 0.1
"""Where a claim fails on a larger share of the cells, it fails not only at borders."""
AROUND = 2
"""The number of cells on each side of a failing cell that are split, too."""


def refined_groups(case: Case) -> tuple[Group, ...] | None:
    """The groups with cells split near failing cells; None if useless or with too many cells."""
    wrong = _failing_cells(case)
    if not wrong:
        return None
    groups = []
    for proof in case.proofs:
        cells = wrong.get(id(proof))
        finer = proof.group if cells is None else _group_with_split_intervals(proof.group, cells)
        if finer is None:
            return None
        groups.append(finer)
    return tuple(groups)


def _failing_cells(case: Case) -> dict[int, Bools] | None:
    """The cells where claims fail, by the proof's `id`; None if too many, or some are unknown."""
    wrong: dict[int, Bools] = {}
    for failure in case.failures:
        if failure.cut:
            continue  # this claim was not examined to the end
        cells = failure.cells
        if failure.claim == "P2a" or failure.proof is None or cells is None:
            return None
        if cells.mean() > BORDER_MAX:
            return None
        before = wrong.get(id(failure.proof))
        wrong[id(failure.proof)] = cells if before is None else before | cells
    return wrong


def _group_with_split_intervals(group: Group, cells: Bools) -> Group | None:
    """The group with all intervals near failing cells cut in two; None if cells become too many."""
    axes = []
    for k, axis in enumerate(group.axes):
        others = tuple(i for i in range(cells.ndim) if i != k)
        near = np.asarray(cells.any(axis=others))
        for _ in range(AROUND):
            near[1:] |= near[:-1].copy()
            near[:-1] |= near[1:].copy()
        axes.append(axis_with_halved_cells(axis, near))
    size = int(np.prod([len(a.edges) - 1 for a in axes], dtype=np.int64))
    return None if size > CELLS_MAX else replace(group, axes=tuple(axes))


def axis_with_halved_cells(axis: Axis, near: Bools) -> Axis:
    """The axis whose intervals marked in `near`, (n,), are cut in two, but for endless ones."""
    edges: list[float] = []
    outer = (0, len(near) - 1) if axis.unbounded else ()
    for k, (low, high, split) in enumerate(zip(axis.edges, axis.edges[1:], near, strict=False)):
        edges.append(low)
        if k in outer:
            continue
        middle = low / 2 + high / 2
        if split and low < middle < high:
            edges.append(middle)
    return replace(axis, edges=(*edges, axis.edges[-1]))


def cell_count(problem: Problem) -> int:
    """The total number of grid cells of all groups."""
    return sum(prod(len(a.edges) - 1 for a in g.axes) for g in problem.groups)


def finer_problem(problem: Problem, coarse: Collection[Group]) -> Problem:
    """The problem with all cells of the groups `coarse` halved on each axis, except open ends."""
    groups = tuple(_group_with_all_cells_halved(g) if g in coarse else g for g in problem.groups)
    return replace(
        problem, groups=groups, declared_groups=problem.declared_groups or problem.groups
    )


def _group_with_all_cells_halved(group: Group) -> Group:
    axes = []
    for axis in group.axes:
        near = np.ones(len(axis.edges) - 1, dtype=np.bool_)
        near[-1] = not axis.open
        axes.append(axis_with_halved_cells(axis, near))
    return replace(group, axes=tuple(axes))


def cell_counts_in_words(before: Group, after: Group) -> str:
    """The numbers of cells along each axis before and after, in words; "" if none differs."""
    pairs = zip(before.axes, after.axes, strict=True)
    counts = [(a.name, len(a.edges) - 1, len(b.edges) - 1) for a, b in pairs]
    finer = ", ".join(f"{n} {a:,} -> {b:,}" for n, a, b in counts if a != b)
    was, is_ = prod(a for _, a, _ in counts), prod(b for _, _, b in counts)
    return f"{finer} ({was:,} -> {is_:,} cells)" if finer else ""


def refinement_notes(done: Sequence[Case]) -> tuple[str, ...]:
    """Notes about grids that are finer than declared in the program, or not declared there."""
    worst: dict[tuple[str, ...], tuple[int, str]] = {}
    for case in done:
        if case.first is None:
            continue
        for before, proof in zip(case.first.proofs, case.proofs, strict=True):
            finer = cell_counts_in_words(before.group, proof.group)
            if not finer:
                continue
            size = prod(len(a.edges) - 1 for a in proof.group.axes)
            text = f"the grid was refined where a claim failed only at borders: {finer}"
            names = tuple(a.name for a in proof.group.axes)
            worst[names] = max(worst.get(names, (0, "")), (size, text))
    notes = (*(text for _, text in worst.values()), *_notes_on_finer_cells(done))
    groups = done[0].problem.groups if done else ()
    if all(g.span is None for g in groups):
        return notes
    alone = (g.axes[0] for g in groups if g.span is None)
    return notes + tuple(
        f"{a.name} stands on no axis: a group of its own, {len(a.edges) - 1:,} cells over "
        f"[{a.edges[0]:.6g}, {a.edges[-1]:.6g}]; another `grid` line says otherwise"
        for a in alone
    )


def _notes_on_finer_cells(done: Sequence[Case]) -> dict[str, None]:
    """A note for each group whose Q is on smaller cells than the DM's table."""
    lines: dict[str, None] = {}
    for part in (proof.found for case in done for proof in case.proofs):
        if part.finer is None:
            continue
        size, group = part.finer
        pairs = zip(part.group.axes, group.axes, strict=True)
        counts = [f"{a.name} {len(a.edges) - 1:,} -> {len(b.edges) - 1:,}" for a, b in pairs]
        text = f"P2b: Q on cells of {size} the size ({', '.join(counts)})"
        lines[f"{text}; the DM's table is as declared"] = None
    return lines


def coarser_problem(problem: Problem, most: int) -> Problem:
    """The problem with cells merged along every axis, until each group has at most `most` cells."""
    groups = tuple(_merged_group(g, most) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=())


def _group_cell_count(group: Group) -> int:
    return int(np.prod([len(a.edges) - 1 for a in group.axes], dtype=np.int64))


def _merged_group(group: Group, most: int) -> Group:
    if _group_cell_count(group) <= most:
        return group
    step = int(np.ceil((_group_cell_count(group) / most) ** (1 / len(group.axes))))
    return replace(group, axes=tuple(_every_nth_edge(a, step) for a in group.axes))


def _every_nth_edge(axis: Axis, step: int) -> Axis:
    edges = axis.edges[::step]
    last = axis.edges[-1]
    return replace(axis, edges=edges if edges[-1] == last else (*edges, last))


FROM_CELLS = 50_000
"""With fewer cells than this no time is estimated."""
PILOTS = (1_500, 6_000)
"""The most cells of a group in the two measured attempts."""
GROWTH = (1.0, 1.2)
"""The time is assumed to grow as a power of the number of cells: the limits of its exponent."""
FROM_S = 20.0
"""An estimate of fewer seconds is not shown."""
TO_S = 10
"""Estimates are rounded to multiples of this many seconds."""


def announce_work(problem: Problem, settle: Settle) -> None:
    """Shows an estimate of the time for a problem's sets; `settle` computes those of one case."""
    if cell_count(problem) >= FROM_CELLS:
        with passing_phase(f"{problem.name}: how long it will take"):
            announce(lambda: _estimate_in_words(problem, _estimated_seconds(problem, settle)))


def _estimated_seconds(problem: Problem, settle: Settle) -> float:
    """The estimated CPU seconds for all cases; 0 where an attempt on merged cells fails."""
    first = next(iter(parameter_cases(problem)))
    count = sum(1 for _ in islice(parameter_cases(problem), 100_000))
    tries = []
    for most in PILOTS:
        small = coarser_problem(problem, most)
        began = time.process_time()
        try:
            settle(small, first)
        except UnboundedError:
            return 0.0
        tries.append((cell_count(small), time.process_time() - began))
    (fewer_cells, fewer_s), (more_cells, more_s) = tries
    slope = (
        math.log(more_s / fewer_s) / math.log(more_cells / fewer_cells)
        if more_cells > fewer_cells and more_s > fewer_s > 0.0
        else GROWTH[0]
    )
    growth = min(max(slope, GROWTH[0]), GROWTH[1])
    return float(more_s * (cell_count(problem) / more_cells) ** growth * count)


def _estimate_in_words(problem: Problem, seconds: float) -> str:
    """The line that shows the estimated time; "" if the time is too short to be shown."""
    if seconds < FROM_S:
        return ""
    shapes = [" x ".join(str(len(a.edges) - 1) for a in g.axes) for g in problem.groups]
    axes = sum(len(g.axes) for g in problem.groups)
    many = "1 axis" if axes == 1 else f"{axes} axes"
    text = f"{problem.name}: {many} of {' and '.join(shapes)} cells"
    return f"{text}: about {lasting(seconds, TO_S)} of processor time"
