"""Docking in two and three directions: what bench/running/docking_peer.py rests on.

Purpose: limits of single directions say the limit of their zoo; the craft moves as the plant of
docking_orbit.soter does; the plane is proved and rechecked on a coarse grid, flown, and not left.
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
