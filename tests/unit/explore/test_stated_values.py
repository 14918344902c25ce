"""Stand-ins of topics with floats and lists: stated values, and values that nobody tells apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.explore import assumptions, command
from soter.explore.results import wholes_by_parts
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


def explored(reads: str, states: str, asks: str, without: str = "") -> dict[str, TestResult]:
    """All its tests; `without`: one that is left out of the program."""
    text = PROGRAM.format(reads=reads, states=states, asks=asks)
    lines = [line for line in text.splitlines() if not without or f"test {without} " not in line]
    return every_test("\n".join(lines))


def every_test(text: str) -> dict[str, TestResult]:
    program = check_file("p.soter", text)
    results = {}
    for name in program.tests:
        told = command.TraceHeader(
            "p.soter", {}, assumptions.replacements_in_test(program.tests[name])
        )
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


@pytest.mark.whole
def test_unbounded_numbers_are_tried_on_both_sides_and_at_the_constant() -> None:
    for asked in ("a.x < 1.0", "a.x == 1.0", "a.x > 1.0", "a.n > 999999", "a.n == 7"):
        assert verdict(f"{asked} ? 1 : 0", "never out == 1;") == "violated", asked


def test_what_is_read_as_it_is_has_to_be_stated() -> None:
    with pytest.raises(SoterError) as problem:
        verdict("sqrt(a.y) > 1.0 ? 1 : 0", "always true;")
    (told,) = problem.value.diagnostics
    assert told.code == "E015"
    assert "`a.y`" in told.message
    assert [h for h in told.helps if "`guarantees a.y in {" in h]
    assert [h for h in told.helps if "`assumes a.y in {" in h]
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
    (whole,) = wholes_by_parts(right.values())
    assert not whole.missing
    assert "Nothing is assumed" in whole.text
    wrong = explored(READS, "guarantees a.y in { 0.5, 1.0 };", "always true;")
    assert wrong["AsItIs"].verdict == "violated"
    assert wrong["AsItIs"].replayed is not None
    assert wrong["AsItIs"].broken is not None
    assert wrong["AsItIs"].broken.text.startswith(
        "guarantees a.y in { 0.5, 1.0 }, as Replaced has it"
    )
    (whole,) = wholes_by_parts(wrong.values())
    assert whole.missing


def test_values_that_are_assumed_are_asked_where_their_publisher_runs() -> None:
    wrong = explored(READS, "assumes a.y in { 0.5 };", "never out == 1;")
    assert wrong["Replaced"].verdict == "exhausted"
    assert wrong["AsItIs"].verdict == "violated"
    assert wrong["AsItIs"].replayed is not None
    assert wrong["AsItIs"].broken is not None
    assert (
        wrong["AsItIs"].broken.text == "guarantees a.y in { 0.5 }, as Replaced assumes it, in Maker"
    )
    (whole,) = wholes_by_parts(wrong.values())
    assert whole.missing
    right = explored(READS, "assumes a.y in { 0.5, 1.0, 1.5 };", "always true;")
    assert {r.verdict for r in right.values()} == {"exhausted"}
    assert any(
        "alone: that it publishes no other is asked by `AsItIs`" in s
        for s in right["Replaced"].assumptions
    )
    (whole,) = wholes_by_parts(right.values())
    assert not whole.missing


def test_values_that_no_test_asks_for_are_an_assumption() -> None:
    results = explored(READS, "assumes a.y in { 0.5 };", "never out == 1;", without="AsItIs")
    assert results["Replaced"].verdict == "exhausted"
    told = [s for s in results["Replaced"].assumptions if "a.y in { 0.5 } alone" in s]
    assert len(told) == 1
    assert told[0].endswith("do no harm is assumed")
    (whole,) = wholes_by_parts(results.values())
    assert whole.missing == (
        "Maker is replaced by its contract and runs as it is in no test that is asked",
    )


WILD = """node Wild period 10ms {
  publishes a, b;
  step {
    publish a = { x: 0.0, y: 9.0, n: 0, on: false, trail: [] };
    publish b = 0.0;
  }
}
system S {"""


@pytest.mark.parametrize("said", ["guarantees", "assumes"])
def test_who_the_system_puts_in_a_place_is_held_to_the_values_and_who_a_test_does_is_not(
    said: str,
) -> None:
    states = f"{said} a.y in {{ 0.5, 1.0, 1.5 }};"
    text = PROGRAM.format(reads=READS, states=states, asks="always true;")
    text = text.replace("system S {", WILD)
    by_test = text.replace("replace Reader by", "replace Maker by Wild; replace Reader by")
    assert every_test(by_test)["AsItIs"].verdict == "exhausted"
    (whole,) = wholes_by_parts(every_test(by_test).values())
    assert whole.missing
    by_system = text.replace("node Reader; }", "node Reader; replace Maker by Wild; }")
    assert every_test(by_system)["AsItIs"].verdict == "violated"
