"""Helps that are edits: made, told, applied."""

from __future__ import annotations

import pytest

from soter.diagnostics.diagnostic import Diagnostics, Edit, Fix, Source, Span
from soter.diagnostics.fixes import append, apply_fix, insert, remove, replace
from soter.diagnostics.render import render, to_json

SOURCE = Source("a.soter", "let a = 1;\n  let b = 2;\nlet c = 3;\n")


def span(text: str, source: Source = SOURCE) -> Span:
    start = source.text.index(text)
    return Span(source, start, start + len(text))


def test_title_of_a_replacement_is_what_to_write() -> None:
    fix = replace(span("1"), "1.0")
    assert fix.title == "write `1.0`"
    assert apply_fix(fix) == {SOURCE: "let a = 1.0;\n  let b = 2;\nlet c = 3;\n"}


def test_text_is_put_in_front_or_behind() -> None:
    assert apply_fix(insert(span("1"), "-"))[SOURCE].startswith("let a = -1;")
    assert apply_fix(append(span("1"), "ms"))[SOURCE].startswith("let a = 1ms;")


def test_what_fills_its_line_goes_with_the_line() -> None:
    assert apply_fix(remove(span("let b = 2;"), "remove it"))[SOURCE] == "let a = 1;\nlet c = 3;\n"
    assert apply_fix(remove(span("= 2"), "remove it"))[SOURCE].split("\n")[1] == "  let b ;"
    assert (
        apply_fix(remove(span("let c = 3;"), "remove it"))[SOURCE] == "let a = 1;\n  let b = 2;\n"
    )


def test_edits_belong_together_in_any_order_and_over_several_files() -> None:
    other = Source("b.soter", "x")
    edits = (Edit(span("3"), "4"), Edit(span("1"), "2"), Edit(span("x", other), "y"))
    after = apply_fix(Fix("count on", edits))
    assert after == {SOURCE: "let a = 2;\n  let b = 2;\nlet c = 4;\n", other: "y"}


def test_overlapping_edits_are_refused() -> None:
    with pytest.raises(ValueError, match="overlap"):
        apply_fix(Fix("twice", (Edit(span("a = 1"), "x"), Edit(span("= 1;"), "y"))))


def test_fix_of_a_diagnostic_is_a_help_line_and_an_edit() -> None:
    diagnostics = Diagnostics()
    diagnostics.error("N001", "m", span("b"), helps=("think", replace(span("b"), "c")))
    diagnostic = diagnostics.items[0]
    assert diagnostic.helps == ("think", "write `c`")
    assert [f.title for f in diagnostic.fixes] == ["write `c`"]
    assert render(diagnostic).endswith("= help: think\n   = help: write `c`")
    assert to_json(diagnostic)["fixes"] == [
        {
            "title": "write `c`",
            "edits": [
                {
                    "file": "a.soter",
                    "line": 2,
                    "column": 7,
                    "end_line": 2,
                    "end_column": 8,
                    "text": "c",
                }
            ],
        }
    ]
