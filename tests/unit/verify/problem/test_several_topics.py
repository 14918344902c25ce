"""What a proof takes from a program that reads its plant through several topics, or not at all."""

from __future__ import annotations

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.claims.results import UNDECIDED
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval, Problem, assumption_texts
from soter.verify.verify_module import verify_module

SIGHTED = """soter 1;
topic clean: float max_age 10ms;
topic est: float max_age 10ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms {
  reads u;
  drives clean = p;
  drives est = p;
  state p: float;
  der p = u;
  measured est within 0.5;
}
node Fast period 10ms { publishes u; step { publish u = 1.0; } }
node Slow period 10ms {
  subscribes clean;
  publishes u;
  step { publish u = clamp(-clean, -1.0, 1.0); }
}
rta M {
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(est) < 1.0;
  verify { grid est in [-1.2, 1.2] / 240; }
}
system S { p: P; module M; }
"""


def problem_of(text: str) -> Problem:
    checked = check_file("test.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


def test_what_only_a_computed_dm_reads_has_its_errors_too() -> None:
    problem = problem_of(SIGHTED)
    assert [e.name for e in problem.quantities.errors] == ["est"]
    assert problem.errors == (Interval(-0.5, 0.5),)


def test_a_module_whose_dm_does_not_switch_is_proved_under_the_assumption_that_it_does() -> None:
    forced = SIGHTED.replace("module M; }", "module M; force M ac; }")
    said = "the DM switches: in system S it does not, M is forced to AC"
    assert said in assumption_texts(problem_of(forced).assumptions)
    assert said not in assumption_texts(problem_of(SIGHTED).assumptions)


CLOCKS = (
    ("drives clean = p;\n", ""),
    (
        "node Fast",
        "plant Q period 5ms { drives clean = q; state q: float; der q = -q; }\nnode Fast",
    ),
    ("verify { ", "verify { grid clean in [-1.0, 1.0] / 4; "),
    ("{ p: P;", "{ p: P; q: Q;"),
    ("subscribes clean", "subscribes clean, est"),
    ("clamp(-clean,", "clamp(-clean - est,"),
)


def test_plants_with_different_periods_are_not_read_as_one_state() -> None:
    text = SIGHTED
    for old, new in CLOCKS:
        assert old in text, old
        text = text.replace(old, new)
    with pytest.raises(SoterError) as raised:
        problem_of(text)
    diagnostics = [d for d in raised.value.diagnostics if d.code == "R016"]
    assert [d.message.split(" reads")[0] for d in diagnostics] == ["the DM", "SC"]
    problem_of(text.replace("plant Q period 5ms", "plant Q period 10ms"))


def test_the_order_in_which_commands_act_is_assumed_with_and_without_delays() -> None:
    said = "commands of AC and SC act in the order in which they were published"
    assert said in assumption_texts(problem_of(SIGHTED).assumptions)
    late = SIGHTED.replace("verify { ", "verify { acts within 2ms; ")
    assert said in assumption_texts(problem_of(late).assumptions)


def test_the_dm_sees_a_state_in_the_topic_that_is_declared_as_its_axis() -> None:
    text = SIGHTED.replace("  drives clean = p;\n", "").replace(
        "  drives est = p;\n", "  drives est = p;\n  drives clean = p;\n"
    )
    problem = problem_of(text)
    topic, leaf = problem.topic_leaf_of_state[0]
    assert (problem.system.topics[topic].name, leaf) == ("est", 0)


def test_a_dm_that_sees_nothing_is_undecided() -> None:
    blind = SIGHTED.replace("drives est = p;", "drives est = 2.0 * p;").replace(
        "drives clean = p;", "drives clean = 2.0 * p;"
    )
    problem = problem_of(blind.replace("grid est in", "grid p.p in"))
    result = verify_module(problem, refute=False)
    assert result.findings["ttf"].verdict == UNDECIDED


def test_of_an_abstraction_what_it_starts_from_and_time_stamps_are_told() -> None:
    text = SIGHTED.replace("plant P ", "plant Model ").replace("{ p: P;", "{ d: Far;")
    text = text.replace("verify { ", "verify { abstracts d by t: Model = { p: d.truth.far }; ")
    flies = "plant Far period 10ms { drives clean = far; drives est = far; state far: float; }\n"
    problem = problem_of(text.replace("node Fast", flies + "node Fast"))
    said = "\n".join(assumption_texts(problem.assumptions))
    assert "d behaves like t (Model)" in said
    assert "from the start of d on" in said
    assert "shows the state of d at the instant of publication" in said
