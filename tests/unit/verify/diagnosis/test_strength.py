"""How much less would have to stand against SC: the bisection agrees with programs that say so."""

from __future__ import annotations

import pytest

from soter.verify import verify_module
from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import cause, changed, check_run, explained, soonest

LEAK = 0.104


@pytest.fixture(scope="module")
def weak() -> ModuleResult:
    return explained(changed(("[0.0, 0.02]", f"[0.0, {LEAK}]")))


def scaled(p: float) -> str:
    """The program with a part p of leak (about its middle), error and age."""
    low, high = LEAK / 2 * (1 - p), LEAK / 2 * (1 + p)
    return changed(
        ("[0.0, 0.02]", f"[{low!r}, {high!r}]"),
        ("within 0.01", f"within {0.01 * p!r}"),
        ("max_age 100ms", f"max_age {round(100_000_000 * p)}ns"),
    )


@pytest.mark.long
def test_sc_keeps_a_set_with_that_part_and_none_with_the_next(
    weak: ModuleResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the declared grid, which is the one that was measured on."""
    monkeypatch.setattr(verify_module, "REFINEMENTS_MAX", 0)
    strength_cause = cause(weak, "P2a", "strength")
    numbers = dict(strength_cause.numbers)
    assert 0.8 < numbers["part"] < numbers["fails_at"] <= 1.0
    fine, bad = (explained(scaled(numbers[k])) for k in ("part", "fails_at"))
    assert fine.findings["P2a"].verdict == "proved"
    assert bad.findings["P2a"].verdict == "undecided"
    (part,) = fine.cases[0].groups
    share = (part.core > 0).sum() / part.allowed.sum()
    assert share == pytest.approx(numbers["share_of_C"], abs=1e-9)


def test_the_tank_itself_agrees_about_which_is_too_much(weak: ModuleResult) -> None:
    numbers = dict(cause(weak, "P2a", "strength").numbers)
    kept, lost = (LEAK / 2 * (1 + numbers[k]) for k in ("part", "fails_at"))
    assert soonest(1.0, kept, 0.01 * numbers["part"]) == float("inf")
    assert kept < 0.1 < LEAK  # the pump gives 0.1
    assert soonest(1.0, LEAK, 0.01) < 300.0
    assert lost > kept


def test_the_run_that_is_shown_is_one_of_the_tank(weak: ModuleResult) -> None:
    run = weak.findings["P2a"].leaving
    assert run is not None
    check_run(run, (0.0, LEAK), 0.01, 1.0)
    assert run.states[-1][0] < 0.2 <= run.states[-2][0]


def test_what_alone_would_be_enough_is_told(weak: ModuleResult) -> None:
    text = cause(weak, "P2a", "strength").text
    assert "without disturbances" in text
    assert "without errors" not in text
