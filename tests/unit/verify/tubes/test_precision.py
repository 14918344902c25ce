"""How precisely a tube follows SC: several steps a command where states are quick."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import soter
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.tubes import leading_back
from soter.verify.tubes.noise_estimate import moves_quickly
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import show_rest_claims
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_precision import FINE, MOST, PLAIN, PRECISIONS
from soter.verify.tubes.verify import TubeResult

if TYPE_CHECKING:
    import pytest

QUICK = """soter 1;
type Cart = { x: float, v: float };
topic cart: Cart max_age 1ms;
topic wish: float in [-1.0, 1.0] = 0.0;
node Fast period 50ms { subscribes cart; publishes wish;
  step { publish wish = clamp(1.0 - cart.x, -1.0, 1.0); } }
node Home period 200ms { subscribes cart; publishes wish;
  step { publish wish = clamp(-1.0 * cart.x, -1.0, 1.0); } }
rta Guard {
  ac Fast;
  sc Home;
  period 200ms;
  safe abs(cart.x) < 2.0;
  rest abs(cart.x) < 0.4 && abs(cart.v) < 0.8 within 3s;
  verify { late dm 1ms, sc 1ms; response dm 5ms, sc 1ms; acts within 1ms; }
}
plant Servo period 1ms {
  reads wish;
  drives cart = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.05, 0.05];
  der x = v + wind;
  der v = (wish - v) / 0.05;
  measured cart.x within 0.01, cart.v within 0.01;
}
system Track { s: Servo; module Guard; until 5s; }
"""
"""The lag is a quarter of SC's period: one step of second order would say 5 in place of e^-4."""


def check_of(text: str) -> TubeCheck:
    flat = system_to_prove(check_file("quick.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def test_a_plant_that_is_quick_beside_sc_is_followed_in_several_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    (tmp_path / "quick.soter").write_text(QUICK)
    cert = tmp_path / "cert"
    (module,) = soter.load(tmp_path / "quick.soter").verify(cert=cert).modules
    assert isinstance(module, TubeResult)
    assert (module.claims.kept, module.claims.start) == ("", "")
    assert module.check.precision == FINE
    assert soter.recheck(cert).accepted


def test_one_step_a_command_does_not_show_its_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    check = check_of(QUICK)
    monkeypatch.setattr(leading_back, "PRECISIONS", PRECISIONS[:FINE])
    monkeypatch.setattr(leading_back, "SPLITS", 0)
    monkeypatch.setattr(leading_back, "ESTIMATED", 0)
    assert "does not certainly lead back" in show_rest_claims(check).kept


def test_a_slow_plant_is_not_followed_in_several_steps() -> None:
    for lag, quick in (("0.05", True), ("2.0", False)):
        check = check_of(QUICK.replace("0.05;", f"{lag};"))
        assert moves_quickly(check) is quick


def test_the_check_is_as_precise_as_ac_needs_it_to_have_control() -> None:
    tanks = Path(__file__).parents[4] / "bench" / "tubes" / "designed" / "quadtank.soter"
    check = check_of(tanks.read_text(encoding="utf-8"))
    claims = show_rest_claims(check)
    assert (claims.kept, claims.start) == ("", "")
    assert claims.ac_has_control
    assert (check.precision, claims.precision) == (MOST, MOST)
    check.precision = PLAIN  # by which rest was shown, in parts
    assert not leading_back.is_control_given(check, claims.ways)
