"""Replay: what the enumerator can do is allowed and looks the same; anything else is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import pytest

from soter.explore.replay import replay
from soter.explore.trace import BEGIN, EFFECT, LOST, STEP, Choice, Step, ViolationId
from soter.language.model.values import to_json
from unit.explore.explored_programs import (
    CONTRACTS,
    FAULTS,
    QUEUED,
    SEVERAL,
    STARTS,
    TESTED,
)
from unit.explore.random_walks import Walk, system_of_text, walk

if TYPE_CHECKING:
    from soter.language.model.system import System

NAMES = (
    "Far",
    "Skewed",
    "Theorem",
    "Skips",
    "Overruns",
    "Answers",
    "Sometime",
    "AtLast",
    "BeyondTheEnd",
    "Forgotten",
)
CASES = [
    *[(TESTED, t) for t in NAMES],
    (FAULTS, "Overflows"),
    (CONTRACTS, "Kept"),
    (QUEUED, "Fits"),
    (QUEUED, "Slowly"),
    (SEVERAL, "Many"),
    (STARTS, "Drifts"),
]
SEEDS = range(25)


@cache
def system(text: str, test: str) -> System:
    return system_of_text(text, test)


def walks(test: str, text: str = TESTED) -> list[Walk]:
    return [walk(system(text, test), seed) for seed in SEEDS]


def violating(test: str, text: str = TESTED) -> Walk:
    return next(w for w in walks(test, text) if w.broken is not None)


@pytest.mark.parametrize(("text", "test"), CASES, ids=[t for _, t in CASES])
def test_every_execution_is_allowed_and_ends_as_the_enumerator_says(text: str, test: str) -> None:
    tested = system(text, test)
    outcomes = set()
    for w in walks(test, text):
        replay_result = replay(w.trace, tested)
        assert replay_result.problem is None
        assert replay_result.reproduced == (w.broken is not None)
        assert len(replay_result.steps) == len(w.trace.steps)
        topics = [{t.name: to_json(t.type, c[t.index]) for t in tested.topics} for c in w.topics]
        assert [s.topics for s in replay_result.steps][: len(topics)] == topics
        outcomes.add(w.broken)
    assert outcomes - {None}, "some of the walks have to go wrong"


def test_walks_break_what_there_is_to_break() -> None:
    broken = {w.broken for text, test in CASES for w in walks(test, text)} - {None}
    assert {what for what, _ in filter(None, broken)} == {"property", "contract", "fault", "timed"}
    contracts = {w.broken for w in walks("Kept", CONTRACTS)} - {None}
    assert len(contracts) == 2, "what it assumes, and what it guarantees"


def test_only_the_end_is_violated() -> None:
    for w in walks("Far"):
        replay_result = replay(w.trace, system(TESTED, "Far"))
        before, last = replay_result.steps[:-1], replay_result.steps[-1]
        assert all(not s.violated for s in before)
        assert bool(last.violated) == (w.broken is not None)


def test_without_its_last_step_it_is_not_reproduced() -> None:
    w = violating("Far")
    short = replace(w.trace, steps=w.trace.steps[:-1])
    replay_result = replay(short, system(TESTED, "Far"))
    assert replay_result.problem is None
    assert not replay_result.reproduced
    assert "not violated" in replay_result.outcome


def test_another_property_is_not_the_one_that_is_violated() -> None:
    w = violating("Far")
    other = replace(w.trace, broken=ViolationId("property", 0, "always true"))
    replay_result = replay(other, system(TESTED, "Far"))
    assert not replay_result.reproduced
    assert "no such property" in replay_result.outcome
    beyond = replace(w.trace, broken=ViolationId("timed", 7, "x"))
    assert not replay(beyond, system(TESTED, "Far")).reproduced


# ---------------------------------------------------------------- what is refused


def refused(test: str, steps: list[Step], text: str = TESTED) -> str:
    """Why a trace with these steps is no execution."""
    w = violating(test, text)
    replay_result = replay(replace(w.trace, steps=tuple(steps)), system(text, test))
    assert not replay_result.reproduced
    assert replay_result.problem is not None
    return replay_result.problem


def steps_of(test: str, text: str = TESTED) -> list[Step]:
    return list(violating(test, text).trace.steps)


def test_steps_of_a_later_instant_have_to_wait() -> None:
    steps = steps_of("Far")
    later = next(i for i, s in enumerate(steps) if s.time_ns == 10_000_000)
    assert "has to step before" in refused("Far", [*steps[: later - 1], *steps[later:]])


def test_a_release_happens_once() -> None:
    steps = steps_of("Far")
    assert "next release" in refused("Far", [*steps[:2], steps[1], *steps[2:]])


def test_a_step_stays_in_its_window() -> None:
    steps = steps_of("Skewed")
    i = next(i for i, s in enumerate(steps) if s.actor == "watch")
    late = replace(steps[i], time_ns=steps[i].release_ns + 6_000_000)
    assert "can happen from" in refused("Skewed", [*steps[:i], late])
    early = replace(steps[i], time_ns=steps[i].time_ns - 1)
    assert "can happen from" in refused("Skewed", [*steps[:i], early])


def test_times_lie_on_the_grid() -> None:
    steps = steps_of("Skewed")
    i = next(i for i, s in enumerate(steps) if s.actor == "watch")
    between = replace(steps[i], time_ns=steps[i].time_ns + 1)
    assert "grid" in refused("Skewed", [*steps[:i], between])


def test_only_what_may_skip_skips_and_not_too_often() -> None:
    lost = Step("watch", LOST, 0, 0)
    assert "skip any" in refused("Far", [lost])
    tested, first = system(TESTED, "Skips"), violating("Skips")
    actors = [a for a in ("input.wish", "input.alarm", "robot", "Keeper.dm") if a]
    instant = [Step(a, STEP, 0, 0) for a in (*actors, "Keeper.Home", "Keeper.Bold")]
    second = [Step(a, STEP, 10_000_000, 10_000_000) for a in ("robot", "Keeper.Bold")]
    third = [
        Step(a, STEP, 20_000_000, 20_000_000)
        for a in ("input.wish", "robot", "Keeper.Home", "Keeper.Bold")
    ]
    twice = replace(lost, release_ns=20_000_000, time_ns=20_000_000)
    trace = replace(first.trace, steps=(*instant, lost, *second, *third, twice))
    replay_result = replay(trace, tested)
    assert replay_result.problem is not None
    assert "more than 1 in a row" in replay_result.problem


def test_only_what_may_overrun_overruns() -> None:
    assert "overrun" in refused("Far", [Step("watch", BEGIN, 0, 0)])
    assert "nothing can take effect" in refused("Far", [Step("watch", EFFECT, 0, 0)])
    begins = Step("watch", BEGIN, 0, 0)
    assert "still runs" in refused("Overruns", [begins, begins])


def test_what_overruns_publishes_later() -> None:
    tested, w = system(TESTED, "Overruns"), violating("Overruns")
    steps = [
        Step("input.alarm", STEP, 0, 0, (Choice("input.alarm", 1, 2),)),
        Step("watch", BEGIN, 0, 0),
        *[Step(a, STEP, 0, 0) for a in ("input.wish", "robot", "Keeper.dm", "Keeper.Bold")],
        Step("Keeper.Home", BEGIN, 0, 0),
        Step("watch", EFFECT, 0, 5_000_000),
    ]
    replay_result = replay(replace(w.trace, steps=tuple(steps)), tested)
    assert replay_result.problem is None
    assert [s.topics["seen"] for s in replay_result.steps][1:] == [0, 0, 0, 0, 0, 0, 1]
    assert replay_result.steps[-1].published == {"seen": 1}
    late = [*steps[:-1], replace(steps[-1], time_ns=11_000_000)]
    assert not replay(replace(w.trace, steps=tuple(late)), tested).reproduced


def test_picks_answer_what_is_asked() -> None:
    steps = steps_of("Far")
    i = next(i for i, s in enumerate(steps) if s.actor == "Keeper.Bold")
    (choice,) = steps[i].choices
    more = replace(steps[i], choices=(replace(choice, of=4),))
    assert "3 alternatives" in refused("Far", [*steps[:i], more])
    twice = replace(steps[i], choices=(choice, choice))
    assert "nothing asks" in refused("Far", [*steps[:i], twice])
    stranger = replace(steps[i], choices=(Choice("weather", 0, 2),))
    assert "nothing asks" in refused("Far", [*steps[:i], stranger])


def test_picks_at_the_start_are_checked_too() -> None:
    w = violating("Drifts", STARTS)
    first = w.trace.steps[0]
    (choice,) = first.choices
    for wrong in ((replace(choice, of=2, pick=0),), (choice, choice)):
        steps = (replace(first, choices=wrong), *w.trace.steps[1:])
        replay_result = replay(replace(w.trace, steps=steps), system(STARTS, "Drifts"))
        assert not replay_result.reproduced
        assert replay_result.problem is not None
        assert "start" in replay_result.problem


def test_nothing_comes_after_a_fault() -> None:
    w = violating("Overflows", FAULTS)
    last = w.trace.steps[-1]
    later = last.time_ns + 10_000_000
    after = replace(last, release_ns=later, time_ns=later)
    replay_result = replay(
        replace(w.trace, steps=(*w.trace.steps, after)), system(FAULTS, "Overflows")
    )
    assert not replay_result.reproduced
    assert "no execution goes on" in replay_result.outcome


def test_the_start_comes_first_and_its_actor_exists() -> None:
    steps = steps_of("Far")
    assert "comes first" in refused("Far", [steps[0], steps[1], steps[0]])
    assert "no actor" in refused("Far", [replace(steps[1], actor="nobody")])
    beyond = replace(steps[1], release_ns=10**15, time_ns=10**15)
    assert "next release" in refused("Far", [beyond])


# ---------------------------------------------------------------- what is told


def test_choices_come_with_their_values() -> None:
    replay_result = replay(violating("Far").trace, system(TESTED, "Far"))
    told = {c.stream: c.value for s in replay_result.steps for c in s.choices}
    assert isinstance(told["input.alarm"], bool)
    assert told["input.wish"] in (-1, 0, 1)
    drift = replay(violating("Drifts", STARTS).trace, system(STARTS, "Drifts"))
    start = {c.stream: c.value for c in drift.steps[0].choices}
    assert start["p.x.start"] in (0.0, -1.0, 2.0)
    later = {c.value for s in drift.steps[1:] for c in s.choices if c.stream == "p.wind"}
    assert later <= {0.0, 3.0}, "zero is inside: it is the middle, and the least value too"


def test_a_switch_and_what_the_dm_saw_are_told() -> None:
    switches = [
        (s, r)
        for w in walks("Far")
        for r in [replay(w.trace, system(TESTED, "Far"))]
        for s in r.steps
        if s.switch is not None
    ]
    step, replay_result = switches[0]
    assert step.switch == ("Keeper", "SC", "AC")
    assert step.decided is not None
    assert step.decided["safer"] is True
    assert replay_result.steps[step.number].modes == {"Keeper": "AC"}


def test_a_trace_that_goes_on_after_the_violation_is_no_execution() -> None:
    violation_walk = violating("Far")
    last = violation_walk.trace.steps[-1]
    more = replace(violation_walk.trace, steps=(*violation_walk.trace.steps, last))
    refused = replay(more, system(TESTED, "Far"))
    assert not refused.reproduced
    assert refused.problem is not None
    assert "goes on after a violation" in refused.problem


def test_a_configuration_starts_once() -> None:
    violation_walk = violating("Drifts", STARTS)
    assert violation_walk.trace.steps[0].kind == "start"
    twice = replace(
        violation_walk.trace, steps=(violation_walk.trace.steps[0], *violation_walk.trace.steps)
    )
    refused = replay(twice, system(STARTS, "Drifts"))
    assert not refused.reproduced
    assert refused.problem is not None
    assert "and once" in refused.problem
