"""Finer grids: where only borders fail, and all cells halved.

Purpose: split the breakpoints near the cells on which a claim failed, a bounded number of times, or
every one; and say so.
Non-goals: deciding anything: a finer grid is a new attempt, no more (`levels.py`).
"""

from __future__ import annotations

from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case
    from soter.verify.problem.problem import Axis, Group, Problem

    Bools = NDArray[np.bool_]

CELLS_MAX = 4_000_000
"""No group is refined beyond."""
BORDER_MAX = 0.1
"""A claim that fails on a larger share of the cells fails not only at borders."""
AROUND = 2
"""Cells around a failing one that are split too."""


def refined(case: Case) -> tuple[Group, ...] | None:
    """The groups with finer axes, or None where that cannot help or would be too much."""
    wrong = _failing(case)
    if not wrong:
        return None
    groups = []
    for proof in case.proofs:
        cells = wrong.get(id(proof))
        finer = proof.group if cells is None else _split(proof.group, cells)
        if finer is None:
            return None
        groups.append(finer)
    return tuple(groups)


def _failing(case: Case) -> dict[int, Bools] | None:
    """By identity of a group's proof the cells on which some claim fails; None: also elsewhere."""
    wrong: dict[int, Bools] = {}
    for failure in case.failures:
        if failure.cut:
            continue  # nothing is known of it
        cells = failure.cells
        if failure.claim == "P2a" or failure.proof is None or cells is None:
            return None
        if cells.mean() > BORDER_MAX:
            return None
        before = wrong.get(id(failure.proof))
        wrong[id(failure.proof)] = cells if before is None else before | cells
    return wrong


def _split(group: Group, cells: Bools) -> Group | None:
    """Every interval near a failing cell in two."""
    axes = []
    for k, axis in enumerate(group.axes):
        others = tuple(i for i in range(cells.ndim) if i != k)
        near = np.asarray(cells.any(axis=others))
        for _ in range(AROUND):
            near[1:] |= near[:-1].copy()
            near[:-1] |= near[1:].copy()
        axes.append(halved(axis, near))
    size = int(np.prod([len(a.edges) - 1 for a in axes], dtype=np.int64))
    return None if size > CELLS_MAX else replace(group, axes=tuple(axes))


def halved(axis: Axis, near: Bools) -> Axis:
    """The axis with those of its intervals in two; never an outer one of an axis without ends."""
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


def cells_of(problem: Problem) -> int:
    """Of all groups together."""
    grids = (g for g in problem.groups if g.representation == "grid")
    return sum(prod(len(a.edges) - 1 for a in g.axes) for g in grids)


def smaller_cells(problem: Problem, coarse: Collection[Group]) -> Problem:
    """Every cell of these grids halved along each axis, but those that an open end makes."""
    groups = tuple(_all_halved(g) if g in coarse else g for g in problem.groups)
    return replace(
        problem, groups=groups, declared_groups=problem.declared_groups or problem.groups
    )


def _all_halved(group: Group) -> Group:
    axes = []
    for axis in group.axes:
        near = np.ones(len(axis.edges) - 1, dtype=np.bool_)
        near[-1] = not axis.open
        axes.append(halved(axis, near))
    return replace(group, axes=tuple(axes))


def counts_of(before: Group, after: Group) -> str:
    """How many cells there were, and are, where that is not the same; "" where it is."""
    pairs = zip(before.axes, after.axes, strict=True)
    counts = [(a.name, len(a.edges) - 1, len(b.edges) - 1) for a, b in pairs]
    finer = ", ".join(f"{n} {a:,} -> {b:,}" for n, a, b in counts if a != b)
    was, is_ = prod(a for _, a, _ in counts), prod(b for _, _, b in counts)
    return f"{finer} ({was:,} -> {is_:,} cells)" if finer else ""


def refinement_note(done: Sequence[Case]) -> tuple[str, ...]:
    """A line where a grid is finer than the program says, or is one that it does not mention."""
    worst: dict[tuple[str, ...], tuple[int, str]] = {}
    for case in done:
        if case.first is None:
            continue
        for before, proof in zip(case.first.proofs, case.proofs, strict=True):
            finer = counts_of(before.group, proof.group)
            if not finer:
                continue
            size = prod(len(a.edges) - 1 for a in proof.group.axes)
            text = f"the grid was refined where a claim failed only at borders: {finer}"
            names = tuple(a.name for a in proof.group.axes)
            worst[names] = max(worst.get(names, (0, "")), (size, text))
    told = (*(text for _, text in worst.values()), *_finer_notes(done))
    groups = done[0].problem.groups if done else ()
    if all(g.span is None for g in groups):
        return told
    alone = (g.axes[0] for g in groups if g.span is None)
    return told + tuple(
        f"{a.name} stands on no axis: a group of its own, {len(a.edges) - 1:,} cells over "
        f"[{a.edges[0]:.6g}, {a.edges[-1]:.6g}]; another `grid` line says otherwise"
        for a in alone
    )


def _finer_notes(done: Sequence[Case]) -> dict[str, None]:
    """A line for each group whose Q is on smaller cells than the DM's table."""
    lines: dict[str, None] = {}
    for part in (part for case in done for part in case.sets.groups):
        if part.finer is None:
            continue
        size, group = part.finer
        pairs = zip(part.group.axes, group.axes, strict=True)
        counts = [f"{a.name} {len(a.edges) - 1:,} -> {len(b.edges) - 1:,}" for a, b in pairs]
        text = f"P2b: Q on cells of {size} the size ({', '.join(counts)})"
        lines[f"{text}; the DM's table is as declared"] = None
    return lines
