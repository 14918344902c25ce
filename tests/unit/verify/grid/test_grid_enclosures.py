"""Images and tubes contain every run, to the last bit that numpy has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.grid_adversary import Car, Runs
from unit.verify.grid.small_enclosure_units import car, corner, hill, pendulum

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

MS = 1_000_000
SLACK = 1e-12  # of numpy's own rounding along a run


def group_of(c: Car, changed: dict[str, object] | None = None, cells: int = 40) -> GridGroup:
    """The engine for a car on [-2, 2] x [-4, 4]."""
    values: dict[str, object] = {
        "states": ((-2.0, 2.0), (-4.0, 4.0)),
        "controls": ((-c.brake, c.brake),),
        "disturbances": ((-c.wind, c.wind),),
        "errors": tuple((-e, e) for e in c.errors),
        "period_ns": round(c.period * 1e9),
        "delay_ns": round(c.delay * 1e9),
        "jitter_ns": round(c.jitter * 1e9),
        "parameters": tuple(round(1000 * k) for k in (c.kp, c.kv, c.brake)),
    }
    inputs = GridInputs(**{**values, **(changed or {})})  # type: ignore[arg-type]
    edges = [np.linspace(-2, 2, cells + 1), np.linspace(-4, 4, cells + 1)]
    return GridGroup(car(), inputs, list(enumerate(edges)))


CARS = [
    Car(4.0, 4.0, 5.0, 0.01),
    Car(4.0, 4.0, 5.0, 0.01, wind=0.3, errors=(0.05, 0.1)),
    Car(4.0, 4.0, 5.0, 0.01, delay=0.004, wind=0.3, errors=(0.05, 0.1)),
    Car(4.0, 4.0, 5.0, 0.02, delay=0.012, jitter=0.004, wind=0.3, errors=(0.02, 0.1)),
    Car(9.0, 6.0, 3.0, 0.01, delay=0.035, jitter=0.002, wind=0.1),
    Car(9.0, 6.0, 30.0, 0.02, jitter=0.008),
    Car(9.0, 6.0, 30.0, 0.02, delay=0.03),
]


def outside(c: Car, engine: GridGroup, rng: np.random.Generator, holds: int = 15) -> float:
    """How far the worst of 400 runs from a random box gets out of images or tubes."""
    low = rng.uniform((-1.2, -2.0), (1.0, 1.6))
    high = low + rng.uniform(0, 0.2, 2) * rng.choice([0.0, 0.01, 1.0])
    images, tubes = engine.images_and_tubes(low, high, holds)
    assert len(images) == holds
    start = np.stack([corner(rng, low[i], high[i], (400,)) for i in range(2)])
    worst = -np.inf
    for k, x, met in Runs(c, start, rng).holds(holds):
        box = images[k - 1]
        worst = max(worst, float((x - box[:, 1, None]).max()), float((box[:, 0, None] - x).max()))
        near = [k - 1, min(k, holds - 1)] if c.jitter else [k - 1]
        low_t, high_t = tubes[near, :, 0].min(axis=0), tubes[near, :, 1].max(axis=0)
        if c.jitter:
            low_t = np.minimum(low_t, box[:, 0])
            high_t = np.maximum(high_t, box[:, 1])
        for y in met:
            over = max(float((y - high_t[:, None]).max()), float((low_t[:, None] - y).max()))
            worst = max(worst, over)
    return worst


@pytest.mark.parametrize("c", CARS, ids=range(len(CARS)))
def test_runs_stay_in_images_and_tubes(c: Car) -> None:
    rng = np.random.default_rng(7)
    engine = group_of(c)
    assert engine.is_linear
    assert max(outside(c, engine, rng) for _ in range(12)) <= SLACK


def test_the_runs_would_show_a_forgotten_wind_error_delay_or_jitter() -> None:
    rng = np.random.default_rng(8)
    c = CARS[3]
    forgotten: list[dict[str, object]] = [
        {"disturbances": ((0.0, 0.0),)},
        {"errors": ((0.0, 0.0), (0.0, 0.0))},
        {"delay_ns": 0},
        {"jitter_ns": 0},
    ]
    for changed in forgotten:
        engine = group_of(c, changed)
        assert max(outside(c, engine, rng) for _ in range(12)) > 1e-6, changed


def test_enclosures_are_tight_for_a_point_without_noise() -> None:
    c = CARS[0]
    images, _ = group_of(c).images_and_tubes((0.5, 1.0), (0.5, 1.0), 20)
    assert np.all(images[:, :, 1] - images[:, :, 0] < 1e-12)


def pendulum_rate(x: Floats, a: Floats) -> Floats:
    return np.stack([x[1], -np.sin(x[0]) - 0.2 * x[1] * np.abs(x[1]) + a])


@pytest.mark.long
def test_a_nonlinear_flow_is_enclosed() -> None:
    rng = np.random.default_rng(9)
    edges = [np.linspace(-1.2, 1.2, 31), np.linspace(-2, 2, 31)]
    inputs = GridInputs(
        states=((-1.2, 1.2), (-2.0, 2.0)),
        controls=((-1.0, 1.0),),
        disturbances=((-0.1, 0.1),),
        period_ns=50 * MS,
    )
    engine = GridGroup(pendulum(3.0, 2.0, 1.0), inputs, list(enumerate(edges)))
    assert not engine.is_linear
    for _ in range(8):
        low = rng.uniform((-0.6, -0.8), (0.5, 0.7))
        high = low + rng.uniform(0, 0.1, 2)
        images, tubes = engine.images_and_tubes(low, high, 12)
        assert len(images) == 12
        assert (images[-1, :, 1] - images[-1, :, 0]).max() < 0.5
        x = np.stack([corner(rng, low[i], high[i], (200,)) for i in range(2)])
        for image, tube in zip(images, tubes, strict=True):
            u = np.clip(-3.0 * x[0] - 2.0 * x[1], -1, 1)
            for _ in range(20):
                a = u + corner(rng, -0.1, 0.1, (200,))
                h = 0.05 / 20
                k1 = pendulum_rate(x, a)
                k2 = pendulum_rate(x + h / 2 * k1, a)
                k3 = pendulum_rate(x + h / 2 * k2, a)
                k4 = pendulum_rate(x + h * k3, a)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                assert np.all(x <= tube[:, 1, None] + 1e-9)
                assert np.all(x >= tube[:, 0, None] - 1e-9)
            assert np.all((image[:, 0, None] - 1e-9 <= x) & (x <= image[:, 1, None] + 1e-9))


def test_a_map_is_enclosed() -> None:
    rng = np.random.default_rng(10)
    edges = [np.linspace(-2, 2, 41), np.linspace(-0.6, 0.6, 41)]
    inputs = GridInputs(
        states=((-2.0, 2.0), (-0.6, 0.6)), controls=((-1.0, 1.0),), kind="map", period_ns=100 * MS
    )
    engine = GridGroup(hill(1.0, 2.0), inputs, list(enumerate(edges)))
    for _ in range(20):
        low = rng.uniform((-1.2, -0.4), (1.0, 0.3))
        high = low + rng.uniform(0, 0.1, 2)
        images, _ = engine.images_and_tubes(low, high, 30)
        x = np.stack([corner(rng, low[i], high[i], (200,)) for i in range(2)])
        assert len(images) == 30
        for image in images:
            u = np.clip(-x[0] - 2.0 * x[1], -1, 1)
            v = np.clip(x[1] + 0.1 * u - 0.05 * x[0], -0.5, 0.5)
            x = np.stack([x[0] + v, v])
            assert np.all((image[:, 0, None] - SLACK <= x) & (x <= image[:, 1, None] + SLACK))


@pytest.mark.parametrize("steps", [2, 3])
def test_a_command_is_held_for_every_step_of_a_map_until_sc_steps_again(steps: int) -> None:
    rng = np.random.default_rng(15)
    edges = [np.linspace(-2, 2, 41), np.linspace(-0.6, 0.6, 41)]
    inputs = GridInputs(
        states=((-2.0, 2.0), (-0.6, 0.6)),
        controls=((-1.0, 1.0),),
        kind="map",
        period_ns=steps * 100 * MS,
        map_step_ns=100 * MS,
    )
    engine = GridGroup(hill(1.0, 2.0), inputs, list(enumerate(edges)))
    for _ in range(20):
        low = rng.uniform((-1.2, -0.4), (1.0, 0.3))
        images, tubes = engine.images_and_tubes(low, low + rng.uniform(0, 0.1, 2), 8)
        x = np.stack([corner(rng, low[i], low[i], (1,)) for i in range(2)])
        assert len(images) == 8
        for image, tube in zip(images, tubes, strict=True):
            u = np.clip(-x[0] - 2.0 * x[1], -1, 1)
            for _ in range(steps):
                assert np.all((tube[:, 0, None] - SLACK <= x) & (x <= tube[:, 1, None] + SLACK))
                v = np.clip(x[1] + 0.1 * u - 0.05 * x[0], -0.5, 0.5)
                x = np.stack([x[0] + v, v])
            assert np.all((image[:, 0, None] - SLACK <= x) & (x <= image[:, 1, None] + SLACK))
