"""Some of the bugs of bench/testing/mutants.py: found, by a least trace, replayed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.testing import mutants as bench
from bench.testing.mutant_models import CONTINUOUS, HARMLESS, MUTANTS, Mutant, Subject

import soter
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

QUICKEST = (
    ("planner", "plan adopted at once", "guarantees PhiPlan(inForce) in Follower"),
    ("planner", "lost mode: AC is never left", "guarantees PhiPlan(inForce) in Follower"),
    ("queue", "queue overflow", "report == Report.LowBattery leadsto landing within 30ms"),
    ("queue", "queue overflow is a fault", "no step of Recorder faults"),
    ("gate", "SC outside its set", "no step of Keeper.Home faults"),
    ("takeover", "no hysteresis", "always abs(robot.truth.at) <= END"),
    ("repaired", "SC slower than Δ - J", "invariant(Protection)"),
)
EVERY = (*MUTANTS, *CONTINUOUS, *HARMLESS)


def seeded(file: str, kind: str) -> Mutant:
    (mutant,) = [m for m in MUTANTS if file in m.subject.file and m.kind == kind]
    return mutant


@pytest.mark.parametrize(("file", "kind", "violated"), QUICKEST)
def test_a_seeded_bug_is_found_by_a_least_trace(file: str, kind: str, violated: str) -> None:
    row = bench.examine(seeded(file, kind), bench.BRUTE)
    assert row.found
    assert row.violated == violated
    assert row.replayed
    assert row.minimal
    assert row.steps == row.shortest == row.brute


def test_a_change_that_harms_nothing_counts_as_not_found() -> None:
    (m,) = [m for m in HARMLESS if m.kind == "SC proposes a bad plan"]
    row = bench.examine(m, 0)
    assert row.verdict == "exhausted"
    assert not row.found
    assert not row.minimal


def test_a_trace_that_is_longer_than_need_be_is_not_minimal() -> None:
    row = bench.Row("f", "T", "", "violated", steps=9, claims_minimal=True, shortest=9, brute=9)
    assert row.minimal
    row.brute = 8
    assert not row.minimal
    row.brute, row.shortest = None, 8
    assert not row.minimal


def test_an_example_that_is_violated_as_shipped_is_no_subject() -> None:
    subject = Subject("testing/late_sc.soter", "Late")
    m = Mutant(subject, "", "const LOOK: int = 6", "const LOOK: int = 5")
    assert bench.examine(m, 0).verdict == "NOT CLEAN AS SHIPPED"


@all_rows("m", EVERY, ids=lambda m: f"{m.subject.test}: {m.kind}")
def test_every_seeded_bug_changes_a_program_into_a_program(m: Mutant, tmp_path: Path) -> None:
    file = bench.changed(m, tmp_path)
    assert soter.load(file).ok


def test_enough_bugs_in_enough_examples() -> None:
    assert len(MUTANTS) >= bench.ENOUGH
    assert len({m.subject.file for m in MUTANTS}) >= 7
    assert len({(m.subject, m.old, m.new) for m in EVERY}) == len(EVERY)
