"""What noise needs of a rest, by an estimate: against a closed form, proofs, and what is told."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.search.hint_text import Hints
from soter.verify.search.rest_hints import hints_with_box
from soter.verify.tubes import simulated_runs
from soter.verify.tubes.noise_estimate import NoiseEstimate, boxes_back_soon, noise_estimate
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck
from unit.verify.tubes.test_rest_claims import HELD, NOT_KEPT, verified

LANE = (Path(__file__).parents[4] / "examples" / "rest" / "lane.soter").read_text(encoding="utf-8")


QUICK_LAG = "state lag: float = 0.0; der v = lag + wind; der lag = 200.0 * (push - lag);"


def check_of(text: str) -> TubeCheck:
    flat = system_of(check_file("module.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def estimate_of(text: str, *, on_time: bool = False) -> NoiseEstimate:
    """Of a box of 0.3 on both sides in each state; `on_time`: without ages and lateness."""
    check = check_of(text)
    if on_time:
        check.times = replace(check.times, delay=0, jitter=0)
    found = noise_estimate(check, dict.fromkeys(check.states, Interval(-0.3, 0.3)))
    assert found is not None
    return found


@pytest.mark.parametrize(("gain", "error", "wind"), [(3.0, 0.02, 0.2), (10.0, 0.1, 0.05)])
def test_of_a_first_order_loop_it_is_the_closed_form(
    gain: float, error: float, wind: float
) -> None:
    """From v = 0 on, |v| <= error + wind / gain while gain * hold < 1, and no less."""
    text = HELD.replace("-3.0 * seen", f"-{gain} * seen").replace(
        "[-0.2, 0.2]", f"[-{wind}, {wind}]"
    )
    text = text.replace("within 0.02", f"within {error}").replace("within 2s", "within 9s")
    found = estimate_of(text, on_time=True)
    assert found.share == found.on_time == found.young == pytest.approx((error + wind / gain) / 0.3)
    assert found.command == pytest.approx(gain * 0.3)


def test_twice_the_noise_needs_twice_the_room_and_late_commands_and_old_reads_need_more() -> None:
    late = HELD.replace("within 2s;", "within 2s; verify { acts within 7ms; }")
    one = estimate_of(late)
    two = estimate_of(
        late.replace("[-0.2, 0.2]", "[-0.4, 0.4]").replace("within 0.02", "within 0.04")
    )
    assert two.share == pytest.approx(2.0 * one.share)
    assert estimate_of(late, on_time=True).share < min(one.on_time, one.young) < one.share


@pytest.mark.parametrize("text", [HELD, LANE])
def test_a_rest_that_is_proved_has_room_for_noise(tmp_path: Path, text: str) -> None:
    """Else one of the two were wrong: SC, linear near its rest, keeps it."""
    m: Any = verified(tmp_path, text)
    assert m.findings["P2a"].verdict == "proved"
    found = noise_estimate(m.check, m.claims.box)
    assert found is not None
    assert 0.0 < found.share < 0.5


def test_it_is_told_where_rest_is_not_shown(tmp_path: Path) -> None:
    text = HELD.replace(*NOT_KEPT["what is seen is too far off"])
    hint = verified(tmp_path, text, explain=True).findings["P2a"].hint
    found = re.search(r"needs ([\d.]+) times what it has of `seen`: ([\d.]+) if no command", hint)
    assert found is not None
    assert float(found[1]) > 1.0


def test_an_sc_that_holds_nothing_has_no_estimate() -> None:
    check = check_of(HELD.replace(*NOT_KEPT["SC pushes the wrong way"]))
    assert noise_estimate(check, {check.states[0]: Interval(-0.3, 0.3)}) is None


def test_an_operation_that_is_not_simulated_leaves_no_estimate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    check = check_of(HELD)
    monkeypatch.delitem(simulated_runs.OPERATIONS, "mul")
    assert noise_estimate(check, {check.states[0]: Interval(-0.3, 0.3)}) is None


def test_a_past_that_nothing_bounds_is_told(tmp_path: Path) -> None:
    """A lag of 5 ms, and reads 20 ms old: Picard's boxes find no end backwards."""
    text = HELD.replace("topic push", "topic acted: float in [-2.0, 2.0] max_age 20ms;\ntopic push")
    text = text.replace("drives seen = v;", "drives seen = v; drives acted = lag;")
    text = text.replace("der v = push + wind;", QUICK_LAG).replace(
        "subscribes seen;", "subscribes seen, acted;"
    )
    text = text.replace("-3.0 * seen", "-3.0 * seen - 0.1 * acted")
    text = text.replace("abs(seen) < 0.3", "abs(seen) < 0.3 && abs(acted) < 1.0")
    assert (
        "nothing bounds how states moved in the " in verified(tmp_path, text).findings["P2a"].text
    )


def with_rest(condition: str) -> str:
    return HELD.replace("abs(seen) < 0.3", condition)


def test_boxes_that_are_back_soon_are_back_by_the_estimate_and_the_first_is_the_largest() -> None:
    check = check_of(HELD)
    boxes = list(boxes_back_soon(check, {check.states[0]: Interval(-0.3, 0.3)}))
    sides = [box[check.states[0]].high for box in boxes]
    assert len(boxes) > 1
    assert sides == sorted(sides, reverse=True)
    for box in boxes:
        found = noise_estimate(check, box)
        assert found is not None
        assert 0 < found.back <= 32
        assert found.command <= 1.0


def test_a_box_below_noise_is_never_back() -> None:
    check = check_of(HELD)
    found = noise_estimate(check, {check.states[0]: Interval(-0.03, 0.03)})
    assert found is not None
    assert found.share > 1.0
    assert found.back == 0


def test_no_box_is_proposed_where_sc_pushes_the_wrong_way_or_a_state_has_no_range() -> None:
    wrong = check_of(HELD.replace(*NOT_KEPT["SC pushes the wrong way"]))
    assert not list(boxes_back_soon(wrong, {wrong.states[0]: Interval(-0.3, 0.3)}))
    assert not list(boxes_back_soon(check_of(HELD), {}))


def test_the_other_box_is_shown_once_it_is_written(tmp_path: Path) -> None:
    """The declared rest is smaller than noise; the tube shows a box that the estimate proposes."""
    small: Any = verified(tmp_path, with_rest("abs(seen) < 0.03"))
    (ends,) = small.claims.other.values()
    assert small.findings["P2a"].verdict == "undecided"
    assert f"{ends.high:.4g}] it is shown to lead" in small.findings["P2a"].text
    wide: Any = verified(tmp_path, with_rest(f"abs(seen) < {ends.high}"))
    assert wide.findings["P2a"].verdict == "proved"
    assert not wide.claims.other


def test_the_search_writes_the_other_box_into_the_program() -> None:
    hints = Hints(clauses=("rest abs(seen) < 0.03 within 2s;", "shield;"), longer="")
    other = hints_with_box(hints, {"seen": Interval(-0.1, 0.1), "a.b": Interval(0.5, 1.0)})
    assert other.clauses == (
        "rest abs(seen) < 0.1 && a.b > 0.5 && a.b < 1.0 within 2s;",
        "shield;",
    )
