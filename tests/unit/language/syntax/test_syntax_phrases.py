"""Phrases of other languages: told as such, and what is written for them is Soter."""

from __future__ import annotations

import pytest

from soter.diagnostics.diagnostic import Diagnostics
from soter.diagnostics.fix import applied
from soter.diagnostics.source import Source
from soter.language.syntax.parser import parse

TOP = [
    ("const float A = 3.0;", "const A: float = 3.0;"),
    ("static const double A = 3.0;", "const A: float = 3.0;"),
    ("const A float = 3.0;", "const A: float = 3.0;"),
    ("float A = 3.0;", "const A: float = 3.0;"),
    ("A = 3.0;", "const A: float = 3.0;"),
    ("N = 3", "const N: int = 3;"),
    ("pub const A: float = 3.0;", "const A: float = 3.0;"),
    ("struct M { float x; double v; };", "type M = { x: float, v: float };"),
    ("class M { x: float, v: f64 }", "type M = { x: float, v: float };"),
    ("struct M {\n  float x;\n  int n[3];\n};", "type M = { x: float, n: int[3] };"),
    ("enum E { A, B };", "type E = enum { A, B };"),
    ("typedef enum { A, B } E;", "type E = enum { A, B };"),
    ("typedef struct { float x; } M;", "type M = { x: float };"),
    ("topic speed<float>;", "topic speed: float;"),
    ("topic /robot/speed: float;", "topic speed: float;"),
    ("import lib as l;", 'import "lib.soter" as l;'),
    ("#define A 3.0", "const A: float = 3.0;"),
    ("#define N 3", "const N: int = 3;"),
    ('#include "lib.soter"', 'import "lib.soter" as lib;'),
    ("# a comment", "// a comment"),
    ("const A: float = 3,5;", "const A: float = 3.5;"),
    ("const A: float = 3.0f;", "const A: float = 3.0;"),
    ("const A: float = 9.81m;", "const A: float = 9.81;"),
    ("const A: float = 250cm;", "const A: float = 2.5;"),
    ("const A: float = 10.0_f64;", "const A: float = 10.0;"),
    ("const T: duration = 10sec;", "const T: duration = 10s;"),
    ("const A: float[2] = [0.0 for i in range(2)];", "const A: float[2] = [0.0, 0.0];"),
    ("const A: [float; 2] = [0.0, 1.0];", "const A: float[2] = [0.0, 1.0];"),
    ("const A: std::array<double, 2> = [0.0, 1.0];", "const A: float[2] = [0.0, 1.0];"),
    ("const A: float[2][2] = {{ 1.0, 2.0 }};", "const A: float[2][2] = [{ 1.0, 2.0 }];"),
    ("fun f(float x): float { return x; }", "fun f(x: float): float { return x; }"),
    ("fun f(const x: float): float { return x; }", "fun f(x: float): float { return x; }"),
    ("float f(float x, float y[2]) { return x; }",
     "fun f(x: float, y: float[2]): float { return x; }"),
    ("fun f(x: float) -> float { return x; }", "fun f(x: float) : float { return x; }"),
    ("fun f<T>(x: float): float { return x; }", "fun f(x: float): float { return x; }"),
    ("class N : public Node { step { } }", "node N period 10ms { step { } }"),
]  # fmt: skip

IN_A_FUNCTION = [
    ("return (float)n;", "return float(n);"),
    ("return static_cast<float>(n);", "return float(n);"),
    ("return std::abs(x);", "return abs(x);"),
    ("return p->x;", "return p.x;"),
    ("return x if x > 0.0 else 0.0;", "return x > 0.0 ? x : 0.0;"),
    ("return if x > 0.0 { x } else { 0.0 };", "return x > 0.0 ? x : 0.0;"),
    ("return x ** 2;", "return (x * x);"),
    ("return x ^ 3;", "return (x * x * x);"),
    ("return 0.0 < x < 1.0 ? x : 0.0;", "return 0.0 < x && x < 1.0 ? x : 0.0;"),
    ("return x > 0.0 and y > 0.0 ? x : y;", "return x > 0.0 && y > 0.0 ? x : y;"),
    ("return n // 2;", "return n / 2;"),
    ("auto y = x; return y;", "let y = x; return y;"),
    ("double y = x; return y;", "var y: float = x; return y;"),
    ("float y[2]; return y[0];", "var y: float[2]; return y[0];"),
    ("var y = x; y += 2.0; return y;", "var y = x; y = y + 2.0; return y;"),
    ("var y = x; y *= x + 2.0; return y;", "var y = x; y = y * (x + 2.0); return y;"),
    ("var k = n; k++; return k;", "var k = n; k = k + 1; return k;"),
    ("for (int i = 0; i < 4; i++) { } return x;", "for i in 0..4 { } return x;"),
    ("for (i = 1; i <= 4; ++i) { } return x;", "for i in 1..5 { } return x;"),
    ("for i in 0..=3 { } return x;", "for i in 0..4 { } return x;"),
    ("if x > 0.0 { return x; } else if x > 1.0 { } return x;",
     "if x > 0.0 { return x; } elseif x > 1.0 { } return x;"),
    ("let y = { .x = 1.0, .y = 2.0 }; return y.x;",
     "let y = { x: 1.0, y: 2.0 }; return y.x;"),
    ("var y[2]: float; return x;", "var y: float[2]; return x;"),
    ("\n  x + 1.0\n", "\n  return x + 1.0;\n"),
    ("let y = x\n  return y;", "let y = x;\n  return y;"),
]  # fmt: skip

IN_A_NODE = [
    ("float last = 0.0; step { }", "var last: float = 0.0; step { }"),
    ("uint8_t n; step { }", "var n: int in [0, 255]; step { }"),
    ("state n: int; step { }", "var n: int; step { }"),
    ("reads speed; step { }", "subscribes speed; step { }"),
    ("on speed { }", "step { }"),
    ("step { speed.publish(1.0); }", "step { publish speed = 1.0; }"),
    ("step { publish(speed, 1.0); }", "step { publish speed = 1.0; }"),
]

IN_A_PLANT = [
    ("float v; der v = 1.0;", "state v: float; der v = 1.0;"),
    ("subscribes force; state v: float;", "reads force; state v: float;"),
    ("state v: float; v' = 1.0;", "state v: float; der v = 1.0;"),
    ("state v: float; dv/dt = 1.0;", "state v: float; der v = 1.0;"),
    ("state v: float; d(v)/dt = 1.0;", "state v: float; der v = 1.0;"),
    ("state v: float; der(v) = 1.0;", "state v: float; der v = 1.0;"),
]

CASES = [
    *(("{}", wrong, right) for wrong, right in TOP),
    *(("fun f(): float {{ {} }}", wrong, right) for wrong, right in IN_A_FUNCTION),
    *(("node N period 10ms {{ {} }}", wrong, right) for wrong, right in IN_A_NODE),
    *(("plant P period 10ms {{ {} }}", wrong, right) for wrong, right in IN_A_PLANT),
]


@pytest.mark.parametrize(("around", "wrong", "right"), CASES)
def test_a_phrase_of_another_language_gets_the_edit_that_makes_it_soter(
    around: str, wrong: str, right: str
) -> None:
    source = Source("t.soter", f"soter 1;\n{around.format(wrong)}\n")
    diagnostics = Diagnostics()
    parse(source, diagnostics)
    assert len(diagnostics.items) == 1, [d.message for d in diagnostics.items]
    (problem,) = diagnostics.items
    (fix,) = problem.fixes
    (text,) = applied(fix).values()
    assert text == f"soter 1;\n{around.format(right)}\n"
    again = Diagnostics()
    parse(Source("t.soter", text), again)
    assert problem.message not in [d.message for d in again.items]


def test_a_right_program_is_never_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def find(*_: object) -> None:
        asked.append(1)

    monkeypatch.setattr("soter.language.syntax.parsing.token_cursor.find", find)
    diagnostics = Diagnostics()
    parse(Source("t.soter", "soter 1;\nconst A: float = 3.0;\n"), diagnostics)
    assert not diagnostics.items
    assert not asked
