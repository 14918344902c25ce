"""`examples/arm`: proved, accepted, deployed without a warning; what its policy is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.api import Program

ARM = Path(__file__).resolve().parents[3] / "examples" / "arm" / "arm.soter"


def test_its_rest_is_proved_and_its_robot_is_checked_without_a_warning() -> None:
    program = Program(str(ARM))
    (module,) = program.verify(refute=False).modules
    assert {module.findings[n].verdict for n in ("P2a", "start")} == {"proved"}
    assert module.not_rechecked == ""
    assert program.check().warnings == ()


@pytest.mark.parametrize(("choices", "flown"), [(3, {-1, 0, 1, 2}), (1, {-1, 0, 3})])
def test_the_policy_is_told_which_candidate_acts(choices: int, flown: set[int]) -> None:
    """A second and a third candidate fly where there are any; SC's command where there is one."""
    run = Program(str(ARM)).simulate("Played", seed=3, params={"CHOICES": choices})
    assert run.violations == 0
    assert set(run.array("cell.told.acts").astype(int).tolist()) == flown
    assert run.modules["cell.Separation"].gate_faults > 0
