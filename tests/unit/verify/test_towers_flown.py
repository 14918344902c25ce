"""Towers in runs: what was proved holds, what was not may fail, and the report says who held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.api.program import load
from soter.simulate import run_report
from soter.simulate.run_report import report_page
from unit.verify.towers import TOWER

if TYPE_CHECKING:
    from pathlib import Path

    from soter.api.program import Program

FLIGHTS = 24
PUSHES = "step { publish u = x >= 0.0 ? 1.0 : -1.0; }"
FLIPS = "step { publish u = choose { -1.0, 1.0 }; }"


def _program(folder: Path, ac: str, *changes: tuple[str, str]) -> Program:
    text = TOWER.replace(FLIPS, ac).replace("state p: float;", "state p: float in [-2.6, 2.6];")
    text = text.replace("node Any period 10ms {", "node Any period 10ms {\n  subscribes x;")
    text = text.replace(
        "disturbance w: float in [-0.1, 0.1];", "disturbance w: float in [-0.1, 0.1] hold 200ms;"
    )
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "tower.soter"
    path.write_text(text)
    return load(path)


def _violated(program: Program) -> tuple[int, int]:
    """Flights that violated anything, and hand-backs of the outer module."""
    runs = [program.simulate(seed=k) for k in range(1, FLIGHTS + 1)]
    return sum(r.violations > 0 for r in runs), sum(r.modules["Outer"].switches_to_ac for r in runs)


@pytest.mark.parametrize("ac", [PUSHES, FLIPS])
def test_no_adversary_violates_what_is_proved(tmp_path: Path, ac: str) -> None:
    program = _program(tmp_path, ac)
    assert [m.headline for m in program.verify(refute=False).modules] == [
        "proved",
        "proved while Outer is in AC",
    ]
    violated, given_back = _violated(program)
    assert violated == 0
    assert given_back >= FLIGHTS


def test_a_hand_back_that_is_not_proved_is_violated(tmp_path: Path) -> None:
    """The adversary is no paper tiger: given back too early, the inner property fails."""
    late = ("safer abs(x) < 1.6", "safer abs(x) < 2.2"), ("ttf abs(x) > 1.7", "ttf abs(x) > 2.6")
    program = _program(tmp_path, PUSHES, *late)
    upper, lower = program.verify(refute=False).modules
    assert (upper.verdict, lower.verdict) == ("proved", "undecided")
    assert _violated(program)[0] > 0


def test_the_report_says_who_had_control(tmp_path: Path) -> None:
    """The shares follow from the modes: below a module in SC nobody has control."""
    program = _program(tmp_path, PUSHES, ("ttf abs(x) > 1.7", "ttf abs(x) > 1.2"))
    run = program.simulate(seed=3)
    trace = run.require_trace()
    (tower,) = run_report.towers(run.system)
    names = run_report.controllers(run.system, tower)
    assert names == ["Outer.Back", "Outer.Inner.Near", "Outer.Inner.Any"]
    held = run_report.controller_levels(tower, trace)
    assert set(held) >= {0, 2}
    at = np.array([run.system.component(n).index for n in names])
    enabled = trace["components"]["oe"][:, at] == 1
    assert (enabled.sum(axis=1) == 1).all()
    assert (enabled.argmax(axis=1) == held).all()
    (line,) = run_report.control_shares(run)
    assert line.startswith("Who had control in Outer: Outer.Back ")
    page = report_page(run, "a tower", {})
    assert line in page.notes
    (series,) = [s for c in page.charts for s in c.series if s.name == "control(Outer)"]
    assert series.panel == (
        "who has control (0: Outer.Back, 1: Outer.Inner.Near, 2: Outer.Inner.Any)"
    )


def test_a_run_of_a_module_alone_says_nothing_of_towers(tmp_path: Path) -> None:
    text = TOWER[: TOWER.index("rta Outer")] + (
        "system Lane default { c: Cart; module Inner; until 1s; }\n"
    )
    path = tmp_path / "alone.soter"
    path.write_text(text)
    assert run_report.control_shares(load(path).simulate()) == []


def test_a_safety_case_says_while_which_module_is_in_ac(tmp_path: Path) -> None:
    pytest.importorskip("flint")
    path = tmp_path / "tower.soter"
    path.write_text(TOWER)
    program = load(path)
    program.verify(refute=False, cert=tmp_path / "certificate")
    program.assure(tmp_path / "case", cert=tmp_path / "certificate")
    text = (tmp_path / "case" / "case.json").read_text()
    assert "keeps `abs(x) < 3.0` and `abs(x) < 2.0` while Outer is in AC" in text


def test_what_goes_wrong_in_a_module_that_claims_nothing_is_inside(tmp_path: Path) -> None:
    wrong = "saturated Outer.Inner.Near at 60 per 1h for 1s; late Outer.Inner.dm by 3ms;"
    quiet = TOWER[: TOWER.index("  verify")] + TOWER[TOWER.index("}\nrta Outer") :]
    inside = {}
    for name, text in (("claims", TOWER), ("comfort", quiet)):
        path = tmp_path / f"{name}.soter"
        path.write_text(text.replace("until 20s;", f"until 20s; faults {{ {wrong} }}"))
        inside[name] = [f.inside for f in load(path).flat().faults]
    assert inside["comfort"][:2] == ["nothing is claimed of its module"] * 2
    assert inside["claims"][:2] == [None, None]  # behind them: that SC waits for its DM
