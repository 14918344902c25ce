"""Finds Q on smaller cells than the declared ones, where `safer` is computed.

Purpose: where Q is empty on the declared cells, `find_q_on_finer_cells` tries smaller ones: each
interval in which `safer` lies is cut in two, then in four. Counts of cells decide whether it is.
Non-goals: the way to Q (`recovery.py`); a `safer` that the user wrote (`grid_refinement.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.grid.grid_refinement import axis_with_halved_cells
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Bools
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Group

SIZES = (("half", 80_000), ("a quarter of", 20_000))
"""The size of smaller cells, in words, and how many of them the target may have at most."""


@dataclass(frozen=True, eq=False)
class FinerQ:
    """The set Q on the cells of `engine`, smaller than the declared ones; `home`: its witnesses."""

    engine: GridGroup
    group: Group
    size: str
    """The size of its smallest cells, in words."""
    origin: tuple[NDArray[np.intp], ...]
    """An index: `cells[origin]` transfers a set of declared cells to the cells of `engine`."""
    home: NDArray[np.uint8]

    def declared_cells(self, cells: Bools) -> Bools:
        """The declared cells, in the shape of their grid, that contain any of `cells`."""
        found = np.zeros([int(at.max()) + 1 for at in self.origin], dtype=np.bool_)
        np.logical_or.at(found, self.origin, cells)
        return found


def find_q_on_finer_cells(
    case: Case, engine: GridGroup, part: GroupSets
) -> tuple[FinerQ | None, str]:
    """Q on the largest smaller cells for which Q is not empty; else None and the sizes tried."""
    assert part.deployed is not None
    inner = part.deployed[1]
    group, tried = part.group, []
    for size, most in SIZES:
        group = _group_with_halved_intervals(group, part.group, inner)
        fine = engine_for_cells(case, engine, group)
        origin = index_of_declared_cells(part, group)
        target = target_on_small_cells(case, fine, part, origin)
        if not target.any():
            continue
        if np.count_nonzero(target) > most:
            break
        tried.append(size)
        home = fine.compute_core(target).witness
        if home.any():
            return FinerQ(fine, group, size, origin, home), ""
    return None, " or ".join(tried)


def engine_for_cells(case: Case, engine: GridGroup, group: Group) -> GridGroup:
    """An engine with the same dynamics but with the cells of `group`."""
    return GridGroup.for_group(
        engine.library, case.problem, group, case.parameter, threads=engine.threads
    )


def target_on_small_cells(
    case: Case, fine: GridGroup, part: GroupSets, origin: tuple[NDArray[np.intp], ...]
) -> Bools:
    """The small cells of C, in their grid's shape, where DM gives AC control at every estimate."""
    assert part.deployed is not None
    return (
        fine.erode(part.deployed[1][origin], errors_by_state(case.problem)) & part.allowed[origin]
    )


def index_of_declared_cells(part: GroupSets, group: Group) -> tuple[NDArray[np.intp], ...]:
    """The index with which `cells[index]` transfers declared cells to the cells of `group`.

    It has a table (1, ..., n, ..., 1) for each axis, n its finer cells.
    """
    return np.ix_(
        *(_interval_ids(a, np.array(b.edges)) for a, b in zip(part.edges, group.axes, strict=True))
    )


def _group_with_halved_intervals(group: Group, declared: Group, inner: Bools) -> Group:
    """Halves those intervals of a group's axes that contain a declared cell of the set `inner`."""
    axes = []
    for k, axis in enumerate(group.axes):
        near = np.asarray(inner.any(axis=tuple(i for i in range(inner.ndim) if i != k)))
        at = _interval_ids(declared.axes[k].edges, np.array(axis.edges))
        axes.append(axis_with_halved_cells(axis, near[at]))
    return replace(group, axes=tuple(axes))


def _interval_ids(declared: Sequence[float], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """For each interval of an axis the number of the declared interval that holds it."""
    return np.maximum(np.searchsorted(np.array(declared), edges[:-1], side="right") - 1, 0)
