"""Docking in two and three directions: what bench/running/docking_peer.py rests on.

Purpose: limits of single directions say the limit of their zoo; the craft moves as the plant of
docking_orbit.soter does; the plane is proved and rechecked on a coarse grid, flown, and not left.
Of docking_together.soter: the craft is one of the small plants of the proofs, which are proved and
rechecked, and an AC on a straight line keeps control.
Non-goals: the peer; the figures.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import soter

pytest.importorskip("gymnasium", reason="the extra `gym` is not installed")

from bench.running import docking_peer

ROOT = Path(__file__).resolve().parents[2]
FINE = "/ 320, plane.{0}.v in [-0.32, 0.32] / 256"
COARSE = "/ 80, plane.{0}.v in [-0.32, 0.32] / 128"


@pytest.mark.parametrize("directions", [2, 3])
def test_limits_of_directions_say_the_limit_of_all(directions: int) -> None:
    rng = np.random.default_rng(directions)
    task = docking_peer.TASKS[directions]
    for _ in range(2000):
        r = rng.normal(size=directions) * 10.0 ** rng.uniform(-2, 2)
        v = docking_peer.each(task, r) * rng.choice([-1.0, 1.0, 0.3], directions)
        assert not docking_peer.outside(task, np.concatenate([r, v * (1.0 - 1e-12)]))
    fast = docking_peer.each(task, np.zeros(directions)) * 1.01
    assert docking_peer.outside(task, np.concatenate([np.zeros(directions), fast]))


@pytest.mark.parametrize("directions", [1, 2, 3])
def test_the_craft_moves_as_the_plant_of_the_proof(directions: int, tmp_path: Path) -> None:
    """With its own sensors and no disturbance: no step is off the model."""
    task = docking_peer.TASKS[directions]
    ours = docking_peer.Ours.of_each(task, tmp_path, shield=False)
    rng = np.random.default_rng(1)
    ours.env.reset(seed=1)
    for _ in range(200):
        wish = rng.uniform(-task.greatest, task.greatest, directions)
        *_, info = ours.env.step(wish)
        assert not info["off_model"]


def coarse(folder: Path) -> Path:
    """The plane on fewer cells."""
    text = (ROOT / docking_peer.ORBIT).read_text("utf-8")
    for axis in "xy":
        assert FINE.format(axis) in text
        text = text.replace(FINE.format(axis), COARSE.format(axis))
    path = folder / "orbit.soter"
    path.write_text(text, "utf-8")
    return path


def test_directions_that_feel_each_other_are_proved_and_rechecked(tmp_path: Path) -> None:
    program = soter.load(coarse(tmp_path))
    report = program.verify(system="InPlaneOrbit", cert=tmp_path / "cert", refute=False)
    module = report["InPlaneDocking"]
    assert [p for p in ("P2a", "P3", "ttf", "start", "DM") if not module.findings[p].holds] == []
    assert soter.recheck(tmp_path / "cert").accepted
    runs = [
        program.simulate(system="InPlaneOrbit", seed=1, until="120s", engine=e)
        for e in ("interp", "native")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations


# ---------------------------------------------------------------- one limit for all directions

FAR, ERROR, FUZZ = 200.0, 0.0125, 0.12
"""Those of docking_together.soter."""


def pull(task: docking_peer.Task) -> float:
    """PULL of docking_together.soter."""
    n, d = docking_peer.N, task.directions
    return 3 * n * n / task.v1 + 2 * n + task.v1 + float(np.sqrt(d)) * task.push / docking_peer.V0


def limit(task: docking_peer.Task, state: np.ndarray) -> float:
    return float(docking_peer.V0 + task.v1 * np.linalg.norm(state[: task.directions]))


def scaled(task: docking_peer.Task, state: np.ndarray) -> np.ndarray:
    return np.asarray(state[task.directions :] / limit(task, state))


def drawn(task: docking_peer.Task, rng: np.random.Generator) -> np.ndarray:
    """A state within the limit, often far out, near the chief or at the limit."""
    d = task.directions
    r = rng.normal(size=d)
    r *= rng.choice([0.0, 1e-3, 1.0, 50.0, 0.9 * FAR]) / np.linalg.norm(r)
    v = rng.normal(size=d) if rng.random() < 0.5 else r + 1e-6
    v *= rng.choice([0.05, 0.5, 0.9, 0.98]) / np.linalg.norm(v)
    state = np.concatenate([r, v])
    state[d:] *= limit(task, state)
    return state


def test_the_figures_are_those_of_the_program() -> None:
    text = (ROOT / docking_peer.TOGETHER).read_text("utf-8")
    for name, value in {"FAR": FAR, "ERROR": ERROR, "FUZZ": FUZZ}.items():
        assert f"const {name}: float = {value};" in text
    for end in ("PLANE", "SPACE"):
        assert f"PULL_{end}: float = 3.0 * N * N / V1_{end} + 2.0 * N + V1_{end} + " in text
        gain = f"gain: float in [1.0 / (V0 + V1_{end} * FAR), 1.0 / V0];"
        assert text.count(gain) == {"PLANE": 2, "SPACE": 1}[end]


@pytest.mark.parametrize("directions", [2, 3])
def test_what_is_read_is_as_wrong_as_declared(directions: int) -> None:
    task, rng = docking_peer.TASKS[directions], np.random.default_rng(directions)
    bounds = np.repeat(task.errors, directions)
    for _ in range(3000):
        state = drawn(task, rng)
        seen = state + bounds * rng.choice([-1.0, 1.0], 2 * directions)
        off = np.abs(scaled(task, seen) - scaled(task, state))
        assert off.max() <= ERROR
        lengths = [np.linalg.norm(scaled(task, s)) for s in (seen, state)]
        assert abs(lengths[0] - lengths[1]) <= np.sqrt(directions) * ERROR


@pytest.mark.parametrize("directions", [2, 3])
def test_the_craft_is_one_of_the_small_plants(directions: int) -> None:
    """Rates of w and of |w|, over 120 ms of a held command that brakes by an old and wrong look."""
    task, rng = docking_peer.TASKS[directions], np.random.default_rng(directions)
    step, tick = 1e-3, docking_peer.held(task, 1e-3)
    greatest, bound, near = task.greatest, pull(task), 0.0
    for _ in range(150):
        state = drawn(task, rng)
        look = scaled(task, state) + rng.choice([-ERROR, ERROR], directions)
        brake = rng.choice([0.0, 0.5, 1.0])
        asked = rng.choice([-greatest, 0.0, greatest], directions)
        u = np.clip((1 - brake) * asked - brake * greatest * look, -greatest, greatest)
        for _ in range(120):
            drag = rng.choice([-task.push, task.push], directions)
            after = tick[0] @ state + tick[1] @ (u + drag)
            old, new = scaled(task, state), scaled(task, after)
            if max(np.linalg.norm(old), np.linalg.norm(new)) > 1.0:
                break  # nothing is claimed beyond the limit
            gain = 1.0 / limit(task, (state + after) / 2)
            rest = (new - old) / step - gain * u
            assert np.abs(rest).max() <= bound + 1e-4
            near = max(near, float(np.abs(rest).max()) / bound)
            s, rate = np.linalg.norm(old), (np.linalg.norm(new) - np.linalg.norm(old)) / step
            if s > 0.1:  # below it a difference of lengths is no rate
                along = float(asked @ old) / s
                model = gain * ((1 - brake) * along - brake * greatest * s)
                assert abs(rate - model) <= gain * brake * greatest * FUZZ + bound + 3e-3
            state = after
    assert near > 0.5


@pytest.mark.parametrize("system", ["InPlaneOrbit", "InSpaceOrbit"])
def test_one_limit_for_all_directions_is_proved_and_rechecked(system: str, tmp_path: Path) -> None:
    program = soter.load(ROOT / docking_peer.TOGETHER)
    report = program.verify(system=system, cert=tmp_path / "cert", refute=False)
    (module,) = report.modules
    holds = {p: module.findings[p].holds for p in ("P2a", "P2b", "P3", "ttf", "start", "DM")}
    assert all(holds.values()), holds
    assert soter.recheck(tmp_path / "cert").accepted
    runs = [
        program.simulate(system=system, seed=1, until="60s", engine=e) for e in ("interp", "native")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations


@pytest.mark.parametrize("directions", [2, 3])
def test_an_ac_on_a_straight_line_keeps_control(directions: int) -> None:
    task = docking_peer.TASKS[directions]
    ours = docking_peer.Ours.of_all(task)
    assert docking_peer.flown(ours, task, "on a straight line", 1, 200.0) == (1.0, 0.0, 0)
    share, outside, _ = docking_peer.flown(ours, task, "pushes", 1, 200.0)
    assert 0.2 < share < 0.9
    assert outside == 0.0
