"""All properties that are violated at the end of a trace, and with `--all` those elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from generators.brute_force import BruteForce, TooLargeError
from generators.small_test_programs import small_program
from long_tests import examples, seeds
from soter.diagnostics.diagnostic import SoterError
from soter.explore.command import TraceHeader, explore_test, save_traces
from soter.explore.replay import replay
from soter.explore.search_options import SearchOptions
from soter.explore.trace import read_document, trace_from_document
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from pathlib import Path

    from soter.explore.results import TestResult

PROGRAMS = examples(14)
THREE = """
soter 1;
topic x: int in [0, 9];
node Picks period 10ms { publishes x; step { publish x = choose [0, 4]; } }
node Reads period 10ms {
  subscribes x; publishes y;
  assumes x != 3;
  var before: int in [0, 9] = 0;
  step { publish y = before; before = x; }
}
topic y: int in [0, 9];
system S { picks: Picks; reads: Reads; until 1s; }
test Some {
  system S; horizon 40ms;
  never x == 1; never y == 1; never x == 2; never x >= 2 && x < 3; never x == 7;
  y == 4 leadsto y == 9 within 10ms;
}
"""


def explored(text: str, test: str, **options: object) -> TestResult:
    made = replace(SearchOptions(), all_properties=True, **options)  # type: ignore[arg-type]
    return explore_test(system_of_text(text, test), made, TraceHeader("small.soter", {}))


def texts(test_result: TestResult) -> list[str]:
    assert test_result.broken is not None
    for one in (test_result, *test_result.others):
        assert one.replayed is not None
        assert one.replayed.reproduced
        assert replay(one.replayed.trace, one.system).reproduced
    return [
        test_result.broken.text,
        *(o.broken.text for o in test_result.others if o.broken is not None),
    ]


ALL = {
    "never x == 1",
    "never y == 1",
    "never x == 2",
    "never x >= 2 && x < 3",
    "assumes x != 3 in reads",
    "y == 4 leadsto y == 9 within 10ms",
}


@pytest.mark.parametrize("strategy", ["bfs", "random"])
@pytest.mark.parametrize("reduction", ["none", "all"])
def test_every_property_that_can_be_violated_is_found(strategy: str, reduction: str) -> None:
    test_result = explored(THREE, "Some", strategy=strategy, reduction=reduction)
    said = texts(test_result)
    assert len(said) == len(set(said))
    # y is 1 only after x was: an execution ends at its first violation
    assert set(said) == ALL - {"never y == 1"}
    assert all(one.minimal for one in (test_result, *test_result.others))
    assert test_result.others_bound == ("runs" if strategy == "random" else None)


def test_all_that_is_violated_where_the_trace_ends_is_named() -> None:
    test_result = explored(THREE, "Some")
    two = next(
        one
        for one in (test_result, *test_result.others)
        if one.broken is not None and one.broken.text == "never x == 2"
    )
    assert two.violated_there == ("never x == 2", "never x >= 2 && x < 3")


def test_the_least_execution_may_violate_something_else_with_it() -> None:
    """It was passed over once, and a longer one called the shortest."""
    text = """
soter 1;
topic x: int in [0, 3];
node Picks period 10ms {
  publishes x;
  var n: int in [0, 2] = 0;
  step { publish x = n < 2 ? (choose { 0, 3 }) : (choose { 0, 2 }); n = min(n + 1, 2); }
}
system S { picks: Picks; until 1s; }
test T { system S; horizon 40ms; never x == 3; never x >= 2; }
"""
    system = system_of_text(text, "T")
    later = 0
    for seed in range(1, 12):
        options = replace(SearchOptions(), strategy="random", seed=seed)
        test_result = explore_test(system, options, TraceHeader("small.soter", {}))
        assert test_result.minimal
        assert test_result.broken is not None
        assert test_result.replayed is not None
        later += test_result.broken.index
        assert len(test_result.replayed.steps) == 2, seed
    assert later > 0


def test_without_it_the_first_violation_ends_the_search() -> None:
    test_result = explored(THREE, "Some")
    first = explore_test(test_result.system, SearchOptions(), TraceHeader("small.soter", {}))
    assert first.others == ()
    assert first.broken == test_result.broken


def test_each_has_a_file_of_its_own(tmp_path: Path) -> None:
    test_result = explored(THREE, "Some")
    assert save_traces(test_result, tmp_path) == tmp_path / "small-Some.trace.json"
    names = ["small-Some.trace.json", *(f"small-Some-{i}.trace.json" for i in range(2, 6))]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    for one, name in zip((test_result, *test_result.others), names, strict=True):
        assert (
            trace_from_document(read_document(tmp_path / name), tmp_path / name).broken
            == one.broken
        )


@pytest.mark.long
@pytest.mark.random
def test_random_programs_violate_what_the_enumerator_says() -> None:
    """Without reduction exactly that; with all of it nothing else."""
    several = 0
    for number in seeds(PROGRAMS):
        try:
            system = system_of_text(small_program(number), "T")
            least = set(BruteForce(system).run(6_000).least)
        except (SoterError, AssertionError, TooLargeError):
            continue
        if not least:
            continue
        told = TraceHeader("small.soter", {})
        for reduction in ("none", "all"):
            options = replace(
                SearchOptions(), all_properties=True, reduction=reduction, minimise=0.0
            )
            test_result = explore_test(system, options, told)
            said = {
                (one.broken.what, one.broken.index)
                for one in (test_result, *test_result.others)
                if one.broken is not None
            }
            assert len(texts(test_result)) == len(said)
            assert said == least if reduction == "none" else said <= least, number
        several += len(least) > 1
    assert several > 0
