"""Slips of grids: axes in other units, states that are torn apart, an SC that only stops."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from soter.language.front_end import check_file
from soter.verify.command import modules_of, problems_of
from soter.verify.diagnosis import tried_remedies
from soter.verify.grid.set_figures import deepest_cell
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis.tank_modules import changed, explained

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


def test_an_sc_that_only_stops_is_told_that_it_may_stay() -> None:
    text = (EXAMPLES / "emergency_brake.soter").read_text(encoding="utf-8")
    coarse = changed(("/ 250", "/ 125"), ("/ 190; recover never;", "/ 95;"), text=text)
    hint = hint_of_p2a(coarse, 120.0)
    assert hint == "`recover never`, if it may stay where SC stops (tried: every claim is proved)"


@pytest.mark.parametrize("shape", [(4, 40), (40, 4), (1, 9), (2, 2), (5, 3, 8)])
def test_the_deepest_cell_of_a_whole_grid_lies_in_its_middle(shape: tuple[int, ...]) -> None:
    class Part:
        allowed = np.ones(shape, dtype=bool)
        edges = tuple(np.arange(n + 1.0) for n in shape)

        class group:  # noqa: N801 - as in `GroupSets`
            axes = tuple(type("Axis", (), {"state": k}) for k in range(len(shape)))

    for state, at in deepest_cell(Part()).items():  # type: ignore[arg-type]
        assert abs(at - shape[state] / 2) <= 1.0
