"""Hostile input: always diagnostics, by little work; never an exception."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.diagnostics.render import render_all, to_json
from soter.language.syntax.parsing.parser import parse
from work import work_of

N = 10_000
MILLION = 1_000_000
CALLS_PER_CHARACTER = 60
"""At most; a text of 10,000 equal parts takes thousands where each looks at all before it."""
CALLS_SHOWN = 500_000
"""At most, for the hundred diagnostics that are kept."""
_RANDOM = random.Random(20)  # noqa: S311 - test data


def inside(expression: str) -> str:
    """A program with this expression."""
    return f"soter 1;\nfun f(x: float): float {{ return {expression}; }}\n"


def statements(text: str) -> str:
    """A program with these statements."""
    return f"soter 1;\nfun f(x: float): float {{ {text} }}\n"


DIGITS = "1" * 5000
"""More than Python makes an int of."""
_BYTES = _RANDOM.randbytes(MILLION)
HOSTILE = {
    "a duration of 5,000 digits": inside(f"x + seconds(0.{DIGITS}ms) +"),
    "a list of 5,000 digits": f"soter 1;\nconst A: float[2] = [0.0 for i in range({DIGITS})];\n",
    "a loop to 5,000 digits": statements(f"for (int i = 0; i <= {DIGITS}; i++) {{ }} return x;"),
    "an index of 5,000 digits": inside(f"x[{DIGITS}] + {DIGITS}.0 + 0x{DIGITS}"),
    "a version of 5,000 digits": f"soter {DIGITS};\n",
    "random bytes as utf-8": _BYTES.decode("utf-8", "replace"),
    "random bytes as latin-1": _BYTES.decode("latin-1"),
    "random bytes as surrogates": _BYTES.decode("utf-8", "surrogateescape"),
    "random printable": _BYTES.translate(bytes(32 + b % 95 for b in range(256))).decode(),
    "random words": " ".join(
        _RANDOM.choices(
            [
                "node",
                "fun",
                "rta",
                "topic",
                "x",
                "1",
                "1.5",
                "10ms",
                "{",
                "}",
                "(",
                ")",
                "[",
                "]",
                ";",
                ",",
                ":",
                "=",
                "+",
                "-",
                "if",
                "else",
                "for",
                "let",
                "step",
            ],
            k=200_000,
        )
    ),
    "parentheses": inside("(" * N + "x" + ")" * N),
    "open parentheses": inside("(" * N),
    "nothing but parentheses": "(" * N,
    "brackets": inside("[" * N + "x" + "]" * N),
    "nothing but brackets": "[" * N,
    "braces": "{" * N,
    "braces in an expression": inside("{" * N),
    "closing braces": "}" * N,
    "records": inside("{ a: " * N + "x" + "}" * N),
    "minus": inside("-" * N + "x"),
    "not": inside("!" * N + "x"),
    "words not": inside("not " * N + "x"),
    "choices to the right": inside("x ? x : " * N + "x"),
    "choices to the left": inside("x ? " * N + "x" + " : x" * N),
    "sums": inside("x" + " + x" * N),
    "comparisons": inside("x" + " < x" * N),
    "calls": inside("f(" * N + "x" + ")" * N),
    "indices": inside("x" + "[0]" * N),
    "nested indices": inside("x[" * N + "0" + "]" * N),
    "fields": inside("x" + ".a" * N),
    "blocks": statements("if x { " * N + "}" * N),
    "open blocks": statements("if x { " * N),
    "ifs": statements("if " * N),
    "elses": statements("else " * N),
    "whiles": statements("while " * N),
    "lets": statements("let " * N),
    "assignments": statements("x = " * N),
    "braceless": statements("if x return 1; " * N),
    "nested record types": "soter 1; type T = " + "{ a: " * N + "float" + "}" * N + ";",
    "array types": "soter 1; type T = float" + "[1]" * N + ";",
    "value sets": "soter 1; topic t: T in " + "{ a in " * N + "[1,2]" + "}" * N + ";",
    "declarations in declarations": "soter 1;\n"
    + "".join(" " * i + "fun f(x: float): float {\n" for i in range(1000)),
    "open comment": "soter 1; " + "/* " * N,
    "open string": 'soter 1; import "' + "a" * MILLION,
    "open strings": '"\n' * N,
    "NUL": "\0" * MILLION,
    "spaced NUL": "\0 " * (MILLION // 2),
    "byte-order marks": "\ufeff" * N,
    "surrogates": "soter 1;\n\ud800 const \udfff: float = \ud800;",
    "non-ASCII names": "soter 1;\n" + "const gr\u00f6\u00dfe: float = \u00e4;\n" * 1000,
    "semicolons": ";" * MILLION,
    "dots": "." * MILLION,
    "digits": "soter 1; const x: int = " + "1" * MILLION + ";",
    "underscored digits": "1_" * (MILLION // 2),
    "points in a number": "1." * (MILLION // 2),
    "exponent": "soter 1; const x: float = 1e" + "9" * N + "; const y: duration = 1e-9999999s;",
    "long duration": "soter 1; const x: duration = 1" + "0" * N + "s + 1e999999h;",
    "keywords": "fun rta node plant topic " * N,
    "operators": "<>=!&|+-*/" * N,
    "one name": "a" * MILLION,
    "names": "a " * (MILLION // 2),
    "instances": "soter 1; system S {" + "a: b; " * N,
    "subscriptions": "soter 1; node n period 1s { subscribes " + "a, " * N,
    "parameters": "soter 1; fun f(" + "a: float, " * N,
    "enums": "soter 1; type t = enum { " + "a, " * N,
    "verify blocks": "soter 1; rta r { " + "verify { " * N,
    "carriage returns": "soter 1;\r" * N,
    "empty": "",
    "one brace": "{",
    "nothing but soter": "soter",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_answered_by_work_that_grows_with_it(name: str) -> None:
    diagnostics = Diagnostics()
    text = HOSTILE[name]
    file, calls = work_of(lambda: parse(Source("bad.soter", text), diagnostics))
    assert diagnostics.has_errors
    assert len(diagnostics) <= 101
    assert file is not None
    assert calls <= CALLS_PER_CHARACTER * (1_000 + len(text))


@pytest.mark.parametrize("name", HOSTILE)
def test_diagnostics_of_hostile_text_can_be_shown(name: str) -> None:
    diagnostics = Diagnostics()
    parse(Source("bad.soter", HOSTILE[name]), diagnostics)
    shown, calls = work_of(lambda: render_all(diagnostics.items))
    assert calls <= CALLS_SHOWN
    assert all(line.isprintable() and len(line) < 300 for line in shown.split("\n"))
    shown.encode("utf-8")
    assert all(to_json(d)["line"] for d in diagnostics.items)


def test_errors_of_one_file_are_capped_with_a_final_note() -> None:
    diagnostics = Diagnostics()
    parse(Source("bad.soter", "soter 1;\n" + "const x: float = ;\n" * 500), diagnostics)
    assert [d.code for d in diagnostics.items] == ["S007"] * 100 + ["S021"]


_PIECES = [
    "soter",
    "1;",
    "node",
    "fun",
    "rta",
    "plant",
    "system",
    "test",
    "topic",
    "type",
    "const",
    "param",
    "import",
    "extern",
    "period",
    "step",
    "let",
    "var",
    "publish",
    "return",
    "assert",
    "if",
    "elseif",
    "else",
    "for",
    "in",
    "while",
    "push",
    "true",
    "false",
    "float",
    "int",
    "x",
    "y",
    "f",
    "1",
    "1.5",
    "10ms",
    '"s"',
    "(",
    ")",
    "{",
    "}",
    "[",
    "]",
    ";",
    ",",
    ":",
    ".",
    "..",
    "=",
    "==",
    "<=",
    "&&",
    "||",
    "!",
    "-",
    "+",
    "*",
    "/",
    "%",
    "?",
    "default",
    "ac",
    "sc",
    "safe",
    "verify",
    "grid",
    "drives",
    "within",
    "leadsto",
    "max_age",
    "//",
    "/*",
    "*/",
    "@",
    "é",
    "'",
    '"',
    "\n",
]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(_PIECES), max_size=60).map(" ".join))
def test_any_mixture_of_tokens_is_answered(text: str) -> None:
    diagnostics = Diagnostics()
    file = parse(Source("bad.soter", text), diagnostics)
    assert render_all(diagnostics.items) or file.edition == 1


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=80))
def test_any_text_is_answered(text: str) -> None:
    diagnostics = Diagnostics()
    parse(Source("bad.soter", "soter 1;\n" + text), diagnostics)
    render_all(diagnostics.items, color=True)


@pytest.mark.long
def test_truncating_a_program_anywhere_is_answered(everything: str) -> None:
    for end in range(0, len(everything), 17):
        diagnostics = Diagnostics()
        parse(Source("cut.soter", everything[:end]), diagnostics)
        assert len(diagnostics) <= 4
