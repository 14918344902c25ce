"""Other vehicles among moving things: nobody is touched by one that moves.

Purpose: `examples/exploration/wheels.soter` is proved, and somebody else agrees; those who mean
to be hit are not, by a vehicle that moves; one that does not switch hits them; and what is
simulated does as the plant of the proof may.
Non-goals: wrong modules (`unit/verify/claims/test_passive_vehicles.py`); `people.soter`.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "exploration"
KINDS = ("Hunting", "Luring", "Strolling")
SEEDS = range(1, 6)
NOT_ASKED = {"P2b"}
"""`recover never`."""


def verdicts_of(file: str, cert: Path) -> dict[str, str]:
    """What was said of each claim of `Passive` in a file, re-checked."""
    report = soter.load(FOLDER / file).verify(refute=False, cert=cert)
    again = soter.recheck(cert)
    assert again.accepted, again.reason
    return {name: f.verdict for name, f in report["Passive"].findings.items()}


def test_wheels_are_proved_with_their_fail_safe_law_and_somebody_else_agrees(
    tmp_path: Path,
) -> None:
    verdicts = verdicts_of("wheels.soter", tmp_path / "cert")
    assert {name for name, v in verdicts.items() if v != "proved"} == NOT_ASKED


@pytest.mark.parametrize("kind", KINDS)
def test_nobody_is_hit_by_wheels_that_move(kind: str) -> None:
    program = soter.load(FOLDER / "wheels.soter")
    for seed in SEEDS:
        run = program.simulate(system="Hunted", seed=seed, params={"walkers.KIND": kind})
        assert run.violations == 0, run.violation_list
        assert run.modules["Passive"].switches_to_sc > 2


@pytest.mark.parametrize("kind", KINDS)
def test_people_are_hit_by_wheels_where_nobody_switches(kind: str) -> None:
    program = soter.load(FOLDER / "wheels.soter")
    runs = [
        program.simulate(system="Bare", seed=seed, params={"walkers.KIND": kind}) for seed in SEEDS
    ]
    assert sum(run.violations for run in runs) > 0


SHARES = st.floats(0.8, 1.2)


@given(SHARES, SHARES, st.floats(-3.0, 3.0))
def test_a_base_of_any_lag_and_strength_is_one_of_the_proof(
    gain: float, most: float, off: float
) -> None:
    """`grip` of `wheels.soter`: the rate is between 0.8 and 1.2 times that of the nominal base."""
    nominal = min(max(6.0 * off, -2.0), 2.0)
    rate = min(max(gain * 6.0 * off, -most * 2.0), most * 2.0)
    low, high = sorted((0.8 * nominal, 1.2 * nominal))
    assert low - 1e-12 <= rate <= high + 1e-12
