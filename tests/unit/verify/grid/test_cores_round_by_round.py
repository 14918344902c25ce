"""A core with its witnesses is what numpy finds round by round from each cell's own holds.

The chains are those of `soter_reach_run`, hold by hold and each from its beginning; numpy gives
chains up as the engine's `patience` says, and tries parts of tiles as one box first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from unit.verify.grid.test_commands_around_tiles import CARS, cover
from unit.verify.grid.test_grid_enclosures import group_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.verify.grid.sets import GridGroup
    from unit.verify.grid.grid_adversary import Car

    Bools = npt.NDArray[np.bool_]
    Bytes = npt.NDArray[np.uint8]
    Cell = tuple[int, ...]
    Box = tuple[slice, ...]

LONGEST = 12


def grown(box: Box) -> Box:
    """By a cell on all sides."""
    return tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)


@dataclass
class Rounds:
    """The fixpoint as `soter_reach.c` describes it."""

    engine: GridGroup
    allowed: Bools
    patience: int
    witness: Bytes = field(init=False)
    image: dict[Cell, Box] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.kept = self.allowed.copy()
        self.witness = np.zeros(self.allowed.shape, dtype=np.uint8)

    def holds(self, first: Cell, last: Cell, count: int) -> list[tuple[bool, Box | None]]:
        """Of each hold from a box of cells: whether its tube lies in C, and its image."""
        low = [e[i] for e, i in zip(self.engine.edges, first, strict=True)]
        high = [e[i + 1] for e, i in zip(self.engine.edges, last, strict=True)]
        found = []
        for image, tube in zip(*self.engine.images_and_tubes(low, high, count), strict=True):
            met = cover(self.engine, tube)
            found.append(
                (met is not None and bool(self.allowed[met].all()), cover(self.engine, image))
            )
        return found

    @cached_property
    def chains(self) -> dict[Cell, list[tuple[bool, Box | None]]]:
        cells = [tuple(int(i) for i in at) for at in np.argwhere(self.allowed)]
        return {at: self.holds(at, at, LONGEST) for at in cells}

    def by_halves(self, first: Cell, last: Cell) -> None:
        cells = tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))
        size = self.kept[cells].size
        if not self.kept[cells].any():
            return
        if size > 1 and self.kept[cells].all():
            hold = self.holds(first, last, 1)
            end = hold[0][1] if hold and hold[0][0] else None
            if end is not None and self.kept[end].all():
                self.witness[cells] = 1
                self.image |= dict.fromkeys(product(*(range(s.start, s.stop) for s in cells)), end)
                return
        if size > 4:
            wide = [b - a for a, b in zip(first, last, strict=True)]
            axis = wide.index(max(wide))
            middle = first[axis] + wide[axis] // 2
            self.by_halves(first, (*last[:axis], middle, *last[axis + 1 :]))
            self.by_halves((*first[:axis], middle + 1, *first[axis + 1 :]), last)

    def remote(self, image: Box) -> bool:
        return not self.kept[grown(image)].any()

    def looked_at(self, at: Cell) -> int:
        """The witness of a cell whose image is not in K: its number of holds; 0: none."""
        n, lost = int(self.witness[at]), 0
        if n > 0 and self.patience <= 1 and self.remote(self.image[at]):
            return 0
        while n < LONGEST and n < len(self.chains[at]):
            inside, image = self.chains[at][n]
            n += 1
            if not inside:
                return 0
            if image is None:
                continue
            self.image[at] = image
            if self.kept[image].all():
                return n
            lost = lost + 1 if self.remote(image) else 0
            if lost >= self.patience:
                return 0
        return 0

    def run(self) -> Bytes:
        sizes = [int(self.engine.c.tile[a]) for a in range(self.allowed.ndim)]
        ends = [range(0, n, t) for n, t in zip(self.allowed.shape, sizes, strict=True)]
        for first in product(*ends):
            over = zip(first, sizes, self.allowed.shape, strict=True)
            self.by_halves(first, tuple(min(a + t, n) - 1 for a, t, n in over))
        fell = True
        while fell:
            fallen = []
            for at in map(tuple, np.argwhere(self.kept)):
                if self.witness[at] == 0 or not self.kept[self.image[at]].all():
                    self.witness[at] = self.looked_at(at)
                    fallen += [at] if self.witness[at] == 0 else []
            for at in fallen:
                self.kept[at] = False
            fell = bool(fallen)
        return self.witness


@pytest.mark.parametrize("patience", [1, 2, 5])
@pytest.mark.parametrize("c", CARS, ids=range(len(CARS)))
def test_witnesses_are_those_of_each_cell_alone(c: Car, patience: int) -> None:
    engine = group_of(c, cells=43)
    allowed = engine.compute_constraint()
    allowed[30:32, 10:13] = False
    core = engine.compute_core(allowed, longest=LONGEST, patience=patience)
    told = Rounds(engine, allowed, patience).run()
    assert np.array_equal(core.witness, told)
    assert 0 < core.cells.sum() < allowed.sum()


def test_chains_that_are_not_kept_are_made_again() -> None:
    """With room for few chains, and a witness that is more than a hold away."""
    engine = group_of(CARS[2], cells=64)
    allowed = engine.compute_constraint()
    for k in range(0, 64, 7):
        allowed[k, k // 2 : k // 2 + 2] = False
    core = engine.compute_core(allowed, longest=LONGEST, patience=3)
    assert np.array_equal(core.witness, Rounds(engine, allowed, 3).run())
    assert len(np.unique(core.witness)) > 4
