"""Which cells stay under all of U is what each cell's tube tells, to the last bit.

numpy does what `tube_inside` of soter_reach_tubes.c does, cell by cell and in its order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.small_enclosure_units import car
from unit.verify.grid.test_boxes_that_move_together import CASES, FLOWS, LANES
from unit.verify.grid.test_grid_enclosures import MS

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Bools = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]

EPS, TINY, KEPT = 2.220446049250313e-16, 1e-300, 1


def tube_of(engine: GridGroup, t_ns: int, pieces: int) -> Any:
    tube = engine.library.ffi.new("soter_reach_tube *")
    assert engine.library.lib.soter_reach_tube_prepare(engine.c, t_ns * 1e-9, pieces, tube)
    return tube


def safe(engine: GridGroup, tube: Any, target: Bools, known: Bools) -> Bools:
    """As the engine has it."""
    out = np.full(engine.shape, 7, dtype=np.uint8)
    bits, done = engine.bits_of(target), engine.bits_of(known)
    sets = [engine.pointer(b, "uint64_t *") for b in (bits, done)]
    to = engine.pointer(out, "uint8_t *")
    end = engine.library.lib.soter_reach_safe(engine.c, tube, 1, *sets, to, 0, 60.0, 1)
    assert end == engine.tiles
    assert out.max() <= 1
    return out.astype(bool)


def segment(s: Any, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The states of a segment of the tube from a box; `soter_reach_cells.c`, `segment_of`."""
    n = len(low)
    down, up = np.zeros(n), np.zeros(n)
    for i in range(n):
        size = abs(s.lo[i]) + abs(s.hi[i])
        down[i], up[i] = s.lo[i], s.hi[i]
        for j in range(n):
            phi, ends = (s.phi_lo[i][j], s.phi_hi[i][j]), (low[j], high[j])
            products = [p * x for p in phi for x in ends]
            down[i] += min(products)
            up[i] += max(products)
            size += abs(min(products)) + abs(max(products))
        down[i] -= 8 * EPS * size + TINY
        up[i] += 8 * EPS * size + TINY
    return down, up


def cells(engine: GridGroup, low: Floats, high: Floats) -> tuple[slice, ...] | None:
    """What a box touches; None outside the grid."""
    found = []
    for a, e in enumerate(engine.edges):
        x, y = low[a], high[a]
        if engine.c.kept_low[a] == KEPT and y >= e[0]:
            x = max(x, e[0])
        if engine.c.kept_high[a] == KEPT and x <= e[-1]:
            y = min(y, e[-1])
        if x < e[0] or y > e[-1]:
            return None
        first = int(np.searchsorted(e, x, side="right")) - 1
        found.append(slice(first, max(first + 1, int(np.searchsorted(e, y, side="left")))))
    return tuple(found)


def alone(engine: GridGroup, tube: Any, target: Bools, known: Bools) -> Bools:
    """Cell by cell."""
    out = target & known
    for at in map(tuple, np.argwhere(target & ~known)):
        low = np.array([e[i] for e, i in zip(engine.edges, at, strict=True)])
        high = np.array([e[i + 1] for e, i in zip(engine.edges, at, strict=True)])
        met = [cells(engine, *segment(tube.at[k], low, high)) for k in range(tube.segments)]
        out[at] = all(m is not None and target[m].all() for m in met)
    return np.asarray(out)


@pytest.mark.parametrize(("name", "lanes"), CASES)
def test_cells_stay_together_as_alone(name: str, lanes: int) -> None:
    engine, rng = FLOWS[name].engine(LANES[lanes]), np.random.default_rng(5)
    for pieces in (1, 3):
        tube = tube_of(engine, 100 * MS, pieces)
        for share in (0.0, 0.01, 0.1):
            target = rng.random(engine.shape) >= share
            known = rng.random(engine.shape) < 0.1
            told = safe(engine, tube, target, known)
            assert np.array_equal(told, alone(engine, tube, target, known))
            assert (target & known)[told].sum() == (target & known).sum()


def test_some_of_the_axes_are_kept() -> None:
    """So that what is cut at an end is among what is compared."""
    kept = FLOWS["kept"].engine().c
    assert [kept.kept_low[a] for a in range(2)] == [KEPT, KEPT] == list(kept.kept_high)[:2]


def line(edges: Sequence[float]) -> GridGroup:
    """The speed of a car, on a grid of its own."""
    inputs = GridInputs(
        states=((-2.0, 2.0), (-4.0, 4.0)),
        controls=((-5.0, 5.0),),
        disturbances=((0.0, 0.0),),
        errors=((0.0, 0.0), (0.0, 0.0)),
        period_ns=10 * MS,
        parameters=(0, 0, 5000),
    )
    return GridGroup(car(), inputs, [(1, np.array(edges))])


def moved_by(engine: GridGroup, low: float, high: float) -> Any:
    """A tube of one segment: x + [low, high]."""
    tube = engine.library.ffi.new("soter_reach_tube *")
    tube.segments = 1
    tube.at[0].phi_lo[0][0] = tube.at[0].phi_hi[0][0] = 1.0
    tube.at[0].lo[0], tube.at[0].hi[0] = low, high
    return tube


def by_halves(engine: GridGroup, tube: Any, target: Bools, first: int, last: int) -> list[bool]:
    """A box of cells as a whole, or else its halves."""
    ends = engine.edges[0][[first]], engine.edges[0][[last + 1]]
    met = cells(engine, *segment(tube.at[0], *ends))
    if target[first : last + 1].all() and met is not None and target[met].all():
        return [True] * (last + 1 - first)
    if first == last:
        return [False]
    middle = first + (last - first) // 2
    halves = ((first, middle), (middle + 1, last))
    return [x for a, b in halves for x in by_halves(engine, tube, target, a, b)]


@pytest.mark.parametrize("side", [1, -1])
def test_ties_of_rounding_are_told_as_halves_tell_them(side: int) -> None:
    engine = line((np.array([0.0, 0.5, 1.0, 1.5, 2.0]) * side)[::side].tolist())
    target, none = np.array([True, True, True, False])[::side], np.zeros(4, dtype=bool)
    found = set()
    for k in range(40):
        ends = sorted((0.25 * side, (0.5 - k * EPS) * side))
        tube = moved_by(engine, *ends)
        told = safe(engine, tube, target, none).tolist()
        assert told == by_halves(engine, tube, target, 0, 3)
        found.add((tuple(told), bool((alone(engine, tube, target, none) == told).all())))
    assert len(found) > 2


def test_a_tie_of_rounding_is_left_to_halves() -> None:
    """[0, 1] moved by 1/2 - 16 EPS stays below 3/2 after 14 EPS more; [1/2, 1] is given 18."""
    engine = line([0.0, 0.5, 1.0, 1.5, 2.0])
    tube = moved_by(engine, 0.25, 0.5 - 16 * EPS)
    target, none = np.array([True, True, True, False]), np.zeros(4, dtype=bool)
    assert alone(engine, tube, target, none).tolist() == [True, False, False, False]
    assert safe(engine, tube, target, none).tolist() == [True, True, False, False]
