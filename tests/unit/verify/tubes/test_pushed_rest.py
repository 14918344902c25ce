"""A boat that wind pushes at rest, too: what is said of a `rest` that is not shown, with figures.

Purpose: verdicts, diagnostics and lints that a stranger met who put a robot of his own behind it.
Non-goals: what is proved (`test_rest_claims.py`).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import Program
from soter.cli.terminal.console import Console
from soter.cli.terminal.run_summary import run_summary
from soter.diagnostics.current_phase import listening_to_phases
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.language.model.tree_walk import MAX_OPERATIONS
from soter.simulate.run_report import report_page
from soter.verify.problem.extract import extract
from soter.verify.tubes.generated_functions import Caller, TooLongError
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck
from unit.verify.tubes.test_rest_claims import HELD

if TYPE_CHECKING:
    from soter.verify.claims.results import Finding

BOAT = """soter 1;
type Fix = { x: float unit "m", v: float unit "m/s" };
topic fix: Fix in { x in [-100.0, 100.0], v in [-5.0, 5.0] } max_age 50ms;
topic thrust: float in [-1.0, 1.0] = 0.0;
plant Boat period 10ms {
  reads thrust;
  drives fix = { x: x, v: v };
  measured fix.x within 0.2, fix.v within 0.05;
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.1, 0.1];
  der x = v;
  der v = 1.5 * thrust - 0.8 * v + wind;
}
node Go period 20ms { subscribes fix; publishes thrust; step { publish thrust = 1.0; } }
node Stop period 100ms { subscribes fix; publishes thrust; step { publish thrust = LAW; } }
rta Keep {
  ac Go;
  sc Stop;
  period 100ms;
  safe abs(fix.x) < 20.0;
  rest REST within 10s;
}
system Lake default { b: Boat; module Keep; until 1s; }
"""
COAST, BRAKE, HOLD = "0.0", "clamp(-fix.v, -1.0, 1.0)", "clamp(-0.3 * fix.x - fix.v, -1.0, 1.0)"


def check_of(program: Program) -> TubeCheck:
    flat = system_to_prove(check_file("boat.soter", Path(program.path).read_text()), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def boat(folder: Path, law: str, rest: str, *changes: tuple[str, str]) -> Program:
    text = BOAT.replace("LAW", law).replace("REST", rest)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "boat.soter"
    path.write_text(text, encoding="utf-8")
    return Program(str(path))


@pytest.mark.parametrize("period", ["100ms", "200ms", "1s"])
def test_a_slower_sc_of_a_module_with_rest_is_not_exchanged(tmp_path: Path, period: str) -> None:
    slower = ("period 100ms", f"period {period}")
    text = "abs(fix.v) < 0.2 moves fix.x by 1.0"
    program = boat(tmp_path, COAST, text, slower)
    assert "W012" not in {d.code for d in program.check().warnings}
    predicates = (f"rest {text} within 10s", "ttf fix.x > 9.0; safer fix.x < 8.0")
    program = boat(tmp_path, COAST, text, slower, predicates)
    assert "W012" in {d.code for d in program.check().warnings}


def test_a_time_that_is_too_long_is_told_with_the_longest(tmp_path: Path) -> None:
    program = boat(tmp_path, HOLD, "abs(fix.v) < 0.5", ("within 10s", "within 600s"))
    with pytest.raises(SoterError) as caught:
        program.verify(budget_s=0.0)
    (told,) = caught.value.diagnostics
    assert told.code == "R007"
    assert "4e+08 operations" in told.message
    found = re.fullmatch(r"`within ([\d.]+)s` at most, (\d+) steps of SC", told.helps[0])
    assert found is not None
    within, steps = found.groups()
    assert float(within) == pytest.approx(0.1 * int(steps))
    check = check_of(program)
    assert check.offline_operations(int(steps)) <= MAX_OPERATIONS
    with pytest.raises(TooLongError):
        check.offline_operations(int(steps) + 1)


@pytest.fixture
def nothing_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache without what an earlier run of these tests found of the same programs."""
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))


def said(program: Program, row: str = "P2a") -> Finding:
    return program.verify(budget_s=0.0).modules[0].findings[row]


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize(("wind", "speed"), [("0.1", 0.125), ("0.2", 0.25)])
def test_a_rest_that_wind_blows_away_is_told_with_how_far(
    tmp_path: Path, wind: str, speed: float
) -> None:
    """v' = -0.8 v + wind comes to wind / 0.8, whatever the boat did before."""
    pushed = ("[-0.1, 0.1]", f"[-{wind}, {wind}]")
    heard: list[str] = []
    with listening_to_phases(lambda *_: None, heard.append):
        finding = said(boat(tmp_path, COAST, "abs(fix.v) < 0.05 moves fix.x by 9.0", pushed))
    assert finding.verdict == "undecided"
    run = re.search(r"b.wind = (-?[\d.]+) is at b.v = (-?[\d.]+) after", finding.text)
    assert run is not None
    assert abs(float(run[2])) == pytest.approx(speed, rel=1e-2)
    assert float(run[1]) * float(run[2]) == pytest.approx(float(wind) * speed, rel=1e-2)
    assert any("is at b.v" in line for line in heard)  # at once, not with the verdict
    larger = re.search(r"into b.v in \[-?[\d.]+, ([\d.]+)\] it is shown to lead", finding.text)
    assert larger is not None
    assert speed < float(larger[1]) < 2 * speed
    asked = f"abs(fix.v) < {larger[1]} moves fix.x by 9.0"
    assert "lead back" not in said(boat(tmp_path, COAST, asked, pushed)).text
    assert "anchor" in finding.hint


@pytest.mark.usefixtures("nothing_kept")
def test_a_run_that_is_not_back_ends_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of parts of such a box nothing is asked, which took minutes."""
    asked: list[str] = []
    value = Caller.result

    def heard(self: Caller, name: str, *arguments: Any) -> Any:
        asked.append(name)
        return value(self, name, *arguments)

    monkeypatch.setattr(Caller, "result", heard)
    wrong = "clamp(0.3 * fix.x - fix.v, -1.0, 1.0)"
    finding = said(boat(tmp_path, wrong, "abs(fix.x) < 2.0 && abs(fix.v) < 0.5"))
    assert "a run from b.x = " in finding.text
    assert 1 <= asked.count("keeps") <= 2


def test_an_anchor_is_rest_under_wind(tmp_path: Path) -> None:
    rest = "abs(fix.x) < 2.0 && abs(fix.v) < 0.5"
    assert said(boat(tmp_path, HOLD, rest)).verdict == "proved"


MOVES = {
    "pushed for ever": (COAST, "abs(fix.v) < 0.2 moves fix.x by 0.5", (), "at up to 0.2"),
    "by what SC reads": (BRAKE, "abs(fix.v) < 0.5 moves fix.x by 0.5", (), "SC, by what it reads"),
    "farther than it says": (
        COAST,
        "abs(fix.v) < 0.2 moves fix.x by 0.2",
        (("-0.1, 0.1", "0.0, 0.0"),),
        "by up to 0.25",
    ),
    "one way": (
        COAST,
        "abs(fix.v) < 0.2 moves fix.x by 0.1 down",
        (("x in [-100.0, 100.0], ", ""),),
        "down, it may go on",
    ),
}


@pytest.mark.parametrize("name", MOVES)
def test_what_moves_says_and_is_not_shown_is_told_with_how_far_it_is(
    tmp_path: Path, name: str
) -> None:
    law, rest, changes, told = MOVES[name]
    finding = said(boat(tmp_path, law, rest, *changes))
    assert finding.verdict == "undecided"
    assert told in finding.text
    assert f"`moves` allows {rest.split(' by ')[1].split()[0].rstrip('0')}" in finding.text


def test_a_run_says_in_its_first_lines_that_a_rest_is_not_shown(tmp_path: Path) -> None:
    rest = "abs(fix.v) < 0.2 moves fix.x by 0.5"
    for law, shown in ((COAST, False), (HOLD, True)):
        rest = "abs(fix.x) < 2.0 && abs(fix.v) < 0.5" if shown else rest
        program = boat(tmp_path, law, rest)
        run = program.simulate(until="1s")
        assert run.modules["Keep"].ac_share > 0.0
        with Console(json=False) as console:
            lines = run_summary(run, "boat.soter", console)
        assert ("NOT SHOWN" in lines.split("\n\n")[0]) is not shown
        page = report_page(run, "boat", {})
        assert ("is not shown" in page.headline) is not shown
        assert any("not shown" in text for text in page.assumptions) is not shown


def test_a_part_that_is_not_led_back_is_named(tmp_path: Path) -> None:
    """No run of what is read rightly goes astray; what is read may be too far off."""
    path = tmp_path / "held.soter"
    for error, kept in (("0.4", False), ("0.02", True)):
        path.write_text(HELD.replace("seen within 0.02", f"seen within {error}"), encoding="utf-8")
        finding = said(Program(str(path)))
        part = r"shown of [\d.]+% of it, not from p.v in \[.*\] \(\d+ parts asked\)"
        assert bool(re.search(part, finding.text)) is not kept, finding.text
        assert finding.verdict == ("proved" if kept else "undecided")
