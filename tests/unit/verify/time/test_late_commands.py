"""Commands that act later than half a period: how old what they answer is, and how long AC acts."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from soter.certificate.reading.derived_times import (
    Clock,
    DerivedTimes,
    Effect,
    TimingSetting,
    TopicPath,
    TopicReading,
    derive_times,
)
from unit.verify.time.pending_commands import PendingCommands, late_system

if TYPE_CHECKING:
    from soter.verify.problem.schedule import Releases, Schedule

SYSTEMS, RUNS = 40, 60


def derived(s: Schedule) -> DerivedTimes:
    """What the re-checker makes of it."""

    def clock(name: str, x: Releases) -> Clock:
        return Clock(name, x.period, x.phase, x.late, x.response)

    (path,) = s.read_by_sc
    sensor = TopicPath(clock("the sensor", path.sensor))
    read = (TopicReading("x", (sensor,), path.sensor.period),)
    effects = tuple(Effect(o.least, o.most) for o in s.outputs)
    return derive_times(
        TimingSetting(clock("the DM", s.dm), clock("SC", s.sc), read, read, effects)
    )


@pytest.fixture(scope="module")
def systems() -> list[Schedule]:
    draw = random.Random("late commands")  # noqa: S311 - systems, not secrets
    return [late_system(draw) for _ in range(SYSTEMS)]


def worst(s: Schedule, number: int) -> tuple[int, int]:
    """The oldest state that was answered by what acted, and the longest that AC acted."""
    draw = random.Random(f"run {number}")  # noqa: S311
    answered = of_ac = 0
    for _ in range(RUNS):
        run = PendingCommands(s, draw, ac_until=draw.randrange(-1, 60)).run()
        answered, of_ac = max(answered, run.oldest_answered), max(of_ac, run.last_of_ac)
    return answered, of_ac


def test_nothing_that_acts_is_older_than_derived_and_some_is_as_old(
    systems: list[Schedule],
) -> None:
    reached = 0
    for k, s in enumerate(systems):
        ours, theirs = s.read_age, derived(s).in_force
        answered, of_ac = worst(s, k)
        assert answered <= theirs <= ours, s
        assert of_ac <= s.h_star, s
        reached += answered == theirs
    assert reached > len(systems) / 2


def test_runs_would_show_a_horizon_that_forgets_a_period(systems: list[Schedule]) -> None:
    shown = sum(worst(s, k)[1] > s.h_star - s.sc.period for k, s in enumerate(systems))
    assert shown > len(systems) / 4


@pytest.mark.parametrize("forgotten", ["a period", "the latest effect", "the read's own age"])
def test_runs_would_show_an_age_that_forgets_something(
    systems: list[Schedule], forgotten: str
) -> None:
    shown = 0
    for k, s in enumerate(systems):
        less = {
            "a period": s.sc.period,
            "the latest effect": max(o.most for o in s.outputs) - min(o.least for o in s.outputs),
            "the read's own age": max(1, s.age_sc),
        }[forgotten]
        shown += worst(s, k)[0] > s.read_age - less
    assert shown > len(systems) / 2
