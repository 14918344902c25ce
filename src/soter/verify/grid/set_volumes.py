"""How much the sets of a grid say, in shares of volumes.

Purpose: shares for people and for `verify/diagnosis/vacuity.py`; states of K; a state deep in C.
Non-goals: anything that a proof rests on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.cell_boxes import drawn_edges, share

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.claims.results import GroupSets

    Floats = NDArray[np.float64]


def shares(part: GroupSets) -> dict[str, float]:
    """Of the grid's volume, by set; `estimates`: of S_0, where predicates are computed."""
    edges = drawn_edges(part.group.axes)
    sets = {
        "core": part.core > 0,
        "free": part.free,
        "lets_ac": part.lets_ac,
        "gives_back": part.gives_back,
        "estimates": part.deployed[0] if part.levels and part.deployed is not None else None,
    }
    every = {name: cells for name, cells in sets.items() if cells is not None}
    return {name: share(np.asarray(cells), edges) for name, cells in every.items()}


def core_share(part: GroupSets) -> float:
    """Of C that K is; 0 where there is no C."""
    edges = drawn_edges(part.group.axes)
    whole = share(part.allowed, edges)
    return share((part.core > 0) & part.allowed, edges) / whole if whole else 0.0


def both(part: GroupSets) -> tuple[float, bool] | None:
    """Share of K on which `safer` may be true and `ttf` may be false, and whether that is any."""
    if part.lets_ac is None or part.gives_back is None:
        return None
    core, lets = part.core > 0, part.lets_ac & part.gives_back
    whole = share(core, drawn_edges(part.group.axes))
    fraction = share(lets & core, drawn_edges(part.group.axes)) / whole if whole else 1.0
    return fraction, bool(lets.any())


def lets_share(part: GroupSets, predicate: str) -> float | None:
    """Share of K on which a predicate lets AC have control, as the DM holds it where it does."""
    which = 0 if predicate == "ttf" else 1
    cells = (
        (part.lets_ac, part.gives_back)[which] if part.deployed is None else part.deployed[which]
    )
    if cells is None:
        return None
    core, edges = part.core > 0, drawn_edges(part.group.axes)
    return share(cells & core, edges) / share(core, edges)


def drawn(part: GroupSets, chance: np.random.Generator, count: int) -> Floats:
    """States of K, (count, axes), uniform."""
    core, edges = np.argwhere(part.core > 0), drawn_edges(part.group.axes)
    sizes = np.prod([np.diff(e)[core[:, k]] for k, e in enumerate(edges)], axis=0)
    at = core[chance.choice(len(core), count, p=sizes / sizes.sum())]
    low = np.stack([e[at[:, k]] for k, e in enumerate(edges)], axis=1)
    high = np.stack([e[at[:, k] + 1] for k, e in enumerate(edges)], axis=1)
    return np.asarray(chance.uniform(low, high))


def deepest(part: GroupSets) -> dict[int, float]:
    """State -> the middle of a cell that is far from the border of C; nothing without C."""
    left = part.allowed
    while True:
        inner = left.copy()
        for axis in range(inner.ndim):
            n = inner.shape[axis]
            if n < 3:
                continue
            inner &= np.roll(left, 1, axis) & np.roll(left, -1, axis)
            edge = np.moveaxis(inner, axis, 0)  # a view
            edge[[0, n - 1]] = False
        if not inner.any() or np.array_equal(inner, left):
            break  # axes of one or two cells have no inside, and take nothing away
        left = inner
    if not left.any():
        return {}
    at = np.argwhere(left)[int(left.sum()) // 2]
    every = zip(part.group.axes, part.edges, at, strict=True)
    return {a.state: (e[i] + e[i + 1]) / 2 for a, e, i in every}
