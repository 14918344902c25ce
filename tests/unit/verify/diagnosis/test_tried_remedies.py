"""What `verify` advises was tried: done to the program it proves it; what did not help is told."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import Program
from soter.cli.main import main
from soter.verify.claims import choose_cells_and_levels
from soter.verify.claims.results import ProofSearch, Try
from soter.verify.diagnosis import open_claims, tried_remedies, variations
from soter.verify.diagnosis.tried_remedies import ordered_trials
from soter.verify.diagnosis.variations import NotProved, grid_lines_of, remedies
from soter.verify.grid.grid_refinement import cell_count, finer_problem
from unit.verify.diagnosis.tank_modules import TANK, cause, changed, explained, kinds
from unit.verify.problem.test_left_out_states import LANE

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

PREDICATES = (
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
)
COARSE = (*PREDICATES, ("/ 320", "/ 16"))
SWAPPED = ("ac Learned; sc Hold;", "ac Hold; sc Learned;")
OLD = ("max_age 100ms", "max_age 4s")
CART = """soter 1;
topic m: { x: float, v: float } max_age 20ms;
topic a: float in [-3.0, 3.0] = 0.0;
plant Cart period 10ms {
  reads a;
  drives m = { x: x, v: v };
  state x: float;
  state v: float;
  disturbance w: float in [-0.1, 0.1];
  der x = v;
  der v = a + w;
}
node Fast period 20ms {
  subscribes m;
  publishes a;
  step { publish a = clamp(9.0 - m.x, -3.0, 3.0); }
}
node Park period 20ms {
  subscribes m;
  publishes a;
  step { publish a = clamp(9.6 - m.x - 2.5 * m.v, -3.0, 3.0); }
}
rta SafeCart {
  ac Fast; sc Park; period 200ms;
  safe abs(m.x) < 10.0;
  verify { grid m.x in [-10.0, 10.0] / 400, m.v in [-6.0, 6.0] / 240; }
}
system Track { c: Cart; module SafeCart; }
"""

CLIMB = """soter 1;
topic flight: { h: float, climb: float } max_age 40ms;
topic pull: float in [-2.0, 2.0] = 0.0;
plant Aircraft period 20ms {
  reads pull;
  drives flight = { h: h, climb: climb };
  state h: float = 100.0;
  state climb: float;
  der h = climb;
  der climb = pull - 0.5 * climb;
}
node Dive period 40ms { subscribes flight; publishes pull; step { publish pull = -flight.h; } }
node PullUp period 40ms {
  subscribes flight;
  publishes pull;
  step { publish pull = clamp(4.0 * (1.0 - flight.climb), -2.0, 2.0); }
}
rta SafeHeight {
  ac Dive; sc PullUp; period 80ms;
  safe flight.h > 0.0;
  ttf flight.h < 20.0;
  safer flight.h > 30.0;
  verify { grid flight.h in [0.0, 200.0] / 100, flight.climb in [-4.5, 4.5] / 90; }
}
system Range { a: Aircraft; module SafeHeight; until 10s; }
"""


def first_help(result: ModuleResult) -> str:
    """What is advised first."""
    return next(f.hint for n, f in result.findings.items() if not f.holds and f.hint)


def test_fewer_levels_are_no_advice_where_the_program_says_how_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(choose_cells_and_levels.CELLS_MAX, "P2b", 0)  # else smaller ones are chosen
    result = explained(changed(*COARSE, ("/ 16;", "/ 16; levels 3;")))
    assert [n for n, f in result.findings.items() if not f.holds] == ["P2b"]
    assert not any("levels" in text for text in result.findings["P2b"].tried)


@pytest.fixture(scope="module")
def parked() -> ModuleResult:
    return explained(CART)


def test_under_computed_predicates_an_sc_that_rests_elsewhere_is_told_so(
    parked: ModuleResult,
) -> None:
    assert parked.findings["P2a"].verdict == "proved"
    assert "comes to rest at c.x = 9.6, " in cause(parked, "P2b", "stays_away").text


def test_what_was_tried_in_vain_is_no_advice(parked: ModuleResult) -> None:
    assert any("more cells" in t for t in parked.findings["P2b"].tried)
    assert "cells" not in first_help(parked)
    assert first_help(parked).endswith("(not tried)")


STRONG = (*PREDICATES, ("float in [-0.1, 0.1] = 0.0", "float in [-20.0, 20.0] = 0.0"))


def test_what_is_suggested_was_tried_or_says_that_it_was_not() -> None:
    for result in (explained(changed(*STRONG)), explained(changed(OLD))):
        for finding in result.findings.values():
            hint = finding.hint
            assert not hint or "(tried: " in hint or hint.startswith("as for `") or "(not" in hint


def test_several_changes_are_tried_together_and_told_together() -> None:
    """Reads of four seconds leave no K; with young ones a bold `ttf` still has to go."""
    bold = ("ttf level < 0.25 || level > 1.75", "ttf level < 0.21 || level > 1.79")
    result = explained(changed(OLD, bold))
    said = first_help(result)
    assert "`max_age 100ms` of `level`" in said
    assert said.count("neither `ttf` nor `safer`") == 1  # alone it was tried in vain
    assert "(tried: every claim is proved)" in said
    assert explained(changed(*PREDICATES)).verdict == "proved"


def test_what_helps_and_does_not_suffice_says_what_it_shows() -> None:
    """SC cannot be back so soon, whatever else is changed; young reads show the rest."""
    soon = ("/ 320;", "/ 320; recover within 10ms;")
    result = explained(changed(("max_age 100ms", "max_age 9s"), soon))
    said = first_help(result)
    assert "of `level` (tried: all but P2b proved)" in said
    young = explained(changed(soon))
    assert {n for n, f in young.findings.items() if not f.holds} == {"P2b"}


def test_controllers_in_each_other_s_place_are_told_also_where_a_run_refutes_them(
    tmp_path: Path,
) -> None:
    (tmp_path / "tank.soter").write_text(changed(SWAPPED))
    (result,) = soter.load(tmp_path / "tank.soter").verify().modules
    assert result.findings["P2a"].verdict == "refuted"
    said = "`ac Learned; sc Hold;`, if that is what was meant (tried: every claim is proved)"
    assert first_help(result).startswith(said)
    assert result.findings["P2a"].cost is not None
    assert "other controllers" in result.findings["P2a"].cost.not_measured


def test_an_sc_that_keeps_nothing_beside_an_ac_that_does_not_either_is_not_exchanged() -> None:
    neither = ("clamp(0.5 * (1.0 - level), -0.1, 0.1)", "-0.1")
    finding = explained(changed(neither)).findings["P2a"]
    assert finding.leaving is not None
    assert finding.tried
    assert not any("if that is what was meant" in x for x in finding.tried)


def test_what_there_was_no_time_for_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        choose_cells_and_levels.CELLS_MAX, "P2b", 20
    )  # else smaller ones are chosen
    monkeypatch.setattr(tried_remedies, "LEAST_S", 0.0)
    monkeypatch.setattr(tried_remedies, "OF_PROOF", 0.0)
    monkeypatch.setattr(tried_remedies, "SHOWN_S", 0.0)
    result = explained(changed(*COARSE, ("/ 16;", "/ 16; levels 3;")))
    assert any("not, for want of time: more cells" in t for t in result.findings["P2b"].tried)
    assert "(tried" not in first_help(result)


def test_what_has_few_cells_is_tried_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid of many cells does not take the time of what is quick; other controllers are last."""
    monkeypatch.setattr(tried_remedies, "COARSE", 12)
    bold = ("ttf level < 0.25 || level > 1.75", "ttf level < 0.21 || level > 1.79")
    result = explained(changed(OLD, bold))
    leaving = explained(changed(SWAPPED)).findings["P2a"].leaving
    seen = {}
    for failing in (("P2a", "ttf"), ("ttf",)):
        trials = ordered_trials(remedies(NotProved(result.problem, failing, [], leaving)))
        seen[failing] = [(change.cost, cell_count(problem)) for change, problem in trials]
        assert seen[failing] == sorted(seen[failing])
        last = {change.advice: problem for change, problem in trials}
        assert all(last[change.advice] is change.problem for change, _ in trials)
    assert seen["P2a", "ttf"][-1][0] == variations.OTHERS
    assert len({cells for _, cells in seen["ttf",]}) > 2


def test_no_refute_keeps_the_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tank.soter").write_text(changed(SWAPPED))
    main(["verify", str(tmp_path / "tank.soter"), "--no-refute", "--json"])
    found = json.loads(capsys.readouterr().out)["modules"]["SafeTank"]["properties"]["P2a"]
    assert found["verdict"] == "undecided"
    assert found["causes"]
    assert "(tried: every claim is proved)" in found["hint"]


def test_an_end_that_stays_is_written_as_the_program_writes_it() -> None:
    """Six digits of PI are no full turn."""
    named = ("soter 1;", "soter 1;\nconst FULL: float = 1.8000000000000003;")
    result = explained(changed(named, ("[0.2, 1.8]", "[0.2, FULL]"), OLD))
    assert grid_lines_of(result.problem) == "grid t.h in [0.2, FULL] / 320;"
    longer = variations.problem_with_ends(result.problem, {0: (0.1, 1.8000000000000003)})
    assert grid_lines_of(longer) == "grid t.h in [0.1, FULL] / 340;"


def test_what_is_proved_is_not_tried() -> None:
    result = explained(TANK)
    assert result.verdict == "proved"
    assert not any(f.tried for f in result.findings.values())


def test_an_axis_that_nothing_reads_is_opened_where_runs_leave() -> None:
    """SC climbs for ever, at any height: K is empty on a grid that ends, and nowhere else."""
    result = explained(CLIMB)
    assert kinds(result, "P2a") == ["leaves"]
    said = re.match(r"no ends where runs leave: `(grid [^`]*;)` \(tried: every", first_help(result))
    assert said is not None
    grid = re.search(r"grid [^;]*;", CLIMB)
    assert grid is not None
    assert explained(changed((grid[0], said[1]), text=CLIMB)).verdict == "proved"


def test_changes_that_were_made_before_stay_in_a_problem_that_is_read_again() -> None:
    result = explained(CART)
    finer = finer_problem(result.problem, result.problem.groups)
    assert (
        variations.problem_with_younger_reads(finer) is None
    )  # 20 ms are two periods of the plant
    again = variations.problem_with_exchanged_controllers(finer)
    assert again is not None
    assert again.groups == finer.groups
    assert cell_count(again) == 4 * 400 * 240


def test_a_finer_grid_that_was_tried_in_vain_is_not_advised(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(CART.replace("9.6 - m.x - 2.5 * m.v", "0.5 * m.x - 1.6 * m.v"))
    (module,) = soter.load(path).verify().modules
    finding = module.findings["P2a"]
    assert finding.tried[0] == "in vain: cells of half the size"
    assert finding.tried[1].startswith("not: cells of a quarter of the size, as 1,536,000 are more")
    assert "cells" not in finding.hint


@pytest.mark.parametrize(
    ("hint", "left"),
    [
        ("smaller cells; smaller errors (not tried)", "smaller errors (not tried)"),
        ("smaller errors; smaller cells (not tried)", "smaller errors (not tried)"),
        ("smaller cells where SC ends (not tried)", ""),
        ("`a` (tried: proved)", "`a` (tried: proved)"),
    ],
)
def test_cells_that_a_search_tried_in_vain_are_not_advised(hint: str, left: str) -> None:
    result = explained(TANK)
    finding = result.findings["P2a"]
    finding.hint = hint
    for other in (
        Try("rest v < 1.0;", "undecided", 1.0),
        Try("grid v in [0, 1] / 2;", "not tried", 9.0, untried=True),
        Try("grid v in [0, 1] / 2;", "the budget ended", 9.0, cut=True),
    ):
        tried_remedies.remove_tried_advice([result], [ProofSearch(result.name, True, [other])])
        assert finding.hint == hint
    search = ProofSearch(result.name, True, [Try("grid v in [0, 1] / 2;", "undecided", 1.0)])
    tried_remedies.remove_tried_advice([result], [search])
    assert finding.hint == left
    assert (tried_remedies.SEARCHED in finding.tried) == (hint != left)


def test_a_search_in_vain_is_not_advised_after_it_was_made() -> None:
    result = explained(TANK)
    finding = result.findings["P2a"]
    for hint in (open_claims.REST, tried_remedies.OTHERS_FOUND):
        finding.hint = f"{hint}; smaller errors (not tried)"
        rests = ProofSearch(result.name, True, [Try("rest v < 1.0;", "undecided", 1.0)])
        tried_remedies.remove_tried_advice([result], [rests])
        assert finding.hint == "smaller errors (not tried)"


def test_a_module_with_a_shield_is_read_again_without_what_that_permitted(tmp_path: Path) -> None:
    (tmp_path / "lane.soter").write_text(
        LANE.replace("  safe", "  shield 4;\n  safe").replace("40ms", "80ms"), "utf-8"
    )
    problem = Program(str(tmp_path / "lane.soter")).verify(refute=False).modules[0].problem
    shield = problem.module.shield
    assert shield is not None
    shield.held = shield.permits = problem.module.symbol.safe  # as its compiled DM has it
    read_again = variations.problem_with_younger_reads(problem)
    assert read_again is not None
    again = read_again[0].module.shield
    assert again is not None
    assert again.held is None
