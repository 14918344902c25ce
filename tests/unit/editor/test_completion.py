"""What is offered at a place, also while the program around it is broken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from lsprotocol import types as lsp

from editor_client import Editor, place
from soter.editor.completion import cursor_at
from soter.editor.language_words import PLACES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

HERE = "@@"


@pytest.fixture
def offered(served: Editor, wall: Path) -> Callable[[str, str], list[str]]:
    """The labels at `@@`, where some words of the cart are replaced by others."""
    path = wall / "cart.soter"
    text = path.read_text(encoding="utf-8")
    uri, diagnostics = served.checked(path)
    assert diagnostics == []

    def ask(words: str, instead: str) -> list[str]:
        assert words in text
        broken = text.replace(words, instead, 1)
        at = place(broken, HERE)
        served.type(uri, broken.replace(HERE, ""))
        params = lsp.CompletionParams(lsp.TextDocumentIdentifier(uri), at)
        items = served.ask(served.client.text_document_completion_async(params))
        return [item.label for item in items]

    return ask


def test_words_by_place(offered: Callable[[str, str], list[str]]) -> None:
    assert offered("node Fast", "@@\nnode Fast") == list(PLACES["file"])
    assert offered("  sc Careful;", "  sc Careful;\n  @@") == list(PLACES["rta"])
    assert offered("  reads accel;", "  @@\n  reads accel;") == list(PLACES["plant"])
    assert offered("until 30s;", "@@\n  until 30s;") == list(PLACES["system"])
    assert offered("    late dm", "    @@\n    late dm") == list(PLACES["verify"])
    assert offered("publish accel = clamp(4", "@@ publish accel = clamp(4") == list(PLACES["block"])


def test_fields_behind_a_dot(offered: Callable[[str, str], list[str]]) -> None:
    assert offered("clamp(-2.0 * motion.x", "clamp(-2.0 * motion.@@") == ["x", "v"]
    assert offered("clamp(-2.0 * motion.x", "clamp(-2.0 * motion.@@\n  }\n") == ["x", "v"]
    assert offered("abs(m.x)", "abs(m.@@)") == ["x", "v"]  # an argument
    assert offered("let v = max", "let v = { a: speed, b: 1.0 }; let w = v.@@ + max") == ["a", "b"]
    assert offered("Clear(c.truth)", "Clear(c.@@)") == ["truth"]
    assert offered("Clear(c.truth)", "c.truth.@@ > 1.0") == ["x", "v"]
    assert offered("Clear(c.truth)", "mode(SafeCart) == Mode.@@") == ["AC", "SC"]


def test_names_of_the_kind_that_is_asked_for(offered: Callable[[str, str], list[str]]) -> None:
    assert offered("publish accel = clamp(4", "publish @@ = clamp(4") == ["motion", "goal", "accel"]
    assert offered("subscribes motion, goal;", "subscribes motion, @@") == [
        "motion", "goal", "accel",
    ]  # fmt: skip
    assert offered("  ac Fast;", "  ac @@") == ["Fast", "Careful"]
    assert offered("  module SafeCart;", "  module @@") == ["SafeCart"]
    assert {"Cart", "SafeCart", "Fast"} < set(offered("c: Cart;", "c: @@"))
    assert offered("let v = max", "let @@ = max") == []
    types = offered("let v = max", "let v: @@ = max")
    assert types[:4] == ["bool", "int", "float", "duration"]
    assert "Motion" in types
    assert "WALL" not in types


def test_what_moves_at_rest_is_a_topic_and_how_far_a_value(
    offered: Callable[[str, str], list[str]],
) -> None:
    end = "within 3s;"
    assert offered("ttf ", f"rest goal < 0.0 moves @@ {end} ttf ") == ["motion", "goal", "accel"]
    more = f"rest goal < 0.0 moves motion.x by WALL down, @@ {end} ttf "
    assert offered("ttf ", more) == ["motion", "goal", "accel"]
    assert offered("ttf ", f"rest goal < 0.0 moves motion.@@ {end} ttf ") == ["x", "v"]
    assert "WALL" in offered("ttf ", f"rest goal < 0.0 moves motion.x by @@ {end} ttf ")


def test_an_index_of_an_axis_is_a_value(offered: Callable[[str, str], list[str]]) -> None:
    axis = "grid motion.x in"
    assert offered(axis, "grid motion.@@ in") == ["x", "v"]
    assert "WALL" in offered(axis, "grid motion.x[@@] in")


def test_values_in_reach(offered: Callable[[str, str], list[str]]) -> None:
    labels = offered("return v * v", "return @@ v * v")
    assert {"v", "speed", "tau", "WALL", "Clear", "clamp", "sqrt", "true"} < set(labels)
    assert "m" not in labels  # the argument of another function
    assert "Fast" not in labels


def test_locals_of_a_body_that_does_not_parse(offered: Callable[[str, str], list[str]]) -> None:
    labels = offered("return v * v / (2.0", "let w = ((v * @@ return ) v * v / (2.0")
    assert {"v", "speed", "tau"} < set(labels)


def test_nothing_in_comments_and_strings(offered: Callable[[str, str], list[str]]) -> None:
    assert offered("// Safe: returns", "// Safe: @@ returns") == []
    assert offered("const A:", 'import "ca@@') == []


@pytest.mark.parametrize(
    ("text", "body", "item"),
    [
        ("node N period 10ms {\n  step { if a > 1.0 { ", "block", ()),
        ("node N period 10ms {\n  step { if a > 1.0 { } let b = ", "block", ("let", "b", "=")),
        ("rta M { verify { view east { ", "view", ()),
        ("system S { for i in 0..3 { ", "system", ()),
        ("system S { r: Robot { set K = 1 }; ", "system", ()),
        ("topic t: T in { x in [0, 1] }; ", "file", ()),
        ("} } } ; ", "file", ()),
    ],
)
def test_the_place_is_told_from_what_stands_before(
    text: str, body: str, item: tuple[str, ...]
) -> None:
    cursor = cursor_at(text, len(text))
    assert (cursor.body, cursor.item) == (body, item)
