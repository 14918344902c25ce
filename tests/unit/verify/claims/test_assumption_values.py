"""Assumptions and verdicts are values: nothing is edited after the fact."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from soter.certificate.scope import assumptions_of
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_of
from soter.language.model.assumption_words import numbered_assumptions
from soter.verify.claims.results import ASSUMED, PROVED, REFUTED, UNDECIDED, WORSE, Finding
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import FRESH, SCHEME, Assumption, assumptions_left
from soter.verify.verify_module import module_method
from tables import all_rows
from unit.certificate.small_proofs import facts_of

EXAMPLES = Path(__file__).resolve().parents[4] / "examples"


@pytest.mark.parametrize("name", ["wall/cart.soter", "testing/planner.soter"])
def test_a_problem_that_is_verified_twice_rests_on_the_same(name: str) -> None:
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    coarse = re.sub(r"/ \d+0(?=[,;])", "/ 40", text) if "grid" in text else text
    checked = check_file(str(EXAMPLES / name), coarse)
    assert checked.program is not None
    flat = system_of(checked, None)
    (seen,) = systems_by_view(flat, flat.modules[0])
    problem = extract(*seen)
    before = problem.assumptions
    verify = module_method(problem).verify
    first, second = (verify(problem, refute=False) for _ in range(2))
    assert first.assumptions == second.assumptions
    assert len(set(first.assumptions)) == len(first.assumptions)
    assert problem.assumptions == before


@all_rows("first", WORSE)
@all_rows("second", WORSE)
def test_a_verdict_is_the_worst_of_what_it_rests_on(first: str, second: str) -> None:
    finding = Finding(first, text="why", hint="mend it")
    finding.weaken_to(second, "another reason")
    assert finding.verdict == max(first, second, key=WORSE.index)
    worse = WORSE.index(second) >= WORSE.index(first)
    assert finding.text == ("another reason" if worse else "why")


def test_a_verdict_cannot_be_set_anew() -> None:
    finding = Finding(UNDECIDED)
    with pytest.raises(AttributeError, match="made once"):
        finding.verdict = PROVED
    assert finding.verdict == UNDECIDED
    assert WORSE == (PROVED, ASSUMED, UNDECIDED, REFUTED)


def test_what_was_never_assumed_cannot_be_shown() -> None:
    assert assumptions_left([FRESH, SCHEME], added=[], shown={"scheme"}) == (FRESH,)
    with pytest.raises(KeyError, match="scheme"):
        assumptions_left([FRESH], added=[], shown={"scheme"})


def test_what_shares_its_key_with_another_cannot_be_shown() -> None:
    other = Assumption("scheme", "something else that is called so")
    with pytest.raises(KeyError, match="scheme"):
        assumptions_left([SCHEME, other], added=[], shown={"scheme"})
    assert assumptions_left([SCHEME, SCHEME], added=[], shown={"scheme"}) == ()


def test_what_a_proof_adds_stands_once() -> None:
    together = Assumption("together u, v", "both at one instant")
    assert assumptions_left([FRESH], added=[together, together], shown=()) == (FRESH, together)


JUMPS = """soter 1;
topic seen: { x: float, v: float } max_age 100ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Slider period 50ms {
  reads push;
  drives seen = { x: x, v: v };
  state x: float;
  state v: float;
  der x = -x + v * v;
  der v = v > 0.0 ? push - 0.5 : push + 0.5;
}
node Any period 100ms { subscribes seen; publishes push; step { publish push = -seen.v; } }
node Calm period 100ms { subscribes seen; publishes push; step { publish push = -seen.v; } }
rta M {
  ac Any; sc Calm; period 100ms;
  safe abs(seen.v) < 2.0;
  WITH
}
system S { s: Slider; module M; until 1s; }
"""
"""Friction that jumps at v = 0, and a state beside it that reads v."""


@pytest.mark.parametrize(
    "how",
    [
        "verify { grid seen.x in [-5.0, 5.0] / 9, seen.v in [-2.0, 2.0] / 9; }",
        "verify { grid seen.x in [-5.0, 5.0] / 9; grid seen.v in [-2.0, 2.0] / 9; }",
        "rest abs(seen.v) < 0.7 within 2s;",
    ],
    ids=("one group", "a product", "tubes"),
)
def test_of_a_plant_that_jumps_it_is_assumed_what_may_be_so(how: str, tmp_path: Path) -> None:
    """Prover and re-checker: that it has one solution, not that its rates are Lipschitz."""
    program = tmp_path / "slider.soter"
    program.write_text(JUMPS.replace("WITH", how))
    checked = check_file(str(program))
    assert checked.ok, checked.diagnostics
    flat = system_of(checked, None)
    (seen,) = systems_by_view(flat, flat.modules[0])
    every = extract(*seen).assumptions, assumptions_of(facts_of(program, "S", "M"))
    (ours,), (theirs,) = ([a.text for a in some if a.key == "scheme"] for some in every)
    assert ours == theirs
    assert "only solution" in ours
    assert "jumps" in ours
    assert "Lipschitz" not in ours


STATED_BY_ONE = {
    ("wall/cart.soter", "SafeCart"): {"age"},
    ("wall/lift.soter", "SafeLift"): {"age"},
    ("wall/landing.soter", "SafeCart"): {
        "age",
        "mode SafeBattery",
        "waits",
        "waits SafeBattery",
        "set charge",
        "set place",
    },
    ("mountain_car/cliff.soter", "SafeCar"): {"shows car", "prelude", "bound of cos"},
    ("rest/cruise.soter", "Distance"): {"no dropout", "set sight"},
}
"""Keys of what differs in substance (docs/assure.md), or is confirmed in a re-check (`set`)."""


@pytest.mark.parametrize("of", STATED_BY_ONE, ids=" ".join)
def test_prover_and_rechecker_say_the_same_of_the_same(of: tuple[str, str]) -> None:
    """Derived twice, by code that shares the words alone."""
    path = EXAMPLES / of[0]
    flat = system_of(check_file(str(path)), None)
    (module,) = (m for m in flat.modules if m.name == of[1])
    (seen,) = systems_by_view(flat, module)
    ours = {a.text: a.key for a in extract(*seen).assumptions}
    theirs = {a.text: a.key for a in assumptions_of(facts_of(path, flat.name, of[1]))}
    both = ours.keys() & theirs.keys()
    assert {t: ours[t] for t in both} == {t: theirs[t] for t in both}
    different = {*ours.items(), *theirs.items()} - {(t, ours[t]) for t in both}
    assert {key for _, key in different} == STATED_BY_ONE[of]
    assert len(set(ours.values())) == len(ours)
    assert len(set(theirs.values())) == len(theirs)


def test_the_first_list_keeps_its_order_and_others_add_to_it() -> None:
    said = numbered_assumptions(["b", "a", "b"], ["c", "a"], ["d"])
    assert said == {"b": "A1", "a": "A2", "c": "A3", "d": "A4"}
