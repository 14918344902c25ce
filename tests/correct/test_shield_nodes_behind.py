"""Nodes between a module with a shield and its plants (docs/proof-flight.md, Shields).

Purpose: one in SC's instant is followed, W counts until it passes a command on; what it makes of
sensors or of a memory is state of the plants of the proof, or refused by prover and re-checker.
Non-goals: nodes before the module; shields without nodes (`test_shield.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from correct.test_shield import SMALL
from soter.verify.problem import extract

if TYPE_CHECKING:
    from pathlib import Path

PASSED_ON = (
    SMALL.replace("reads speed;", "reads passed;")
    .replace("der x = speed", "der x = passed")
    .replace("grid at", "abstracts c by q: Model = { x: c.truth.x };\n  grid at")
    .replace("late dm 1ms, sc 1ms;", "late dm 1ms, sc 1ms; response sc 2ms;")
    .replace(
        "rta Keep",
        """plant Model period 5ms {
  reads speed;
  drives at = x;
  state x: float;
  disturbance slip: float in [-0.1, 0.1];
  der x = speed + slip;
  measured at within 0.01;
}
rta Keep""",
    )
    .replace(
        "plant Cart",
        """topic passed: float in [-1.0, 1.0];
node Pass period 5ms {
  subscribes speed;
  publishes passed;
  step { publish passed = speed; }
}
plant Cart""",
    )
    .replace("module Keep;", "module Keep; node Pass;")
)


def test_what_a_node_in_the_instant_of_sc_holds_back_still_counts(tmp_path: Path) -> None:
    """It passes a command on once that step of SC has published: W has R_sc in it."""
    path = tmp_path / "passed.soter"
    path.write_text(PASSED_ON, "utf-8")
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert report["Keep"].verdict == "proved", report["Keep"]
    assert soter.recheck(tmp_path / "cert").accepted
    times = report["Keep"].problem.times
    late, period = times.schedule.latest_start_of_sc, times.delta_sc
    assert times.replaced_window == times.schedule.age_dm + times.acts + period + late + 2_000_000


def test_a_controller_between_module_and_plants_is_refused_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that listens to sensors, too, is no part of the instant of SC."""
    path = tmp_path / "inner.soter"
    text = PASSED_ON.replace(
        "subscribes speed;\n  publishes passed;", "subscribes speed, at;\n  publishes passed;"
    )
    path.write_text(text.replace("passed = speed;", "passed = at > 9.0 ? 0.0 : speed;"), "utf-8")
    with pytest.raises(soter.SoterError, match="R007"):
        soter.load(path).verify(refute=False)
    monkeypatch.setattr(extract, "_check_shield", lambda *_: None)
    soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert "nodes behind the module" in soter.recheck(tmp_path / "cert").reason


def test_a_node_with_sensors_is_followed_where_the_plants_of_the_proof_show_what_it_says(
    tmp_path: Path,
) -> None:
    """It runs in SC's instant, so W is that of a node which reads commands alone."""
    path = tmp_path / "shown.soter"
    text = (
        PASSED_ON.replace(
            "subscribes speed;\n  publishes passed;", "subscribes speed, at;\n  publishes passed;"
        )
        .replace("passed = speed;", "passed = at > 9.0 ? 0.0 : speed;")
        .replace("{ x: c.truth.x }", "{ x: c.truth.x + 0.0 * passed }")
    )
    path.write_text(text, "utf-8")
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert report["Keep"].verdict == "proved", report["Keep"]
    assert soter.recheck(tmp_path / "cert").accepted
    told = {a.key: a.text for a in report["Keep"].problem.assumptions}
    assert "Pass" in told["in step"]
    path.write_text(text.replace("node Pass period 5ms", "node Pass period 4ms"), "utf-8")
    with pytest.raises(soter.SoterError, match="R007"):
        soter.load(path).verify(refute=False)


def test_a_memory_behind_the_module_that_no_plant_of_the_proof_shows_is_refused_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it makes of a command is no command of V."""
    path = tmp_path / "memory.soter"
    text = PASSED_ON.replace(
        "step { publish passed = speed; }",
        "var last: float;\n  step { publish passed = 0.5 * (last + speed); last = speed; }",
    )
    path.write_text(text, "utf-8")
    with pytest.raises(soter.SoterError, match="R007"):
        soter.load(path).verify(refute=False)
    monkeypatch.setattr(extract, "_check_shield", lambda *_: None)
    soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert "nodes behind the module" in soter.recheck(tmp_path / "cert").reason
