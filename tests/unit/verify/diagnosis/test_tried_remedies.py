"""What `verify` advises was tried: done to the program it proves it; what did not help is told."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import Program
from soter.cli.main import main
from soter.verify.claims import choice
from soter.verify.claims.cells import cells_of, smaller_cells
from soter.verify.diagnosis import experiments, tried_remedies
from soter.verify.diagnosis.tried_remedies import in_order, lines_of, remedies
from soter.verify.grid import recovery
from unit.verify.claims.test_finer_home import text as slot_text
from unit.verify.claims.test_finer_home import verified as slot_verified
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
    monkeypatch.setitem(choice.CELLS_MAX, "P2b", 0)  # else smaller ones are chosen
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
    why = cause(parked, "P2b", "stays_away")
    numbers = dict(why.numbers)
    assert numbers["at"] == pytest.approx(9.6, abs=1e-3)
    assert numbers["low"] < 0.0 < numbers["high"] < 9.6
    assert first_help(parked).startswith("let SC bring c.x to ")


def test_what_was_tried_in_vain_is_no_advice(parked: ModuleResult) -> None:
    (in_vain,) = (t for t in parked.findings["P2b"].tried if t.startswith("in vain: "))
    assert "more cells" in in_vain
    assert "cells" not in first_help(parked)
    assert first_help(parked).endswith("(not tried)")


def test_an_sc_that_rests_where_it_is_told_is_proved(parked: ModuleResult) -> None:
    target = re.search(r"let SC bring c\.x to (-?[\d.]+) instead", first_help(parked))
    assert target is not None
    assert explained(changed(("9.6 -", f"{target[1]} -"), text=CART)).verdict == "proved"


STRAYS = (
    ("clamp(9.6 - m.x - 2.5 * m.v, -3.0, 3.0)", "clamp(0.3 * (8.2 - m.x) - 1.2 * m.v, -3.0, 3.0)"),
    ("w: float in [-0.1, 0.1]", "w: float in [-0.3, 0.3]"),
)


def test_an_sc_that_strays_where_there_is_no_room_is_sent_to_where_there_is() -> None:
    result = explained(changed(*STRAYS, text=CART))
    assert [n for n, f in result.findings.items() if not f.holds] == ["P2b"]
    assert first_help(result).endswith("(not tried)")
    target = re.match(r"let SC bring c\.x to (-?[\d.]+) instead of 8\.2, as", first_help(result))
    assert target is not None
    there = ("8.2 -", f"{target[1]} -")
    assert explained(changed(*STRAYS, there, text=CART)).verdict == "proved"


STRONG = (*PREDICATES, ("float in [-0.1, 0.1] = 0.0", "float in [-20.0, 20.0] = 0.0"))


def test_commands_that_cross_k_within_h_are_told_and_a_shield_of_them_gives_back_nothing() -> None:
    result = explained(changed(*STRONG))
    why = cause(result, "ttf", "moved")
    seconds = result.problem.times.horizon_ns / 1e9
    assert dict(why.numbers)["moved"] == pytest.approx(40.0 * seconds)
    assert "`shield n;`" in why.text
    assert result.findings["P2b"].text == result.findings["ttf"].text  # said once
    shielded = explained(changed(*STRONG, ("  safe level", "  shield 8;\n  safe level")))
    assert [n for n, f in shielded.findings.items() if not f.holds] == ["P2b", "P3", "ttf", "safer"]
    assert "shield" not in cause(shielded, "ttf", "moved").text


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
    assert all("cells of" in x for x in finding.tried)


def test_under_a_computed_safer_nothing_is_advised_that_leads_in_a_circle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where smaller cells are too many to be tried that is said, and no `safer` is asked for."""
    for claim in choice.CELLS_MAX:
        monkeypatch.setitem(choice.CELLS_MAX, claim, 20)
    monkeypatch.setattr(recovery, "SIZES", ())
    finding = slot_verified(slot_text(), explain=True).findings["P2b"]
    assert [c.kind for c in finding.causes] == ["comes_back", "computed"]
    assert finding.hint.startswith("more cells (half the size, 34, is more than is looked at")
    assert finding.hint.endswith("smaller disturbances, smaller errors, smaller delays")


def test_what_there_was_no_time_for_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(choice.CELLS_MAX, "P2b", 20)  # else smaller ones are chosen
    monkeypatch.setattr(tried_remedies, "LEAST_S", 0.0)
    monkeypatch.setattr(tried_remedies, "OF_PROOF", 0.0)
    result = explained(changed(*COARSE, ("/ 16;", "/ 16; levels 3;")))
    assert any("not, for want of time: more cells" in t for t in result.findings["P2b"].tried)
    assert "(tried" not in first_help(result)


def test_what_has_few_cells_is_tried_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid of many cells does not take the time of what is quick; other controllers are last."""
    monkeypatch.setattr(tried_remedies, "COARSE", (4, 12))
    bold = ("ttf level < 0.25 || level > 1.75", "ttf level < 0.21 || level > 1.79")
    result = explained(changed(OLD, bold))
    result.findings["P2a"].leaving = explained(changed(SWAPPED)).findings["P2a"].leaving
    seen = {}
    for failing in (("P2a", "ttf"), ("ttf",)):
        trials = in_order(remedies(result.problem, failing, result))
        seen[failing] = [(change.exchanged, cells_of(problem)) for change, problem in trials]
        assert seen[failing] == sorted(seen[failing])
        last = {change.said: problem for change, problem in trials}
        assert all(last[change.said] is change.problem for change, _ in trials)
    assert seen["P2a", "ttf"][-1][0]
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
    assert lines_of(result.problem) == "grid t.h in [0.2, FULL] / 320;"
    longer = experiments.longer_axes(result.problem, {0: (0.1, 1.8000000000000003)})
    assert lines_of(longer) == "grid t.h in [0.1, FULL] / 340;"


def test_what_is_proved_is_not_tried() -> None:
    result = explained(TANK)
    assert result.verdict == "proved"
    assert not any(f.tried for f in result.findings.values())


def test_an_axis_that_nothing_reads_is_opened_where_runs_leave() -> None:
    """SC climbs for ever, at any height: K is empty on a grid that ends, and nowhere else."""
    result = explained(CLIMB)
    assert kinds(result, "P2a")[0] == "one_sided"
    said = re.match(r"no ends where runs leave: `(grid [^`]*;)` \(tried: every", first_help(result))
    assert said is not None
    grid = re.search(r"grid [^;]*;", CLIMB)
    assert grid is not None
    assert explained(changed((grid[0], said[1]), text=CLIMB)).verdict == "proved"


def test_changes_that_were_made_before_stay_in_a_problem_that_is_read_again() -> None:
    result = explained(CART)
    finer = smaller_cells(result.problem, result.problem.groups)
    assert experiments.younger_reads(finer) is None  # 20 ms are two periods of the plant
    again = experiments.exchanged(finer)
    assert again is not None
    assert again.groups == finer.groups
    assert cells_of(again) == 4 * 400 * 240


def test_a_finer_grid_that_was_tried_in_vain_is_not_advised(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(CART.replace("9.6 - m.x - 2.5 * m.v", "0.5 * m.x - 1.6 * m.v"))
    (module,) = soter.load(path).verify().modules
    finding = module.findings["P2a"]
    assert finding.tried[0] == "in vain: cells of half the size"
    assert finding.tried[1].startswith("not: cells of a quarter of the size, as 1,536,000 are more")
    assert finding.hint == "another SC (not tried)"


def test_a_module_with_a_shield_is_read_again_without_what_that_permitted(tmp_path: Path) -> None:
    (tmp_path / "lane.soter").write_text(
        LANE.replace("  safe", "  shield 4;\n  safe").replace("40ms", "80ms"), "utf-8"
    )
    problem = Program(str(tmp_path / "lane.soter")).verify(refute=False).modules[0].problem
    shield = problem.module.shield
    assert shield is not None
    shield.held = shield.permits = problem.module.symbol.safe  # as its compiled DM has it
    read_again = experiments.younger_reads(problem)
    assert read_again is not None
    again = read_again[0].module.shield
    assert again is not None
    assert again.held is None
