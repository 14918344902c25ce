"""Latest starts and ends in a thread that works in order, against executions of it.

The simulator (tests/generators/simulated_thread.py) goes tick by tick and knows the model only.
"""

from __future__ import annotations

import random

import pytest

from generators.simulated_thread import Job, at_worst, drawn, spans, turn
from long_tests import examples, seed_of
from soter.timing import trusted_thread
from soter.timing.trusted_thread import Analysis, Task, WorstResponse, analyse_thread

SETS = examples(300)


def tasks_of(jobs: list[Job]) -> list[Task]:
    return [
        Task(str(k), period=j.every, phase=j.offset, wcet=j.cost, jitter=j.hold, deadline=j.due)
        for k, j in enumerate(jobs)
    ]


def worst_of(analysis: Analysis) -> list[WorstResponse]:
    """Of every task; all of them were released."""
    known = [w for w in analysis.worst if w is not None]
    assert len(known) == len(analysis.worst)
    return known


def latest(jobs: list[Job], ticks: int) -> list[tuple[int, int]]:
    """Latest start and end of each job in the execution in which all is as late as it may be."""
    return spans(jobs, ticks, lambda k, _: jobs[k].hold, lambda k, _: jobs[k].cost)


@pytest.mark.random
def test_nothing_is_later_than_computed_and_the_computed_is_reached() -> None:
    rng = random.Random(seed_of(20261122))  # noqa: S311 - schedules, not secrets
    kept = 0
    for _ in range(SETS):
        jobs = drawn(rng, rng.uniform(0.3, 1.0))
        analysis = analyse_thread(tasks_of(jobs))
        assert analysis.exact
        if analysis.miss is not None:
            continue
        kept += 1
        ticks = max(j.offset for j in jobs) + 3 * turn(jobs)
        reached = latest(jobs, ticks)
        assert [(w.start, w.end) for w in worst_of(analysis)] == reached
        share = rng.random()

        def held(k: int, _: int, jobs: list[Job] = jobs, share: float = share) -> int:
            return jobs[k].hold if rng.random() < share else rng.randint(0, jobs[k].hold)

        def lasts(k: int, _: int, jobs: list[Job] = jobs, share: float = share) -> int:
            return jobs[k].cost if rng.random() < share else rng.randint(0, jobs[k].cost)

        for k, (start, end) in enumerate(spans(jobs, ticks, held, lasts)):
            assert start <= worst_of(analysis)[k].start
            assert end <= worst_of(analysis)[k].end
    assert kept >= SETS // 5


@pytest.mark.random
def test_what_is_refused_has_an_execution_that_misses_first_there() -> None:
    rng = random.Random(seed_of(7))  # noqa: S311 - schedules, not secrets
    refused = 0
    for _ in range(SETS):
        jobs = drawn(rng, rng.uniform(0.6, 1.2))
        miss = analyse_thread(tasks_of(jobs)).miss
        if miss is None:
            continue
        refused += 1
        s = miss.step
        assert s.end > miss.deadline == s.release + jobs[s.task].due
        missed = at_worst(jobs, s.end + 1)
        assert (s.task, s.number, s.end) in missed
        assert min(end for _, _, end in missed) == s.end
    assert refused >= SETS // 5


def overload(excess: int) -> Analysis:
    """Two jobs, of which the second keeps the thread busy, and `excess` more, in 1000."""
    return analyse_thread(
        [
            Task("a", period=10, phase=0, wcet=5, jitter=0, deadline=10),
            Task("b", period=1000, phase=0, wcet=500 + excess, jitter=0, deadline=100_000),
        ]
    )


def test_a_thread_that_is_asked_for_too_much_misses_however_little_that_is() -> None:
    analysis = overload(1)
    assert analysis.work == analysis.hyperperiod + 1
    assert analysis.miss is not None
    jobs = [Job(10, 0, 5, 0, 10), Job(1000, 0, 501, 0, 100_000)]
    s = analysis.miss.step
    missed = at_worst(jobs, s.end + 1)
    assert (s.task, s.number, s.end) in missed


def test_work_that_fills_all_time_is_no_miss_by_itself() -> None:
    analysis = analyse_thread(
        [
            Task("a", period=10, phase=0, wcet=5, jitter=0, deadline=10),
            Task("b", period=20, phase=5, wcet=10, jitter=0, deadline=20),
        ]
    )
    assert analysis.miss is None
    assert analysis.work == analysis.hyperperiod
    assert [w.end for w in worst_of(analysis)] == [10, 10]


def test_hyperperiods_that_only_add_to_the_backlog_are_left_out_of_the_search() -> None:
    tasks = [
        Task("a", period=1_000_003, phase=0, wcet=1_000_003, jitter=0, deadline=10**12),
        Task("b", period=1_000_003, phase=0, wcet=1, jitter=0, deadline=10**12),
    ]
    miss = analyse_thread(tasks).miss
    assert miss is not None
    s = miss.step
    assert s.end == s.release + 1_000_003 + s.number * 1 + (s.task == 1) * 1
    assert s.end - s.release == 10**12 + 1


@pytest.mark.random
def test_of_a_calendar_that_is_too_long_there_is_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed_of(3))  # noqa: S311 - schedules, not secrets
    decided = 0
    for _ in range(SETS):
        jobs = drawn(rng, rng.uniform(0.2, 0.8))
        exact = analyse_thread(tasks_of(jobs))
        monkeypatch.setattr(trusted_thread, "RELEASES_MAX", 10)
        bound = analyse_thread(tasks_of(jobs))
        monkeypatch.undo()
        if bound.exact:
            assert (bound.miss is None) == (exact.miss is None)
            continue
        assert bound.miss is None
        if exact.miss is not None or not bound.worst:
            continue
        decided += 1
        for b, e in zip(worst_of(bound), worst_of(exact), strict=True):
            assert b.start >= e.start
            assert b.end >= e.end
    assert decided >= SETS // 10


def test_who_was_not_released_before_a_miss_has_no_figures() -> None:
    analysis = analyse_thread(
        [
            Task("a", period=10, phase=0, wcet=11, jitter=0, deadline=10),
            Task("b", period=40, phase=30, wcet=1, jitter=0, deadline=40),
        ]
    )
    assert analysis.miss is not None
    assert analysis.worst == (WorstResponse(0, 11, 0), None)


def test_no_tasks_are_no_trouble() -> None:
    assert analyse_thread([]).miss is None
