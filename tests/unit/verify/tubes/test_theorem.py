"""The theorem of docs/proof-flight.md, "Decisions by tubes", on all executions of small modules."""

from __future__ import annotations

import random
from dataclasses import fields, replace
from typing import TYPE_CHECKING

import pytest

from generators.schedule_systems import _drawn
from tables import all_rows
from unit.verify.tubes.executions import Mode
from unit.verify.tubes.fallback_runs import Check, Times
from unit.verify.tubes.judged_commands import Judge, JudgedExecutions
from unit.verify.tubes.naive_variants import REFUSED, SAFE, VARIANTS, VIOLATED
from unit.verify.tubes.small_systems import drawn, off

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from unit.verify.tubes.fallback_runs import Hold, Past

SHARP = (
    (2894, "alpha", 1),  # H - delta - j is its larger part
    (3926, "alpha", 1),  # Delta - J_dm + L_min is
    (9, "horizon", -1),
    (33860, "delay", -1),
    (770, "jitter", -1),
)
"""Numbers of modules in which one time that is a tick off lets an execution be unsafe."""

APART = (89, 325, 642, 1204, 1900, 2315, 2542, 3264, 3621, 3635)
"""Numbers of modules with two components that begin to act one after the other."""

STILL_GOOD = {
    "rest_entered_from_outside",
    "start_by_the_state_alone",
    "read_of_before_the_estimate",
}
"""Variants in which AC goes on flying, by the conditions of the page."""


class Together(Check):
    """Wrong: the components of an output begin to act at one instant."""

    def instants(self, now: Hold, p: Past) -> Iterator[tuple[Hold | None, bool]]:
        for after, complete in super().instants(now, p):
            if after is None or after.begun is None:
                yield after, complete


def holds(numbers: Iterable[int], maps: int = 1, parts: int = 1) -> int:
    """No execution of any of these modules is unsafe; in how many both fly, with each map."""
    switched = 0
    for number in numbers:
        if (got := drawn(number, maps, parts)) is not None:
            module, starts = got
            unsafe, modes = module.violated(starts)
            assert not unsafe, number
            switched += {Mode(ac, m) for ac in (False, True) for m in range(maps)} <= modes
    return switched


def test_no_execution_of_small_modules_is_unsafe() -> None:
    assert holds(range(800)) > 30


def test_no_execution_is_unsafe_where_two_components_begin_apart() -> None:
    assert holds(APART, parts=2) == len(APART)


def test_components_that_are_taken_to_begin_together_are_seen_to_be_unsafe() -> None:
    got = drawn(3635, parts=2)
    assert got is not None
    module, _ = got
    of = {f.name: getattr(module.checks[0], f.name) for f in fields(Check) if f.init}
    wrong = Together(**of)
    wrong = replace(wrong, rest=frozenset(x for x in wrong.safe if wrong.keeps(x)))
    starts = {x for x in wrong.safe if wrong.starts_well(x)}
    assert replace(module, checks=(wrong,)).violated(starts)[0]


def test_answers_that_stand_still_move_the_plant_where_their_components_begin_apart() -> None:
    """The second rule of rest asks of each component what SC may answer, not of whole answers."""
    times = Times((2, 0, 0, 0), (2, 0, 0, 0), most=1)
    still = ((1, -1), (-1, 1))
    given = (lambda _: still, frozenset(range(-9, 10)), frozenset[int](), still, (0,), (0,), 9)
    assert Together(*given, **times.derived()).keeps(0)
    assert not Check(*given, **times.derived()).keeps(0)


def test_the_constraint_of_the_last_map_holds_where_maps_change() -> None:
    assert holds(range(500), maps=2) > 15


@pytest.mark.long
@pytest.mark.parametrize(
    ("maps", "parts", "last", "least"), [(1, 1, 12_000, 300), (2, 1, 8_000, 150), (1, 2, 5_000, 5)]
)
def test_no_execution_of_many_small_modules_is_unsafe(
    maps: int, parts: int, last: int, least: int
) -> None:
    assert holds(range(1000, last), maps, parts) > least


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


@all_rows("name", VARIANTS)
def test_a_naive_variant_is_unsafe_and_the_conditions_exclude_it(name: str) -> None:
    naive, by_the_page = VARIANTS[name]()
    assert naive == VIOLATED
    assert by_the_page == (SAFE if name in STILL_GOOD else REFUSED)


def test_a_step_of_sc_is_out_before_the_next_one_is_due() -> None:
    """By R015 and R018: what SC began before a look cannot pass after the next one."""
    with_nodes, waits_longer, otherwise = 0, 0, 0
    for number in range(4000):
        s = _drawn(random.Random(number))  # noqa: S311
        if s.sc.period > s.dm.period or any(
            o.skipping_node(s.sc, s.latest_output) is not None for o in s.outputs
        ):
            continue
        if s.are_windows_short:
            assert s.latest_output <= s.sc.period, number
            with_nodes += any(o.nodes for o in s.outputs)
            waits_longer += s.latest_output > s.jitter
        else:
            otherwise += s.latest_output > s.sc.period
    assert min(with_nodes, waits_longer, otherwise) > 0


NAIVE = {"looks_only": (185, 410, 1294), "earliest": (410, 1023, 2503)}
"""Of each wrong gate, numbers of modules that are unsafe with it."""


def judged(number: int) -> tuple[JudgedExecutions, set[int]] | None:
    """A drawn module with a gate; W is H* less A, Delta and L_min."""
    if (got := drawn(number)) is None:
        return None
    module, starts = got
    t, check = module.times, module.checks[0]
    any_for = check.horizon - t.age - t.dm[0] - t.least
    return JudgedExecutions(t, module.checks, judge=Judge(check, any_for)), starts


def test_no_execution_with_a_gate_is_unsafe() -> None:
    flown = 0
    for number in range(300):
        if (got := judged(number)) is not None:
            module, starts = got
            unsafe, modes = module.violated(starts)
            assert not unsafe, number
            flown += {Mode(True), Mode(False)} <= modes
    assert flown > 10


@pytest.mark.parametrize(("kind", "number"), [(k, n) for k, ns in NAIVE.items() for n in ns])
def test_a_naive_gate_is_seen_to_be_unsafe(kind: str, number: int) -> None:
    """It judges at looks alone; or it goes by alpha, which is of looks, for what AC publishes."""
    got = judged(number)
    assert got is not None
    module, starts = got
    assert module.judge is not None
    if kind == "looks_only":
        wrong = replace(module, looks_only=True)
    else:
        late = replace(module.judge, earliest=module.checks[0].alpha)
        wrong = replace(module, judge=late)
    assert wrong.violated(starts)[0]
    assert not module.violated(starts)[0]


def test_a_judge_permits_what_the_check_of_any_command_does_not() -> None:
    """And nothing less: what is good with any command is good with each."""
    more = 0
    for number in range(300):
        if (got := judged(number)) is None:
            continue
        module, _ = got
        check, judge = module.checks[0], module.judge
        assert judge is not None
        every = replace(check, alpha=0)
        for x in check.safe:
            each = [judge.good(x, frozenset(u)) for u in check.commands]
            assert all(each) or not every.good(x)
            more += any(each) and not check.good(x)
    assert more > 0
