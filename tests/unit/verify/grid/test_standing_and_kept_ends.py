"""What stands keeps standing; ends that the plant keeps are no way out; and nothing beyond that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from tables import all_rows
from unit.verify.grid.sampled_sc_runs import Sampled
from unit.verify.grid.small_enclosure_units import END, SIGNATURE, _source, corner, linear
from unit.verify.grid.test_grid_sets import inside

if TYPE_CHECKING:
    import numpy.typing as npt

    Bools = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]

MS = 1_000_000

# in: x, u, w, e;  x' = u + w, u = -GAIN max(x + e - EDGE, 0), at least -1
TABLE = (
    SIGNATURE.format(name="law", type="soter_form")
    + """  soter_form y, a, b;
  soter_n_add(SOTER_INPUTS, &y, &in[0], &in[3]);
  soter_n_shift(SOTER_INPUTS, &a, &y, -EDGE, -EDGE);
  soter_n_at_least(SOTER_INPUTS, &b, &a, 0.0);
  soter_n_scale(SOTER_INPUTS, &a, &b, -GAIN, -GAIN);
  soter_n_at_least(SOTER_INPUTS, &out[0], &a, -1.0);
"""
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + "  soter_n_add(SOTER_INPUTS, &out[0], &in[1], &in[2]);\n"
    + END.format()
)
# the same with two states, the second x2' = x1 - 2 x2 + w
BESIDE = TABLE.replace("in[3]", "in[4]").replace(
    "  soter_n_add(SOTER_INPUTS, &out[0], &in[1], &in[2]);\n",
    """  soter_form a, b;
  out[0] = in[2];
  soter_n_scale(SOTER_INPUTS, &a, &in[1], -2.0, -2.0);
  soter_n_add(SOTER_INPUTS, &b, &a, &in[0]);
  soter_n_add(SOTER_INPUTS, &out[1], &b, &in[3]);
""",
)
# in: x, u, w;  x' = u + w - x |x| (or - x where LINEAR); u = 0
TANK = (
    SIGNATURE.format(name="law", type="soter_form")
    + "  soter_n_range(SOTER_INPUTS, &out[0], 0.0, 0.0);\n"
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + """  soter_form a, b, out_flow;
  soter_n_abs(SOTER_INPUTS, &a, &in[0]);
  soter_n_mul(SOTER_INPUTS, &b, &a, &in[0]);
  soter_n_add(SOTER_INPUTS, &a, &in[1], &in[2]);
  out_flow = LINEAR ? in[0] : b;
  soter_n_sub(SOTER_INPUTS, &out[0], &a, &out_flow);
"""
    + END.format()
)

# in: x, y, u, w;  x' = w (1 + 4 y^2), y' = u; u = 0.3
PUSHED = (
    SIGNATURE.format(name="law", type="soter_form")
    + "  soter_n_range(SOTER_INPUTS, &out[0], 0.3, 0.3);\n"
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + """  soter_form a, b;
  soter_n_square(SOTER_INPUTS, &a, &in[1]);
  soter_n_scale(SOTER_INPUTS, &b, &a, 4.0, 4.0);
  soter_n_shift(SOTER_INPUTS, &a, &b, 1.0, 1.0);
  soter_n_mul(SOTER_INPUTS, &out[0], &a, &in[3]);
  out[1] = in[2];
"""
    + END.format()
)


def table(
    edge: float = 10.0,
    gain: float = 1.0,
    *,
    wind: tuple[float, float] = (0.0, 0.0),
    delay: int = 0,
    jitter: int = 0,
    error: float = 0.0,
    cells: int = 200,
    plant_ms: int = 0,
) -> GridGroup:
    """A table on a rail, [-1, 1]; SC reads below `edge`: it stands."""
    inputs = GridInputs(
        states=((-1.0, 1.0),),
        controls=((-1.0, 1.0),),
        disturbances=(wind,),
        errors=((-error, error),),
        period_ns=20 * MS,
        delay_ns=delay * MS,
        jitter_ns=jitter * MS,
        plant_period_ns=plant_ms * MS,
    )
    unit = linear(_source(TABLE, 4, {"EDGE": edge, "GAIN": gain}))
    return GridGroup(unit, inputs, [(0, np.linspace(-1, 1, cells + 1))])


@pytest.mark.parametrize("times", [(0, 0), (12, 0), (0, 4), (30, 9)])
@pytest.mark.parametrize("plant_ms", [0, 10])
def test_what_stands_is_kept_cell_by_cell_and_at_the_ends(
    times: tuple[int, int], plant_ms: int
) -> None:
    engine = table(delay=times[0], jitter=times[1], plant_ms=plant_ms, error=0.01)
    assert engine.covers_scheme == (plant_ms > 0)
    rng = np.random.default_rng(1)
    for allowed in (np.ones(200, dtype=bool), rng.random(200) < 0.3):
        core = engine.compute_core(allowed)
        assert np.array_equal(core.cells, allowed)
        assert core.witness.max() == 1


@pytest.mark.parametrize("wind", [(-1e-9, 1e-9), (0.0, 1e-12), (-1e-12, 0.0), (1e-9, 1e-9)])
def test_what_is_pushed_does_not_stand(wind: tuple[float, float]) -> None:
    engine = table(wind=wind)
    assert not engine.compute_core(np.ones(200, dtype=bool)).cells.any()


def test_a_command_that_is_nearly_zero_does_not_stand() -> None:
    assert not table(-2.0, 1e-9).compute_core(np.ones(200, dtype=bool)).cells.any()


def rate(_: Floats, u: Floats, w: Floats) -> Floats:
    return np.stack([u + w])


def escaped(engine: GridGroup, witness: npt.NDArray[np.uint8], system: Sampled, seed: int) -> int:
    """Runs from K that leave the grid before a_N or are not in K at a_N."""
    rng = np.random.default_rng(seed)
    cells = np.flatnonzero(witness)
    ends = np.repeat([cells[0], cells[1], cells[-2], cells[-1]], 100)
    at = np.concatenate([ends, cells[rng.integers(0, len(cells), 400)]])
    edges = engine.edges[0]
    start = edges[at] + corner(rng, 0.0, 1.0, (len(at),)) * np.diff(edges)[at]
    low, high, last = system.run(start[None], witness[at].astype(int), rng)
    away = (low[0] < edges[0] - 1e-9) | (high[0] > edges[-1] + 1e-9)
    return int((away | ~inside(engine, witness != 0, last)).sum())


CASES = [
    (edge, delay, jitter, error)
    for edge in (-1.0, -0.9899, -0.97, -0.5)
    for delay, jitter, error in ((0, 0, 0.0), (12, 0, 0.0), (0, 4, 0.0), (12, 4, 0.0), (5, 2, 0.02))
]


@all_rows(("edge", "delay", "jitter", "error"), CASES)
def test_no_run_leaves_a_core_of_what_stands_below_an_edge(
    edge: float, delay: int, jitter: int, error: float
) -> None:
    engine = table(edge, 3.0, delay=delay, jitter=jitter, error=error)
    core = engine.compute_core(np.ones(200, dtype=bool))
    far = edge + 1.0 >= 0.011 + delay * 1e-3 + error
    assert core.cells.any() or not far
    assert core.cells[0] or not far
    if core.cells.any():
        system = Sampled(
            rate, lambda y: np.maximum(-3.0 * np.maximum(y[0] - edge, 0.0), -1.0),
            (-1.0, 1.0), (0.0, 0.0), 20, delay, jitter, error,
        )  # fmt: skip
        assert sum(escaped(engine, core.witness, system, seed) for seed in range(2)) == 0


@pytest.mark.parametrize(
    ("delay", "error", "wind"), [(12, 0.0, 0.0), (0, 0.02, 0.0), (0, 0.0, -1e-4)]
)
def test_the_runs_would_show_what_a_standing_core_forgot(
    delay: int, error: float, wind: float
) -> None:
    system = Sampled(
        rate, lambda y: np.maximum(-3.0 * np.maximum(y[0] + 0.9899, 0.0), -1.0),
        (-1.0, 1.0), (wind, 0.0), 20, delay, 0, error,
    )  # fmt: skip
    witness = table(-0.9899, 3.0).compute_core(np.ones(200, dtype=bool)).witness
    assert witness[0]
    assert escaped(table(-0.9899, 3.0), witness, system, 3) > 0


@pytest.mark.long
def test_one_state_stands_beside_another_that_moves() -> None:
    inputs = GridInputs(
        states=((-1.0, 1.0), (-1.0, 1.0)),
        controls=((-1.0, 1.0),),
        disturbances=((-0.1, 0.1),),
        errors=((0.0, 0.0),),
        period_ns=20 * MS,
        delay_ns=5 * MS,
        jitter_ns=2 * MS,
    )
    edges = np.linspace(-1, 1, 41)
    unit = linear(_source(BESIDE, 5, {"EDGE": 0.5, "GAIN": 1.0}))
    engine = GridGroup(unit, inputs, [(0, edges), (1, edges)])
    images, tubes = engine.images_and_tubes((0.1, 0.2), (0.3, 0.4), 20)
    assert np.all(images[:, 0] == (0.1, 0.3))
    assert np.all(tubes[:, 0] == (0.1, 0.3))
    moved, _ = engine.images_and_tubes((0.4, 0.2), (0.501, 0.4), 3)
    assert np.all(moved[:, 0, 0] < 0.4)
    rng = np.random.default_rng(4)
    x = np.stack([corner(rng, 0.1, 0.3, (500,)), corner(rng, 0.2, 0.4, (500,))])
    for image in images:
        w = corner(rng, -0.1, 0.1, (500,))
        rest = (x[0] + w) / 2
        x[1] = rest + (x[1] - rest) * np.exp(-0.04)
        assert np.all((image[1, 0] - 1e-12 <= x[1]) & (x[1] <= image[1, 1] + 1e-12))


def test_what_stands_soon_still_moves_under_the_command_before() -> None:
    """-1 acts from 0 until as late as 24 ms, the next command being 4 ms late: then it stands."""
    engine = table(0.0, 1e4, jitter=4)
    images, _ = engine.images_and_tubes((0.005,), (0.006,), 3)
    for image in images:
        assert image[0, 0] <= 0.005 - 0.024 <= image[0, 1]
    assert images[2, 0, 0] > -0.05
    quick, _ = table(0.0, 1e4).images_and_tubes((0.005,), (0.006,), 3)
    assert np.array_equal(quick[1], quick[2])  # without jitter it stands from the second hold on


# ---------------------------------------------------------------- ends that the plant keeps


def tank(
    *,
    rain: tuple[float, float] = (0.0, 0.05),
    pump: tuple[float, float] = (0.0, 0.5),
    is_linear: bool = False,
    delay: int = 0,
    jitter: int = 0,
    plant_ms: int = 0,
    low: float = 0.0,
) -> GridGroup:
    """A tank whose level is never below zero, on a grid that ends at `low`."""
    inputs = GridInputs(
        states=((low, 1.0),),
        controls=(pump,),
        disturbances=(rain,),
        period_ns=50 * MS,
        delay_ns=delay * MS,
        jitter_ns=jitter * MS,
        plant_period_ns=plant_ms * MS,
    )
    unit = linear(_source(TANK, 3, {"LINEAR": float(is_linear)}))
    return GridGroup(unit, inputs, [(0, np.linspace(low, 1.0, 101))])


def kept(engine: GridGroup) -> tuple[int, int]:
    return engine.c.kept_low[0], engine.c.kept_high[0]


LATE = [(0, 0), (20, 0), (0, 10), (20, 10)]


@pytest.mark.parametrize("times", LATE)
@pytest.mark.parametrize("is_linear", [True, False])
def test_a_tank_may_be_empty(times: tuple[int, int], is_linear: bool) -> None:
    engine = tank(is_linear=is_linear, delay=times[0], jitter=times[1])
    assert engine.is_linear == is_linear
    assert kept(engine) == (1, 1)  # 0.55 flows in at most, 1 flows out of a full one
    core = engine.compute_core(np.ones(100, dtype=bool))
    assert core.cells.all()
    free = engine.cells_safe_for(100 * MS, core.cells)
    assert free.all()
    target = np.arange(100) < 80
    free = engine.cells_safe_for(100 * MS, target)
    assert free[:70].all()
    assert not free[79:].any()
    system = Sampled(
        lambda x, u, w: np.stack([u + w - (x[0] if is_linear else x[0] * np.abs(x[0]))]),
        lambda y: np.zeros(y.shape[1]),
        (0.0, 0.5), (0.0, 0.05), 50, times[0], times[1],
    )  # fmt: skip
    assert escaped(engine, core.witness, system, 5) == 0
    free_runs = Sampled(
        system.rate, lambda y: np.full(y.shape[1], 0.5), (0.0, 0.5), (0.05, 0.05), 100
    )
    start = np.append(engine.edges[0][:-1][free], engine.edges[0][1:][free])
    _, high, _ = free_runs.run(start[None], np.ones(len(start), dtype=int), np.random.default_rng())
    assert high.max() <= engine.edges[0][80] + 1e-9


@pytest.mark.parametrize(
    "almost",
    [
        {"rain": (-1e-9, 0.05)},
        {"pump": (-1e-6, 0.5)},
        {"low": 1e-6},
        {"rain": (-1e-6, 0.05), "is_linear": True},
        {"low": 1e-6, "is_linear": True},
    ],
)
def test_an_end_that_is_only_almost_kept_is_unsafe(almost: dict[str, float]) -> None:
    engine = tank(**almost)  # type: ignore[arg-type]
    assert kept(engine) == (0, 1)
    core = engine.compute_core(np.ones(100, dtype=bool))
    if "pump" not in almost:
        assert not core.cells[0]
    assert not engine.cells_safe_for(20 * MS, np.ones(100, dtype=bool))[0]


def test_a_border_that_is_left_where_it_repels_is_not_kept() -> None:
    """x' = x: nothing leaves 0, but only by uniqueness; beyond it the flow runs away."""
    away = TANK.replace("n_sub(SOTER_INPUTS, &out[0], &a", "n_add(SOTER_INPUTS, &out[0], &a")
    source = _source(away, 3, {"LINEAR": 1.0})
    inputs = GridInputs(
        states=((0.0, 1.0),), controls=((0.0, 0.0),), disturbances=((0.0, 0.0),), period_ns=50 * MS
    )
    engine = GridGroup(linear(source), inputs, [(0, np.linspace(0, 1, 101))])
    assert kept(engine) == (0, 0)


def test_an_end_is_kept_with_the_error_of_the_scheme_or_not_at_all() -> None:
    inward, neutral = tank(is_linear=True, plant_ms=5, rain=(1e-6, 0.05)), tank(
        is_linear=True, plant_ms=5
    )  # fmt: skip
    assert (kept(inward), kept(neutral)) == ((1, 1), (0, 1))
    assert inward.covers_scheme
    assert neutral.covers_scheme
    assert (inward.crossed, neutral.crossed) == ([], ["state 0 above 0"])


# ---------------------------------------------------------------- one way


@all_rows("times", [(0, 0), (15, 4)])
@all_rows("little", [1e-2, 1e-5, 1e-9])
@all_rows("up", [True, False])
def test_an_end_stays_where_no_push_goes_there_and_moves_with_the_least_one(
    times: tuple[int, int], little: float, *, up: bool
) -> None:
    """Of a flow that is not linear; the runs that are pushed all the time say how far it moves."""
    seconds, longest = 3 * 0.02 - times[1] * 1e-3, (3 * 0.02 + times[1] * 1e-3) * (1 + 4 * 0.2**2)
    low, high = np.array([-0.1, -0.2]), np.array([0.05, -0.15])
    for wind in ((0.0, 0.3), (0.0, little), (-little, 0.3), (little, 0.3)):
        least, most = wind if up else (-wind[1], -wind[0])
        inputs = GridInputs(
            states=((-1.0, 1.0), (-1.0, 1.0)),
            controls=((-1.0, 1.0),),
            disturbances=((least, most),),
            period_ns=20 * MS,
            delay_ns=times[0] * MS,
            jitter_ns=times[1] * MS,
        )
        axes = [(k, np.linspace(-1, 1, 41)) for k in (0, 1)]
        engine = GridGroup(linear(_source(PUSHED, 4, {})), inputs, axes)
        assert engine.c.is_local
        images, tubes = engine.images_and_tubes(low, high, 3)
        assert len(images) == 3
        for enclosures in (images, tubes):
            lows, highs = enclosures[:, 0, 0], enclosures[:, 0, 1]
            assert (lows >= low[0]).all() == (least >= 0.0)
            assert (highs <= high[0]).all() == (most <= 0.0)
            assert lows[-1] <= low[0] + least * (seconds if least < 0.0 else longest)
            assert highs[-1] >= high[0] + most * (seconds if most > 0.0 else longest)
