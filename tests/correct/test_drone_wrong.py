"""Wrong drones are not proved, and flights that the interpreter repeats show why; the right one is.

The whole list, with all verdicts: `python bench/drone/wrong_stacks.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.drone.wrong_base import ASSUMED, WRONG, flown, flown_again, laid_out, refuted, verdict
from bench.drone.wrong_stacks import CHANGES, examine

if TYPE_CHECKING:
    from pathlib import Path

    from bench.drone.wrong_base import Wrong

NAMED = {(w.kind, w.name): w for w in (*WRONG, *ASSUMED)}
RESERVE, LETS_GO = NAMED["battery", "no reserve"], NAMED["motion", "SC lets go"]


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(RESERVE, id=RESERVE.name),
        pytest.param(LETS_GO, id=LETS_GO.name, marks=pytest.mark.long),
    ],
)
@pytest.mark.long
def test_a_wrong_stack_is_not_proved_and_a_flight_shows_why(wrong: Wrong) -> None:
    row = examine(wrong)
    assert not row.verdict.proved
    assert row.refuted
    assert "<== PROVED" not in " ".join(row.cells())


@pytest.mark.long
def test_the_unbroken_stack_is_proved_and_flies_on_in_the_same_worlds(tmp_path: Path) -> None:
    """Or the function never says proved, or the worlds are none that may be."""
    assert verdict(laid_out(tmp_path / "whole", ()), RESERVE.verify).proved
    assert refuted(tmp_path / "battery", (), RESERVE.worlds[:1]) is None
    assert refuted(tmp_path / "motion", (), LETS_GO.worlds[:1]) is None


@pytest.mark.long
def test_a_stack_that_breaks_an_assumption_is_proved_and_says_so() -> None:
    """The bench sees a wrong *proved*; what is broken has to be among what the verdict prints."""
    row = examine(NAMED["assumed", "cost forgotten"])
    assert row.verdict.proved
    assert row.refuted
    assert "behaves like" in row.named


@pytest.mark.long
def test_a_flight_of_another_seed_repeats_nothing(tmp_path: Path) -> None:
    (world, *_) = RESERVE.worlds
    tree = laid_out(tmp_path, (*RESERVE.edits, *world.narrowed))
    violation = flown(tree, world)
    assert violation is not None
    seed, what, at_s = violation
    assert flown_again(tree, world, seed, what, at_s)
    assert not flown_again(tree, world, seed, what, at_s - 1.0)
    assert not flown_again(tree, world, seed, "another property", at_s)


def test_every_change_is_one_of_the_sources_as_they_are(tmp_path: Path) -> None:
    assert len(WRONG) >= CHANGES
    for k, wrong in enumerate((*WRONG, *ASSUMED)):
        laid_out(tmp_path / str(k), wrong.edits)
