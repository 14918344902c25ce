"""What is claimed of a cell holds for every run from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.diagnostics.current_phase import CancelledError, cancelled_when
from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.grid_adversary import Car, Runs, flow
from unit.verify.grid.small_enclosure_units import corner, hill, safe_in_pieces
from unit.verify.grid.test_grid_enclosures import CARS, MS, group_of

if TYPE_CHECKING:
    import numpy.typing as npt

    Bools = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]

WALL = 1.5


def inside(engine: GridGroup, cells: Bools, x: Floats) -> Bools:
    """Whether points (axes, n) lie in closed cells of the set, up to numpy's rounding."""
    mask = np.zeros(x.shape[1], dtype=bool)
    for nudge in np.ndindex(*(3,) * len(x)):
        at = []
        ok = np.ones(x.shape[1], dtype=bool)
        for axis, (edges, step) in enumerate(zip(engine.edges, nudge, strict=True)):
            y = x[axis] + (step - 1) * 1e-11
            i = np.searchsorted(edges, y, side="right") - 1
            ok &= (i >= 0) & (i < len(edges) - 1)
            at.append(np.clip(i, 0, len(edges) - 2))
        mask |= ok & cells[tuple(at)]
    return mask


def drawn(
    engine: GridGroup, cells: Bools, rng: np.random.Generator, n: int
) -> tuple[Floats, Bools]:
    """Points of random cells of the set, mostly corners and mostly near its border; their cells."""
    padded = np.pad(cells, 1)
    near = cells & ~(padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:] & padded[1:-1, :-2])
    border, all_ = np.argwhere(near), np.argwhere(cells)
    at = np.concatenate([border[rng.integers(0, len(border), n // 2)],
                         all_[rng.integers(0, len(all_), n - n // 2)]])  # fmt: skip
    share = corner(rng, 0.0, 1.0, (2, n))
    low = np.stack([engine.edges[a][at[:, a]] for a in range(2)])
    high = np.stack([engine.edges[a][at[:, a] + 1] for a in range(2)])
    return low + share * (high - low), at


def escapes(c: Car, engine: GridGroup, witness: npt.NDArray[np.uint8], seed: int) -> int:
    """Runs that leave C before a_N, or are not in K at a_N."""
    rng = np.random.default_rng(seed)
    start, at = drawn(engine, witness != 0, rng, 3000)
    n = witness[at[:, 0], at[:, 1]].astype(int)
    lost = np.zeros(len(n), dtype=bool)
    for k, x, met in Runs(c, start, rng).holds(int(n.max())):
        for y in met:
            lost |= (n >= k) & (np.abs(y[0]) > WALL + 1e-9)
        lost |= (n == k) & ~inside(engine, witness != 0, x)
    return int(lost.sum())


@pytest.mark.parametrize("c", CARS, ids=range(len(CARS)))
def test_no_run_escapes_the_core(c: Car) -> None:
    engine = group_of(c, cells=161)
    core = engine.compute_core(engine.compute_constraint(), longest=80)
    assert core.cells.mean() > 0.2
    assert sum(escapes(c, engine, core.witness, seed) for seed in range(3)) == 0


@pytest.mark.parametrize(
    "forgotten",
    [
        {"disturbances": ((0.0, 0.0),)},
        {"errors": ((0.0, 0.0), (0.0, 0.0))},
        {"delay_ns": 0, "jitter_ns": 0},
    ],
)
def test_runs_escape_a_core_that_forgets(forgotten: dict[str, object]) -> None:
    c = Car(4.0, 4.0, 5.0, 0.02, delay=0.012, jitter=0.004, wind=0.3, errors=(0.2, 0.5))
    engine = group_of(c, forgotten, cells=121)
    core = engine.compute_core(engine.compute_constraint(), longest=80)
    assert sum(escapes(c, engine, core.witness, seed) for seed in range(3)) > 0


def test_the_core_does_not_depend_on_threads_or_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    c = CARS[3]
    engine = group_of(c, cells=101)
    allowed = engine.compute_constraint()
    two = engine.compute_core(allowed)
    engine.threads = 1
    one = engine.compute_core(allowed)
    engine.threads = 2
    monkeypatch.setattr("soter.verify.grid.sets.SLICE_S", 1e-4)
    slices = engine.compute_core(allowed)
    assert np.array_equal(one.witness, two.witness)
    assert np.array_equal(one.witness, slices.witness)


def test_less_patience_gives_a_smaller_core() -> None:
    engine = group_of(CARS[1], cells=101)
    allowed = engine.compute_constraint()
    patient, hasty = (engine.compute_core(allowed, patience=p).cells for p in (250, 1))
    assert np.all(patient | ~hasty)
    assert hasty.sum() > 0.95 * patient.sum()


def test_work_stops_when_it_is_told_to() -> None:
    engine = group_of(CARS[1], cells=301)
    with cancelled_when(lambda: True), pytest.raises(CancelledError):
        engine.truth_bits("safe")


def pushed(c: Car, start: Floats, t: float, rng: np.random.Generator) -> list[Floats]:
    """States over [0, t] under any command of U and any wind."""
    x, met = start, [start]
    for _ in range(6):
        u = corner(rng, -c.brake, c.brake, (start.shape[1],))
        x = flow(x, u + corner(rng, -c.wind, c.wind, (start.shape[1],)), np.full_like(u, t / 6))
        met.append(x)
    worst = np.where(rng.random(start.shape[1]) < 0.5, 1, -1) * (c.brake + c.wind)
    return [*met, *(flow(start, worst, np.full_like(worst, s)) for s in np.linspace(0, t, 9))]


@pytest.mark.parametrize("segments", [1, 3])
def test_nothing_under_u_leaves_the_target_within_t(segments: int) -> None:
    c, rng = CARS[1], np.random.default_rng(3)
    engine = group_of(c, cells=161)
    core = engine.compute_core(engine.compute_constraint(), longest=80).cells
    safe = safe_in_pieces(engine, 120 * MS, core, segments)
    assert 0.3 * core.sum() < safe.sum() < core.sum()
    start, _ = drawn(engine, safe, rng, 4000)
    for x in pushed(c, start, 0.12, rng):
        assert inside(engine, core, x).all()
    start, _ = drawn(engine, safe_in_pieces(engine, 80 * MS, core, segments), rng, 4000)
    assert not all(inside(engine, core, x).all() for x in pushed(c, start, 0.12, rng))


def test_more_segments_never_lose_the_border_of_what_is_safe() -> None:
    engine = group_of(CARS[1], cells=161)
    core = engine.compute_core(engine.compute_constraint(), longest=80).cells
    few, many = (safe_in_pieces(engine, 120 * MS, core, s) for s in (1, 6))
    assert many.sum() >= few.sum()


def test_a_map_under_u_is_one_step_after_the_other() -> None:
    inputs = GridInputs(
        states=((-2.0, 2.0), (-0.6, 0.6)), controls=((-1.0, 1.0),), kind="map", period_ns=100 * MS
    )
    edges = [np.linspace(-2, 2, 121), np.linspace(-0.6, 0.6, 121)]
    engine = GridGroup(hill(1.0, 2.0), inputs, list(enumerate(edges)))
    rng = np.random.default_rng(4)
    core = engine.compute_core(np.ones(engine.shape, dtype=bool)).cells
    safe = [engine.cells_safe_for(k * 100 * MS, core) for k in range(4)]
    assert np.array_equal(safe[0], core)
    assert core.sum() > safe[1].sum() > safe[2].sum() > safe[3].sum() > 0
    for k in (1, 2, 3):
        x, _ = drawn(engine, safe[k], rng, 3000)
        for _ in range(k):
            u = corner(rng, -1.0, 1.0, (x.shape[1],))
            v = np.clip(x[1] + 0.1 * u - 0.05 * x[0], -0.5, 0.5)
            x = np.stack([x[0] + v, v])
            assert inside(engine, core, x).all()


def test_erosion_and_dilation_agree_with_their_definition() -> None:
    rng = np.random.default_rng(5)
    edges = [np.sort(rng.uniform(-2, 2, 14)), np.sort(rng.uniform(-4, 4, 12))]
    whole = group_of(CARS[0])
    engine = GridGroup(whole.library, whole.inputs, list(enumerate(edges)))
    cells = rng.random(engine.shape) < 0.8
    e = {0: 0.21, 1: 0.4}
    eroded, dilated = engine.erode(cells, e), engine.dilate(cells, e)
    for at in np.ndindex(*engine.shape):
        box = [(edges[a][at[a]] - e[a], edges[a][at[a] + 1] + e[a]) for a in range(2)]
        touched = np.ix_(*[
            (edges[a][1:] > box[a][0]) & (edges[a][:-1] < box[a][1]) for a in range(2)
        ])  # fmt: skip
        off = any(box[a][0] < edges[a][0] or box[a][1] > edges[a][-1] for a in range(2))
        assert eroded[at] == (bool(cells[touched].all()) and not off)
        assert dilated[at] == bool(cells[touched].any())


def test_truth_of_a_predicate_over_cells() -> None:
    engine = group_of(CARS[1], cells=33)
    truth = engine.truth_bits("safe")
    low, high = engine.edges[0][:-1], engine.edges[0][1:]
    definite = (low >= -WALL) & (high <= WALL)
    never = (low > WALL) | (high < -WALL)
    expected = np.where(definite, 2, np.where(never, 1, 3))
    assert np.array_equal(truth, np.repeat(expected[:, None], engine.shape[1], axis=1))
    assert np.array_equal(engine.compute_constraint(), truth == 2)
