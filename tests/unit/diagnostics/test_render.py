"""Diagnostics as text and as data."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Label, Severity, Source, Span
from soter.diagnostics.render import render, render_all, safe, summary, to_json

if TYPE_CHECKING:
    from collections.abc import Callable

DRONE = Source(
    "drone.soter",
    "\n" * 37
    + """rta SafeMotionPrimitive {
  period 100ms;
  ac MotionPrimitive;
  sc MotionPrimitiveSC;
  safe  PhiSafe_MPr(localPosition);
}
""",
)


def span(source: Source, text: str, nth: int = 1) -> Span:
    """The span of the nth occurrence of a text."""
    at = -1
    for _ in range(nth):
        at = source.text.index(text, at + 1)
    return Span(source, at, at + len(text))


def slower(severity: Severity = Severity.ERROR) -> Diagnostic:
    """The example of the design document."""
    return Diagnostic(
        "P1a",
        "`MotionPrimitiveSC` is slower than its decision module",
        Label(span(DRONE, "MotionPrimitiveSC"), "steps every 150 ms"),
        (Label(span(DRONE, "100ms"), "the decision module samples every 100 ms"),),
        ("a switch could come too late: P1a needs period(SC) <= \u0394",),
        ("set the node's period to 100ms or less, or raise \u0394 to 150ms",),
        severity,
    )


def one_line(text: str, *labels: tuple[str, str]) -> Diagnostic:
    """A diagnostic in a one-line file: the first label is the primary one."""
    source = Source("line.soter", text)
    made = [Label(span(source, part), words) for part, words in labels]
    return Diagnostic("X001", "a message", made[0], tuple(made[1:]))


def test_the_example_of_the_design_looks_like_the_golden(
    golden: Callable[[str, str], None],
) -> None:
    golden("diagnostics/design_example.txt", render(slower()) + "\n")


def test_colours_wrap_text_and_change_nothing_else(golden: Callable[[str, str], None]) -> None:
    import re

    coloured = render(slower(Severity.WARNING), color=True)
    golden("diagnostics/design_example_colour.txt", coloured + "\n")
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured) == render(slower(Severity.WARNING))


def test_diagnostic_without_a_place_has_no_source_lines() -> None:
    plain = Diagnostic("U001", "no file `x.soter`", helps=("check the path",))
    assert render(plain) == "error[U001]: no file `x.soter`\n   = help: check the path"


def test_labels_on_one_line_are_written_below_each_other() -> None:
    shown = render(one_line("let a = b + c;", ("+", "float and int"), ("b", "float"), ("c", "int")))
    assert shown.split("\n")[2:] == [
        " 1 | let a = b + c;",
        "   |         - ^ - int",
        "   |         | float and int",
        "   |         float",
    ]


def test_overlapping_labels_get_rows_of_their_own() -> None:
    shown = render(one_line("let a = b + c;", ("b", "here"), ("b + c", "in this sum")))
    assert shown.split("\n")[3:] == [
        "   |         ^ here",
        "   |         ----- in this sum",
    ]


def test_empty_span_is_shown_as_one_caret() -> None:
    source = Source("t", "let a = 1")
    end = Diagnostic("S004", "m", Label(Span(source, 9, 9), "`;` is missing here"))
    assert render(end).endswith("   |          ^ `;` is missing here")


def test_span_over_several_lines_is_marked_to_the_end_of_the_first() -> None:
    source = Source("t", "rta X {\n  ac A;\n}\n")
    long = Diagnostic("M001", "m", Label(Span(source, 6, 17), "this body"))
    assert render(long).split("\n")[2:] == [" 1 | rta X {", "   |       ^ this body"]


def test_tabs_are_expanded_and_marks_stay_below_their_text() -> None:
    shown = render(one_line("\tlet\ta = b;", ("b", ""))).split("\n")
    assert shown[2] == " 1 |     let a = b;"
    assert shown[3].index("^") == shown[2].index("b")


def test_wide_letters_keep_marks_aligned() -> None:
    shown = render(one_line("// \u6f22\u5b57 b", ("b", ""))).split("\n")
    assert shown[3] == "   |         ^"


def test_control_characters_never_reach_the_terminal() -> None:
    source = Source("a\x1b[31m.soter", "x\x00\x1b[2J\u202e y")
    hostile = Diagnostic("L001", "bad \x1b[2J\nthing", Label(Span(source, 1, 2), "\x07"))
    shown = render(hostile)
    assert all(line.isprintable() for line in shown.split("\n"))
    assert shown.split("\n")[0] == "error[L001]: bad \ufffd[2J\ufffdthing"


def test_very_long_lines_are_shortened_around_the_span() -> None:
    text = "a" * 5000 + " HERE " + "b" * 5000
    lines = render(one_line(text, ("HERE", "this"))).split("\n")
    assert len(lines[2]) < 120
    assert lines[2].count("...") == 2
    at = lines[2].index("HERE")
    assert lines[3][at : at + 9] == "^^^^ this"


def test_far_labels_on_a_very_long_line_are_shown_in_two_views() -> None:
    text = "FIRST" + "a" * 5000 + "SECOND"
    lines = render(one_line(text, ("SECOND", "two"), ("FIRST", "one"))).split("\n")
    assert [line[:4] for line in lines[2:]] == [" 1 |", "   |", " 1 |", "   |"]
    assert lines[3].endswith("----- one")
    assert lines[5].endswith("^^^^^^ two")


def test_span_longer_than_the_view_is_cut() -> None:
    lines = render(one_line("a" * 10_000, ("a" * 9_000, "long"))).split("\n")
    assert len(lines[3]) < 120


def test_labels_in_another_file_get_a_section_of_their_own() -> None:
    other = Source("iris.soter", "const K: float = 1.0;\n")
    two = Diagnostic(
        "N002",
        "`K` is declared twice",
        Label(span(DRONE, "ac"), "again"),
        (Label(span(other, "K"), "first here"),),
    )
    assert render(two).split("\n")[4:] == [
        "  ::: iris.soter:1:7",
        " 1 | const K: float = 1.0;",
        "   |       - first here",
    ]


def test_lines_of_a_note_are_indented() -> None:
    noted = Diagnostic("C001", "m", notes=("first\nsecond",))
    assert render(noted) == "error[C001]: m\n   = note: first\n           second"


def test_gutter_fits_the_largest_line_number() -> None:
    source = Source("t", "\n" * 1233 + "x y")
    far = Diagnostic("N001", "m", Label(span(source, "x")), (Label(Span(source, 0, 0), "top"),))
    assert render(far).split("\n")[1:] == [
        "    --> t:1234:1",
        "   1 |",
        "     | - top",
        "...",
        "1234 | x y",
        "     | ^",
    ]


@pytest.mark.parametrize(
    ("errors", "warnings", "words"),
    [
        (1, 0, "1 error"),
        (2, 1, "2 errors, 1 warning"),
        (0, 3, "3 warnings"),
        (0, 0, ""),
    ],
)
def test_summary_counts_each_severity(errors: int, warnings: int, words: str) -> None:
    diagnostics = Diagnostics()
    for number in range(errors):
        diagnostics.error("N001", f"e{number}")
    for number in range(warnings):
        diagnostics.warning("W001", f"w{number}")
    assert summary(diagnostics.items) == words
    assert render_all(diagnostics.items).rpartition("\n")[2] == words


def test_json_has_the_promised_fields() -> None:
    document = to_json(slower())
    assert document == {
        "code": "P1a",
        "severity": "error",
        "message": "`MotionPrimitiveSC` is slower than its decision module",
        "file": "drone.soter",
        "line": 41,
        "column": 6,
        "end_line": 41,
        "end_column": 23,
        "notes": ["a switch could come too late: P1a needs period(SC) <= \u0394"],
        "helps": ["set the node's period to 100ms or less, or raise \u0394 to 150ms"],
        "fixes": [],
        "labels": [
            {
                "file": "drone.soter",
                "line": 41,
                "column": 6,
                "end_line": 41,
                "end_column": 23,
                "text": "steps every 150 ms",
                "primary": True,
            },
            {
                "file": "drone.soter",
                "line": 39,
                "column": 10,
                "end_line": 39,
                "end_column": 15,
                "text": "the decision module samples every 100 ms",
                "primary": False,
            },
        ],
    }
    json.dumps(document)


def test_json_of_a_diagnostic_without_a_place_has_nulls() -> None:
    document = to_json(Diagnostic("U001", "m"))
    assert (document["file"], document["line"], document["column"]) == (None, None, None)
    assert document["labels"] == []


def test_safe_replaces_what_a_terminal_would_act_upon() -> None:
    assert safe("plain \u0394") == "plain \u0394"
    assert safe("a\x1bb\ud800") == "a\ufffdb\ufffd"


def test_one_mistake_is_reported_once() -> None:
    diagnostics = Diagnostics()
    for _ in range(3):
        diagnostics.error("N001", "m", span(DRONE, "ac"))
    assert len(diagnostics) == 1
