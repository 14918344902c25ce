"""Sets of random linear modules against an adversary who times everything; holes are found."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from long_tests import some
from soter.verify.polytope import linear_group as polytope_model
from soter.verify.polytope.matrices import exact, up_product
from soter.verify.polytope.proofs import Claims, Windows, find_core, prove_core
from unit.verify.polytope.polytope_adversary import MS, Attack, random_group

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.verify.polytope.linear_group import LinearGroup
    from soter.verify.polytope.matrices import Array
    from soter.verify.polytope.proofs import PolytopeSets

pytest.importorskip("highspy")

WINDOWS = Windows(60 * MS, 50 * MS, 3)
TIMES = ((0, 0), (10, 0), (10, 4), (30, 2), (2, 7), (7, 7))
"""d and j in ms."""
RUNS, PERIODS = 200, 14
ROOM = 1e-7
"""Rounding of LP vertices."""


def module(seed: int, delay_ms: int, jitter_ms: int) -> LinearGroup:
    chance = np.random.default_rng(seed)
    return random_group(chance, delay_ms=delay_ms, jitter_ms=jitter_ms)


def kept(group: LinearGroup) -> PolytopeSets | None:
    sets = find_core(group, WINDOWS)
    if sets is not None:
        prove_core(sets, Claims())
    return sets


def exceeded(sets: PolytopeSets, seed: int = 0) -> float:
    """The largest excess over C, or over K at nominal times, for a_0 anywhere in its window."""
    chance = np.random.default_rng(seed)
    jitter = sets.group.jitter_ns // MS
    worst = -np.inf
    for lead in sorted({0, jitter // 2, jitter}):
        excess = Attack(sets.group, sets.core, RUNS, lead, chance).run(PERIODS)
        worst = max(worst, excess.constraint, excess.core)
    return worst


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("seed", some(range(3), 1))
def test_nobody_leaves_k_by_timing(seed: int, times: tuple[int, int]) -> None:
    sets = kept(module(seed, *times))
    assert sets is not None
    assert exceeded(sets, seed) <= ROOM


# ---------------------------------------------------------------- holes put back


def _only_errors(self: polytope_model.Hold) -> Array:
    return up_product(np.abs(self.group.gain), self.group.error)


READ = polytope_model.Hold._read_error
HOLES: dict[str, tuple[object, str, Callable[..., object], tuple[int, int], float]] = {
    "every read is d/2 old": (polytope_model.Hold, "_read_error", _only_errors, (30, 0), 0.1),
    "reads are exact": (
        polytope_model.Hold,
        "_read_error",
        lambda self: READ(self) - _only_errors(self),
        (0, 0),
        5.0,
    ),
    "nothing disturbs": (
        polytope_model.TimeGrid,
        "noise",
        lambda self, rows, _: np.zeros((len(self.times_ns), rows.mid.shape[0])),
        (0, 0),
        0.1,
    ),
}


@pytest.mark.parametrize("name", HOLES)
@pytest.mark.parametrize("seed", some([0, 4], 1))
def test_a_hole_put_back_by_hand_is_found(
    name: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    of, what, wrong, times, errors = HOLES[name]
    group = module(seed, *times)
    group = replace(group, error=group.error * errors)
    right = kept(group)
    assert right is not None
    assert exceeded(right, seed) <= ROOM
    monkeypatch.setattr(of, what, wrong)
    sets = kept(group)
    assert sets is not None
    assert exceeded(sets, seed) > 1e-3


def late(seed: int) -> LinearGroup:
    """SC acts late by up to 7 ms, on fresh reads, and little else happens."""
    group = module(seed, 1, 7)
    low, high = group.drift_low * 0.1, group.drift_high * 0.1
    return replace(group, error=group.error * 0.1, drift_low=low, drift_high=high)


@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.long
def test_an_sc_that_was_taken_to_be_in_time_is_found(seed: int) -> None:
    group = late(seed)
    right, wrong = kept(group), kept(replace(group, jitter_ns=0))
    assert right is not None
    assert wrong is not None
    assert exceeded(right, seed) <= ROOM
    assert exceeded(replace(wrong, group=group), seed) > 2e-4


# ---------------------------------------------------------------- bounds of one hold


def over_bound(sets: PolytopeSets, promised: LinearGroup, seed: int) -> float:
    """By how much states at the end of holds exceed what the hold before promised of rows."""
    group = sets.group
    chance = np.random.default_rng(seed)
    n = len(group.low)
    rows = np.concatenate([np.eye(n), -np.eye(n), chance.normal(size=(20, n))])
    row, loss = polytope_model.Hold(promised, sets.rate).after(exact(rows))
    worst = -np.inf
    for lead in (0, 3, 7):
        states = Attack(group, sets.core, RUNS, lead, chance).run(PERIODS).nominal
        for before, after in pairwise(states):
            worst = max(worst, float((after @ rows.T - before @ row.mid.T - loss).max()))
    return worst


@pytest.mark.parametrize("seed", [0, 4])
def test_the_end_of_a_hold_is_where_it_was_said_to_be(seed: int) -> None:
    group = late(seed)
    sets = kept(group)
    assert sets is not None
    assert over_bound(sets, group, seed) <= ROOM
    assert over_bound(sets, replace(group, jitter_ns=0), seed) > 2e-3, "the runs do try"
