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

SIZES = (("half", 80_000), ("a quarter of", 20_000))
"""Of a cell, along each axis; and how many cells of the target are looked at, at most."""
WAY_MAX = 80_000
"""From more cells of K than that the way to it is not looked at: of 70,000 it takes a minute."""


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
    for size, most in SIZES:
        group = _halved(group, part.group, inner)
        fine = engine_on(case, engine, group)
        origin = parts_of(part, group)
        target = target_on(case, fine, part, origin)
        if not target.any():
            continue
        if np.count_nonzero(target) > most:
            break
        tried.append(size)
        home = fine.core(target).witness
        if home.any():
            return FinerHome(fine, group, size, origin, home), ""
    return None, " or ".join(tried)


def engine_on(case: Case, engine: GridGroup, group: Group) -> GridGroup:
    """The engine of the same group on other cells."""
    return GridGroup.of(
        engine.library,
        case.problem,
        group,
        case.parameter,
        threads=engine.threads,
        progress=engine.progress,
        stop=engine.stop,
    )


def target_on(
    case: Case, fine: GridGroup, part: GroupSets, origin: tuple[NDArray[np.intp], ...]
) -> Bools:
    """The smaller cells of C every estimate of which the DM gives back."""
    assert part.deployed is not None
    return fine.erode(part.deployed[1][origin], errors_of(case.problem)) & part.allowed[origin]


def led_back(part: GroupSets) -> Bools:
    """The declared cells all of which W holds."""
    assert part.rank is not None
    if part.finer is None:
        return part.rank > 0
    led = np.ones(part.core.shape, dtype=np.bool_)
    np.logical_and.at(led, parts_of(part, part.finer[1]), part.rank > 0)
    return led


def parts_of(part: GroupSets, group: Group) -> tuple[NDArray[np.intp], ...]:
    """As an index of a set of declared cells: that set on the cells of `group`, parts of them."""
    return np.ix_(
        *(_origin(a, np.array(b.edges)) for a, b in zip(part.edges, group.axes, strict=True))
    )


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
