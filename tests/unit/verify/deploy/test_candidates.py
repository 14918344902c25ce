"""`shield toward plans, sc;`: of several commands the first that is good is published."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.front_end import check_file
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller
from tables import all_rows
from unit.verify.tubes.test_judged_programs import (
    CELLS,
    MOVED,
    NEAR,
    NEVER,
    NOW,
    check_of,
    flown,
)
from unit.verify.tubes.test_rest_programs import changed

if TYPE_CHECKING:
    from pathlib import Path

PLANS = "topic plans: Levers[2] in [0.0, 1.0];\n"
PLAN = """node Plan period 20ms {
  publishes plans;
  step { publish plans = [{ gas: 0.3, brake: 0.7 }, { gas: 0.2, brake: 0.8 }]; }
}
"""
READS = "node Cruise period 20ms {\n  subscribes sight"
TRIED = (
    (f"{READS};", f"{PLANS}{PLAN}{READS}, plans;"),
    ("shield toward sc;", "shield toward plans, sc;"),
    ("  module Follow;", "  node Plan;\n  module Follow;"),
)
CHOSEN = changed(MOVED, *TRIED)
FULL, SOME, LITTLE, BRAKE = (1.0, 0.0), (0.3, 0.7), (0.2, 0.8), (0.0, 1.0)


def test_the_first_that_may_act_for_longer_is_found() -> None:
    """At 30 m/s, d in front of what stands: AC's command, two others, and what SC said last."""
    caller = Caller(check_of(CHOSEN).text_in_flight({2: Interval(-0.31, 0.31)}))

    def found(gap: float, *plans: tuple[float, float]) -> tuple[float, ...]:
        until, wanted = (NEVER,) * (2 * CELLS), (*FULL, *BRAKE, *plans[0], *plans[1])
        seen = gap, 200.0, 30.0
        answer: tuple[float, ...] = caller.result("toward", seen, wanted, until, NOW)
        if answer[2] == 1.0:
            assert caller.returns_true("judged", seen, answer[:2], until, NOW)
        return answer

    assert found(40.0, SOME, LITTLE) == (*FULL, 1.0)
    assert found(20.0, SOME, LITTLE) == (*SOME, 1.0)
    assert found(20.0, LITTLE, SOME) == (*LITTLE, 1.0), "the order is that of the topic"
    assert found(10.0, SOME, LITTLE) == (*FULL, 0.0), "nothing is good"


def test_what_is_no_number_or_lies_beyond_is_never_found() -> None:
    """The topic's set keeps such a candidate out; the judgement does not rely on it."""
    caller = Caller(check_of(CHOSEN).text_in_flight({2: Interval(-0.31, 0.31)}))
    until, nan = (NEVER,) * (2 * CELLS), float("nan")
    for wild in ((nan, 0.7), (0.3, nan), (-1.0, 1.0), (0.0, 1.5), (0.0, float("inf"))):
        wanted = (*FULL, *BRAKE, *wild, *SOME)
        assert caller.result("toward", (20.0, 200.0, 30.0), wanted, until, NOW) == (*SOME, 1.0)


def test_both_engines_choose_alike_and_nothing_is_hit(tmp_path: Path) -> None:
    near = changed(NEAR, *TRIED)
    runs = [flown(tmp_path, near, e, "60ms") for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    run = flown(tmp_path, CHOSEN)
    assert not run.violations
    levers = zip(run.array("levers.gas"), run.array("levers.brake"), strict=True)
    assert {FULL, SOME, LITTLE, BRAKE} >= {(float(g), float(b)) for g, b in levers} > {FULL, BRAKE}


@all_rows(
    ("old", "new", "why"),
    [
        ("sight, plans", "sight", "its AC does not subscribe `plans`"),
        ("Levers[2]", "float[2]", "`plans` is no array of what it publishes"),
        ("plans: Levers[2] in [0.0, 1.0]", "plans: Levers[2]", "may lie outside of the set"),
        ("Levers[2] in [0.0, 1.0]", "Levers[2] in [0.0, 1.1]", "may lie outside of the set"),
        ("shield toward plans, sc", "shield 8 toward plans, sc", "leave the number of `shield`"),
    ],
)
def test_what_cannot_hand_commands_over_is_told(old: str, new: str, why: str) -> None:
    text = CHOSEN.replace(old, new)
    assert text != CHOSEN
    if "float[2]" in new:
        text = text.replace("[{ gas: 0.3, brake: 0.7 }, { gas: 0.2, brake: 0.8 }]", "[0.0, 1.0]")
    found = [(d.notes, d.helps) for d in check_file("follow.soter", text).diagnostics.items]
    assert any(why in str(d) for d in found), found


def test_a_plant_hands_no_commands_over() -> None:
    """What a plant drives passes no gate."""
    plant = "drives plans = [{ gas: v, brake: v }, { gas: v, brake: v }];\n  drives sight ="
    text = changed(CHOSEN, (PLAN, ""), ("  node Plan;\n", ""), ("drives sight =", plant))
    assert "may lie outside" in str(
        [d.notes for d in check_file("f.soter", text).diagnostics.items]
    )
