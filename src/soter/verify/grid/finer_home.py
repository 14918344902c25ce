"""Q and W of P2b on smaller cells than the declared ones, which the DM's table keeps.

Purpose: where SC keeps no set of declared cells inside a computed `safer`: every interval in which
that lies cut in two, then in four; Q there, and which cells of the declared grid a set is made of.
Non-goals: `safer` of the user, for which the whole grid is refined (`claims/grid_refinement.py`);
the way back (`recovery.py`).

Whether it is tried, and how finely, depends on counts of cells alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.grid_refinement import halved
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.estimates import errors_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import GroupSets
    from soter.verify.problem.problem import Group

    Bools = NDArray[np.bool_]

TARGET_MAX = 20_000
"""More cells of the target are not looked at."""
WAY_MAX = 40_000
"""From more cells of K than that the way to it is not looked at: of 70,000 it took a minute."""
SIZES = ("half", "a quarter of")
"""Of a cell, along each axis."""


@dataclass(frozen=True, eq=False)
class FinerHome:
    """A set that SC keeps, on the cells of `engine`; none of them where nothing was found."""

    engine: GridGroup
    group: Group
    size: str
    """Of its smallest cells, in words."""
    origin: tuple[NDArray[np.intp], ...]
    """As an index of a set of declared cells: that set on the cells of `engine`."""
    home: NDArray[np.uint8]

    def declared(self, cells: Bools) -> Bools:
        """The declared cells that some of these smaller ones are part of."""
        found = np.zeros([int(at.max()) + 1 for at in self.origin], dtype=np.bool_)
        np.logical_or.at(found, self.origin, cells)
        return found


def finer_home(case: Case, engine: GridGroup, part: GroupSets) -> tuple[FinerHome | None, str]:
    """What was found on the largest cells that serve; else which sizes were tried, in words."""
    assert part.deployed is not None
    inner = part.deployed[1]
    group, tried = part.group, []
    for size in SIZES:
        group = _halved(group, part.group, inner)
        fine = GridGroup.of(
            engine.library,
            case.problem,
            group,
            case.parameter,
            threads=engine.threads,
            progress=engine.progress,
            stop=engine.stop,
        )
        origin = np.ix_(*map(_origin, part.edges, fine.edges))
        target = fine.erode(inner[origin], errors_of(case.problem)) & part.allowed[origin]
        if not target.any():
            continue
        if np.count_nonzero(target) > TARGET_MAX:
            break
        tried.append(size)
        home = fine.core(target).witness
        if home.any():
            return FinerHome(fine, group, size, origin, home), ""
    return None, " or ".join(tried)


def _halved(group: Group, declared: Group, inner: Bools) -> Group:
    """Every interval that cells of a set of declared ones lie in, cut in two."""
    axes = []
    for k, axis in enumerate(group.axes):
        near = np.asarray(inner.any(axis=tuple(i for i in range(inner.ndim) if i != k)))
        at = _origin(declared.axes[k].edges, np.array(axis.edges))
        axes.append(halved(axis, near[at]))
    return replace(group, axes=tuple(axes))


def _origin(declared: Sequence[float], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """Of each interval of an axis the declared one that it is part of."""
    return np.maximum(np.searchsorted(np.array(declared), edges[:-1], side="right") - 1, 0)
