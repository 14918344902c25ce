"""The theorem of docs/proof.md, "Decisions by tubes", on all executions of small modules."""

from __future__ import annotations

import pytest

from unit.verify.tubes.executions import Mode
from unit.verify.tubes.naive_variants import REFUSED, SAFE, VARIANTS, VIOLATED
from unit.verify.tubes.small_systems import drawn, off

SHARP = (
    (2894, "alpha", 1),  # H - delta - j is its larger part
    (3926, "alpha", 1),  # Delta - J_dm + L_min is
    (9, "horizon", -1),
    (33860, "delay", -1),
    (770, "jitter", -1),
)
"""Numbers of modules in which one time that is a tick off lets an execution be unsafe."""

STILL_GOOD = {
    "rest_entered_from_outside",
    "start_by_the_state_alone",
    "read_of_before_the_estimate",
}
"""Variants in which AC goes on flying, by the conditions of the page."""


def holds(numbers: range, maps: int) -> int:
    """No execution of any of these modules is unsafe; in how many both fly, with each map."""
    switched = 0
    for number in numbers:
        if (got := drawn(number, maps)) is not None:
            module, starts = got
            unsafe, modes = module.violated(starts)
            assert not unsafe, number
            switched += {Mode(ac, m) for ac in (False, True) for m in range(maps)} <= modes
    return switched


def test_no_execution_of_small_modules_is_unsafe() -> None:
    assert holds(range(1000), maps=1) > 40


def test_the_constraint_of_the_last_map_holds_where_maps_change() -> None:
    assert holds(range(1000), maps=2) > 10


@pytest.mark.long
@pytest.mark.parametrize("maps", [1, 2])
def test_no_execution_of_many_small_modules_is_unsafe(maps: int) -> None:
    assert holds(range(1000, 12_000), maps) > 100


@pytest.mark.parametrize(("number", "time", "by"), SHARP)
def test_a_time_that_is_a_tick_off_is_seen_to_be_unsafe(number: int, time: str, by: int) -> None:
    got = drawn(number)
    assert got is not None
    module, starts = got
    assert not module.violated(starts)[0]
    wrong = off(module, time, by)
    assert wrong is not None
    assert wrong.violated(starts)[0]


def test_the_recorded_modules_of_alpha_have_either_part_larger() -> None:
    larger = []
    for number in (2894, 3926):
        got = drawn(number)
        assert got is not None
        t = got[0].times
        d = t.derived()
        parts = (t.dm[0] - t.dm[2] + t.least, d["horizon"] - d["delta"] - d["jitter"] + 1)
        assert d["alpha"] == max(parts)
        larger.append(parts[0] - parts[1])
    assert larger == [-1, 1]


@pytest.mark.parametrize("name", VARIANTS)
def test_a_naive_variant_is_unsafe_and_the_conditions_exclude_it(name: str) -> None:
    naive, by_the_page = VARIANTS[name]()
    assert naive == VIOLATED
    assert by_the_page == (SAFE if name in STILL_GOOD else REFUSED)
