"""One to four axes, several groups, nonlinear flows, unequal cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.group_model import UnboundedError
from soter.verify.grid.scheme_error import scheme_error, scheme_weight
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.small_enclosure_units import (
    END,
    SIGNATURE,
    _source,
    corner,
    exact,
    linear,
    linear_source,
    pendulum,
    safe_in_pieces,
)
from unit.verify.grid.test_grid_enclosures import CARS, MS, group_of, pendulum_rate
from unit.verify.grid.test_grid_sets import drawn, escapes, inside

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]


def system(name: str) -> tuple[Floats, Floats, Floats]:
    """A, B and gains: a lag, a lagged cart, an oscillator, two carts of which one is pushed."""
    if name == "lag":
        return np.array([[-2.0]]), np.array([[2.0]]), np.array([[3.0]])
    if name == "lagged cart":
        a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -12.0]])
        return a, np.array([[0.0], [0.0], [12.0]]), np.array([[3.0, 3.5, 0.2]])
    if name == "oscillator":
        return np.array([[0.0, 40.0], [-40.0, -8.0]]), np.array([[0.0], [5.0]]), np.ones((1, 2))
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[3, 1] = 0.2
    return a, np.array([[0.0, 0], [1, 0], [0, 0], [0, 1]]), np.array(
        [[3.0, 3.0, 0, 0], [0, 0, 3.0, 3.0]]
    )  # fmt: skip


SIZES = {"lag": 40, "lagged cart": 15, "oscillator": 30, "two carts": 10}
WIND = 0.05


def engine_of(
    name: str,
    axes: list[int],
    controls: tuple[float, float] = (-2.0, 2.0),
    step_ns: int = 0,
) -> GridGroup:
    a, b, gains = system(name)
    n, m = b.shape
    inputs = GridInputs(
        states=((-1.0, 1.0),) * n,
        controls=(controls,) * m,
        disturbances=((-WIND, WIND),) * n,
        period_ns=20 * MS,
        plant_period_ns=step_ns,
    )
    edges = np.linspace(-1, 1, SIZES[name] + 1)
    return GridGroup(linear(linear_source(a, b, gains, 2.0)), inputs, [(i, edges) for i in axes])


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("lag", [0]),
        ("lagged cart", [0, 1, 2]),
        ("oscillator", [0, 1]),
        ("two carts", [0, 1, 2, 3]),
        ("two carts", [0, 1]),
        ("two carts", [2, 3]),
        ("two carts", [3, 2]),
    ],
)
def test_runs_of_any_group_stay_in_images_and_tubes(name: str, axes: list[int]) -> None:
    rng = np.random.default_rng(11)
    a, b, gains = system(name)
    engine = engine_of(name, axes)
    assert engine.is_linear
    worst = -np.inf
    for _ in range(6):
        low = rng.uniform(-0.4, 0.3, len(a))
        high = low + rng.uniform(0, 0.1, len(a))
        images, tubes = engine.images_and_tubes(low[axes], high[axes], 8)
        assert len(images) == 8
        x = np.stack([corner(rng, low[i], high[i], (300,)) for i in range(len(a))])
        for image, tube in zip(images, tubes, strict=True):
            u = np.clip(-gains @ x, -2, 2)
            for share in rng.dirichlet((1, 1, 1)):
                w = corner(rng, -WIND, WIND, x.shape)
                phi, integral = exact(a, 0.02 * share)
                x = phi @ x + integral @ (b @ u + w)
                assert np.abs(x).max() < 1
                seen = x[axes]
                worst = max(worst, float((seen - tube[:, 1, None]).max()),
                            float((tube[:, 0, None] - seen).max()))  # fmt: skip
            worst = max(worst, float((seen - image[:, 1, None]).max()),
                        float((image[:, 0, None] - seen).max()))  # fmt: skip
    assert worst < 1e-12
    assert worst > -0.3


@pytest.mark.parametrize(("name", "axes"), [("lag", [0]), ("lagged cart", [0, 1, 2]),
                                            ("two carts", [0, 1, 2, 3])])  # fmt: skip
def test_what_is_safe_under_u_is(name: str, axes: list[int]) -> None:
    rng = np.random.default_rng(12)
    a, b, _ = system(name)
    engine = engine_of(name, axes, (-0.5, 2.0))
    target = np.zeros(engine.shape, dtype=bool)
    middle = (slice(1, -1),) * len(axes)
    target[middle] = True
    safe = engine.cells_safe_for(30 * MS, target)
    assert 0 < safe.sum() < target.sum()
    at = np.argwhere(safe)[rng.integers(0, safe.sum(), 2000)]
    width = engine.edges[0][1] - engine.edges[0][0]
    x = -1 + width * (at.T + corner(rng, 0.0, 1.0, at.T.shape))
    limit = float(engine.edges[0][-2])
    for share in rng.dirichlet((1,) * 5):
        u = corner(rng, -0.5, 2.0, (b.shape[1], 2000))
        u[:, :500] = 2.0
        phi, integral = exact(a, 0.03 * share)
        x = phi @ x + integral @ (b @ u + corner(rng, -WIND, WIND, x.shape))
        assert np.abs(x).max() <= limit + 1e-9


@pytest.mark.parametrize("name", ["lagged cart", "oscillator"])
def test_a_tube_is_cut_as_often_as_pays_off(name: str) -> None:
    engine = engine_of(name, list(range(len(system(name)[0]))), (-0.5, 2.0))
    target = np.zeros(engine.shape, dtype=bool)
    target[(slice(1, -1),) * target.ndim] = True
    few, many = (safe_in_pieces(engine, 40 * MS, target, s) for s in (2, 32))
    safe_cells = engine.cells_safe_for(40 * MS, target)
    assert not np.any(few & ~safe_cells)
    assert not np.any(safe_cells & ~target)
    assert safe_cells.sum() > 1.05 * few.sum()
    assert safe_cells.sum() > 0.95 * many.sum()


def test_a_core_on_four_axes_is_the_product_of_its_parts() -> None:
    a, b, gains = system("two carts")
    a[3, 1] = 0.0
    inputs = GridInputs(
        states=((-1.0, 1.0),) * 4, controls=((-2.0, 2.0),) * 2,
        disturbances=((-WIND, WIND),) * 4, period_ns=20 * MS,
    )  # fmt: skip
    library = linear(linear_source(a, b, gains, 2.0))
    edges = np.linspace(-1, 1, 15)

    def core(axes: list[int]) -> npt.NDArray[np.bool_]:
        group = GridGroup(library, inputs, [(i, edges) for i in axes])
        return group.compute_core(np.ones(group.shape, dtype=bool), longest=60, patience=60).cells

    one, both = core([0, 1]), core([0, 1, 2, 3])
    product = one[:, :, None, None] & one[None, None]
    assert one.any()
    assert not np.any(both & ~product)
    assert both.sum() > 0.8 * product.sum()


ALONE = SIGNATURE.format(name="law_0", type="soter_form") + """  soter_form all[2];
  (void)soter_law(in, param, all);
  out[0] = all[0];
""" + END.format()  # fmt: skip


@pytest.mark.parametrize("limit", [2.0, 0.5])
def test_one_control_is_asked_alone_only_where_all_of_sc_is_free_of_faults(limit: float) -> None:
    """SC steps outside what it publishes for this group, too: with a fault there, it is no SC."""
    a, b, gains = system("two carts")
    whole = linear_source(a, b, gains, 2.0)
    faulty = whole.replace("return 0U;", f"return in[3].hi > {limit!r} ? 1U : 0U;", 1)
    assert faulty != whole
    inputs = GridInputs(
        states=((-1.0, 1.0),) * 4, controls=((-2.0, 2.0),) * 2,
        disturbances=((-WIND, WIND),) * 4, period_ns=20 * MS,
    )  # fmt: skip
    axes = [(i, np.linspace(-1, 1, 31)) for i in (0, 1)]
    cores = []
    for source in (faulty, faulty + ALONE):
        group = GridGroup(linear(source), inputs, axes)
        asked = "law_0" if limit > 1 and source is not faulty else "law"
        assert group.c.law == group.library.symbol(asked)
        cores.append(group.compute_core(np.ones(group.shape, dtype=bool), longest=60).witness)
    assert cores[0].any() == (limit > 1)
    assert np.array_equal(cores[0], cores[1])


def test_unequal_cells_are_as_sound() -> None:
    c = CARS[1]
    whole = group_of(c)
    p = np.concatenate([np.linspace(-2, -1, 61)[:-1], np.linspace(-1, 1, 31)[:-1],
                        np.linspace(1, 2, 61)])  # fmt: skip
    v = np.sinh(np.linspace(-2, 2, 120)) * 4 / np.sinh(2)
    engine = GridGroup(whole.library, whole.inputs, [(0, p), (1, v)])
    core = engine.compute_core(engine.compute_constraint(), longest=80)
    assert core.cells.any()
    assert sum(escapes(c, engine, core.witness, seed) for seed in range(2)) == 0


def pendulum_engine() -> GridGroup:
    edges = [np.linspace(-1.2, 1.2, 49), np.linspace(-2, 2, 61)]
    inputs = GridInputs(
        states=((-1.2, 1.2), (-2.0, 2.0)),
        controls=((-1.0, 1.0),),
        disturbances=((-0.1, 0.1),),
        period_ns=50 * MS,
    )
    return GridGroup(pendulum(3.0, 2.0, 1.0), inputs, list(enumerate(edges)))


def moved(x: Floats, force: Floats, t: float, steps: int) -> Floats:
    h = t / steps
    for _ in range(steps):
        k1 = pendulum_rate(x, force)
        k2 = pendulum_rate(x + h / 2 * k1, force)
        k3 = pendulum_rate(x + h / 2 * k2, force)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + pendulum_rate(x + h * k3, force))
    return x


def test_a_nonlinear_core_and_what_is_safe_under_u() -> None:
    rng, engine = np.random.default_rng(13), pendulum_engine()
    core = engine.compute_core(np.ones(engine.shape, dtype=bool), longest=40)
    assert 0.3 < core.cells.mean() < 1
    x, at = drawn(engine, core.cells, rng, 2000)
    n = core.witness[at[:, 0], at[:, 1]]
    for k in range(int(n.max())):
        u = np.clip(-3 * x[0] - 2 * x[1], -1, 1)
        x = moved(x, u + corner(rng, -0.1, 0.1, u.shape), 0.05, 5)
        assert inside(engine, core.cells, x)[n == k + 1].all()
    safe = engine.cells_safe_for(120 * MS, core.cells)
    assert 0 < safe.sum() < core.cells.sum()
    x, _ = drawn(engine, safe, rng, 3000)
    for share in rng.dirichlet((1,) * 7):
        force = corner(rng, -1.0, 1.0, (3000,)) + corner(rng, -0.1, 0.1, (3000,))
        x = moved(x, force, 0.12 * share, 3)
        assert inside(engine, core.cells, x).all()


def test_what_has_no_bound_is_said_to_have_none() -> None:
    a, b, gains = system("lag")
    inputs = GridInputs(
        states=((-1.0, 1.0),), controls=((-2.0, 2.0),), disturbances=((-WIND, WIND),),
        period_ns=20 * MS,
    )  # fmt: skip
    stiff = linear(linear_source(a * 1e5, b, gains, 2.0))
    with pytest.raises(UnboundedError):
        GridGroup(stiff, inputs, [(0, np.linspace(-1, 1, 11))])


def test_the_scheme_error_covers_one_step_of_the_simulator() -> None:
    rng = np.random.default_rng(14)
    a, b, _ = system("oscillator")
    h = 0.01
    model = {"A": a, "B": b, "c": np.zeros(2), "w": np.zeros(2)}
    w = scheme_error(model, np.ones(2), np.full(1, 2.0), h)
    phi, integral = exact(a, h)
    needed = 0.0
    for _ in range(200):
        x, u = corner(rng, -1, 1, (2,)), corner(rng, -2, 2, (1,))
        drive = b @ u
        k1 = a @ x + drive
        k2 = a @ (x + h / 2 * k1) + drive
        k3 = a @ (x + h / 2 * k2) + drive
        k4 = a @ (x + h * k3) + drive
        rk4 = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        error = np.linalg.solve(integral, rk4 - phi @ x - integral @ b @ u)
        assert np.all(np.abs(error) <= w)
        needed = max(needed, float((np.abs(error) / w).max()))
    assert needed > 0.05
    assert not scheme_weight(np.array([[0.0, 1.0], [0.0, 0.0]]), h).any()
    assert np.isinf(scheme_weight(a * 100, h)).all()


def test_the_scheme_error_is_part_of_the_model() -> None:
    without, with_it = (engine_of("oscillator", [0, 1], step_ns=k * MS) for k in (0, 10))
    grown = with_it.linear_model()["w"] - without.linear_model()["w"]
    expected = scheme_error(without.linear_model(), np.ones(2), np.full(1, 2.0), 0.01)
    assert np.allclose(grown, expected, rtol=1e-3)
    low, high = (-0.1, -0.1), (0.1, 0.1)
    few, many = (e.images_and_tubes(low, high, 3)[0] for e in (without, with_it))
    assert np.all(many[:, :, 1] > few[:, :, 1])


def test_the_scheme_error_of_a_group_counts_what_drives_it() -> None:
    """x' = z: alone the scheme is exact, but z swings, and its stages are no solution."""
    rng = np.random.default_rng(15)
    h, a, b = 0.01, np.zeros((3, 3)), np.zeros((3, 1))
    a[1, 2], a[2, 1], a[0, 1], b[2, 0] = 40.0, -40.0, 1.0, 5.0
    library = linear(linear_source(a, b, np.ones((1, 3)), 2.0))

    def engine(step_ns: int) -> GridGroup:
        inputs = GridInputs(
            states=((-1.0, 1.0),) * 3,
            controls=((-2.0, 2.0),),
            disturbances=((0.0, 0.0),) * 3,
            period_ns=20 * MS,
            plant_period_ns=step_ns,
        )
        return GridGroup(library, inputs, [(0, np.linspace(-1, 1, 11))])

    with_it = engine(round(h * 1e9))
    assert with_it.covers_scheme
    extra = float((with_it.linear_model()["w"] - engine(0).linear_model()["w"])[0])
    phi, integral = exact(a, h)
    needed = 0.0
    for _ in range(200):
        x, drive = corner(rng, -1, 1, (3,)), b @ corner(rng, -2, 2, (1,))
        k1 = a @ x + drive
        k2 = a @ (x + h / 2 * k1) + drive
        k3 = a @ (x + h / 2 * k2) + drive
        k4 = a @ (x + h * k3) + drive
        rk4 = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        needed = max(needed, abs(np.linalg.solve(integral, rk4 - phi @ x - integral @ drive)[0]))
    assert 1e-6 < needed <= extra


# in: x, v, u;  x' = v, v' = u, and up to 1000 more or less beyond EDGE
CLIFF = (
    SIGNATURE.format(name="derivative", type="soter_form")
    + """  soter_form edge, kick;
  out[0] = in[1];
  out[1] = in[2];
  soter_n_range(SOTER_INPUTS, &edge, EDGE, EDGE);
  if (soter_n_no_more(SOTER_INPUTS, &in[0], &edge) != 2) {
    soter_n_range(SOTER_INPUTS, &kick, -1000.0, 1000.0);
    soter_n_add(SOTER_INPUTS, &out[1], &in[2], &kick);
  }
"""
    + END.format()
)


@pytest.mark.parametrize(("edge", "covered"), [(1.002, False), (4.0, True)])
def test_the_scheme_is_covered_only_where_its_stages_see_the_same_flow(
    edge: float, covered: bool
) -> None:
    inputs = GridInputs(
        states=((-1.0, 1.0), (-4.0, 4.0)),
        controls=((-5.0, 5.0),),
        period_ns=100 * MS,
        plant_period_ns=100 * MS,
    )
    edges = [np.linspace(-1, 1, 41), np.linspace(-4, 4, 41)]
    engine = GridGroup(linear(_source(CLIFF, 3, {"EDGE": edge})), inputs, list(enumerate(edges)))
    assert engine.is_linear
    assert engine.covers_scheme is covered
