"""Thinning keeps what matters; splitting by controller leaves no gaps."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.report.run.figure_parts import (
    POINTS_MAX,
    event_place,
    flight_indices,
    mode_edges,
    mode_stretches,
    nearest_indices,
    rows_flown_by,
    thinned_indices,
)
from soter.report.run.record import Decision, Violation

if TYPE_CHECKING:
    from soter.report.run.record import Flight

MODES = st.lists(st.booleans(), min_size=1, max_size=60).map(np.asarray)


def test_runs_hold_until_the_next_sample() -> None:
    assert mode_stretches(np.asarray([False, False, True, True, False])) == [
        (0, 2, False),
        (2, 4, True),
        (4, 4, False),
    ]


@given(MODES)
def test_runs_cover_everything_once(modes: np.ndarray) -> None:
    mode_runs = mode_stretches(modes)
    assert mode_runs[0][0] == 0
    assert mode_runs[-1][1] == len(modes) - 1
    for (_, last, before), (first, _, after) in pairwise(mode_runs):
        assert last == first
        assert before is not after


@given(MODES)
def test_the_parts_of_both_controllers_make_up_the_whole_line(modes: np.ndarray) -> None:
    rows = np.arange(len(modes), dtype=np.float64)[:, None]
    pieces = set()
    for ac in (True, False):
        part = rows_flown_by(rows, modes, ac=ac)[:, 0]
        for a, b in pairwise(part.tolist()):
            if not np.isnan([a, b]).any():
                pieces.add((a, b))
                assert bool(modes[int(a)]) is ac
    assert pieces == {(i, i + 1) for i in range(len(modes) - 1)}


@given(
    st.integers(1, 5000),
    st.lists(st.integers(0, 4999), max_size=40),
    st.integers(60, 500),
)
def test_thinning_keeps_ends_and_what_it_was_told_to(
    count: int, keep: list[int], points_max: int
) -> None:
    dips = np.sin(np.arange(count) / 7.0)
    chosen = thinned_indices(count, keep, dips, points_max).tolist()
    assert chosen == sorted(set(chosen))
    assert len(chosen) <= points_max
    assert {0, count - 1} <= set(chosen)
    assert {index for index in keep if index < count} <= set(chosen)


def test_thinning_keeps_the_lowest_clearance() -> None:
    dips = np.ones(100_000)
    dips[[31_337, 77_777]] = 0.01, 0.02
    assert {31_337, 77_777} <= set(thinned_indices(100_000, [], dips).tolist())


def test_events_are_kept_even_beyond_the_limit() -> None:
    assert set(range(0, 4000, 2)) <= set(
        thinned_indices(10_000, range(0, 4000, 2), None, 100).tolist()
    )


def test_a_long_flight_keeps_every_decision_and_violation(protected: Flight) -> None:
    count = 60_000
    time_s = np.linspace(0.0, 300.0, count)
    modes = np.ones(count, dtype=bool)
    modes[20_001:20_004] = False
    long = dataclasses.replace(
        protected,
        time_s=time_s,
        position=np.zeros((count, 3)),
        in_control=modes,
        clearance_m=np.ones(count),
        speed=np.ones(count),
        decisions=(Decision(float(time_s[20_001]), "M", "SC"),),
        violations=(Violation(float(time_s[54_321]), "x"),),
    )
    chosen = set(flight_indices(long).tolist())
    assert len(chosen) <= POINTS_MAX
    assert {20_000, 20_001, 20_003, 20_004, 54_321} <= chosen
    assert set(mode_edges(modes)) == {20_000, 20_001, 20_003, 20_004}


def test_nearest_is_the_sample_not_after() -> None:
    time_s = np.asarray([0.0, 0.1, 0.2])
    assert nearest_indices(time_s, [-1.0, 0.0, 0.15, 0.2, 9.0]) == [0, 0, 1, 2, 2]


def test_an_event_without_a_place_is_found_on_the_flight(protected: Flight) -> None:
    time_s = float(protected.time_s[100])
    assert event_place(protected, time_s, None) == pytest.approx(protected.position[100])
    assert event_place(protected, time_s, (1, 2, 3)) == (1, 2, 3)
