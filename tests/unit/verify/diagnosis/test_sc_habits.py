"""What SC does by itself where it keeps nothing: the advice is about SC, nothing else is tried."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.current_phase import listening_to_phases
from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.diagnosis import tried_remedies
from soter.verify.diagnosis.variations import CALMER, NotProved, Remedy
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis.tank_modules import TANK, changed, explained

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

HOLD = "clamp(0.5 * (1.0 - level), -0.1, 0.1)"
COARSE = (("/ 320", "/ 32"),)
STOPS = ((HOLD, "0.0"), ("leak: float in [0.0, 0.02]", "leak: float in [-0.02, 0.02]"))
WEAK = (("leak: float in [0.0, 0.02]", "leak: float in [-0.2, 0.2]"),)
BOLD = ("ttf level < 0.25 || level > 1.75", "ttf level < 0.2 || level > 1.8")


def problem_of(text: str) -> Problem:
    (problem,) = problems_of(modules_of(check_file("tank.soter", text), None, None, {}))
    return problem


@pytest.mark.parametrize(
    ("changes", "said", "hint"),
    [
        (
            STOPS,
            "SC leaves t.h at 1.16 where it begins at 1.16, and does not bring it back",
            "to a place",
        ),
        (
            ((HOLD, "clamp(0.5 * (level - 1.0), -0.1, 0.1)"), WEAK[0]),
            "without any disturbance SC drives t.h away: from 1.16 it leaves C",
            "publishes `pump` with the other sign",
        ),
        (
            ((HOLD, "clamp(0.5 * (2.5 - level), -0.1, 0.1)"), WEAK[0]),
            "without any disturbance SC comes to rest outside of C, at t.h = 2.5",
            "comes to rest where `safe` holds",
        ),
    ],
)
def test_the_advice_is_about_sc(changes: tuple[tuple[str, str], ...], said: str, hint: str) -> None:
    p2a = explained(changed(*changes, *COARSE)).findings["P2a"]
    assert [c.kind for c in p2a.causes] == ["habit"]
    assert said in p2a.causes[0].text
    assert hint in p2a.hint
    assert not [t for t in p2a.tried if "half as wide" in t or "max_age" in t]


def test_an_sc_that_is_too_weak_has_no_habit_and_hears_no_advice_that_failed() -> None:
    """Half of the leak is still too much for it: that was tried, and is not advised again."""
    p2a = explained(changed(*WEAK, *COARSE)).findings["P2a"]
    assert [c.kind for c in p2a.causes] == ["leaves"]
    assert any(t.startswith("in vain: ") and "half as wide" in t for t in p2a.tried)
    assert "a sixteenth as wide; and more cells" in p2a.hint
    assert "smaller errors" not in p2a.hint


def test_what_was_in_vain_alone_is_not_told_as_untried(monkeypatch: pytest.MonkeyPatch) -> None:
    """One more change helps, and then there is no time: each line names what the other does not."""
    problem = problem_of(TANK)
    ages, half = replace(problem), replace(problem)
    answers = {id(problem): None, id(ages): ("safer",), id(half): ("ttf", "safer")}

    class Trials:
        calls = 0

        def failing_claims(self, tried: Problem) -> tuple[str, ...] | None:
            self.calls += 1
            return answers[id(tried)] if self.calls <= 2 else None

        def go_on(self) -> bool:
            return self.calls <= 2

    trials = Trials()
    monkeypatch.setattr(
        tried_remedies,
        "remedies",
        lambda found: [
            Remedy("A", half, 0),
            *([Remedy("B", ages, 1)] if found.problem is problem else []),
        ],
    )
    monkeypatch.setattr(tried_remedies, "coarser_problem", lambda tried, _: tried)
    helped = tried_remedies._KeptChanges(NotProved(problem, ("ttf", "safer"), (), None))
    while helped.try_one_more(trials):  # type: ignore[arg-type]
        pass
    assert helped.advice == ["B"]
    assert (list(helped.in_vain), list(helped.untried)) == (["A"], [])


def test_where_all_that_is_suggested_was_in_vain_the_search_is_named() -> None:
    result = explained(TANK)
    result.findings["P2a"].hint = "smaller errors"
    kept = tried_remedies._KeptChanges(NotProved(problem_of(TANK), ("P2a",), (), None))
    kept.in_vain[tried_remedies.CALMEST] = None
    kept.enter(result, ("P2a",))
    assert result.findings["P2a"].hint == tried_remedies.OTHERS_FOUND


def test_a_refutation_is_told_before_anything_is_tried() -> None:
    """And what is told of the trials is what is tried, not the claims of the changed problem."""
    told: list[str] = []
    bold = changed(
        BOLD,
        ("safer level > 0.4 && level < 1.6", "safer level > 0.22 && level < 1.6"),
    )
    with listening_to_phases(lambda name, _: told.append(name), told.append):
        result = verify_module(problem_of(bold), refute=True)
    assert result.findings["ttf"].verdict == "refuted"
    (at,) = [k for k, line in enumerate(told) if "SafeTank is REFUTED (P3, ttf)" in line]
    assert not [line for line in told[:at] if "trying" in line]
    assert [line for line in told[at + 1 :] if "trying" in line]
    assert not [line for line in told[at + 1 :] if line.endswith((": P2a", ": P3", ": ttf"))]


def test_a_ttf_that_a_run_refutes_hears_how_far_it_has_to_look_ahead() -> None:
    result = verify_module(problem_of(changed(BOLD)), refute=True)
    assert [n for n, f in result.findings.items() if not f.holds] == ["P3", "ttf"]
    for name in ("P3", "ttf"):
        found = result.findings[name]
        assert found.verdict == "refuted"
        assert "H = 200 ms (the age of what the DM reads 100 ms, the period of the DM 100 ms)" in (
            found.hint
        )


def test_nothing_is_tried_for_an_sc_that_a_run_refutes() -> None:
    told: list[str] = []
    with listening_to_phases(lambda name, _: told.append(name)):
        result = verify_module(problem_of(changed(*WEAK, *COARSE)), refute=True)
    p2a = result.findings["P2a"]
    assert p2a.verdict == "refuted"
    assert not [line for line in told if "trying" in line and "ac Hold" not in line]
    assert not [t for t in p2a.tried if CALMER.format("") in t]
