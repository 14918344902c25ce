"""The model of time says no less than any schedule does, and no more than it must."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from bench.verify.time_model import BLIND

from generators.every_schedule import QUANTITIES
from generators.every_schedule_of_module import EverySchedule
from generators.one_schedule import OneSchedule
from generators.schedule_systems import Compared, compare, in_the_limit, multiple, said, system
from soter.verify.problem.problem import Times
from soter.verify.problem.problem_times import horizon_in_words
from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath
from tables import all_rows

SYSTEMS = 200
TEN = Releases(10)
SENSOR = SensorPath(TEN)
BASE = Schedule(TEN, TEN, (SENSOR,), (SENSOR,))


def _both(path: SensorPath) -> Schedule:
    return replace(BASE, read_by_dm=(path,), read_by_sc=(path,))


BY_HAND: dict[str, tuple[Schedule, dict[str, int]]] = {
    "everything at once: DM and SC read what sensors publish at that instant": (
        BASE,
        {
            "age_dm": 0,
            "age_sc": 0,
            "stamp_age_sc": 0,
            "latest_start_of_sc": 0,
            "h_star": 10,
            "delay": 0,
            "jitter": 0,
            "start": 0,
            "longest_between_states": 10,
        },
    ),
    "a sensor just after DM and SC": (
        _both(SensorPath(Releases(10, phase=1))),
        {"age_dm": 9, "age_sc": 9, "delay": 9, "h_star": 19, "start": 10},
    ),
    "SC waits for the verdict of DM": (
        replace(BASE, dm=Releases(10, late=2, response=3)),
        {
            "latest_start_of_sc": 5,
            "jitter": 5,
            "age_sc": 5,
            "delay": 5,
            "start": 5,
            "h_star": 17,
        },
    ),
    "SC waits for what is left of it": (
        replace(BASE, dm=Releases(10, late=2, response=3), sc=Releases(10, phase=4)),
        {"latest_start_of_sc": 1, "jitter": 1, "age_sc": 5, "start": 5},
    ),
    "SC due when the verdict has come": (
        replace(BASE, dm=Releases(10, late=2, response=3), sc=Releases(10, phase=5)),
        {"latest_start_of_sc": 0, "jitter": 0, "age_sc": 5, "start": 5},
    ),
    "lateness and waiting do not add up": (
        replace(BASE, dm=Releases(10, late=2, response=3), sc=Releases(10, late=4, response=1)),
        {"latest_start_of_sc": 5, "jitter": 6, "start": 6},
    ),
    "DM comes before a path node of the same instant": (
        _both(SensorPath(TEN, (TEN,))),
        {"age_dm": 10, "age_sc": 10, "start": 10, "h_star": 20, "stamp_age_sc": 10},
    ),
    "DM comes after a path node that ran before": (
        _both(SensorPath(TEN, (Releases(10, phase=9),))),
        {"age_dm": 10, "age_sc": 10, "stamp_age_sc": 1, "start": 10},
    ),
    "a publication at the instant of the read may be missed": (
        _both(SensorPath(TEN, (Releases(10, phase=5, response=5),))),
        {"age_dm": 20, "age_sc": 20, "start": 20},
    ),
    "a node ahead in the path at the same instant may be missed": (
        _both(SensorPath(TEN, (Releases(10, phase=5), Releases(10, phase=5)))),
        {"age_dm": 20, "age_sc": 20, "start": 20},
    ),
    "an enforced age is a stamp's, the state is older": (
        replace(
            BASE, read_by_dm=(SensorPath(TEN, (Releases(10, late=1, response=1),), max_age=3),)
        ),
        {"age_dm": 5, "h_star": 15},
    ),
    "an output before the verdict is dropped, the next one acts": (
        replace(BASE, dm=Releases(10, response=4), sc=Releases(10, phase=8, response=1)),
        {"h_star": 19, "latest_start_of_sc": 0, "jitter": 1},
    ),
    "an output that comes just before the verdict is dropped": (
        replace(BASE, dm=Releases(20), sc=Releases(20, phase=15, response=5)),
        {"h_star": 40},
    ),
    "a silent sensor": (replace(BASE, dropout=10), {"age_dm": 10, "delay": 10, "start": 10}),
    "an actuator node at the same instant may miss the output": (
        replace(BASE, outputs=(ActuationPath(nodes=(TEN,)),)),
        {"jitter": 10, "start": 10, "delay": 10, "h_star": 20},
    ),
    "outputs of different latencies share one window": (
        replace(BASE, outputs=(ActuationPath(0, 1), ActuationPath(2, 4))),
        {"jitter": 4, "start": 4, "delay": 4, "h_star": 14},
    ),
    "the older of two paths counts": (
        replace(BASE, read_by_dm=(SENSOR, SensorPath(Releases(10, phase=3)))),
        {"age_dm": 7, "age_sc": 0, "h_star": 17},
    ),
}


@all_rows("name", BY_HAND)
def test_a_corner_worked_out_by_hand(name: str) -> None:
    schedule, expected = BY_HAND[name]
    reached = EverySchedule(schedule).enumerate()
    assert {q: reached[q] for q in expected} == expected
    assert {q: said(schedule, q) for q in expected} == expected


@pytest.fixture(scope="module")
def compared() -> list[list[Compared]]:
    return [compare(system(k).schedule) for k in range(SYSTEMS)]


def test_no_schedule_exceeds_what_the_model_says(compared: list[list[Compared]]) -> None:
    wrong = [
        (number, comparison)
        for number, every in enumerate(compared)
        for comparison in every
        if comparison.slack is not None and comparison.slack < 0
    ]
    assert not wrong, wrong[0]


def test_some_schedule_reaches_what_the_model_says(compared: list[list[Compared]]) -> None:
    reached = dict.fromkeys(QUANTITIES, 0)
    for number, every in enumerate(compared):
        limit = in_the_limit(system(number).schedule, every) if number < 20 else set()
        for comparison in every:
            reached[comparison.quantity] += comparison.slack == 0 or comparison.quantity in limit
    assert reached["latest_start_of_sc"] == SYSTEMS
    assert reached["jitter"] > 0.9 * SYSTEMS
    assert min(reached.values()) > 0, reached


def test_no_single_run_exceeds_the_enumeration() -> None:
    """Drawn schedules, run the plain way: the enumeration has them all, and invents few."""
    short, total = 0, 0
    for number in range(25):
        schedule = system(number).schedule
        draw = random.Random(number)  # noqa: S311 - schedules, not secrets
        worst = EverySchedule(schedule).enumerate()
        enforced = any(p.max_age is not None for p in schedule.read_by_dm)
        seen: dict[str, int] = {}
        for _ in range(12):
            run = OneSchedule(schedule, draw, 120 + 2 * multiple(schedule)).run()
            run["h_star"] = run["switch"] + (worst["age_dm"] or 0)
            seen = {q: max(v, seen.get(q, v)) for q, v in run.items()}
        for quantity, limit in worst.items():
            of_dm = quantity in {"age_dm", "longest_to_decision", "longest_between_states"}
            if quantity in seen and limit is not None and not (enforced and of_dm):
                assert seen[quantity] <= limit, (number, quantity)
                total += 1
                short += seen[quantity] < limit
    assert short < 0.3 * total


@all_rows("name", BLIND)
def test_a_model_that_forgets_something_is_seen(name: str) -> None:
    tell, expected = BLIND[name]
    unseen = set(expected)
    for number in range(SYSTEMS):
        if not unseen:
            return
        schedule = system(number).schedule
        comparisons = compare(schedule, tell(schedule))
        unseen -= {c.quantity for c in comparisons if c.slack is not None and c.slack < 0}
    assert not unseen


def test_an_h_that_nobody_declared_is_not_said_to_have_room() -> None:
    times = Times(BASE)
    assert horizon_in_words(times).startswith(
        "H = H* = 10 ns: what is needed (no `horizon` declared; "
    )
    assert "spare" not in horizon_in_words(times)
    for horizon, said_of_h in ((10, "0 s spare"), (15, "5 ns spare"), (5, "5 ns missing")):
        assert said_of_h in horizon_in_words(replace(times, horizon=horizon))
