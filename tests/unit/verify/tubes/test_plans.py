"""Several plans of SC: what a naive version gets wrong (docs/proof-flight.md, "Several plans").

A car rolls toward a wall and can go round it on either side; how far it is to the wall says of
each plan whether an estimate is good.
"""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.api import Program
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless
from soter.language.front_end import check_file, system_to_prove
from soter.semantics.interpreter import Interpreter
from soter.verify.deploy.missing_predicates import complete, decision_costs
from soter.verify.problem.extract import extract
from soter.verify.scope import problem_key
from soter.verify.tubes.problem import TubeProblem

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.verify.claims.results import ModuleResult

TEXT = Path(__file__).with_name("two_plans.soter").read_text(encoding="utf-8")
START = "state y: float = 0.0;"
UP, DOWN = 0, 1


def changed(*pairs: tuple[str, str], text: str = TEXT) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def flat_of(text: str) -> System:
    return system_to_prove(check_file("plans.soter", text), None)


def verified(tmp_path: Path, text: str) -> ModuleResult:
    path = tmp_path / "plans.soter"
    path.write_text(text, encoding="utf-8")
    (result,) = Program(str(path)).verify(refute=False).modules
    return result


def verdicts(result: ModuleResult) -> tuple[str, str]:
    return result.findings["P2a"].verdict, result.findings["start"].verdict


NEAR = ("state x: float = 0.0;", "state x: float = 0.7;"), (START, "state y: float = 0.3;")


def test_a_start_is_proved_by_the_first_plan_alone(tmp_path: Path) -> None:
    """From there only Up goes round the wall."""
    assert verdicts(verified(tmp_path, TEXT)) == ("proved", "proved")
    up_first = changed(*NEAR)
    assert verdicts(verified(tmp_path, up_first)) == ("proved", "proved")
    down_first = verified(tmp_path, changed(("sc Up, Down;", "sc Down, Up;"), text=up_first))
    assert verdicts(down_first) == ("proved", "undecided")
    assert down_first.findings["start"].text.startswith("Down: ")


def test_that_each_start_has_a_plan_does_not_prove_the_start(tmp_path: Path) -> None:
    both = changed(NEAR[0], (START, "state y: float in [-0.3, 0.3];"))
    assert verdicts(verified(tmp_path, both)) == ("proved", "undecided")


def test_what_is_shown_is_shown_of_plans_that_do_not_fly_too(tmp_path: Path) -> None:
    too_much = changed(("publish aside = -1.0", "publish aside = -1.1"))
    result = verified(tmp_path, too_much)
    assert verdicts(result) == ("undecided", "undecided")
    assert result.findings["P2a"].text.startswith("Down: ")
    flat = flat_of(too_much)
    (note,) = complete(flat)
    assert note.endswith("its AC never gets control")
    assert flat.modules[0].goods == ()


def test_plans_beside_judged_commands_are_refused() -> None:
    """The last judgement may have been good for another plan than the last look."""
    flat = flat_of(changed(("safe apart(pose);", "safe apart(pose);\n  shield;")))
    with pytest.raises(SoterError) as refusal:
        extract(faultless(flat), flat.modules[0])
    (diagnostic,) = refusal.value.diagnostics
    assert diagnostic.code == "R007"
    assert "with several plans no command is judged" in diagnostic.message
    assert diagnostic.helps


def looked(text: str, x: float, y: float, plan: int = UP) -> tuple[bool, int | None]:
    """Whether a DM that saw this is good, and with which plan."""
    flat = flat_of(text)
    complete(flat)
    it, (module,) = Interpreter(flat), flat.modules
    said = {"pose": (x, y, 1.0), "Round.plan": plan}
    c = it.initial()
    topics = tuple(said.get(t.name, t.default) for t in flat.topics)
    env = it.machine.environment(c, flat.components[module.dm])
    env.topics = topics
    ttf, safer, chosen, _ = it.machine.dms[module.dm].decide(env, topics)
    assert ttf != safer
    return safer, chosen


def test_an_estimate_is_good_where_one_plan_is_good_for_all_of_it() -> None:
    """From 0.7 m each state has a plan, and an estimate that may be 0.1 m off has none."""
    exact = looked(TEXT, 0.7, 0.0)
    assert exact == (True, UP)
    measured = changed(("  der v =", "  measured pose.y within 0.1;\n  der v ="))
    assert looked(measured, 0.7, 0.0) == (False, None)
    assert looked(measured, 0.7, 0.2) == (True, UP)
    assert looked(measured, 0.7, -0.2) == (True, DOWN)


def test_ac_keeps_control_where_no_plan_alone_lets_it() -> None:
    one = changed(("sc Up, Down;", "sc Up;"), ("node Down", "node _Down"))
    flat = flat_of(one)
    complete(flat)
    assert looked(TEXT, 0.7, -0.2) == (True, DOWN)
    assert looked(TEXT, 0.7, 0.0, plan=DOWN) == (True, DOWN)
    it = Interpreter(flat)
    env = it.machine.environment(it.initial(), flat.components[flat.modules[0].dm])
    env.topics = tuple((0.7, -0.2, 1.0) if t.name == "pose" else t.default for t in flat.topics)
    assert it.machine.dms[flat.modules[0].dm].decide(env, env.topics)[:2] == (True, False)


def test_a_decision_costs_what_all_checks_cost() -> None:
    costs, _ = decision_costs(flat_of(TEXT))
    one, _ = decision_costs(flat_of(changed(("sc Up, Down;", "sc Up;"))))
    assert costs["Round"].operations > 1.9 * one["Round"].operations


def test_each_plan_is_proved_as_if_it_stood_alone() -> None:
    flat = flat_of(TEXT)
    problem = extract(faultless(flat), flat.modules[0])
    assert isinstance(problem, TubeProblem)
    assert [p.plan for p in problem.plans] == ["Up", "Down"]
    for p in problem.plans:
        alone = flat_of(changed(("sc Up, Down;", f"sc {p.plan};")))
        same = extract(faultless(alone), alone.modules[0])
        assert (p.times, p.initial, p.states, p.controls) == (
            same.times,
            same.initial,
            same.states,
            same.controls,
        )
        assert p.system.components[p.module.sc].node is not None
        assert p.module.plan is None


@pytest.mark.parametrize("start", [0.3, -0.3])
def test_both_engines_fly_the_plan_of_the_last_verdict(tmp_path: Path, start: float) -> None:
    path = tmp_path / "plans.soter"
    text = changed(NEAR[0], (START, f"state y: float = {start};"))
    path.write_text(changed(("aside = 0.0; }", f"aside = {-start}; }}"), text=text), "utf-8")
    program = Program(str(path))
    native = program.simulate(until="1s", trace=True)
    assert program.simulate(until="1s", engine="interp").trace_sha256 == native.trace_sha256
    trace, (module,) = native.require_trace(), native.system.modules
    plan, mode = trace["topics"]["Round.plan"], trace["modules"]["mode"][:, module.index]
    changes = [k for k in range(1, len(plan)) if plan[k] != plan[k - 1]]
    assert all(mode[k] == 1 for k in changes)
    flown = [(p, u) for p, u, m in zip(plan, trace["topics"]["aside"], mode, strict=True) if not m]
    assert len(flown) > 10
    assert all(u == (1.0, -1.0)[p] for p, u in flown[2:])
    assert plan[-1] == (UP if start > 0.0 else DOWN)


def test_another_problem_of_any_plan_is_another_problem_of_the_module() -> None:
    """Else one of two systems would be taken for proved as the other one is."""
    flat = flat_of(TEXT)
    problem = extract(faultless(flat), flat.modules[0])
    assert isinstance(problem, TubeProblem)
    other = copy(problem)
    up, down = problem.plans
    another = copy(down)
    another.levels = down.levels + 1
    other.plans = (up, another)
    assert problem_key(problem) == problem_key(copy(problem)) != problem_key(other)
