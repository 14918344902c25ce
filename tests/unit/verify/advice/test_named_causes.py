"""Help that names the cause: of a start, of an axis that ends or is open, of a quotient."""

from __future__ import annotations

from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
import pytest

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.claims.claims import open_case
from soter.verify.diagnosis import tried_remedies
from soter.verify.diagnosis.model_runs import LeavingSearch, PointModel, patterns_to_try, run_of_sc
from soter.verify.diagnosis.open_claims import REST, _no_run_cause
from soter.verify.diagnosis.unbounded_terms import term_without_bound
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis import tank_modules
from unit.verify.diagnosis.test_way_back import FINE, LIFT

if TYPE_CHECKING:
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Problem

TANK = tank_modules.TANK
CART = """soter 1;
topic seen: { x: float, v: float } max_age 100ms;
topic speed: float in [-0.5, 0.5] = 0.0;
plant Cart period 50ms {
  reads speed;
  drives seen = { x: x, v: v };
  state x: float = 2.0;
  state v: float = 0.0;
  disturbance slope: float in [-0.5, 0.5];
  der x = -v + slope * v;
  der v = (speed - v) / 0.2;
  measured seen.x within 0.01, seen.v within 0.01;
}
node Drive period 100ms { publishes speed; step { publish speed = 0.5; } }
node Stop period 100ms { subscribes seen; publishes speed; step { publish speed = 0.0; } }
rta Halt {
  ac Drive; sc Stop; period 100ms;
  safe seen.x > 0.1;
  verify { grid seen.x in [0.1, 4.1] / 8, seen.v in [-0.6, 0.6] / 6; }
}
system S default { c: Cart; module Halt; until 10s; }
"""
LATE = (
    ("/ 320;", "/ 320; late dm 0s, sc 0s; response dm 0s, sc 0s; acts within 45ms;"),
    ("ttf level < 0.25 || level > 1.75;", "ttf level < 0.35 || level > 1.65;"),
)


def problem_of(text: str) -> Problem:
    checked = check_file("cart.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    return problem


def case_of(text: str) -> Case:
    problem = problem_of(text)
    return open_case(problem, library_of(problem)[0], problem.groups, ())


def changed(text: str, *pairs: tuple[str, str]) -> str:
    return tank_modules.changed(*pairs, text=text)


@pytest.mark.parametrize(
    ("text", "changes", "said"),
    [
        (TANK, (("float = 1.0", "float = 2.5"), *LATE), "the grid does not hold every initial"),
        (TANK, (("float = 1.0", "float = 1.7999"), *LATE), "`safe` does not hold on the whole"),
        (TANK, (("float = 1.0", "float = 1.794"), *LATE), "in K, and other commands may lead it"),
        (
            LIFT,
            (("float = 5.0", "float = 9.6"), ("float = 0.0;", "float = 1.5;"), FINE),
            "an initial state is not in K",
        ),
    ],
    ids=["beyond", "unsafe", "late", "not kept"],
)
def test_a_start_says_which_set_lacks_it(
    text: str, changes: tuple[tuple[str, str], ...], said: str
) -> None:
    result = verify_module(problem_of(changed(text, *changes)), refute=False, explain=False)
    assert said in result.findings["start"].text


@pytest.mark.parametrize(
    ("axis", "named"),
    [("[0.0, 0.6] / 6", "c.v = 0"), ("[-0.6, 0.0] / 6", "c.v = 0"), ("[-0.6, 0.6] / 6", "")],
)
def test_an_sc_that_stops_in_the_last_cell_of_an_axis_is_told_so(axis: str, named: str) -> None:
    case = case_of(changed(CART, ("[-0.6, 0.6] / 6", axis)))
    cause, hint = _no_run_cause(LeavingSearch(), case, np.array([2.0, 0.0]), ())
    assert ("in the last cell of the axis" in cause.text) == bool(named)
    assert hint.startswith(f"{REST}; ")
    assert (f"a wider grid: an axis that goes on beyond {named}, " in hint) == bool(named)
    assert "c.x to no place" in cause.text
    assert "stronger SC" not in hint + _no_run_cause(LeavingSearch(), case, None, ())[1]


def test_what_rest_cannot_follow_is_named() -> None:
    jumps = ("der x = -v + slope * v;", "der x = -v + wrap_angle(v);")
    case = case_of(changed(CART, jumps))
    cause, hint = _no_run_cause(LeavingSearch(), case, np.array([2.0, 0.0]), ())
    assert cause.text.endswith("its rate jumps (`wrap_angle`)")
    assert hint.startswith("rates and an SC that `rest` can follow")


ONE_SIDED = (
    ("safe level > 0.2 && level < 1.8", "safe level > 0.2"),
    ("1.0 - level", "3.0 - level"),
)


@pytest.mark.parametrize(("end", "leaves"), [("/ 320", True), ("/ 320 open to 2.4", False)])
def test_a_run_does_not_leave_by_an_end_that_is_open(end: str, leaves: bool) -> None:
    text = changed(TANK, *ONE_SIDED, ("ttf level < 0.25 || level > 1.75", "ttf level < 0.25"))
    text = changed(text, ("safer level > 0.4 && level < 1.6", "safer level > 0.4"), ("/ 320", end))
    model = PointModel(case_of(text))
    trace = run_of_sc(model, model.start, next(patterns_to_try(model)), 60.0, lambda: True)
    assert trace.left == leaves
    assert trace.states[-1][0] > 1.8


def test_a_run_under_an_sc_much_slower_than_a_lag_of_the_plant_does_not_grow_by_itself() -> None:
    lag = ("der h = pump - leak;", "der h = (1.0 + pump - leak - h) / 0.1;")
    model = PointModel(case_of(changed(TANK, lag).replace("period 100ms", "period 1s")))
    trace = run_of_sc(model, model.start, next(patterns_to_try(model)), 60.0, lambda: True)
    assert not trace.left
    assert abs(trace.states[-1][0] - 1.0) < 0.1


PULLED = ("der h = pump - leak;", "der h = (pump - leak) / (h * h - 1.2 * h + 0.5);")
BY_LET = (
    ("  der h = pump - leak;", "  let m = h * h - 1.2 * h + 0.5;\n  der h = (pump - leak) / m;"),
)
ROOT = ("der h = pump - leak;", "der h = pump * sqrt(h * h - 1.2 * h + 0.4) - leak;")
GUARDED = ("der h = pump - leak;", "der h = (pump - leak) / max(h * h - 1.2 * h + 0.5, 0.14);")


@pytest.mark.parametrize(
    ("changes", "term"),
    [((PULLED,), "h * h - 1.2 * h + 0.5"), (BY_LET, "m"), ((ROOT,), "h * h - 1.2 * h + 0.4")],
    ids=["quotient", "let", "root"],
)
def test_a_quotient_without_finite_range_is_named(
    changes: tuple[tuple[str, str], ...], term: str
) -> None:
    problem = problem_of(changed(TANK, *changes))
    found = term_without_bound(problem)
    assert found is not None
    assert f"`{term}`" in found[1]
    with patch.object(tried_remedies, "LEAST_S", 0.0), patch.object(tried_remedies, "SHOWN_S", 0.0):
        p2a = verify_module(problem, refute=False, explain=True).findings["P2a"]
    assert p2a.text == "the dynamics have no finite enclosure over the grid"
    assert any(term in c.text for c in p2a.causes)
    assert p2a.hint.startswith("`max(that, LEAST)`")


def test_the_guard_that_is_advised_gives_it_an_enclosure() -> None:
    assert term_without_bound(problem_of(changed(TANK, GUARDED))) is None
    assert case_of(changed(TANK, GUARDED)).proofs


def test_a_number_without_a_set_is_not_told_to_have_a_wider_one() -> None:
    """What nothing bounds is left out of the proof; a plant stops only where it is no number."""
    text = changed(
        TANK,
        ("topic pump", "topic far: float max_age 100ms;\ntopic pump"),
        ("reads pump;\n  drives level = h;", "reads pump;\n  drives level = h; drives far = z;"),
        ("  disturbance", "  state z: float = 0.0;\n  disturbance"),
        ("der h = pump - leak;", "der h = pump - leak; der z = pump;"),
        ("0.5 * (1.0 - level), -0.1, 0.1", "0.5 * (level - 1.0), -0.1, 0.1"),
        ("subscribes level; publishes pump; step", "subscribes level, far; publishes pump; step"),
        ("step { publish pump = 0.1; }", "step { publish pump = far > 5.0 ? 0.0 : 0.1; }"),
        ("/ 320", "/ 32"),
    )
    result = verify_module(problem_of(text), refute=False, explain=False)
    assert any("`far` takes only finite numbers" in note for note in result.notes)
    assert "wider set" not in result.findings["P2a"].hint
