"""Ends of grids, axes in other units or torn apart, and `recover never`: what is said of them."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import pytest

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.diagnosis import tried_remedies
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds

TTF = "ttf level < 0.25 || level > 1.75;"
SAFER = "safer level > 0.4 && level < 1.6;"
SAFE = "safe level > 0.2 && level < 1.8;"


def test_an_end_that_is_one_of_safe_is_no_matter_of_the_grid() -> None:
    finding = explained(changed((TTF, "ttf level < 0.232 || level > 1.768;"))).findings["ttf"]
    assert finding.verdict == "undecided"
    assert not any("a longer axis" in text for text in (finding.hint, *finding.tried))


def test_where_ac_need_not_come_back_it_is_said_why_safer_is_asked_all_the_same() -> None:
    """`recover never` makes no proof of `safer` easier: the DM gives control where it holds."""
    wrong = (SAFER, "safer level > 0.2;"), (SAFE, "safe level > 0.2;")
    never = ("/ 320;", "/ 320; recover never;")
    for pairs in (wrong, (*wrong, never)):
        module_result = explained(changed(*pairs))
        assert module_result.findings["safer"].verdict == "undecided"
        assert ("asked_all_the_same" in kinds(module_result, "safer")) == (never in pairs)
        assert "asked_all_the_same" not in kinds(module_result, "ttf")
    why = cause(module_result, "safer", "asked_all_the_same").text
    assert "`recover never`" in why
    assert "wherever `safer` holds" in why


EXAMPLES = Path(__file__).resolve().parents[4] / "examples" / "robots"
CART = """soter 1;
topic m: { x: float, v: float } max_age 20ms;
topic u: float in [-2.0, 2.0] = 0.0;
plant Cart period 10ms { reads u; drives m = { x: x, v: v }; state x: float; state v: float;
  disturbance wind: float in [-0.05, 0.05]; der x = v; der v = u + wind;
  measured m.x within 0.01, m.v within 0.01; }
node Any period 20ms { publishes u; step { publish u = 2.0; } }
node Home period 20ms { subscribes m; publishes u;
  step { publish u = clamp(-2.0 * m.x - 3.0 * m.v, -2.0, 2.0); } }
rta Track { ac Any; sc Home; period 20ms; safe abs(m.x) < 2.0;
  verify { grid m.x in [-2.0, 2.0] / 60, m.v in [-2.5, 2.5] / 60; } }
system S { c: Cart; module Track; }
"""
AXES = "grid m.x in [-2.0, 2.0] / 60, m.v in [-2.5, 2.5] / 60;"


FAR = """soter 1;
topic x: float max_age 20ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms { reads u; drives x = p; state p: float;
  disturbance d: float in [-0.1, 0.1]; der p = u + d; measured x within 0.01; }
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Slow period 20ms { subscribes x; publishes u;
  step { publish u = clamp(-4.0 * x, -1.0, 1.0); } }
rta M { ac Fast; sc Slow; period 20ms; safe abs(x) < 0.5;
  verify { grid x in [-28.6, 28.6] / 200; } }
system S { p: P; module M; }
"""


def test_an_axis_in_another_unit_is_made_as_short_as_safe_and_that_is_tried() -> None:
    hint = explained(FAR).findings["ttf"].hint
    assert (
        hint
        == "a shorter axis: `grid p.p in [-0.572, 0.572] / 400;` (tried: every claim is proved)"
    )
    right = changed(("[-28.6, 28.6]", "[-0.6, 0.6]"), text=FAR)
    assert explained(right).verdict == "proved"


def hint_of_p2a(text: str, trials_s: float) -> str:
    checked = check_file("robot.soter", text)
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    with patch.multiple(tried_remedies, LEAST_S=trials_s, OF_PROOF=0.0):
        return verify_module(problem, refute=False, explain=True).findings["P2a"].hint


def test_states_that_move_each_other_are_told_to_stand_in_one_line() -> None:
    apart = "grid m.x in [-2.0, 2.0] / 60; grid m.v in [-2.5, 2.5] / 60;"
    hint = hint_of_p2a(changed((AXES, apart), text=CART), 0.0)
    assert hint.startswith("c.x and c.v in one `grid` line: c.v moves c.x")
    assert not hint_of_p2a(CART, 0.0)


@pytest.mark.parametrize("times", ["acts within 2s;", "dropout 3s;"])
def test_states_that_are_long_gone_when_sc_answers_them_are_named(times: str) -> None:
    late = changed(("/ 60; } }", f"/ 60; {times} }} }}"), text=CART)
    assert hint_of_p2a(late, 0.0).startswith("commands that act sooner: SC answers states up to ")


def test_an_sc_that_only_stops_is_told_that_it_may_stay() -> None:
    text = (EXAMPLES / "emergency_brake.soter").read_text(encoding="utf-8")
    coarse = changed(("/ 250", "/ 125"), ("/ 190; recover never;", "/ 95;"), text=text)
    hint = hint_of_p2a(coarse, 120.0)
    assert hint == "`recover never`, if it may stay where SC stops (tried: every claim is proved)"


def test_an_sc_that_leaves_its_set_is_told_to_be_clamped_also_where_a_run_shows_it() -> None:
    free = ("clamp(-2.0 * m.x - 3.0 * m.v, -2.0, 2.0)", "-2.0 * m.x - 3.0 * m.v")
    late = (
        "safe abs(m.x) < 2.0;",
        "safe abs(m.x) < 2.0; ttf abs(m.x) > 1.9; safer abs(m.x) < 1.0;",
    )
    checked = check_file("robot.soter", changed(free, late, text=CART))
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    for refute, verdict in ((True, "refuted"), (False, "undecided")):
        found = verify_module(problem, refute=refute, explain=False).findings["P2a"]
        assert (found.verdict, found.hint[:5]) == (verdict, "clamp")
