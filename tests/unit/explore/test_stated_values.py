"""Stand-ins of topics with floats and lists: stated values, and values that nobody tells apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.explore import command, contract_use
from soter.explore.assume_guarantee import wholes
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.explore.results import TestResult

PROGRAM = """soter 1;
type Seen = {{ x: float, y: float, n: int in [0, 1000000], on: bool, trail: float[<=3] }};
topic a: Seen;
topic b: float in [0.0, 10.0];
topic out: int in [0, 3];
node Maker period 10ms {{
  publishes a, b;
  guarantees b <= 5.0;
  var k: int in [0, 3];
  step {{
    k = min(k + 1, 3);
    publish a = {{ x: float(k), y: 0.5 * float(k), n: k, on: k > 1, trail: [float(k)] }};
    publish b = float(k);
  }}
}}
node Reader period 10ms {{
  subscribes a, b;
  publishes out;
  step {{ publish out = {reads}; }}
}}
system S {{ node Maker; node Reader; }}
test AsItIs {{ system S; horizon 40ms; replace Reader by contract; always b <= 5.0; }}
test Replaced {{ system S; horizon 40ms; replace Maker by contract; {states} {asks} }}
"""


def explored(reads: str, states: str, asks: str) -> dict[str, TestResult]:
    program = check_file("p.soter", PROGRAM.format(reads=reads, states=states, asks=asks))
    results = {}
    for name in program.tests:
        told = command.TraceHeader("p.soter", {}, contract_use.replaced_in(program.tests[name]))
        system = system_of_test(program, name)
        results[name] = command.explore_test(system, SearchOptions(minimise=0.0), told)
    return results


def verdict(reads: str, asks: str, states: str = "") -> str:
    return explored(reads, states, asks)["Replaced"].verdict


@pytest.mark.parametrize(
    ("asked", "clean"),
    [("out != 3", True), ("out != 2", False), ("out != 1", False), ("out != 0", False)],
)
def test_a_number_compared_with_constants_has_every_answer_that_the_contract_permits(
    asked: str, clean: bool
) -> None:
    reads = "b > 5.0 ? 3 : b >= 2.0 ? 2 : 1.0 < b ? 1 : 0"
    assert verdict(reads, f"always {asked};") == ("exhausted" if clean else "violated")


def test_unbounded_numbers_are_tried_on_both_sides_and_at_the_constant() -> None:
    for asked in ("a.x < 1.0", "a.x == 1.0", "a.x > 1.0", "a.n > 999999", "a.n == 7"):
        assert verdict(f"{asked} ? 1 : 0", "never out == 1;") == "violated", asked


def test_what_is_read_as_it_is_has_to_be_stated() -> None:
    with pytest.raises(SoterError) as problem:
        verdict("sqrt(a.y) > 1.0 ? 1 : 0", "always true;")
    (told,) = problem.value.diagnostics
    assert told.code == "E015"
    assert "`a.y`" in told.message
    assert (
        verdict("a.trail.len", "never out == 3;", "assumes a.trail in { [1.0], [] };")
        == "exhausted"
    )
    assert (
        verdict("a.trail.len", "never out == 1;", "assumes a.trail in { [1.0], [] };") == "violated"
    )


READS = "sqrt(a.y) > 1.0 ? 1 : 0"


def test_who_runs_as_it_is_is_held_to_the_values() -> None:
    right = explored(READS, "guarantees a.y in { 0.5, 1.0, 1.5 };", "always true;")
    assert {r.verdict for r in right.values()} == {"exhausted"}
    (whole,) = wholes(right.values())
    assert not whole.missing
    assert not whole.tried
    wrong = explored(READS, "guarantees a.y in { 0.5, 1.0 };", "always true;")
    assert wrong["AsItIs"].verdict == "violated"
    assert wrong["AsItIs"].replayed is not None
    assert wrong["AsItIs"].broken is not None
    assert wrong["AsItIs"].broken.text.startswith(
        "guarantees a.y in { 0.5, 1.0 }, as Replaced has it"
    )
    (whole,) = wholes(wrong.values())
    assert whole.missing


def test_values_that_nobody_is_held_to_are_an_assumption() -> None:
    results = explored(READS, "assumes a.y in { 0.5 };", "never out == 1;")
    assert {r.verdict for r in results.values()} == {"exhausted"}
    assert any("a.y in { 0.5 } alone" in s for s in results["Replaced"].assumptions)
    (whole,) = wholes(results.values())
    assert whole.tried == (("Replaced", "a.y in { 0.5 }"),)
    assert "Nothing is assumed" not in whole.text
