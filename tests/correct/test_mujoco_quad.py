"""The drone on MuJoCo's rigid body: the model monitor is silent without air and loud in it.

Non-goals: hours (`bench/drone/off_model.py`), the plant of the proof (`test_drone_design.py`).
"""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.api import load

pytest.importorskip("mujoco", reason="the extra `simulators` is not installed")

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
PROGRAM = DRONE / "mujoco_quad.soter"


@pytest.fixture(scope="module")
def quad() -> Any:
    spec = importlib.util.spec_from_file_location("mujoco_quad_of_tests", DRONE / "mujoco_quad.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_its_figures_are_those_of_the_iris(quad: Any) -> None:
    program = load(PROGRAM)

    def constant(name: str) -> Any:
        return program.constant(f"iris.{name}")

    assert constant("MASS") == quad.MASS
    inertia = constant("INERTIA")
    assert (inertia.x, inertia.y, inertia.z) == quad.INERTIA
    names = ("THRUST", "MOMENT", "LAG_UP", "LAG_DOWN", "WIND")
    assert [constant(n) for n in names] == [getattr(quad, n) for n in names]
    assert quad.ROTORS["front_right"][1] == -constant("ARM_FRONT")
    assert quad.ROTORS["rear_left"][1] == constant("ARM_REAR")


def iris_rates(spins: dict[str, float], q: Any, rate: Any) -> tuple[Any, Any]:
    """v' and rate' of iris.soter's equations, without wind; q as (w, x, y, z), rate (3,)."""
    f1, f2, f3, f4 = (
        5.84e-6 * spins[n] ** 2 for n in ("front_right", "rear_left", "front_left", "rear_right")
    )
    w, x, y, z = q
    up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    v = up * (f1 + f2 + f3 + f4) / 1.5 - np.array([0.0, 0.0, 9.81])
    jx, jy, jz = 0.029125, 0.029125, 0.055225
    moments = (
        0.22 * (f3 - f1) + 0.20 * (f2 - f4) - (jz - jy) * rate[1] * rate[2],
        0.13 * (f2 - f1 + f4 - f3) - (jx - jz) * rate[0] * rate[2],
        0.06 * (f3 + f4 - f1 - f2) - (jy - jx) * rate[0] * rate[1],
    )
    return v, np.array(moments) / (jx, jy, jz)


def test_its_body_accelerates_as_the_equations_of_the_iris_say(quad: Any) -> None:
    vehicle = quad.Quad()
    chance = np.random.default_rng(5)
    for _ in range(50):
        vehicle.reset(0)
        vehicle._wind = SimpleNamespace(uniform=lambda *_: np.zeros(3))
        q = chance.normal(size=4)
        q /= np.linalg.norm(q)
        rate, v = chance.normal(size=3), chance.normal(size=3)
        spins = {n: float(chance.uniform(500.0, 1000.0)) for n in quad.ROTORS}
        after = vehicle.step(inputs(q, rate, v, spins))
        dv, drate = iris_rates(spins, q, rate)
        h = quad.PERIOD_S
        turned = np.abs(np.array(after["rate"]) - rate).max() * 15 * h + 0.06
        assert np.allclose(np.array(after["v"]) - v, h * dv, atol=h * turned)
        assert np.allclose(np.array(after["rate"]) - rate, h * drate, atol=h * 0.4)
        assert math.isclose(float(np.linalg.norm(after["q"])), 1.0, abs_tol=1e-9)


def inputs(q: Any, rate: Any, v: Any, spins: dict[str, float]) -> SimpleNamespace:
    """Rotors keep their speed."""
    named = SimpleNamespace

    def vector(x: Any) -> SimpleNamespace:
        return named(x=float(x[0]), y=float(x[1]), z=float(x[2]))

    w, x, y, z = map(float, q)
    state = named(
        p=vector((0, 0, 0)),
        v=vector(v),
        q=named(w=w, x=x, y=y, z=z),
        rate=vector(rate),
        spin=named(**spins),
    )
    return named(state=state, rotors=named(**spins))


def test_the_model_of_the_proof_explains_a_lap_without_air() -> None:
    program = load(PROGRAM)
    (judged,) = program.monitor(seed=7)
    assert (judged.steps, judged.alarms) == (2998, 0)
    assert 0.4 < judged.share < 0.85


def test_the_monitor_finds_the_drag_that_the_model_has_not() -> None:
    (judged,) = load(PROGRAM).monitor(seed=7, system="InAir")
    assert judged.alarms > 50
    assert judged.share > 1.2


def test_the_same_seed_flies_the_same_lap_and_stays_in_its_tube() -> None:
    program = load(PROGRAM)
    one, other = (program.simulate(seed=3, until="4s") for _ in range(2))
    assert one.trace_sha256 == other.trace_sha256
    assert one.violations == 0


def test_the_wind_comes_from_the_seed(quad: Any) -> None:
    vehicle = quad.Quad()
    spins = dict.fromkeys(quad.ROTORS, 800.0)
    samples = []
    for seed in (3, 4, 3):
        vehicle.reset(seed)
        samples.append(vehicle.step(inputs((1, 0, 0, 0), np.zeros(3), np.zeros(3), spins)))
    assert samples[0] == samples[2] != samples[1]
