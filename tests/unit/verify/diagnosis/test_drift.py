"""A state that only goes one way, whatever SC does: said with its end and its rate."""

from __future__ import annotations

import numpy as np
import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import (
    HIGH,
    LOW,
    cause,
    changed,
    check_run,
    explained,
    kinds,
    soonest,
)


@pytest.fixture(scope="module")
def draining() -> ModuleResult:
    return explained(changed(("[0.0, 0.02]", "[0.15, 0.2]")))


def test_it_is_told_first_with_the_end_by_which_it_leaves(draining: ModuleResult) -> None:
    finding = draining.findings["P2a"]
    assert finding.text == "K is empty: the flow leaves C whatever SC does"
    assert finding.causes[0].kind == "drift_of_all"
    numbers = dict(finding.causes[0].numbers)
    assert numbers["end"] == pytest.approx(LOW, abs=0.006)  # a cell


def test_no_command_and_no_disturbance_is_slower_than_it_says(draining: ModuleResult) -> None:
    rate = dict(cause(draining, "P2a", "drift_of_all").numbers)["rate"]
    chance = np.random.default_rng(1)
    rates = chance.uniform(-0.1, 0.1, 10_000) - chance.uniform(0.15, 0.2, 10_000)
    assert rates.max() <= rate < 0.0
    assert rate == pytest.approx(0.1 - 0.15, abs=1e-9)  # and the fastest pump reaches it


def test_strength_is_not_looked_at(draining: ModuleResult) -> None:
    assert not {"strength", "weak"} & set(kinds(draining, "P2a"))


def test_the_run_is_one_of_the_tank_and_as_soon_as_brute_force_finds(
    draining: ModuleResult,
) -> None:
    run = draining.findings["P2a"].leaving
    assert run is not None
    assert run.safe
    assert (run.axis, run.side) == ("t.h", -1)
    check_run(run, (0.15, 0.2), 0.01, 1.0)
    assert not LOW < run.states[-1][0] < HIGH
    fastest = soonest(1.0, 0.2, 0.01)
    assert run.time_s[-1] <= fastest + 0.11  # the age of what SC reads makes it no later
    assert run.time_s[-1] >= (1.0 - LOW) / 0.3  # nothing falls faster than this


def test_a_state_that_can_be_held_is_no_drift() -> None:
    module_result = explained(changed(("[0.0, 0.02]", "[0.0, 0.104]")))
    assert "drift_of_all" not in kinds(module_result, "P2a")
    assert module_result.findings["P2a"].verdict == "undecided"
