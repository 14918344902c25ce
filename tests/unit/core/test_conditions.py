"""Conditions of generated C: where they stand, and what runs show of each."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from soter.api import load
from soter.codegen import c_tree as c
from soter.codegen.conditions import conditions_of, functions_called, watching, why_unshown
from soter.codegen.unit import generate
from soter.simulate.run import NativeProgram

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
A, C = c.Name("a"), c.Name("c")


def test_each_condition_stands_in_its_line() -> None:
    unit = generate(load(EXAMPLES / "drone" / "battery.soter").declared())
    lines = unit.source.splitlines()
    found = conditions_of(unit.tree, unit.source)
    assert len(found) > 20
    for x in found:
        below = " ".join(" ".join(lines[x.line - 1 : x.line + 40]).split())
        assert x.decision in below, x
        assert x.decision.split()[0] in lines[x.line - 1], x


def test_counters_change_no_byte_of_a_run_and_stay_out_of_what_nobody_watches() -> None:
    flat = load(CART).declared("Protected")
    plain = NativeProgram(flat)
    with watching() as seen:
        counted = NativeProgram(flat)
        assert not any(seen().values())
        first, second = (p.run(3_000_000_000, 3, hash_trace=True) for p in (plain, counted))
        assert any(seen().values())
    assert first.trace_sha256 == second.trace_sha256
    assert "soter_outcome" in counted.unit.source
    assert "soter_outcome" not in plain.unit.source


def test_a_run_shows_what_it_evaluated() -> None:
    flat = load(CART).declared("Protected")
    unit = generate(flat)
    at = {x.text: x for x in conditions_of(unit.tree, unit.source) if x.function == "cart_switch"}
    with watching() as seen:
        NativeProgram(flat).run(10_000_000_000, 1)
        shown = seen()
    why = {text: why_unshown(shown[x.key[:2]], x.key[2]) for text, x in at.items()}
    assert why["ttf"] == why["mode == SOTER_AC"] == ""
    assert why["gate_fault"] == "never true"
    assert why["clean"] == "never false"


def test_what_ran_before_somebody_watched_is_not_shown() -> None:
    """A process that loads a library twice has one copy of its counters."""
    flat = load(CART).declared("Protected")
    with watching() as seen:
        NativeProgram(flat).run(10_000_000_000, 1)
        first = seen()
    with watching() as seen:
        program = NativeProgram(flat)
        assert any(first.values())
        assert not any(seen().values())
        program.run(10_000_000_000, 1)
        NativeProgram(flat)
        assert seen() == first


@pytest.mark.parametrize(
    ("decision", "rows", "said"),
    [
        ("or", "FF", ("never true", "never true")),
        ("or", "FF T-", ("", "never true")),
        ("or", "FF T- FT", ("", "")),
        ("and", "TT", ("never false", "never false")),
        ("and", "F-", ("never true", "never evaluated")),
        ("and", "TT F-", ("", "never false")),
        ("and", "TF F-", ("true and false, but it never decided alone", "never true")),
    ],
)
def test_a_condition_is_covered_where_it_alone_changes_the_outcome(
    decision: str, rows: str, said: tuple[str, str]
) -> None:
    vectors = set()
    for row in rows.split():
        seen = sum(1 << k for k, letter in enumerate(row) if letter != "-")
        true = sum(1 << k for k, letter in enumerate(row) if letter == "T")
        outcome = "T" in row if decision == "or" else "F" not in row
        vectors.add((seen, true, outcome))
    assert tuple(why_unshown(vectors, k) for k in range(2)) == said


def test_two_conditions_that_change_together_cover_neither() -> None:
    """`a && (b || c)`: of all evaluations each is covered, of two that differ in two none."""
    vectors = set()
    for a, b, d in product((False, True), repeat=3):
        seen = 1 if not a else 3 if b else 7
        vectors.add((seen, (a + 2 * b + 4 * d) & seen, a and (b or d)))
    assert [why_unshown(vectors, k) for k in range(3)] == ["", "", ""]
    assert (
        why_unshown({(7, 7, True), (7, 1, False)}, 1)
        == "true and false, but it never decided alone"
    )


def test_functions_are_reached_over_calls_and_over_names() -> None:
    def f(name: str, *body: c.CStmt) -> c.FunctionDef:
        return c.FunctionDef("bool", name, (), body)

    functions = {
        "a": f("a", c.IfStmt(c.CallExpr("b", ()), (c.Return(C),))),
        "b": f("b", c.Return(c.Name("c"))),
        "c": f("c", c.Return(A)),
        "d": f("d", c.Return(c.CallExpr("a", ()))),
    }
    assert functions_called(functions, ["b", "absent"]) == {"b", "c", "a"}
    assert functions_called({n: functions[n] for n in "bcd"}, ["c"]) == {"c"}
