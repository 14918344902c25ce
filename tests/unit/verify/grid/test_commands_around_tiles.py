"""A core is the greatest fixpoint of what the engine's holds tell of each cell alone.

Where the law gives one command around a tile the engine asks neither it nor the tube; here every
cell's chain is followed hold by hold, and the fixpoint is numpy's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.grid_adversary import Car
from unit.verify.grid.small_enclosure_units import END, HEAD, SIGNATURE, car, linear, safe_in_pieces
from unit.verify.grid.test_grid_enclosures import MS, group_of

if TYPE_CHECKING:
    import numpy.typing as npt

    Bools = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]
    Box = tuple[slice, ...]

LONGEST = 10
CARS = [
    Car(4.0, 4.0, 5.0, 0.05),
    Car(9.0, 6.0, 3.0, 0.03),
    Car(60.0, 40.0, 3.0, 0.05),
    Car(20.0, 20.0, 3.0, 0.05, wind=0.3, errors=(0.02, 0.05)),
    Car(20.0, 20.0, 3.0, 0.05, delay=0.06),
    Car(20.0, 20.0, 3.0, 0.05, delay=0.01, jitter=0.02),
    Car(20.0, 20.0, 3.0, 0.05, jitter=0.02),
]
"""Strong gains: nearly everywhere these push as hard as they can."""

# in: x, y, u, q;  x' = u, y' = q;  u = clamp(-100 x, +-1), q = 0
PUSHED = (
    HEAD.format(n=4)
    + SIGNATURE.format(name="law", type="soter_form")
    + """  soter_form a, b;
  soter_n_scale(SOTER_INPUTS, &a, &in[0], -100.0, -100.0);
  soter_n_at_most(SOTER_INPUTS, &b, &a, 1.0);
  soter_n_at_least(SOTER_INPUTS, &out[0], &b, -1.0);
  soter_n_range(SOTER_INPUTS, &out[1], 0.0, 0.0);
"""
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + "  out[0] = in[2];\n  out[1] = in[3];\n"
    + END.format()
)


def cover(engine: GridGroup, box: Floats) -> Box | None:
    """The cells that a box (axes, 2) touches; None outside the grid."""
    cells = []
    for edges, (low, high) in zip(engine.edges, box, strict=True):
        if low < edges[0] or high > edges[-1]:
            return None
        first = int(np.searchsorted(edges, low, side="right")) - 1
        cells.append(slice(first, max(first + 1, int(np.searchsorted(edges, high, side="left")))))
    return tuple(cells)


def chains(engine: GridGroup, allowed: Bools) -> dict[tuple[int, ...], list[Box]]:
    """Of each allowed cell the images in the grid, as long as its tubes lie in `allowed`."""
    found: dict[tuple[int, ...], list[Box]] = {}
    for at in map(tuple, np.argwhere(allowed)):
        low = [e[i] for e, i in zip(engine.edges, at, strict=True)]
        high = [e[i + 1] for e, i in zip(engine.edges, at, strict=True)]
        found[at] = []
        for image, tube in zip(*engine.images_and_tubes(low, high, LONGEST), strict=True):
            met, end = cover(engine, tube), cover(engine, image)
            if met is None or not allowed[met].all():
                break
            found[at] += [end] if end is not None else []
    return found


def greatest(engine: GridGroup, allowed: Bools) -> Bools:
    kept: Bools = allowed.copy()
    before: Bools | None = None
    images = chains(engine, allowed)
    while before is None or (before != kept).any():
        before = kept.copy()
        for at, ends in images.items():
            kept[at] = before[at] and any(before[end].all() for end in ends)
    return kept


@pytest.mark.parametrize("c", CARS, ids=range(len(CARS)))
def test_a_core_is_the_fixpoint_of_its_cells(c: Car) -> None:
    engine = group_of(c, cells=43)
    allowed = engine.compute_constraint()
    core = engine.compute_core(allowed, longest=LONGEST, patience=LONGEST + 1).cells
    assert np.array_equal(core, greatest(engine, allowed))
    assert 0 < core.sum() < allowed.sum()


def test_a_box_may_outgrow_what_is_known_around_it() -> None:
    engine = group_of(Car(60.0, 40.0, 5.0, 0.05, wind=3.0), cells=101)
    allowed = engine.compute_constraint()
    core = engine.compute_core(allowed, longest=LONGEST, patience=LONGEST + 1).cells
    assert np.array_equal(core, greatest(engine, allowed))


def test_what_was_known_under_another_constraint_is_forgotten() -> None:
    engine = group_of(CARS[2], cells=43)
    wide = engine.compute_constraint()
    narrow = wide.copy()
    narrow[20:24, 30:33] = False
    for allowed in (wide, narrow, wide):
        core = engine.compute_core(allowed, longest=LONGEST, patience=LONGEST + 1).cells
        assert np.array_equal(core, greatest(engine, allowed))


def still(wind: float) -> GridGroup:
    """The speed alone, of a car that is not pushed."""
    inputs = GridInputs(
        states=((-2.0, 2.0), (-4.0, 4.0)),
        controls=((-5.0, 5.0),),
        disturbances=((-wind, wind),),
        errors=((0.0, 0.0), (0.0, 0.0)),
        period_ns=10 * MS,
        delay_ns=0,
        jitter_ns=0,
        parameters=(0, 0, 5000),
    )
    return GridGroup(car(), inputs, [(1, np.linspace(-4, 4, 300))])


@pytest.mark.parametrize("wind", [0.0, 0.1])
def test_a_speed_that_nothing_changes_stays_in_its_cell(wind: float) -> None:
    engine = still(wind)
    allowed = np.arange(299) % 100 != 50
    core = engine.compute_core(allowed, longest=LONGEST, patience=LONGEST + 1).cells
    assert np.array_equal(core, greatest(engine, allowed))
    assert core.any() == (wind == 0.0)


def test_beside_a_row_that_falls_one_that_stands_is_kept() -> None:
    """x pushed to 0 as hard as can be, y' = 0: only rows of y with a wall in the way fall."""
    inputs = GridInputs(
        states=((-2.0, 2.0), (-1.0, 1.0)),
        controls=((-1.0, 1.0), (-1.0, 1.0)),
        disturbances=(),
        errors=(),
        period_ns=100 * MS,
        delay_ns=0,
        jitter_ns=0,
        parameters=(),
    )
    edges = [np.linspace(-2, 2, 129), np.linspace(-1, 1, 17)]
    engine = GridGroup(linear(PUSHED), inputs, list(enumerate(edges)))
    allowed = np.ones(engine.shape, dtype=bool)
    allowed[72:74, 10:13] = False
    core = engine.compute_core(allowed, longest=LONGEST, patience=LONGEST + 1).cells
    assert np.array_equal(core, greatest(engine, allowed))
    assert core[74:127][:, [9, 13]].all()
    assert not core[72:, 10:13].any()


def test_every_piece_of_a_tube_is_looked_at() -> None:
    engine = group_of(CARS[0], cells=64)
    target = np.ones(engine.shape, dtype=bool)
    target[40, :] = False
    one = safe_in_pieces(engine, 300 * MS, target, 1)
    for pieces in (2, 3, 4):
        several = safe_in_pieces(engine, 300 * MS, target, pieces)
        fast = engine.edges[1][:-1] > 3.0  # beyond the wall long before the end
        assert not several[36:40, fast].any()
        assert several.sum() >= one.sum()
