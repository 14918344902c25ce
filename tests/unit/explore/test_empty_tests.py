"""No test is clean for want of looking: nothing judged, inputs left alone, times off the grid."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from generators.empty_tests import (
    CALCULATED,
    GRIDDED,
    NOTHING_JUDGED,
    UNDRIVEN,
    judged,
    timed,
    watching,
    with_item,
)
from long_tests import examples, seeds
from soter.explore.command import TraceHeader, explore_test
from soter.explore.search_options import SearchOptions
from soter.language.elaborate.time_grid import quantum_of, times_read
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.explore.results import TestResult
    from soter.language.model.system import System

PROGRAMS = examples(8)
MS = 1_000_000
FINE = "quantum 250us; "


def system(text: str) -> System:
    checked = check_file("small.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    return system_of_test(checked, "T")


def found(text: str, **options: float) -> TestResult:
    chosen = replace(SearchOptions(minimise=0), **options)  # type: ignore[arg-type]
    return explore_test(system(text), chosen, TraceHeader("small.soter", {}))


def finer(text: str) -> str:
    return with_item(text, FINE)


@pytest.mark.parametrize("text", NOTHING_JUDGED.values(), ids=list(NOTHING_JUDGED))
def test_where_nothing_was_judged_nothing_is_clean(text: str) -> None:
    result = found(text)
    assert (result.verdict, result.bound) == ("bound", "unjudged")
    assert result.coverage.properties.reached == 0


@pytest.mark.parametrize("text", UNDRIVEN.values(), ids=list(UNDRIVEN))
def test_an_input_that_keeps_its_default_is_a_bound(text: str) -> None:
    result = found(text)
    assert (result.verdict, result.bound) == ("bound", "undriven")
    assert any("wish keeps its default" in line for line in result.assumptions)
    driven = with_item(text, "input wish every 10ms; ")
    assert found(driven).bound is None


@pytest.mark.parametrize("text", GRIDDED.values(), ids=list(GRIDDED))
def test_times_that_a_program_tells_apart_are_tried(text: str) -> None:
    assert found(text).verdict == "violated"
    assert found(finer(text)).verdict == "violated", "the finer grid is the judge"


@pytest.mark.parametrize("text", GRIDDED.values(), ids=list(GRIDDED))
def test_the_grid_of_the_calendar_alone_would_miss_it(text: str) -> None:
    coarse = with_item(text, "quantum 10ms; ")
    result = found(coarse)
    assert result.verdict == "exhausted"
    assert result.quantum_ns == 10 * MS
    assert any("a multiple of 10 ms: no other times" in line for line in result.assumptions)


@pytest.mark.parametrize("text", CALCULATED.values(), ids=list(CALCULATED))
def test_what_calculates_with_times_is_never_clean_on_a_grid_of_ours(text: str) -> None:
    result = found(text)
    assert result.verdict == "violated" or result.bound == "grid"
    assert found(finer(text)).verdict == "violated"
    coarse = with_item(text, "quantum 5ms; ")
    assert found(coarse).bound != "grid", "who declares a grid takes it for granted"


def test_some_of_several_properties_may_never_be_judged() -> None:
    text = NOTHING_JUDGED["a premise that is never true"].replace(
        "horizon 50ms;", "horizon 50ms; always x < 9;"
    )
    result = found(text)
    assert result.verdict == "exhausted"
    assert result.coverage.properties.unreached == ("x > 8 leadsto y within 10ms",)


def test_what_was_judged_is_noted() -> None:
    text = GRIDDED["an age between"].replace("always !y", "always x >= 0")
    result = found(text)
    assert result.verdict == "exhausted"
    assert result.coverage.properties.unreached == ()


@pytest.mark.parametrize(
    ("name", "thresholds", "quantum"),
    [
        ("an age between", (3 * MS, 7 * MS), MS),
        ("a constant", (4 * MS, 6 * MS), 2 * MS // 2),
        ("neighbours", (3 * MS, 4 * MS), MS // 2),
        ("an offset", (3 * MS, 7 * MS), MS),
    ],
)
def test_thresholds_are_in_the_grid_and_something_lies_between_them(
    name: str, thresholds: tuple[int, ...], quantum: int
) -> None:
    flat = system(GRIDDED[name])
    read = times_read(flat)
    assert set(thresholds) <= set(read.thresholds_ns)
    assert quantum_of(flat) <= quantum
    assert all(t % quantum_of(flat) == 0 for t in read.thresholds_ns)


@pytest.mark.parametrize("chunk", range(4))
@pytest.mark.random
def test_a_quarter_of_a_millisecond_finds_no_more(chunk: int) -> None:
    """On random programs that compare times with whole milliseconds, and do nothing else.

    Number 97 asks for an age between zero and its first threshold, through a local with an offset:
    on a grid of one millisecond it was clean.
    """
    for seed in (*seeds(chunk, PROGRAMS, 4), 97 + chunk):
        text = watching(seed)
        first = found(text)
        if first.bound == "grid":  # it says itself that the grid may miss something
            continue
        assert first.verdict in ("violated", "exhausted"), (seed, first.bound)
        fine = with_item(text, "quantum 250us; ")
        again = found(fine)
        assert again.verdict == first.verdict, (seed, text)


OFFSETS = {
    "a local": ("let held = age(x) + 1ms;", "held > 1ms && held < 4ms", (0, 1, 3)),
    "a chain": ("let a = age(x) + 1ms; let b = a + 1ms;", "b > 5ms", (0, 1, 3)),
    "two": ("let a = x > 3 ? age(x) + 1ms : age(x) + 2ms;", "a > 5ms", (0, 1, 2, 3, 4)),
    "a first value": ("if x > 3 { last = time; }", "time - last > 5ms", (0, 2, 5, 7)),
}


@pytest.mark.parametrize("name", OFFSETS)
def test_a_local_keeps_what_its_clock_is_off_by(name: str) -> None:
    step, compared, thresholds = OFFSETS[name]
    text = judged(
        "horizon 22ms; skew 5ms; never y;",
        step=f"{seconds(step)} publish y = {seconds(compared)};",
    ).replace("publishes y;", "publishes y; var last: float = 0.002;")
    read = times_read(system(text))
    assert read.open == ()
    assert set(read.thresholds_ns) == {t * MS for t in thresholds}


def seconds(text: str) -> str:
    return re.sub(r"(\d+)ms", r"0.00\1", text)


def test_where_a_time_is_an_odd_number_of_nanoseconds_something_lies_between() -> None:
    text = timed("publish y = age(x) > 0.0 && age(x) < 0.033333333;").replace("10ms", "33333333ns")
    flat = system(text.replace("horizon 60ms", "horizon 99ms"))
    assert quantum_of(flat) == 3_030_303, "four parts, and eleven divide it"
    assert found(text).verdict == "violated"


@pytest.mark.parametrize(
    ("kept", "compared"),
    [("time", "time - last"), ("age(x)", "last"), ("time", "last"), ("time - last", "last")],
)
def test_one_time_less_another_is_compared_on_the_grid(kept: str, compared: str) -> None:
    """And elapsed times that are added up are not."""
    text = judged(
        "horizon 22ms; skew 5ms; never y;",
        step=f"if x > 3 {{ last = {kept}; }} publish y = {compared} > 0.005;",
    ).replace("publishes y;", "publishes y; var last: float;")
    assert bool(times_read(system(text)).open) == (kept == "time - last")


def test_a_clock_that_is_off_by_ever_more_is_open() -> None:
    text = judged(
        "horizon 22ms; skew 5ms; never y;",
        step="held = held + 0.001; if x > 3 { held = age(x); } publish y = held > 0.005;",
    ).replace("publishes y;", "publishes y; var held: float;")
    assert times_read(system(text)).open
    assert found(text.replace("held > 0.005", "held > 5.0")).bound == "grid"


@pytest.mark.long
def test_such_programs_are_violated_and_clean() -> None:
    """Where the grid of times is fine enough, as it says itself."""
    results = [found(watching(seed)) for seed in range(24)]
    verdicts = {r.verdict for r in results if r.bound != "grid"}
    assert verdicts == {"violated", "exhausted"}


def test_a_disturbance_that_holds_its_value_is_a_bound_of_its_own() -> None:
    """It is drawn once, by chance: not even its ends are tried."""
    text = """soter 1;
topic x: float;
plant P period 10ms {{
  drives x = s;
  state s: float;
  disturbance w: float in [-2.0, 2.0]{hold};
  der s = w;
}}
system S {{ p: P; until 1s; always abs(x) < 0.05; }}
test T {{ system S; horizon 30ms; }}
"""
    result = found(text.format(hold=" hold 30ms"))
    assert (result.verdict, result.bound) == ("bound", "drawn")
    assert "drawn by chance" in result.why
    assert any(line.endswith("p.w") for line in result.assumptions)
    assert found(text.format(hold="")).verdict == "violated", "as every step is tried"
