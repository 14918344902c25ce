"""Words of Soter in a wrong place: told where they belong, never taken for a missing `;`."""

from __future__ import annotations

import re
from itertools import permutations
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Source, applied
from soter.language.syntax import words as clause_words
from soter.language.syntax.parser import parse
from soter.language.syntax.parsing import declarations, modules, systems
from soter.language.syntax.words import places, word_table
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Collection

#: Programs that lack one item, or one declaration.
BODIES = {
    "node": "node N period 10ms {{ {} step {{ }} }}",
    "node without a step": "node N period 10ms {{ {} }}",
    "step": "node N period 10ms {{ step {{ {} }} }}",
    "rta": "rta M {{ {} }}",
    "verify": "rta M {{ verify {{ {} }} }}",
    "plant": "plant P period 10ms {{ {} }}",
    "system": "system S {{ a: P; {} }}",
    "test": "test T {{ system S; {} }}",
    "faults": "system S {{ a: P; faults {{ {} }} }}",
    "function": "fun f(): float {{ {} return 1.0; }}",
    "top": "{}",
}
FORMS = sorted({(word, home.form) for word, homes in places().items() for home in homes})


def errors(text: str) -> tuple[Diagnostic, ...]:
    diagnostics = Diagnostics()
    parse(Source("t.soter", f"soter 1;\n{text}\n"), diagnostics)
    return diagnostics.items


def filled(form: str) -> str:
    return form.replace("{ ... }", "{ step { } }" if form.startswith("node") else "{ }")


@all_rows(("word", "form"), FORMS)
def test_what_a_word_is_told_to_look_like_is_soter(word: str, form: str) -> None:
    assert word in form
    assert any(not errors(body.format(filled(form))) for body in BODIES.values())


def test_every_word_of_an_item_has_a_place() -> None:
    tables = (
        declarations.NODE_ITEMS, modules.RTA_ITEMS, declarations.PLANT_ITEMS,
        systems.SYSTEM_ITEMS, systems.TEST_ITEMS, systems.FAULT_ITEMS, modules.VERIFY_ITEMS,
        modules.VIEW_ITEMS,
    )  # fmt: skip
    words = {word for table in tables for word in table}
    # Words of declarations and statements, too: they are told by what follows them.
    assert words - set(places()) == {"var", "let", "for", "node", "system"}


ITEMS_OF: dict[str, Collection[str]] = {
    "node": declarations.NODE_ITEMS,
    "node without a step": declarations.NODE_ITEMS,
    "rta": modules.RTA_ITEMS,
    "verify": modules.VERIFY_ITEMS,
    "plant": declarations.PLANT_ITEMS,
    "system": systems.SYSTEM_ITEMS,
    "test": systems.TEST_ITEMS,
    "faults": systems.FAULT_ITEMS,
}


def elsewhere() -> list[tuple[str, str, str]]:
    return [
        (body, word, form)
        for body in BODIES
        for word, form in FORMS
        if errors(BODIES[body].format(filled(form)))
        and not any(form.startswith(w) for w in ("node", "topic", "system"))
        and form.startswith(word)
        and word not in ITEMS_OF.get(body, ())
    ]


@all_rows(("body", "word", "form"), elsewhere)
def test_an_item_of_another_body_is_told_where_it_belongs(body: str, word: str, form: str) -> None:
    first, *_ = errors(BODIES[body].format(filled(form)))
    told = " ".join([first.message, *first.notes, *first.helps])
    assert first.primary is not None
    assert first.primary.span.text.split()[0] == word
    assert "missing" not in first.primary.text
    assert "belong" in told or "write `" in told or first.code == "S015", told


def test_many_items_of_other_bodies_were_tried() -> None:
    tried = elsewhere()
    assert len(tried) > 300
    assert {body for body, _, _ in tried} == set(BODIES)


def test_a_brace_that_is_lost_before_an_item_is_still_told() -> None:
    codes = [d.code for d in errors("node N period 10ms { step { let a = 1.0;\n subscribes t; }")]
    assert codes == ["S012"]


# ---------------------------------------------------------------- clauses behind another item

ITEMS = {
    "node": ("subscribes motion", "publishes accel", "var last: float", "failsafe accel = 0.0"),
    "plant": ("reads accel", "drives motion = x", "state x: float"),
    "top": ("topic motion: float", "const A: float = 1.0", "type Speed = float"),
    "step": ("let a = 1.0", "publish accel = 1.0", "var n: int = 0"),
    "system": ("module Guard", "node Lamp", "always x < 1.0"),
}
CLAUSES = (
    "max_age 20ms", "within 0.1", "queue 4", "hold 1s", "every 100ms", "phase 2ms",
    "period 10ms", "default", "delayed 5ms", "substeps 4", "drop_oldest",
)  # fmt: skip


def behind() -> list[tuple[str, str, str]]:
    return [
        (body, item, clause)
        for body, items in ITEMS.items()
        for item in items
        for clause in CLAUSES
        if errors(BODIES[body].format(f"{item} {clause};"))
        and not (item == "node Lamp" and clause[:1] == "p")  # a node that is declared there
    ]


@all_rows(("body", "item", "clause"), behind)
def test_a_clause_of_another_item_is_never_a_missing_semicolon(
    body: str, item: str, clause: str
) -> None:
    first, *_ = errors(BODIES[body].format(f"{item} {clause};"))
    word = clause.split(maxsplit=1)[0]
    if clause in ("default", "drop_oldest"):  # one word, which may be a name
        return
    assert first.primary is not None
    assert first.primary.span.text == word
    assert any(f"`{word}` belongs" in note for note in first.notes), first


@pytest.mark.parametrize(
    ("body", "item"),
    [
        ("node", "var last: float in [-1.0, 1.0];"),
        ("step", "var last: float in [-1.0, 1.0];"),
        ("step", "let last = 0.5 in [-1.0, 1.0];"),
        ("node", "subscribes motion in [-1.0, 1.0];"),
        ("node", "publishes accel in [-1.0, 1.0];"),
        ("plant", "drives motion = x in [-1.0, 1.0];"),
        ("top", "const A: float = 1.0 in [-1.0, 1.0];"),
        ("top", "type Speed = float in [-1.0, 1.0];"),
    ],
)
def test_a_range_where_none_stands_is_told_what_to_do(body: str, item: str) -> None:
    first, *_ = errors(BODIES[body].format(item))
    assert first.primary is not None
    assert first.primary.span.text == "in"
    assert "missing" not in first.primary.text
    assert first.helps


def test_a_clause_of_a_topic_behind_its_name_moves_to_its_declaration() -> None:
    text = (
        "topic speed: float = 0.0;\nnode N period 10ms { subscribes speed max_age 30ms; step { } }"
    )
    (first,) = errors(text)
    (fix,) = first.fixes
    (mended,) = applied(fix).values()
    assert "topic speed: float = 0.0 max_age 30ms;" in mended
    assert "subscribes speed;" in mended
    text = text.replace(" max_age 30ms", " in [0.0, 2.0]")
    (fix,) = errors(text)[0].fixes
    (mended,) = applied(fix).values()
    assert "topic speed: float in [0.0, 2.0] = 0.0;" in mended


def test_a_clause_that_the_topic_has_already_is_left_out() -> None:
    (first,) = errors(
        "topic speed: float max_age 9ms;\n"
        "node N period 10ms { subscribes speed max_age 30ms, other; step { } }"
    )
    (fix,) = first.fixes
    (mended,) = applied(fix).values()
    assert "subscribes speed, other;" in mended


# ---------------------------------------------------------------- the order of clauses

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


# ---------------------------------------------------------------- statements beside a step


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("state h: float; h = h + u;", "state h: float; next h = h + u;"),
        ("state h: float; h = h + 0.01 * (u - h);", "state h: float; der h = u - h;"),
        ("state h: float; h = h + v * dt;", "state h: float; der h = v;"),
        ("state h: float; drag = 0.1 * h;", "state h: float; let drag = 0.1 * h;"),
        ("publish motion = x;", "drives motion = x;"),
        ("var h: float;", "state h: float;"),
    ],
)
def test_a_statement_in_a_plant_is_the_equation_that_was_meant(wrong: str, right: str) -> None:
    first, *_ = errors(BODIES["plant"].format(wrong))
    (mended,) = applied(first.fixes[0]).values()
    assert mended == f"soter 1;\n{BODIES['plant'].format(right)}\n"


@all_rows("body", ["plant", "rta", "system", "test", "verify", "faults"])
@all_rows("statement", ["if x { y = 1; }", "for i in 0..3 { y = i; }", "return x;"])
def test_only_a_node_is_told_of_its_step(body: str, statement: str) -> None:
    problems = errors(BODIES[body].format(statement))
    if body in ("system", "test") and statement[:3] == "for":
        return  # a loop over items
    (first,) = problems
    assert "stand inside a `step { ... }` block" not in first.notes, first


# ---------------------------------------------------------------- items of other tools

EXAMPLES = {
    ("node", "subscribes"): "subscribes motion;",
    ("node", "publishes"): "publishes accel;",
    ("node without a step", "step"): "step {{ }}",
    ("node", "var"): "var n: int;",
    ("node", "assumes"): "assumes motion < 1.0;",
    ("node", "guarantees"): "guarantees accel < 1.0;",
    ("plant", "reads"): "reads accel;",
    ("plant", "drives"): "drives motion = x;",
    ("plant", "disturbance"): "disturbance w: float in [0.0, 1.0];",
    ("plant", "state"): "state x: float;",
    ("plant", "der"): "der x = v;",
    ("plant", "next"): "next x = v;",
    ("plant", "let"): "let y = v;",
    ("plant", "measured"): "measured motion within 0.1;",
    ("plant", "integrate"): "integrate euler;",
    ("rta", "ac"): "ac Fast;",
    ("rta", "sc"): "sc Careful;",
    ("rta", "period"): "period 50ms;",
    ("rta", "safe"): "safe x < 1.0;",
    ("rta", "ttf"): "ttf x > 0.5;",
    ("system", "always"): "always x < 1.0;",
    ("system", "never"): "never x > 1.0;",
    ("system", "until"): "until 10s;",
    ("system", "node"): "node Lamp {{ a = b }};",
    ("system", "module"): "module Guard {{ a = b }};",
    ("system", "set"): "set GAIN = 1.0;",
    ("test", "always"): "always x < 1.0;",
    ("test", "never"): "never x > 1.0;",
    ("test", "eventually"): "eventually x > 1.0 within 1s;",
    ("test", "horizon"): "horizon 10ms;",
    ("test", "replace"): "replace Fast by Slow;",
    ("test", "set"): "set GAIN = 1.0;",
}
WORDS_OF = word_table("words")["item"]
WORDS = [
    (body, example.replace("{{", "{").replace("}}", "}"), item, word)
    for (body, item), example in EXAMPLES.items()
    for word in WORDS_OF[body.split()[0]][item].split()
]


def test_every_item_of_the_table_has_an_example() -> None:
    known = {(body, item) for body, items in WORDS_OF.items() for item in items}
    assert {(body.split()[0], item) for body, item in EXAMPLES} == known


@all_rows(("body", "example", "item", "word"), WORDS)
def test_an_item_of_another_tool_is_read_as_the_one_that_is_meant(
    body: str, example: str, item: str, word: str
) -> None:
    right = BODIES[body].format(example)
    assert not errors(right)
    wrong = BODIES[body].format(word + example[len(item) :])
    problems = errors(wrong)
    if not problems:  # `name: What` of a system, a word that Soter has
        return
    first = problems[0]
    assert len(problems) == 1, [d.message for d in problems]
    if first.code == "S015":  # a phrase says it
        return
    texts = [text for fix in first.fixes for text in applied(fix).values()]
    assert f"soter 1;\n{right}\n" in texts, (first.message, first.helps)


@pytest.mark.parametrize(
    ("body", "item"),
    [
        ("system", "reward -abs(x);"),
        ("system", "connect a b;"),
        ("node", "init { }"),
        ("plant", "initial x = 0.0;"),
        ("test", "print x;"),
        ("system", "rate 10ms;"),
    ],
)
def test_what_soter_has_no_item_for_is_told_what_to_do(body: str, item: str) -> None:
    first, *_ = errors(BODIES[body].format(item))
    assert first.helps
    assert first.primary is not None
    assert first.primary.span.text == item.split(maxsplit=1)[0]


def test_the_bodies_are_told_apart_by_their_items() -> None:
    assert clause_words.body_of(declarations.NODE_ITEMS, 0) == "node"
    assert clause_words.body_of(declarations.NODE_ITEMS, 1) == "step"
    assert clause_words.body_of(modules.RTA_ITEMS, 0) == "rta"
    assert clause_words.body_of(declarations.PLANT_ITEMS, 0) == "plant"
    assert clause_words.body_of(systems.SYSTEM_ITEMS, 0) == "system"
    assert clause_words.body_of(systems.TEST_ITEMS, 0) == "test"
    assert clause_words.body_of(modules.VERIFY_ITEMS, 0) == "verify"
    assert clause_words.body_of(systems.FAULT_ITEMS, 0) == "faults"
    assert clause_words.body_of((), 1) == "function"
    assert clause_words.body_of((), 0) == "top"


@all_rows(("word", "form"), FORMS)
def test_what_belongs_into_a_verify_block_is_shown_in_one(word: str, form: str) -> None:
    """Also where the `;` behind it is missing."""
    homes = [h for h in places()[word] if h.where == "in the `verify` block of an `rta`"]
    if form not in [h.form for h in homes] or word == "view":
        return
    for written in {form, form.removesuffix(";") if " " in form else form}:
        (said, *_) = errors(f"rta M {{ {written} }}")
        assert f"`{word}` belongs in" in said.notes[0]
        assert f"`verify {{ {word}" in str(said.helps[0])
