"""`soter verify` finds how a module is proved of which its program does not say it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from bench.verify.robot_kinds import PROGRAM, drawn, made

import soter
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from pathlib import Path

HOPPER = """soter 1;
topic apex: float max_age 200ms;
topic thrust: float in [0.0, 0.3] = 0.0;
plant Hopper period 400ms {
  reads thrust;
  drives apex = h;
  state h: float = 0.4;
  disturbance ground: float in [-0.03, 0.03];
  next h = 0.75 * h + thrust + ground;
  measured apex within 0.01;
}
node Policy period 400ms { publishes thrust; step { publish thrust = 0.25; } }
node Hold period 400ms {
  subscribes apex;
  publishes thrust;
  step { publish thrust = clamp(0.1 + 0.5 * (0.4 - apex), 0.0, 0.3); }
}
rta Envelope { ac Policy; sc Hold; period 400ms; safe apex > 0.15 && apex < 0.8; }
system S default { h: Hopper; module Envelope; until 60s; always h.truth.h < 0.8; }
"""
BOT = """soter 1;
topic bot: { d: float, v: float } max_age 200ms;
topic cmd: float in [-0.22, 0.22] = 0.0;
plant Bot period 20ms {
  reads cmd;
  drives bot = { d: d, v: v };
  state d: float = 2.0;
  state v: float = 0.0;
  disturbance toward: float in [-1.0, 1.0];
  der d = -toward * v;
  der v = (cmd - v) / 0.1;
  measured bot.d within 0.02, bot.v within 0.01;
}
node Nav period 100ms { publishes cmd; step { publish cmd = 0.22; } }
node Stop period 50ms { publishes cmd; step { publish cmd = 0.0; } }
rta Bump { ac Nav; sc Stop; period 100ms; safe bot.d > 0.12; }
system S default { b: Bot; module Bump; until 60s; always b.truth.d > 0.12; }
"""


def _loaded(text: str) -> soter.Program:
    return soter.load("robot.soter", text=text)


def test_a_grid_is_found_and_written_it_proves_as_quickly() -> None:
    report = _loaded(HOPPER).verify(refute=False)
    (search,) = report.searches
    assert (report.verdict, search.proved, search.own) == ("proved", True, False)
    assert "grid apex in [0.15, 0.8]" in search.text
    again = _loaded(search.text).verify(refute=False)
    assert again.searches == ()
    assert again.program_sha256 == report.program_sha256
    assert [f.verdict for f in again.modules[0].findings.values()] == [
        f.verdict for f in report.modules[0].findings.values()
    ]


@pytest.mark.parametrize("instance", ["b", "bot"], ids=["its own name", "the name of the topic"])
def test_an_sc_that_stops_anywhere_is_proved_by_a_rest_that_is_found(instance: str) -> None:
    named = BOT.replace("b: Bot;", f"{instance}: Bot;").replace("b.truth", f"{instance}.truth")
    report = _loaded(named).verify(refute=False)
    (search,) = report.searches
    assert search.proved
    assert report.modules[0].findings["P2a"].verdict == "proved"
    assert report.modules[0].findings["start"].verdict == "proved"
    assert str(search.found).startswith("rest abs(bot.v) <")
    assert "moves bot.d by" in str(search.found)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        (HOPPER, HOPPER.replace("0.5 * (0.4 - apex)", "0.5 * (apex - 0.4)")),
        (HOPPER, HOPPER.replace("ground: float in [-0.03, 0.03]", "ground: float in [-0.2, 0.2]")),
        (BOT, BOT.replace("step { publish cmd = 0.0; }", "step { publish cmd = 0.1; }")),
        (BOT, BOT.replace("safe bot.d > 0.12", "safe bot.d > 1.999")),
    ],
    ids=["sign", "disturbance", "goes on", "no room"],
)
def test_a_robot_that_is_not_safe_is_not_proved(right: str, wrong: str) -> None:
    assert right != wrong
    report = _loaded(wrong).verify(refute=False, explain=False, budget_s=20.0)
    assert report.verdict not in ("proved", "assumed")
    assert not any(search.proved for search in report.searches)


def test_a_module_is_searched_once_and_its_own_hints_are_none_that_it_does_not_have() -> None:
    wrong = HOPPER.replace("0.5 * (0.4 - apex)", "0.5 * (apex - 0.4)")
    report = _loaded(wrong).verify(refute=False, explain=True)
    assert [(s.module, s.own) for s in report.searches] == [("Envelope", False)]


def test_modules_beside_those_of_which_hints_are_found_are_measured_in_the_same_system() -> None:
    modules, system = HOPPER.removeprefix("soter 1;").split("system S")
    second = modules
    for name in ("apex", "thrust", "Hopper", "Policy", "Hold", "Envelope"):
        second = second.replace(name, f"{name}2")
    both = system.replace("module Envelope;", "g: Hopper2; module Envelope; module Envelope2;")
    text = f"soter 1;{modules}{second}system S{both}"
    report = _loaded(text).verify(refute=False)
    assert [s.proved for s in report.searches] == [True, True]
    assert report.places["Envelope2"].start == text.index("rta Envelope2") + len("rta ")
    costs = [m.levels_cost for m in report.modules]
    assert all(c is not None and "stands" not in c.not_measured for c in costs)


def test_an_interruption_tells_what_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> float:
        raise KeyboardInterrupt

    wrong = HOPPER.replace("0.5 * (0.4 - apex)", "0.5 * (apex - 0.4)")
    monkeypatch.setattr("soter.verify.search.proof_search._rank_of_result", stopped)
    with pytest.raises(KeyboardInterrupt) as raised:
        _loaded(wrong).verify(refute=False, explain=False)
    (line,) = vars(raised.value)["__notes__"]
    assert line.startswith("Envelope: tried `grid apex")


def test_an_sc_that_leaves_the_set_of_its_topic_is_refused_and_no_defect() -> None:
    wrong = HOPPER.replace("0.0, 0.3); }\n}\nrta", "0.0, 0.3) - 0.2; }\n}\nrta")
    assert wrong != HOPPER
    try:
        verdict = _loaded(wrong).verify(refute=False, explain=False, budget_s=5.0).verdict
    except SoterError as error:
        verdict = error.diagnostics[0].code
    assert verdict in ("R008", "undecided")


def test_without_a_budget_nothing_is_looked_for() -> None:
    with pytest.raises(SoterError) as raised:
        _loaded(HOPPER).verify(budget_s=0.0)
    assert [d.code for d in raised.value.diagnostics] == ["R008"]


def test_a_budget_that_ended_before_any_hint_is_named() -> None:
    with pytest.raises(SoterError) as raised:
        _loaded(HOPPER).verify(budget_s=1e-9)
    assert any("`--budget` ended" in note for note in raised.value.diagnostics[0].notes)


def test_what_refuses_the_module_whatever_the_hint_is_named_with_its_help() -> None:
    late = "failsafe cmd = 0.0;\n  verify { response sc 30ms; acts within 1ms; }\n}\nsystem"
    with pytest.raises(SoterError) as raised:
        _loaded(BOT.replace("0.12; }\nsystem", f"0.12;\n  {late}")).verify(budget_s=5.0)
    told = raised.value.diagnostics[0]
    assert told.code == "R008"
    assert any("is refused: R015: SC may act 31 ms late" in note for note in told.notes)
    assert "a period of SC of 62 ms" in told.helps[0]


def test_a_grid_of_the_program_that_proves_is_not_touched() -> None:
    own = HOPPER.replace(
        "< 0.8; }\nsystem", "< 0.8; verify { grid apex in [0.15, 0.8] / 130; } }\nsystem"
    )
    report = _loaded(own).verify(refute=False)
    assert (report.verdict, report.searches) == ("proved", ())


def test_a_grid_of_the_program_that_is_too_coarse_is_replaced_where_another_proves() -> None:
    own = HOPPER.replace(
        "< 0.8; }\nsystem", "< 0.8; verify { grid apex in [0.15, 0.8] / 3; } }\nsystem"
    )
    assert _loaded(own).verify(refute=False, explain=False).verdict == "undecided"
    report = _loaded(own).verify(refute=False, explain=True)
    assert report.verdict == "proved"
    assert [s.own for s in report.searches] == [True]


def test_a_rest_alone_is_looked_for_on_demand() -> None:
    (bot,) = _loaded(BOT).rest_clauses()
    assert bot.proved
    assert all(t.hints.startswith("rest ") for t in bot.tries)
    assert f"{bot.found}" in bot.text
    wrong = BOT.replace("step { publish cmd = 0.0; }", "step { publish cmd = 0.1; }")
    (none,) = _loaded(wrong).rest_clauses()
    assert not none.proved


def test_a_rest_is_found_of_rovers_that_stop_anywhere_in_a_narrow_room() -> None:
    for seed in (0, 1):  # the tube moves one farther than runs do, and the other along its room
        (guard,) = _loaded(made("rover", drawn("rover", seed))[PROGRAM]).rest_clauses()
        assert guard.proved, seed


def test_the_command_line_tells_a_rest_of_the_module_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bot.soter").write_text(BOT)
    assert main(["advise", str(tmp_path / "bot.soter"), "--rest", "--module", "Bump"]) == 0
    assert "found   rest abs(bot.v) <" in capsys.readouterr().out
    assert main(["advise", str(tmp_path / "bot.soter"), "--rest", "--json"]) == 0
    bump = json.loads(capsys.readouterr().out)["rests"]["Bump"]
    assert (bump["proved"], bump["own"]) == (True, False)
    (tmp_path / "hopper.soter").write_text(HOPPER)
    assert main(["advise", str(tmp_path / "hopper.soter"), "--rest"]) == 0
    assert "no clause `rest` was tried" in capsys.readouterr().out


CART = BOT.replace("der d = -toward * v;", "der d = -v + 0.5 * toward * v;")


@pytest.mark.parametrize(
    "text",
    [
        CART,
        CART.replace("/ 0.1;", "/ 0.6;"),
        CART.replace("safe bot.d > 0.12", "safe bot.d > 0.12 && bot.v < 0.25"),
    ],
    ids=["stops where it is", "stops slowly", "a bound on the speed"],
)
def test_an_sc_that_stops_is_proved_and_its_certificate_accepted(text: str, tmp_path: Path) -> None:
    (tmp_path / "robot.soter").write_text(text)
    report = soter.load(tmp_path / "robot.soter").verify(refute=False, cert=tmp_path / "proof")
    assert report.searches[0].proved
    assert soter.recheck(tmp_path / "proof").accepted


def test_wind_that_pushes_at_rest_for_ever_is_not_bounded_by_moves() -> None:
    text = CART.replace("/ 0.1;", "/ 0.1 + 0.1 * toward;")
    report = _loaded(text).verify(refute=False, explain=False, budget_s=30.0)
    assert not report.searches[0].proved


def test_a_try_that_takes_too_much_leaves_time_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first grid is cut short; a later one proves, so the first is not asked again."""
    monkeypatch.setattr("soter.verify.search.proof_search.OF_A_TRY", 1e-9)
    report = _loaded(HOPPER).verify(refute=False, explain=False, budget_s=60.0)
    (search,) = report.searches
    assert search.proved
    first, *_, last = search.tries
    assert first.gave.startswith("cut short")
    assert last.gave == "proved"


def test_no_rest_is_tried_of_a_state_that_no_topic_shows() -> None:
    hidden = BOT.replace("bot: { d: float, v: float }", "bot: { d: float }")
    hidden = hidden.replace("{ d: d, v: v }", "{ d: d }").replace(", bot.v within 0.01", "")
    report = _loaded(hidden).verify(refute=False, explain=False, budget_s=10.0)
    assert not any(t.hints.startswith("rest") for s in report.searches for t in s.tries)
    assert not any(t.gave.startswith("N001") for s in report.searches for t in s.tries)
