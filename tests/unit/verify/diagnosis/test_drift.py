"""The run that is shown where SC keeps nothing is one of the tank, and as soon as can be."""

from __future__ import annotations

import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import HIGH, LOW, cause, changed, check_run, explained
from unit.verify.diagnosis.tank_modules import soonest as soonest_of

LEAK = 0.104
"""More than the pump gives."""


@pytest.fixture(scope="module")
def draining() -> ModuleResult:
    return explained(changed(("[0.0, 0.02]", "[0.15, 0.2]")))


@pytest.fixture(scope="module")
def weak() -> ModuleResult:
    return explained(changed(("[0.0, 0.02]", f"[0.0, {LEAK}]")))


def test_it_is_said_that_a_run_leaves_safe_and_when_without_any_disturbance(
    draining: ModuleResult,
) -> None:
    finding = draining.findings["P2a"]
    assert finding.text == "K is empty: under SC a run of the model leaves `safe`"
    assert [c.kind for c in finding.causes] == ["leaves"]
    alone = soonest_of(1.0, 0.175, 0.0)  # in the middle of what leaks
    assert finding.leaving is not None
    told = float(finding.causes[0].text.partition("or delay after ")[2].split()[0])
    assert finding.leaving.time_s[-1] <= told == pytest.approx(alone, abs=0.11)


def test_the_run_is_one_of_the_tank_and_as_soon_as_brute_force_finds(
    draining: ModuleResult,
) -> None:
    run = draining.findings["P2a"].leaving
    assert run is not None
    assert run.safe
    assert (run.axis, run.side) == ("t.h", -1)
    check_run(run, (0.15, 0.2), 0.01, 1.0)
    assert not LOW < run.states[-1][0] < HIGH
    fastest = soonest_of(1.0, 0.2, 0.01)
    assert run.time_s[-1] <= fastest + 0.11  # the age of what SC reads makes it no later
    assert run.time_s[-1] >= (1.0 - LOW) / 0.3  # nothing falls faster than this


def test_what_only_a_disturbance_does_is_not_said_of_the_undisturbed_run(
    weak: ModuleResult,
) -> None:
    assert "without any" not in cause(weak, "P2a", "leaves").text
    run = weak.findings["P2a"].leaving
    assert run is not None
    check_run(run, (0.0, LEAK), 0.01, 1.0)
    assert run.states[-1][0] < 0.2 <= run.states[-2][0]


def test_a_quarter_of_what_stands_against_sc_is_tried_and_is_what_it_says(
    weak: ModuleResult,
) -> None:
    """So it is told from an SC that keeps nothing anyway."""
    hint = weak.findings["P2a"].hint
    assert hint == "disturbances and errors a quarter as wide (tried: every claim is proved)"
    leak = f"[{LEAK * 3 / 8}, {LEAK * 5 / 8}]"
    quarter = changed(("[0.0, 0.02]", leak), ("within 0.01", "within 0.0025"))
    assert explained(quarter).verdict == "proved"


def test_an_sc_that_keeps_nothing_anyway_is_not_said_to_with_half(draining: ModuleResult) -> None:
    finding = draining.findings["P2a"]
    assert any(t.startswith("in vain: ") and "half as wide" in t for t in finding.tried)
    assert finding.hint.endswith("(not tried)")
