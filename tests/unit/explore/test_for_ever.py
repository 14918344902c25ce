"""Where the configurations come again, a verdict holds for all times, and only there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from generators.programs_in_instants import program_in_instants
from generators.small_test_programs import TICK
from long_tests import examples, seeds
from soter.explore.command import TraceHeader, explore_test
from soter.explore.engine.explorer_library import Engine, EngineSettings, Searched
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

PROGRAMS = examples(20)
CHUNKS = 4 if PROGRAMS >= 60 else 2
MS = 1_000_000
COUNTS = """soter 1;
topic x : int in [0, 3] = 0;
topic y : int in [0, 40] = 0;
node A period 10ms {{ publishes x; step {{ publish x = choose {{ 0, 1, 3 }}; }} }}
node B period {period} phase {phase} {{
  subscribes x;
  publishes y;
  var n : int in [0, 40] = 0;
  step {{ n = {next}; publish y = n; }}
}}
system S {{ node A; node B; }}
test T {{ system S; horizon {horizon}; {property} }}
"""
UP_AND_DOWN = "x > 1 ? min(n + 1, 4) : 0"
ROUND = "n < 6 ? n + 1 : 0"


def engine_of(
    next_: str,
    *,
    period: str = "20ms",
    phase: str = "0ms",
    horizon: str = "2s",
    property_: str = "always y < 40;",
) -> Engine:
    text = COUNTS.format(
        period=period, phase=phase, next=next_, horizon=horizon, property=property_
    )
    checked = check_file("counts.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    return Engine(system_of_test(checked, "T"))


def closed(engine: Engine, **settings: int) -> Searched:
    return engine.explore(replace(EngineSettings(closes=True), **settings))  # type: ignore[arg-type]


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_what_comes_again_ends_the_search(threads: int) -> None:
    engine = engine_of(UP_AND_DOWN)
    exploration = closed(engine, threads=threads)
    assert exploration.status == "exhausted"
    assert 5 * 20 * MS <= exploration.closed_ns < 200 * MS, "after the fifth count, not much later"
    assert exploration.closed_ns % (20 * MS) == 0
    whole = engine.explore(EngineSettings())
    assert whole.closed_ns == 0
    assert whole.states > 5 * exploration.states


def test_a_round_is_closed_when_it_has_been_gone_twice() -> None:
    exploration = closed(engine_of(ROUND))
    assert 14 * 20 * MS <= exploration.closed_ns <= 16 * 20 * MS


def test_what_begins_later_is_no_round_before_it_has_begun() -> None:
    exploration = closed(engine_of(ROUND, phase="15ms", period="30ms"))
    assert 14 * 30 * MS <= exploration.closed_ns <= 17 * 30 * MS
    assert (exploration.closed_ns - 15 * MS) % (30 * MS) == 0


def test_the_calendar_begins_anew_after_all_periods() -> None:
    exploration = closed(engine_of(ROUND, period="15ms"))
    assert exploration.closed_ns > 0
    assert exploration.closed_ns % (30 * MS) == 0, "of 10 and 15 ms"
    for period in ("90ms", "95ms"):
        slow = engine_of(ROUND, period=period, property_="always y < 4;")
        assert closed(slow).status == "violated", "between two of its steps nothing changes"


@pytest.mark.parametrize("property_", ["always y < 40;", "x == 3 leadsto y == 0 within 10s;"])
def test_a_slow_counter_is_not_taken_for_a_round(property_: str) -> None:
    horizon = "700ms" if "leadsto" not in property_ else "10700ms"
    engine = engine_of("min(n + 1, 40)", horizon=horizon, property_=property_)
    exploration = closed(engine)
    assert exploration.closed_ns == 0 or exploration.closed_ns >= 40 * 20 * MS
    longer = engine_of("min(n + 1, 40)", horizon="900ms")
    assert closed(longer).status == "violated"


@pytest.mark.long
def test_a_deadline_that_the_horizon_hides_is_no_end() -> None:
    """What is promised for after the horizon is not kept: everything looks as it did before."""
    owed = "y == 4 leadsto y == 9 within 500ms;"
    for horizon in range(510, 640, 10):
        exploration = closed(engine_of(ROUND, property_=owed, horizon=f"{horizon}ms"))
        assert exploration.closed_ns == 0
        assert exploration.status == ("exhausted" if horizon < 560 else "violated")


@pytest.mark.parametrize(
    "changed",
    [
        {"next_": "time > 1.5 ? 0 : min(x, 3)"},
        {"property_": "always time < 1.9 || y < 40;"},
        {"property_": "time > 1.0 leadsto x == 0 within 100ms;"},
    ],
)
def test_who_reads_the_time_is_never_at_an_end(changed: dict[str, str]) -> None:
    engine = engine_of(**{"next_": UP_AND_DOWN, **changed})
    assert not engine.plan.repeats
    assert closed(engine).closed_ns == 0


@pytest.mark.parametrize(
    "settings",
    [
        {"reduction": "none"},
        {"reduction": "ample"},
        {"storage": "fingerprint"},
    ],
)
def test_other_searches_go_to_the_horizon(settings: dict[str, str]) -> None:
    exploration = closed(engine_of(UP_AND_DOWN, horizon="300ms"), **settings)  # type: ignore[arg-type]
    assert (exploration.status, exploration.closed_ns) == ("exhausted", 0)


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.long
@pytest.mark.random
def test_a_horizon_three_times_as_far_shows_nothing_new(chunk: int) -> None:
    """On random programs: where a search says that it is at an end, longer ones find nothing."""
    ended = 0
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
        checked = check_file("p.soter", program_in_instants(seed))
        if not checked.ok:  # as in every test of such programs
            continue
        system = system_of_test(checked, "T")
        assert system.test is not None
        tests = [replace(system.test, horizon_ns=n * TICK * MS) for n in (24, 72)]
        engine, longer = [Engine(replace(system, test=t)) for t in tests]
        exploration = closed(engine, max_states=100_000)
        plain = engine.explore(EngineSettings(max_states=300_000))
        if exploration.status != "states" and plain.status != "states":
            assert exploration.status == plain.status, seed
        if exploration.closed_ns:
            ended += 1
            assert exploration.status == "exhausted"
            more = longer.explore(EngineSettings(max_states=300_000))
            assert more.status in ("exhausted", "states"), seed
    assert ended > 1


def test_a_verdict_says_that_it_holds_for_ever() -> None:
    result = explore_test(
        engine_of(UP_AND_DOWN).system, SearchOptions(), TraceHeader("counts.soter", {})
    )
    assert (result.verdict, result.covered_ns) == ("exhausted", 2000 * MS)
    assert result.closed_ns is not None
    assert "it holds for ever" in result.for_ever_clause
    assert any(line.startswith("said of all times") for line in result.assumptions)
    assert not any("nothing is said about times after" in line for line in result.assumptions)
    short = explore_test(
        engine_of(UP_AND_DOWN, horizon="60ms").system,
        SearchOptions(),
        TraceHeader("counts.soter", {}),
    )
    assert (short.closed_ns, short.for_ever_clause) == (None, "")
    assert any("nothing is said about times after" in line for line in short.assumptions)
