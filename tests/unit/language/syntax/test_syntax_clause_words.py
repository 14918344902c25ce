"""Clauses of an item: in any order, each of them once."""

from __future__ import annotations

import re
from itertools import permutations

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Source
from soter.language.syntax.parsing.parser import parse
from tables import all_rows

BODIES = {
    "plant": "plant P period 10ms {{ {} }}",
    "system": "system S {{ a: P; {} }}",
    "top": "{}",
}
"""Programs that lack one item, or one declaration."""


def errors(text: str) -> tuple[Diagnostic, ...]:
    diagnostics = Diagnostics()
    parse(Source("t.soter", f"soter 1;\n{text}\n"), diagnostics)
    return diagnostics.items


def test_a_brace_that_is_lost_before_an_item_is_still_told() -> None:
    codes = [d.code for d in errors("node N period 10ms { step { let a = 1.0;\n subscribes t; }")]
    assert codes == ["S012"]


ORDERED = (
    ("top", "topic speed: float", ("in [0.0, 2.0]", "= 0.5", "max_age 20ms", "static"), ";"),
    ("top", "param GAIN: float", ("= 0.5", "in [0.0, 2.0]"), ";"),
    ("plant", "state x: float", ("in [0.0, 2.0]", "= 0.5"), ";"),
    ("plant", "disturbance w: float", ("in [0.0, 2.0]", "hold 1s"), ";"),
    ("system", "input goal", ("in { 1.0, 2.0 }", "every 1s"), ";"),
    ("system", "external topic t", ("every 1s", "delayed 1ms", "measured t within 0.1"), ";"),
    ("top", "node Lamp", ("period 10ms", "phase 2ms"), " { step { } }"),
    ("top", "extern node Lamp", ("period 10ms", "phase 2ms", 'from "c:a"'), " { }"),
    ("top", "extern plant Arm", ("period 10ms", 'from "c:a"'), " { }"),
)
SHUFFLED = [
    (body, head, order, clauses, end)
    for body, head, clauses, end in ORDERED
    for order in permutations(clauses)
    if order != clauses
]


def spoken(text: str) -> str:
    """The tree of a text, without the places where its parts stand."""
    tree = parse(Source("t.soter", f"soter 1;\n{text}\n"), Diagnostics())
    return re.sub(r"Span\(source=Source\(name='t.soter'\), start=\d+, end=\d+\)", "", repr(tree))


@all_rows(("body", "head", "order", "clauses", "end"), SHUFFLED)
def test_the_order_of_clauses_says_nothing(
    body: str, head: str, order: tuple[str, ...], clauses: tuple[str, ...], end: str
) -> None:
    right, other = (BODIES[body].format(f"{head} {' '.join(c)}{end}") for c in (clauses, order))
    assert not errors(right)
    assert not errors(other)
    assert spoken(other) == spoken(right)


@all_rows(("body", "head", "clauses", "end"), ORDERED)
def test_a_clause_stands_once(body: str, head: str, clauses: tuple[str, ...], end: str) -> None:
    for again in clauses:
        text = BODIES[body].format(f"{head} {' '.join((*clauses, again))}{end}")
        assert len(errors(text)) == 1, text
