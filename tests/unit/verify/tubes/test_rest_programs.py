"""Programs with `rest` that somebody wrote to get a wrong verdict, or none at all."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from soter.api import Program
from soter.certificate.rechecker import recheck
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem, TubeTimes
from soter.verify.tubes.tube_check import TubeCheck
from unit.verify.tubes.test_rest_claims import FOLLOW, SENSED, refused, verified

if TYPE_CHECKING:
    from pathlib import Path

PLAIN = FOLLOW.read_text(encoding="utf-8")
STEP = "publish levers = { gas: 0.0, brake: clamp(1.0 + sight.v, 0.0, 1.0) };"
BRAKES = "publish levers = { gas: 0.0, brake: 1.0 };"


def changed(text: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def gauge(text: str, topic: str, value: str = "v") -> str:
    """With a second topic of the plant."""
    text = changed(text, ("topic levers:", f"{topic}\ntopic levers:"))
    return changed(text, ("  state gap:", f"  drives gauge = {value};\n  state gap:"))


def test_a_start_is_asked_of_each_program(tmp_path: Path) -> None:
    """What is kept of one is nothing for another one that starts elsewhere."""
    assert verified(tmp_path, PLAIN).findings["start"].verdict == "proved"
    fast = changed(PLAIN, ("v: float = 10.0;", "v: float = 38.0;"))
    assert verified(tmp_path, fast.replace("60.0", "1.0")).findings["start"].verdict == "undecided"
    near = changed(PLAIN, ("way: float = 0.0;", "way: float = 399.9;"))
    assert verified(tmp_path, near).findings["start"].verdict == "undecided"


MAY_BE_NAN = {
    "a sine beyond its range": "brake: clamp(0.9 + 0.05 * sin(1e5 * sight.v), 0.0, 1.0) };",
    "a cosine beyond its range": "brake: clamp(0.9 + 0.05 * cos(1e5 * sight.v), 0.0, 1.0) };",
    "an angle beyond its range": "brake: wrap_angle(1e5 * sight.v) > 9.0 ? 0.9 : 1.0 };",
    "nothing of the endless": "brake: 1.0 + 0.0 * (sight.v * 1e200 * 1e120) };",
    "the endless is limited": "brake: clamp(0.0 * (sight.v * 1e200 * 1e120), 1.0, 1.0) };",
}


@pytest.mark.parametrize("name", MAY_BE_NAN)
def test_an_sc_that_may_publish_no_number_is_not_proved(tmp_path: Path, name: str) -> None:
    nan = f"publish levers = {{ gas: 0.0, {MAY_BE_NAN[name]}"
    m = verified(tmp_path, changed(SENSED, (STEP, nan)))
    assert "may fault" in m.findings["P2a"].text


def test_a_state_that_sc_sees_twice_has_two_errors(tmp_path: Path) -> None:
    law = changed(SENSED, ("1.0 + sight.v, 0.0", "1.0 - 9.0 * abs(sight.v - OTHER), 0.0"))
    leaf = changed(
        law.replace("OTHER", "sight.u"),
        ('v: float unit "m/s" };', 'v: float unit "m/s", u: float };'),
        ("v: v }", "v: v, u: v }"),
        ("sight.v within 0.05", "sight.v within 0.05, sight.u within 2.0"),
    )
    assert "twice" in refused(tmp_path, leaf)
    topic = gauge(law.replace("OTHER", "gauge"), "topic gauge: float in [-2.0, 40.0] max_age 20ms;")
    topic = changed(
        topic,
        ("  subscribes sight;\n  publishes levers;\n  step { publish", NODE_READS_BOTH),
        ("sight.v within 0.05", "sight.v within 0.05, gauge within 2.0"),
    )
    assert "twice" in refused(tmp_path, topic)


NODE_READS_BOTH = "  subscribes sight, gauge;\n  publishes levers;\n  step { publish"


def test_an_sc_answers_all_that_its_own_topic_may_say(tmp_path: Path) -> None:
    """Another topic of the same state may hold less."""
    text = changed(SENSED, (STEP, f"let a = 1.0 / (sight.v + 1.0); {BRAKES}"))
    text = changed(text, ("sight.v within 0.05", "sight.v within 1.0"))
    other = gauge(text, "topic gauge: float in [-0.5, 35.0];")
    assert "may fault" in verified(tmp_path, other).findings["P2a"].text


def test_the_dm_sees_states_by_what_is_read(tmp_path: Path) -> None:
    """A topic that nobody reads may show a state, too: first or last."""
    for text in (PLAIN, SENSED):
        more = gauge(text, "topic gauge: float;")
        assert verified(tmp_path, more).findings["start"].verdict == "proved"
        assert Program(str(tmp_path / "module.soter")).simulate(until="1s").violations == 0
    hidden = changed(PLAIN, ("sight: Sight in { v in", "sight: Sight in { gap in"))
    hidden = changed(
        hidden,
        (', v: float unit "m/s" }', " }"),
        (", v: v }", " }"),
        ("gap in [-2.0, 40.0]", "gap in [-2.0, 400.0]"),
        ("0.5 * (30.0 - sight.v) + ", ""),
        ("abs(sight.v) < 0.3", "sight.way > 300.0"),
        (", sight.v within 0.05", ""),
    )
    hidden = gauge(hidden, "topic gauge: float in [-2.0, 40.0];")
    assert "`gauge`, which nobody reads" in refused(tmp_path, hidden)


def test_a_plant_that_may_fault_is_not_safe(tmp_path: Path) -> None:
    told = gauge(PLAIN, "topic gauge: float;", "1.0 / (v - 5.0)")
    assert verified(tmp_path, told).findings["start"].verdict == "undecided"
    fun = "fun slow(v: float): float { assert v < 9.0; return v; }\nrta Follow"
    rate = changed(
        PLAIN, ("rta Follow", fun), ("BRAKE * levers.brake * v;", "levers.brake * slow(v);")
    )
    assert verified(tmp_path, rate).findings["start"].verdict == "undecided"
    safe = changed(PLAIN, ("rta Follow", fun), ("sight.gap > 0.0 &&", "slow(sight.v) < 90.0 &&"))
    assert verified(tmp_path, safe).findings["start"].verdict == "undecided"


ODD = {
    "a branch": f"if sight.v > 3.0 {{ {BRAKES} }} else {{ {BRAKES.replace('1.0', '0.9')} }}",
    "truths compared": f"let a = (sight.v > 0.0) == (sight.v < 9.0); {BRAKES}",
    "numbers used twice": "var a = 0.01 * sight.v; for i in 0..40 { a = 0.5 * a * (1.0 - a); } "
    "publish levers = { gas: 0.0, brake: 1.0 + 0.0 * a };",
    "many numbers": f"var a = sight.v; for i in 0..1500 {{ a = 0.5 * a; }} {BRAKES}",
}


@pytest.mark.parametrize("name", ODD)
def test_an_odd_sc_is_followed(tmp_path: Path, name: str) -> None:
    m = verified(tmp_path, changed(SENSED, (STEP, ODD[name])))
    assert m.findings["P2a"].verdict == "proved"


def test_what_is_too_large_is_refused(tmp_path: Path) -> None:
    long = f"var a = sight.v; for i in 0..30000 {{ a = 0.5 * a; }} {BRAKES}"
    assert "too large" in refused(tmp_path, changed(SENSED, (STEP, long)))
    once = f"if sight.v > 3.0 {{ {BRAKES} }}"
    assert "publish nothing" in refused(tmp_path, changed(SENSED, (STEP, once)))


def test_conditions_compare_truths(tmp_path: Path) -> None:
    for same in ("(sight.gap > 0.0) == (sight.v < 50.0)", "(sight.gap <= 0.0) != (sight.v < 50.0)"):
        m = verified(tmp_path, changed(PLAIN, ("safe sight.gap > 0.0", f"safe {same}")))
        assert m.findings["start"].verdict == "proved"


def test_a_state_that_nothing_asks_for_does_not_end(tmp_path: Path) -> None:
    """A plant stops whose state grows without end, or has no rate, and with it what is asked."""
    heat = gauge(PLAIN, "topic gauge: float;", "heat")
    heat = changed(heat, ("  state gap:", "  state heat: float = 1.0;\n  state gap:"))
    for rate in ("heat * heat", "sqrt(v)", "tan(gap)"):
        wrong = changed(heat, ("  der gap", f"  der heat = {rate};\n  der gap"))
        assert "which may end" in refused(tmp_path, wrong)
    for rate in ("v * v - 0.1 * heat", "0.1 * v * heat", "front"):
        right = changed(heat, ("  der gap", f"  der heat = {rate};\n  der gap"))
        assert verified(tmp_path, right).findings["start"].verdict == "proved"


def test_a_plant_that_nothing_moves_is_followed(tmp_path: Path) -> None:
    """No command and no disturbance has an effect on it."""
    rolls = changed(
        PLAIN,
        ("der v = 2.0 * levers.gas - BRAKE * levers.brake * v;", "der v = -BRAKE * v;"),
        ("  disturbance front: float in [0.0, 30.0] hold 1s;", "  //"),
        ("der gap = front - v;", "der gap = -v;"),
    )
    assert verified(tmp_path, rolls).findings["P2a"].verdict == "proved"


@pytest.mark.parametrize(
    ("within", "alpha"), [("", 100), ("acts within 9ms;", 100), ("acts within 4ms to 9ms;", 104)]
)
def test_ac_may_act_until_a_command_of_sc_acts_at_the_soonest(
    tmp_path: Path, within: str, alpha: int
) -> None:
    """Delta - J_dm + L_min is the larger part of alpha here."""
    path = tmp_path / "small.soter"
    path.write_text(changed(PLAIN, ("within 5s;\n", f"within 5s;\n  verify {{ {within} }}\n")))
    flat = system_to_prove(check_file(str(path)), "Line")
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    assert TubeTimes.of_problem(problem).earliest == alpha * 1_000_000


LOST = """soter 1;
type Pose = { s0: float, v: float, s1: float };
topic pose: Pose in { s0 in [-3.0, 3.0], v in [-4.0, 4.0], s1 in [0.5, 1.5] }
  = { s0: 0.0, v: 3.9, s1: 1.0 } max_age 20ms;
topic order: float in [-6.0, 6.0] = 0.0;
plant Body period 10ms {
  reads order;
  drives pose = { s0: s0, v: v, s1: s1 };
  state s0: float = 0.0;
  state v: float = 3.9;
  state s1: float = 1.0;
  der s0 = v * min(max(0.001 * v, HUGE), 1.0) - s0;
  der v = -2.0 * v + order;
  der s1 = 1.0 - s1;
  measured pose.s0 within 0.01, pose.v within 0.01, pose.s1 within 0.01;
}
node Ac period 50ms { publishes order; step { publish order = 0.0; } }
node Sc period 50ms { subscribes pose; publishes order;
  step { publish order = clamp(-pose.v, -1.0, 1.0); } }
rta M { ac Ac; sc Sc; period 50ms; safe abs(pose.s0) < 0.5;
  rest abs(pose.v) < 0.2 && abs(pose.s0) < 0.4 within 3s; }
system S default { b: Body; module M; until 3s; }
"""
"""With v near 4 at first, s0 goes beyond 0.8 wherever the greatest of two is at least 1."""


def test_what_leaves_the_doubles_is_not_left_out_of_a_greatest(tmp_path: Path) -> None:
    m = verified(tmp_path, LOST.replace("HUGE", "abs(s1 * 1e200 * 1e200)"))
    assert m.findings["start"].verdict == "undecided"


def test_a_step_of_no_length_ends_where_it_begins() -> None:
    text = LOST.replace("HUGE", "1.0").replace("- s0;", "- s0 + 1e12;")
    flat = system_to_prove(check_file("lost.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    generated = check.offline_text({})
    sizes = {
        k: int(v) for k, v in re.findall(r"^const (\w+): int = (\d+);", generated, re.MULTILINE)
    }
    none = (0.0,) * sizes["SYMBOLS"]
    still = ((0.0, 0.0, 0.0, 0.0, none),)
    step = Caller(generated).result(
        "flow", still * 3, still, (0.0,) * sizes["MOVED"], 0.0, sizes["MOVES"]
    )
    end, *_, found = step
    assert found
    assert all(low <= 0.0 <= high for _, _, low, high, _ in end)


# ---------------------------------------------------------------- of nothing

HELD = """soter 1;
topic x: float in [-50.0, 50.0] max_age 10ms;
topic a: float in [-2.0, 2.0] = 0.0;
plant Cart period 5ms {
  reads a;
  drives x = s;
  state s: float = 0.0;
  der s = a;
  measured x within 0.01;
}
node Fast period 20ms { publishes a; step { publish a = 0.1; } }
node Careful period 20ms {
  subscribes x;
  publishes a;
  step { publish a = clamp(-2.0 * x, -2.0, 2.0); }
}
rta Keep { ac Fast; sc Careful; period 50ms; safe abs(x) < 1.0; rest abs(x) < 0.5 within 5s; }
system S { c: Cart; module Keep; }
"""
NOWHERE = {
    "it contradicts itself": ("rest abs(x) < 0.5", "rest abs(x) < 0.5 && x > 0.6"),
    "the set of its topic": ("rest abs(x) < 0.5", "rest x > 60.0"),
    "where `safe` holds": ("rest abs(x) < 0.5", "rest abs(x) > 2.0"),
    "`safe` contradicts itself": ("safe abs(x) < 1.0", "safe x < 0.5 && x > 0.6"),
}


@pytest.mark.parametrize("name", NOWHERE)
def test_a_rest_that_holds_nowhere_is_refused(name: str, tmp_path: Path) -> None:
    assert "holds nowhere" in refused(tmp_path, changed(HELD, NOWHERE[name]))


@pytest.mark.parametrize(
    "rest", ["x * x < 0.25 && x > 0.6", "sin(x) > 0.9 && abs(x) < 0.5", "abs(x * x + 1.0) < 0.5"]
)
def test_what_is_said_of_no_state_is_not_proved(rest: str, tmp_path: Path) -> None:
    """What ranges do not decide forms may, and where none is found nothing is known."""
    text = changed(HELD, ("rest abs(x) < 0.5", f"rest {rest}"))
    try:
        said = verified(tmp_path, text).findings["P2a"].verdict
    except SoterError as error:
        said = str(error)
    assert said == "undecided" or "holds nowhere" in said


def test_the_check_is_asked_at_the_start(tmp_path: Path) -> None:
    """With commands that lead out of `safe` before SC can act AC gets control nowhere."""
    right = verified(tmp_path, HELD)
    assert (right.at_the_start, right.vacuity) == ("", None)
    never = verified(tmp_path, HELD.replace("-2.0, 2.0", "-100.0, 100.0"))
    assert (never.findings["P2a"].verdict, never.findings["start"].verdict) == ("proved", "proved")
    assert "does not let AC have control" in never.at_the_start
    assert never.vacuity is not None
    assert never.vacuity.how_often == "not shown"
    assert "nothing says that AC ever gets control" in never.headline
    run = Program(str(tmp_path / "module.soter")).simulate(until="2s")
    assert run.modules["Keep"].ac_share == 0.0


def test_a_safe_that_says_nothing_is_said_of_rest_as_of_sets(tmp_path: Path) -> None:
    m = verified(tmp_path, changed(HELD, ("abs(x) < 1.0", "abs(x) < 60.0")), tmp_path / "cert")
    assert m.vacuity is not None
    assert m.vacuity.what == "safe"
    assert m.findings["P2a"].text == f"of nothing: {m.vacuity.text}"
    (module,) = recheck(tmp_path / "cert").modules
    assert module.vacuous == m.vacuity.text
