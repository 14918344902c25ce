"""An angle that turns over: who counts its turns is said, and an SC that holds one is kept."""

from __future__ import annotations

import math

import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import cause, changed, explained

ARM = """soter 1;
topic arm: float max_age 100ms;
topic motor: float in [-1.0, 1.0] = 0.0;
plant Arm period 50ms {
  reads motor;
  drives arm = a;
  state a: float = 1.0;
  disturbance push: float in [0.0, 0.1];
  der a = 0.5 + motor + push + 0.1 * sin(a);
  measured arm within 0.01;
}
node Learned period 100ms { subscribes arm; publishes motor; step { publish motor = 1.0; } }
node Turn period 100ms {
  subscribes arm;
  publishes motor;
  step { publish motor = arm > 100.0 ? 0.0 : 0.2; }
}
rta SafeArm {
  ac Learned; sc Turn; period 100ms;
  safe sin(arm) < 2.0;
  ttf sin(arm) > 1.5;
  safer sin(arm) < 1.2;
  verify { grid arm in [-3.14159265358979, 3.14159265358979] / 200; }
}
system Plant { t: Arm; module SafeArm; until 60s; }
"""


@pytest.fixture(scope="module")
def arm() -> ModuleResult:
    return explained(ARM)


def test_who_counts_the_turns_of_an_angle_is_said(arm: ModuleResult) -> None:
    """`arm > 100.0` in SC: on an axis of a full turn that nobody counts nothing would leave."""
    why = cause(arm, "P2a", "leaves").text
    assert "t.a is an angle whose axis does not wrap around" in why
    assert "reads how far it has turned" in why


def test_the_run_does_leave_at_that_end_where_plant_and_safe_are_the_same(
    arm: ModuleResult,
) -> None:
    run = arm.findings["P2a"].leaving
    assert run is not None
    assert (run.side, run.safe) == (1, False)
    assert run.states[-1][0] > math.pi >= run.states[-2][0]
    assert math.sin(math.pi) == pytest.approx(math.sin(-math.pi), abs=1e-12)  # x' and `safe`
    x, t = 1.0, 0.0  # the plant's own equation, in small steps, with all of the push
    while x <= math.pi:
        x, t = x + 1e-4 * (0.5 + 0.2 + 0.1 + 0.1 * math.sin(x)), t + 1e-4
    assert run.time_s[-1] == pytest.approx(t, abs=0.06)  # a step of the simulation


def test_a_place_that_merely_moves_on_is_no_angle() -> None:
    text = changed(("+ 0.1 * sin(a)", ""), ("3.14159265358979", "3.0"), text=ARM)
    text = changed(("sin(arm) < 2.0", "arm < 50.0"), text=text)
    assert "angle" not in cause(explained(text), "P2a", "leaves").text


ENDS = ("[-3.14159265358979, 3.14159265358979]", "[-3.15, 3.15]")


def test_an_angle_that_sc_brings_to_one_heading_as_advised_is_kept() -> None:
    law = ("arm > 100.0 ? 0.0 : 0.2", "clamp(-0.5 + 2.0 * wrap_angle(0.0 - arm), -1.0, 1.0)")
    module_result = explained(changed(ENDS, law, text=ARM))
    assert module_result.findings["P2a"].verdict == "proved"


def test_an_axis_that_is_nearly_a_turn_is_told_to_be_one() -> None:
    """Nobody counts turns: of exactly a turn the axis would wrap around, and no run leaves it."""
    nearly = ("-3.14159265358979, 3.14159265358979", "-3.14, 3.14")
    nobody = ("arm > 100.0 ? 0.0 : 0.2", "0.2")
    said = "`t.a in [-PI, PI]`"
    finding = explained(changed(nearly, nobody, text=ARM)).findings["P2a"]
    assert finding.hint.startswith(said)
    assert not explained(changed(nearly, text=ARM)).findings["P2a"].hint.startswith(said)
    assert explained(changed(nobody, text=ARM)).findings["P2a"].verdict == "proved"
