"""The lexer: kinds, places, and what it says about text that is no token."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Source
from soter.language.syntax.lexer import EOF, SOFT, lex, printable, string_value
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

LINES = r"""soter 1; nodes node node_1 _ _x9
0 42 1_000 007 1.5 1_0.5 1e3 1.5E-3 2e+10 10ms 1.5min 3h 4s 5us 6ns
0..10 a.b.c a..b x[1].y -1 --2 !x
<= >= == != && || < > = ! + - * / % ? : ; , . .. ( ) [ ] { }
:= += -= *= /= %= -> => ** ++ <> :: === !== **=
"a \"quoted\" \\ string\n" "" // a comment ; "x"
/* one */ a /* two
lines */ b /**/ /***/ c
"""


def tokens_of(text: str) -> list[tuple[str, str]]:
    tokens = lex(Source("t", text))
    pairs = zip(tokens.kinds, tokens.texts, strict=True)
    return [(kind, word) for kind, word in pairs if kind != EOF]


def codes_of(text: str) -> list[str]:
    return [problem.code for problem in lex(Source("t", text)).problems]


def test_every_kind_of_token_is_read_as_the_golden_says(golden: Callable[[str, str], None]) -> None:
    tokens = lex(Source("t", LINES))
    assert tokens.problems == []
    rows = []
    for kind, text, start in zip(tokens.kinds, tokens.texts, tokens.starts, strict=True):
        if kind != EOF:
            line, column = tokens.source.line_of(start), tokens.source.column_of(start)
            rows.append(f"{line}:{column} {kind if kind != text else 'itself'} {text}\n")
    rows += [f"comment {LINES[a:b]!r}\n" for a, b in tokens.comments]
    golden("language/syntax/tokens.txt", "".join(rows))


def test_tokens_and_comments_cover_all_text_but_white_space() -> None:
    tokens = lex(Source("t", LINES))
    covered = list(zip(tokens.starts, tokens.ends, strict=True)) + tokens.comments
    left = list(LINES)
    for start, end in covered:
        left[start:end] = [" "] * (end - start)
    assert "".join(left).split() == []


@all_rows(
    ("text", "code", "message"),
    [
        ("@", "L001", "unexpected character `@`"),
        ("@@ @\n$", "L001", "unexpected characters `@@ @<U+000A>$`"),
        ("\x00", "L001", "unexpected a NUL byte"),
        ("a\u00a0", "L001", "unexpected a no-break space"),
        ("# python", "L001", "`#` does not begin a comment"),
        ("a & b", "L001", "`&` is not an operator of Soter"),
        ("a \u2264 b", "L001", "`\u2264` (U+2264) is not an operator of Soter"),
        ("'text'", "L001", "there are no characters and no texts at run time"),
        ("\ud800", "L001", "unexpected character `<U+D800>`"),
        ("/* open", "L002", "this comment has no end"),
        ('"open', "L003", "this string has no end"),
        ("1.", "L004", "malformed number `1.`"),
        (".5", "L004", "malformed number `.5`"),
        ("1.5.2", "L004", "malformed number `1.5.2`"),
        ("1__0", "L004", "malformed number `1__0`"),
        ("0x1F", "L004", "malformed number `0x1F`"),
        ("10sec", "L006", "`sec` is not a unit of time"),
        ("100Hz", "L006", "`Hz` is not a unit of time"),
        (r'"\q"', "L007", r"unknown escape `\q` in a string"),
        ("gr\u00f6\u00dfe", "L008", "`gr\u00f6\u00dfe` is not a name"),
    ],
)
def test_text_that_is_no_token_gets_one_error(text: str, code: str, message: str) -> None:
    problems = lex(Source("t", text)).problems
    assert [(p.code, p.message) for p in problems] == [(code, message)]


@all_rows(
    ("text", "help_"),
    [
        ("1.", "write `1.0`"),
        ("1.ms", "write `1.0ms`"),
        (".5", "write `0.5`"),
        ("0x1F", "write `31`"),
        ("5minute", "write `5min`"),
        ("1.0f", "numbers have no suffix: write `1.0`"),
        ("100Hz", "a period is a time: `10ms`"),
        ("a | b", "write `||`"),
        ("# x", "a comment begins with `//`"),
        ("import 'x'", 'write `"x"`'),
        ("'x'", "name the cases, `type Name = enum { A, B };`, or write a number"),
    ],
)
def test_typical_slips_get_a_help(text: str, help_: str) -> None:
    (problem,) = lex(Source("t", text)).problems
    assert problem.helps == (help_,)


def test_a_unit_of_something_else_is_no_unit() -> None:
    (problem,) = lex(Source("t", "90deg")).problems
    assert problem.helps == ()
    assert problem.notes == ("a quantity other than a time carries no unit: it is in SI",)


def test_what_was_meant_is_put_in_place_so_that_parsing_goes_on() -> None:
    assert tokens_of("a & b") == [("NAME", "a"), ("&&", "&&"), ("NAME", "b")]
    assert tokens_of("'x'")[0][0] == "STRING"
    assert tokens_of("gr\u00f6\u00dfe")[0][0] == "NAME"
    assert tokens_of('"open; \nx') == [
        ("STRING", '"open'),
        (";", ";"),
        ("NAME", "x"),
    ]


def test_range_after_an_integer_is_not_a_float() -> None:
    assert tokens_of("0..10") == [("INT", "0"), ("..", ".."), ("INT", "10")]
    assert tokens_of("1.5..2.5") == [("FLOAT", "1.5"), ("..", ".."), ("FLOAT", "2.5")]


def test_byte_order_mark_and_windows_line_ends_are_white_space() -> None:
    assert codes_of("\ufeffsoter 1;\r\n// c\r\nx\r\n") == []
    assert tokens_of("\ufeffsoter 1;\r\nx") == tokens_of("soter 1;\nx")


def test_reading_stops_after_a_hundred_errors() -> None:
    tokens = lex(Source("t", "@ a " * 1000))
    assert len(tokens.problems) == 100
    assert tokens.truncated


def test_string_value_resolves_the_escapes() -> None:
    assert string_value(r'"a\"b\\c\nd\te"') == 'a"b\\c\nd\te'
    assert string_value('"open') == "open"
    assert string_value('"') == ""


def test_visible_makes_any_text_printable_and_short() -> None:
    assert printable("a\x00b\n") == "a<U+0000>b<U+000A>"
    assert printable("x" * 100) == "x" * 24 + "..."


def test_a_soft_word_is_a_name_beside_what_tells_so() -> None:
    source = Source("t.soter", "next x = m.next + next; state state: float; period 10ms step { }")
    tokens = lex(source)
    words = [(t, k) for t, k in zip(tokens.texts, tokens.kinds, strict=True) if t in SOFT]
    assert [(t, k == t) for t, k in words] == [
        ("next", True),
        ("next", False),
        ("next", False),
        ("state", True),
        ("state", False),
        ("period", True),
        ("step", True),
    ]
