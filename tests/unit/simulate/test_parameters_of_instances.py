"""Runs with parameters of instances: from outside, in what is told, on both engines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from pathlib import Path

FLEET = """soter 1;
param GAIN: float = 1.0 in [0.0, 9.0];
param STEP: duration = 10ms;
topic pos: float in [-90.0, 90.0];
plant Point period 10ms {
  drives pos = clamp(x, -90.0, 90.0);
  state x: float;
  disturbance wind: float in [-GAIN, GAIN];
  der x = GAIN + wind;
  measured pos within 0.1 * GAIN;
}
node Watch period STEP { subscribes pos; publishes seen; step { publish seen = pos * GAIN; } }
topic seen: float;
system Robot { p: Point; node Watch; }
system S { for i in 0..2 { r[i]: Robot { set GAIN = float(i) }; } until 200ms; }
"""


@pytest.fixture
def program(tmp_path: Path) -> soter.Program:
    path = tmp_path / "fleet.soter"
    path.write_text(FLEET)
    return soter.load(path)


def run(program: soter.Program, engine: str = "native", **first: object) -> soter.Run:
    """With these parameters of the first robot, and everywhere GAIN 5."""
    params = {"GAIN": 5.0, **{f"r[0].{n}": v for n, v in first.items()}}
    return program.simulate("S", engine=engine, params=params)


def last(of: soter.Run, topic: str) -> float:
    return float(of.topic(topic)[-1])


def test_values_from_outside_reach_the_instance_they_name_and_no_other(
    program: soter.Program,
) -> None:
    plain, other = run(program), run(program, GAIN=2.0)
    assert plain.params["r[0].GAIN"] == 0.0
    assert other.params["r[0].GAIN"] == 2.0
    assert last(plain, "r[0].pos") == 0.0
    assert last(other, "r[0].pos") > 0.0
    assert last(plain, "r[1].pos") == last(other, "r[1].pos")


def test_both_engines_agree_on_values_from_outside(program: soter.Program) -> None:
    native = run(program, GAIN=2.0, STEP="20ms")
    interpreted = run(program, "interp", GAIN=2.0, STEP="20ms")
    assert native.trace_sha256 == interpreted.trace_sha256
    assert native.trace_sha256 != run(program, GAIN=2.0).trace_sha256


def test_values_outside_the_range_of_a_parameter_are_refused(program: soter.Program) -> None:
    with pytest.raises(SoterError, match=r"r\[0\]\.GAIN` was set to 10\.0"):
        run(program, GAIN=10.0)
