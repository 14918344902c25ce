"""Several groups, parameters, hints, maps: products are checked, and each value of a parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file
from soter.verify import verify_module as verifying
from soter.verify.command import verify

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

PLANE = """soter 1;
topic pos: { x: float, y: float } max_age 10ms;
topic u: { x: float, y: float } in [-1.0, 1.0];
plant Ship period 10ms {
  reads u;
  drives pos = { x: x, y: y };
  state x: float;
  state y: float;
  state loaded: bool;
  disturbance wind: Vec2 in [-0.2, 0.2];
  der x = (loaded ? 0.5 : 1.0) * u.x + wind.x;
  der y = u.y + wind.y;
  measured pos within 0.01;
}
node Fast period 20ms {
  subscribes pos;
  publishes u;
  step { publish u = { x: 1.0, y: -1.0 }; }
}
node Home period 20ms {
  subscribes pos;
  publishes u;
  step { publish u = { x: clamp(-2.0 * pos.x, -1.0, 1.0), y: clamp(-2.0 * pos.y, -1.0, 1.0) }; }
}
fun Inside(p: { x: float, y: float }, room: float): bool {
  return abs(p.x) < 2.0 - room && abs(p.y) < 3.0 - room;
}
rta Harbour {
  ac Fast;
  sc Home;
  period 40ms;
  safe Inside(pos, 0.0);
  ttf !Inside(pos, 0.2);
  safer Inside(pos, 0.4);
  verify {
    grid pos.x in [-2.0, 2.0] / 200;
    grid pos.y in [-3.0, 3.0] / 240;
  }
}
system S { s: Ship; module Harbour; }
"""


@pytest.fixture(autouse=True)
def _no_finer_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)


def result_of(*pairs: tuple[str, str], text: str = PLANE) -> ModuleResult:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    checked = check_file("plane.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (module_result,) = verify(checked, refute=False).modules
    return module_result


def test_two_groups_and_two_values_of_a_parameter_are_proved() -> None:
    module_result = result_of()
    assert module_result.verdict == "proved", {n: f.text for n, f in module_result.findings.items()}
    assert [c.parameter for c in module_result.cases] == [(0,), (1,)]
    assert module_result.cells == 2 * (200 + 240)
    one, two = (c.groups[0].core > 0 for c in module_result.cases)
    assert one.sum() >= two.sum()


@pytest.mark.long
def test_states_that_the_constraint_compares_must_be_one_group() -> None:
    together = ("safe Inside(pos, 0.0);", "safe Inside(pos, 0.0) && abs(pos.x + pos.y) < 3.0;")
    module_result = result_of(together)
    assert module_result.findings["P2a"].verdict == "undecided"
    assert "no product" in module_result.findings["P2a"].text


def test_what_the_product_of_the_parts_misses_is_found_between_them() -> None:
    corner = ("safe Inside(pos, 0.0);", "safe Inside(pos, 0.0) && (pos.x < 1.9 || pos.y < 2.9);")
    module_result = result_of(corner)
    assert module_result.findings["P2a"].verdict == "undecided"


def test_a_predicate_that_forgets_a_group_is_not_proved() -> None:
    module_result = result_of(("ttf !Inside(pos, 0.2);", "ttf abs(pos.x) > 1.8;"))
    assert module_result.findings["ttf"].verdict == "undecided"
    assert {axis[0] for r in module_result.findings["ttf"].regions for axis in r.axes} == {"s.y"}


def test_the_value_of_a_parameter_for_which_it_fails_is_named() -> None:
    module_result = result_of(("(loaded ? 0.5 : 1.0)", "(loaded ? -0.5 : 1.0)"))
    assert module_result.findings["P2a"].verdict == "undecided"
    regions = module_result.findings["P2a"].regions
    assert regions
    assert {r.parameters for r in regions} == {(("s.loaded", 1),)}


def test_the_core_stays_inside_its_hint() -> None:
    hint = ("verify {", "verify { core abs(pos.x) < 1.95;")
    module_result = result_of(hint)
    assert module_result.verdict == "proved"
    part = module_result.cases[0].groups[0]
    edges = part.edges[0]
    kept = [i for i, n in enumerate(part.core) if n]
    assert edges[kept[0]] >= -1.95 - 1e-9
    assert edges[kept[-1] + 1] <= 1.95 + 1e-9


@pytest.mark.long
def test_a_map_is_proved_in_steps_and_a_wrong_one_is_not() -> None:
    text = """soter 1;
topic x: float in [-4.0, 4.0] max_age 10ms;
topic u: float in [-1.0, 1.0];
plant Belt period 20ms {
  reads u;
  drives x = p;
  state p: float;
  disturbance push: float in [-0.1, 0.1];
  next p = p + 0.02 * u + 0.02 * push;
}
node Fast period 20ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 20ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
rta M {
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(x) < 3.0;
  ttf abs(x) > 2.9;
  safer abs(x) < 2.5;
  verify { grid x in [-4.0, 4.0] / 800; }
}
system S { b: Belt; module M; }
"""
    assert result_of(text=text).verdict == "proved"
    late = result_of(("ttf abs(x) > 2.9;", "ttf abs(x) > 2.985;"), text=text)
    assert late.findings["ttf"].verdict == "undecided"
    wide = result_of(("clamp(-x, -1.0, 1.0)", "-0.6 * x"), text=text)
    assert wide.findings["P2a"].text == "SC might fault, or publish outside its set"
    assert "each component of a vector by `saturate`" in wide.findings["P2a"].hint
    slow = result_of(("verify {", "verify { horizon 10ms;"), text=text)
    assert slow.findings["P1c"].verdict == "undecided"


@pytest.mark.long
def test_a_finer_grid_settles_borders_and_forgets_no_failure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 2)
    coarse = (("/ 200;", "/ 40;"), ("/ 240;", "/ 60;"))
    fine = result_of(*coarse)
    assert fine.verdict == "proved"
    cells = sum(p.core.size for p in fine.cases[0].groups)
    assert cells > 40 + 60
    wrong = ("ttf !Inside(pos, 0.2);", "ttf !Inside(pos, 0.2) && abs(pos.y) < 2.97;")
    module_result = result_of(*coarse, wrong)
    assert module_result.findings["ttf"].verdict == "undecided"
    assert "s.y" in {axis[0] for r in module_result.findings["ttf"].regions for axis in r.axes}
