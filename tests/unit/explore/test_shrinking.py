"""A trace that is too long to be minimised is shrunk: smaller, the same violation, replayed."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from generators.small_test_programs import small_program
from long_tests import examples, seeds
from soter.diagnostics.diagnostic import SoterError
from soter.explore.command import TraceHeader, explore_test, make_trace
from soter.explore.engine.explorer_library import array_to_steps, steps_to_array
from soter.explore.engine.search import Search
from soter.explore.engine.shrink import Guided, Shrinker, execution_cost
from soter.explore.replay import replay
from soter.explore.search_options import SearchOptions
from unit.explore.explored_programs import CONTRACTS, FAULTS, QUEUED, STARTS, TESTED
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Steps
    from soter.explore.engine.search import Found
    from soter.explore.engine.shrink import Cost
    from soter.explore.replay import Replayed
    from soter.explore.results import TestResult
    from soter.language.model.system import System

TOLD = TraceHeader("small.soter", {})
CART = """
soter 1;
topic pos: float;
topic u: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {
  reads u; drives pos = x;
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-1.0, 1.0];
  der x = v;
  der v = u - 0.5 * v + wind;
  measured pos within 0.05;
}
node Stay period 20ms {
  subscribes pos; publishes u;
  step {
    var gust = choose { false, true };
    publish u = gust ? 0.0 : -clamp(pos, -1.0, 1.0);
  }
}
system S { p: Cart; n: Stay; until 20s; }
test Drifts { system S; horizon 20s; always abs(p.truth.x) < 0.3; }
"""
PROGRAMS = examples(12)
CHUNKS = 4 if PROGRAMS >= 24 else 2


def searched(
    system: System, strategy: str = "random", seed: int = 1, runs: int = 300
) -> tuple[Search, Found]:
    """A search, to be closed by the caller, and what it found."""
    options = replace(SearchOptions(), strategy=strategy, seed=seed, runs=runs)
    search = Search(system, options)
    return search, search.run()


def costs(search: Search, outcome: Found, steps: tuple[object, ...]) -> Cost:
    """What a trace costs; it violates what was found."""
    assert outcome.broken is not None
    raw = steps_to_array([search._raw_step(s) for s in steps])  # type: ignore[arg-type]
    made = Guided(search._engine, search._settings.seed, outcome.broken).execute_along(
        raw, len(raw)
    )
    assert made.violates
    assert array_to_steps(made.steps) == array_to_steps(raw)
    return execution_cost(made)


def replayed(result: TestResult) -> Replayed:
    assert result.replayed is not None
    return result.replayed


@pytest.mark.long
def test_a_long_trace_over_floats_is_shrunk_where_minimising_ends_in_vain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(time, "perf_counter", time.process_time)  # others may have the machine
    system = system_of_text(CART, "Drifts")
    options = replace(SearchOptions(), strategy="random", seed=3, minimise=4.0)
    as_found = explore_test(system, replace(options, minimise=0.0), TOLD)
    assert len(replayed(as_found).steps) > 2_000
    test_result = explore_test(system, options, TOLD)
    assert not test_result.minimal
    assert len(replayed(test_result).steps) < 400, "126 on a fast machine"
    assert replayed(test_result).reproduced
    assert test_result.broken == as_found.broken
    assert test_result.shrunk_from == len(replayed(as_found).steps)
    assert replayed(test_result).trace.shrunk_from == test_result.shrunk_from


@pytest.mark.long
def test_shrinking_gives_the_same_trace_twice() -> None:
    system = system_of_text(CART, "Drifts")
    search, outcome = searched(system, seed=3)
    with search:
        first, second = search.shrink(outcome, 60.0), search.shrink(outcome, 60.0)
    assert first is not None
    assert second is not None
    assert not first.stopped
    assert first.steps == second.steps


@pytest.mark.parametrize(
    "text", [pytest.param(TESTED, marks=pytest.mark.long), FAULTS, STARTS, CONTRACTS, QUEUED]
)
def test_what_is_shrunk_is_not_larger_and_nearly_least(text: str) -> None:
    for test in (line.split()[1] for line in text.splitlines() if line.startswith("test ")):
        system = system_of_text(text, test)
        search, outcome = searched(system, "random")
        with search:
            if outcome.status != "violated":
                continue
            shrunk, least = search.shrink(outcome, 60.0), search.find_shortest_trace(outcome, 60.0)
            assert shrunk is not None
            least_cost = costs(search, outcome, least.steps)
            cost = costs(search, outcome, shrunk.steps)
            assert least_cost[:3] <= cost[:3] <= costs(search, outcome, outcome.steps)[:3]
            assert cost[0] <= 2 * least_cost[0], test


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_shrunk_traces_of_random_programs_replay_and_violate_the_same(chunk: int) -> None:
    shrunk_some = 0
    for number in seeds(chunk, PROGRAMS, CHUNKS):
        try:
            system = system_of_text(small_program(number), "T")
        except (SoterError, AssertionError):
            continue
        search, outcome = searched(system, seed=number + 1)
        with search:
            if outcome.status != "violated":
                continue
            shrunk = search.shrink(outcome, 60.0)
            assert shrunk is not None
            cost, before = (costs(search, outcome, f.steps) for f in (shrunk, outcome))
            assert cost <= before
            shrunk_some += cost < before
            least = search.find_shortest_trace(outcome, 60.0)
            if least.status == "violated":
                assert costs(search, outcome, least.steps)[:3] <= cost[:3]
        result = explore_test(system, replace(search.options, minimise=0.0), TOLD)
        assert replay(make_trace(result, TOLD, shrunk.steps), system).reproduced, number
    assert shrunk_some > 0


def test_time_ends_shrinking_with_the_best_until_then() -> None:
    system = system_of_text(CART, "Drifts")
    search, outcome = searched(system, seed=3)
    with search:
        shrunk = search.shrink(outcome, 0.02)
        assert shrunk is not None
        assert shrunk.stopped == "patience"
        assert costs(search, outcome, shrunk.steps) <= costs(search, outcome, outcome.steps)


def test_ctrl_c_ends_shrinking_with_the_best_until_then(monkeypatch: pytest.MonkeyPatch) -> None:
    honest, calls = Guided.execute_along, []

    def cut(self: Guided, *given: object) -> object:
        calls.append(1)
        if len(calls) == 20:
            raise KeyboardInterrupt
        return honest(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(Guided, "execute_along", cut)
    system = system_of_text(CART, "Drifts")
    options = replace(SearchOptions(), strategy="random", seed=3)
    test_result = explore_test(system, options, TOLD)
    assert test_result.interrupted
    assert test_result.verdict == "violated"
    assert 2 < len(replayed(test_result).steps) < 2_000


def test_what_violates_something_else_is_not_taken() -> None:
    system = system_of_text(TESTED, "Skips")
    search, outcome = searched(system)
    with search:
        assert outcome.broken is not None
        other = Guided(search._engine, 1, (outcome.broken[0], outcome.broken[1] + 1))
        raw: Steps = steps_to_array([search._raw_step(s) for s in outcome.steps])
        shrinker = Shrinker(other, search._engine.actors, deadline_s=time.perf_counter() + 60)
        assert shrinker.shrink(raw) is None
