"""Docking in two and three directions: proved and rechecked, flown by both engines, and not left.

`docking_orbit.soter` has a module for every direction, which feels the others through the orbit;
`docking_together.soter` one for all of them, over the part of the limit that is used.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import soter

HERE = Path(__file__).parent
FINE = "/ 320, plane.{0}.v in [-0.32, 0.32] / 256"
COARSE = "/ 80, plane.{0}.v in [-0.32, 0.32] / 128"


def coarse(folder: Path) -> Path:
    """The plane on fewer cells."""
    text = (HERE / "docking_orbit.soter").read_text("utf-8")
    for axis in "xy":
        assert FINE.format(axis) in text
        text = text.replace(FINE.format(axis), COARSE.format(axis))
    path = folder / "orbit.soter"
    path.write_text(text, "utf-8")
    return path


def agrees(program: soter.Program, system: str, until: str) -> None:
    """Both engines fly the same, and nothing is violated."""
    runs = [
        program.simulate(system=system, seed=1, until=until, engine=e) for e in ("interp", "native")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations


def test_directions_that_feel_each_other_are_proved_and_rechecked(tmp_path: Path) -> None:
    program = soter.load(coarse(tmp_path))
    report = program.verify(system="InPlaneOrbit", cert=tmp_path / "cert", refute=False)
    module = report["InPlaneDocking"]
    assert [p for p in ("P2a", "P3", "ttf", "start", "DM") if not module.findings[p].holds] == []
    assert soter.recheck(tmp_path / "cert").accepted
    agrees(program, "InPlaneOrbit", "120s")


@pytest.mark.parametrize("system", ["InPlaneOrbit", "InSpaceOrbit"])
def test_one_limit_for_all_directions_is_proved_and_rechecked(system: str, tmp_path: Path) -> None:
    program = soter.load(HERE / "docking_together.soter")
    report = program.verify(system=system, cert=tmp_path / "cert", refute=False)
    (module,) = report.modules
    holds = {p: module.findings[p].holds for p in ("P2a", "P2b", "P3", "ttf", "start", "DM")}
    assert all(holds.values()), holds
    assert soter.recheck(tmp_path / "cert").accepted
    agrees(program, system, "60s")
