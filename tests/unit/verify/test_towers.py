"""Towers: what is proved of a module above another one, and of the one below, and what is not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.api.program import load
from soter.diagnostics.diagnostic import SoterError
from tables import all_rows
from unit.verify.towers import GRID, TOWER, WRONG_ABOVE, WRONG_BELOW, changed

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

ROOT = Path(__file__).resolve().parents[3]


def _verified(folder: Path, text: str, module: str) -> ModuleResult:
    path = folder / "tower.soter"
    path.write_text(text)
    (result,) = load(path).verify(module=module, refute=False).modules
    return result


def _why(folder: Path, text: str, module: str) -> str:
    """All that is said where a module is not proved; "" where it is."""
    try:
        result = _verified(folder, text, module)
    except SoterError as error:
        return " ".join(str(x) for d in error.diagnostics for x in (d.message, *d.notes))
    if result.verdict in ("proved", "assumed"):
        return ""
    open_ = {n: f for n, f in result.findings.items() if not f.holds}
    return " ".join(f"{n} {f.text} {f.hint}" for n, f in open_.items())


def test_the_module_above_is_proved_whatever_the_one_below_does(tmp_path: Path) -> None:
    result = _verified(tmp_path, TOWER, "Outer")
    assert result.verdict == "proved"
    assert result.headline == "proved"
    assert result.findings["P2b"].verdict == "proved"
    assert any("Outer.Inner stands in the place of AC" in note for note in result.notes)
    assert {a.key for a in result.assumptions}.isdisjoint({"while Outer"})


def test_the_module_below_is_proved_while_the_one_above_is_in_ac(tmp_path: Path) -> None:
    result = _verified(tmp_path, TOWER, "Inner")
    assert result.headline == "proved while Outer is in AC"
    assert result.findings["start"].text.startswith("wherever Outer may give control back")
    assert result.findings["P2b"].verdict == "assumed"
    assert {"while Outer", "verdict of Outer", "sets while Outer"} <= {
        a.key for a in result.assumptions
    }


def test_what_a_hand_back_asks_of_h_counts_where_it_is_more(tmp_path: Path) -> None:
    late = changed(WRONG_BELOW["a verdict that comes late is not counted"][0])
    long = late.replace("horizon 34ms", "horizon 45ms")
    times = _verified(tmp_path, long, "Inner").problem.times
    assert times.h_star == 45_000_000 > times.schedule.h_star
    assert _why(tmp_path, long, "Inner") == ""


@all_rows("name", WRONG_BELOW)
def test_a_wrong_module_below_is_not_proved(tmp_path: Path, name: str) -> None:
    changes, why = WRONG_BELOW[name]
    said = _why(tmp_path, changed(changes), "Inner")
    assert said
    assert why in said


@pytest.mark.parametrize("name", WRONG_ABOVE)
def test_a_wrong_module_above_is_not_proved(tmp_path: Path, name: str) -> None:
    changes, why = WRONG_ABOVE[name]
    said = _why(tmp_path, changed(changes), "Outer")
    assert said
    assert why in said


def test_a_module_without_a_verify_block_claims_nothing(tmp_path: Path) -> None:
    text = TOWER[: TOWER.index("  verify")] + TOWER[TOWER.index("}\nrta Outer") :]
    path = tmp_path / "tower.soter"
    path.write_text(text)
    program = load(path)
    report = program.verify(refute=False)
    assert [m.name for m in report.modules] == ["Outer"]
    assert report.verdict == "proved"
    assert any("Inner" in said and "whatever it does" in said for said in report.coverage.rest)
    assert "nothing is claimed" in _why(tmp_path, text, "Inner")


def test_of_three_the_upper_two_are_proved(tmp_path: Path) -> None:
    changes, _ = WRONG_BELOW["two modules above"]
    text = changed(changes)
    assert _verified(tmp_path, text, "Outer").headline == "proved while Highest is in AC"


def test_a_law_of_a_tower_is_undecided(tmp_path: Path) -> None:
    text = TOWER.replace("  ac module Inner;", "  ac module Inner;\n  failsafe u = 0.0;")
    result = _verified(tmp_path, text, "Outer")
    assert result.findings["failsafe"].verdict == "undecided"
    assert "commands the same actuators" in result.findings["failsafe"].text


def test_what_the_module_below_keeps_is_no_contract_for_others(tmp_path: Path) -> None:
    """Its `safe` holds while the one above is in AC: nobody else may count on it."""
    follower = """topic gap: float in [-9.0, 9.0] max_age 10ms;
topic pull: float in [-1.0, 1.0] = 0.0;
plant Rope period 10ms {
  reads pull, x;
  drives gap = g;
  state g: float;
  der g = pull + 0.1 * x;
}
node Pull period 10ms { publishes pull; step { publish pull = 1.0; } }
node Hold period 10ms {
  subscribes gap;
  publishes pull;
  step { publish pull = clamp(-2.0 * gap, -1.0, 1.0); }
}
rta Follow {
  ac Pull;
  sc Hold;
  period 20ms;
  safe abs(gap) < 3.0;
  ttf abs(gap) > 2.0;
  safer abs(gap) < 1.0;
  verify { grid gap in [-3.2, 3.2] / 320; }
}
system Lane"""
    text = TOWER.replace("system Lane", follower).replace(
        "  module Outer;", "  module Outer;\n  rope: Rope;\n  module Follow;"
    )
    inner = text.replace("safe abs(x) < 2.0;", "safe x < 5.0 - 0.1 && x > -4.9 && abs(x) < 2.0;")
    outer = inner.replace("safe abs(x) < 3.0;", "safe x < 4.9 && x > -4.9 && abs(x) < 3.0;")
    for program, who in ((inner, {"Outer"}), (outer, {"Outer"})):
        path = tmp_path / "both.soter"
        path.write_text(program)
        report = load(path).verify(module="Follow", refute=False)
        by = {g.by for g in report.coverage.guarantees if "x" in g.what and g.how != "declared"}
        assert "Outer.Inner" not in by
        assert who <= by


def test_the_grid_of_the_module_below_is_read(tmp_path: Path) -> None:
    """A grid on which R(H) does not reach where control is given back proves nothing."""
    assert _why(tmp_path, TOWER.replace(GRID, "grid x in [-2.2, 2.2] / 2;"), "Inner")


@pytest.mark.long
def test_both_modules_of_the_example_are_proved() -> None:
    report = load(ROOT / "examples/wall/tower.soter").verify(refute=False)
    assert [m.headline for m in report.modules] == ["proved", "proved while SafeCart is in AC"]
    assert report.said["SafeCart.Comfort"] == "abs(motion.x) < MIDDLE while SafeCart is in AC"
