"""Phrases of other languages: told as such, and what is written for them is Soter."""

from __future__ import annotations

import pytest

from soter.diagnostics.diagnostic import Diagnostics, Source, applied
from soter.language.syntax.parser import parse
from tables import all_rows

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
    ("static topic m: float max_age 1s;", "topic m: float max_age 1s static;"),
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

IN_A_FUNCTION += [
    ("path.append(x);", "push path, x;"),
    ("path.push_back(min(x, 1.0));", "push path, min(x, 1.0);"),
    ("m.path.add(x);", "push m.path, x;"),
    ("push(path, x);", "push path, x;"),
    ("append(path, x + 1.0);", "push path, x + 1.0;"),
    ("path.clear();", "path = [];"),
    ("for (auto& r : path) { } return x;", "for r in path { } return x;"),
    ("foreach r in path { } return x;", "for r in path { } return x;"),
    ("for r of path { } return x;", "for r in path { } return x;"),
    ("for k = 1 to 3 { } return x;", "for k in 1..4 { } return x;"),
    ("for k in 0:7 { } return x;", "for k in 0..8 { } return x;"),
    ("let (a, b) = (x, y); return a;", "let a = x; let b = y; return a;"),
    ("let a, b = p.v; return a;", "let a = p.v.x; let b = p.v.y; return a;"),
    ("var a, b: float; return a;", "var a: float; var b: float; return a;"),
    ("let p = Pose(x=1.0, y=y); return p.x;", "let p = { x: 1.0, y: y }; return p.x;"),
    ("let p = Pose { x: 1.0, y: y }; return p.x;", "let p = { x: 1.0, y: y }; return p.x;"),
    ("return clamp(x, low=0.0, high=1.0);", "return clamp(x, 0.0, 1.0);"),
    ("let a = [1 2 3]; return x;", "let a = [1.0, 2.0, 3.0]; return x;"),
    ("let a = [1 2; 3 4]; return x;", "let a = [[1.0, 2.0], [3.0, 4.0]]; return x;"),
    ("let a = [0.5; 3]; return x;", "let a = [0.5, 0.5, 0.5]; return x;"),
    ("return x in [0.0, 1.0] ? x : y;", "return 0.0 <= x && x <= 1.0 ? x : y;"),
    ("if k in (3, 4) { } return x;", "if (k == 3 || k == 4) { } return x;"),
    ("if k not in (3, 4) { } return x;", "if (k != 3 && k != 4) { } return x;"),
    ("if x between 0.0 and 1.0 { } return x;", "if 0.0 <= x && x <= 1.0 { } return x;"),
    ("if x =< y { } return x;", "if x <= y { } return x;"),
    ("x <- y; return x;", "x = y; return x;"),
    ("++k; return x;", "k = k + 1; return x;"),
    ("return 2 y;", "return 2 * y;"),
    ("return x as int;", "return int(x);"),
    ("return 1.0 + float k;", "return 1.0 + float(k);"),
    ('assert(x > 0.0, "low"); return x;', 'assert x > 0.0, "low"; return x;'),
    ("a: float = 2.0; return a;", "var a: float = 2.0; return a;"),
    ("let a = choose [1, 2, 3]; return x;", "let a = choose { 1, 2, 3 }; return x;"),
    ("let a = choose(1, 2); return x;", "let a = choose { 1, 2 }; return x;"),
    ("let a = choose 1 | 2; return x;", "let a = choose { 1, 2 }; return x;"),
    ('return m == "SC" ? x : y;', "return m == Mode.SC ? x : y;"),
    ("var a float = 1.0; return a;", "var a: float = 1.0; return a;"),
]
TOP += [
    ("type Cell = int[-3, 3];", "type Cell = int in [-3, 3];"),
    ("type Cell = int(0..9);", "type Cell = int in [0, 9];"),
    ("type E = { Up, Down };", "type E = enum { Up, Down };"),
    ("type E = enum { Up = 1, Down = 2 };", "type E = enum { Up, Down };"),
    ("topic t: float(0.0, 2.0);", "topic t: float in [0.0, 2.0];"),
    ("topic t: float range 0.0 to 2.0;", "topic t: float in [0.0, 2.0];"),
    ("topic t: float default 0.5;", "topic t: float = 0.5;"),
    ("topic float t;", "topic t: float;"),
    ("topic s, t: float;", "topic s: float; topic t: float;"),
    ("param K = 0.5;", "param K: float = 0.5;"),
    ("fun f(x: float): float = 2.0 * x;", "fun f(x: float): float { return 2.0 * x; }"),
    ("fun f(x: float): float => x;", "fun f(x: float): float { return x; }"),
    ("node N every 20ms { step { } }", "node N period 20ms { step { } }"),
    ("node N(period = 20ms) { step { } }", "node N period 20ms { step { } }"),
    ("system default S { }", "system S default { }"),
    ("test T of S { }", "test T { system S; }"),
    ("rta M(A, B) { }", "rta M { ac A; sc B; }"),
    ("rta M period 50ms { }", "rta M { period 50ms; }"),
    (
        "rta M { rest x < 1.0 moves x by 0.1, t.y within 0.1 within 2s; }",
        "rta M { rest x < 1.0 moves x by 0.1, t.y by 0.1 within 2s; }",
    ),
    ("rta M { verify { dropout t.x 10ms; } }", "rta M { verify { dropout 10ms; } }"),
    ("output topic t: float;", "topic t: float;"),
]

IN_A_SYSTEM = [
    ("node A, B;", "node A; node B;"),
    ("node a: A;", "node A;"),
    ("input g in [0.0, 1.0] every 1s;", "input g in { 0.0, 1.0 } every 1s;"),
    ("replace A with B;", "replace A by B;"),
    ("[] (x < 1.0);", "always (x < 1.0);"),
    ("always x > 0.0 -> y < 1.0;", "always !(x > 0.0) || y < 1.0;"),
    ("always if x > 0.0 then y < 1.0;", "always !(x > 0.0) || y < 1.0;"),
    ("never x > 0.0 implies y < 1.0;", "never !(x > 0.0) || y < 1.0;"),
]

IN_A_NODE = [
    ("subscribes (a, b); step { }", "subscribes a, b; step { }"),
    ("subscribes a as b; step { }", "subscribes a; step { }"),
    ("publishes a = 0.0; step { }", "publishes a; step { }"),
    ("def step(self): { }", "step { }"),
    ("step(m: Motion) { }", "step { }"),
    ("float last = 0.0; step { }", "var last: float = 0.0; step { }"),
    ("uint8_t n; step { }", "var n: int in [0, 255]; step { }"),
    ("state n: int; step { }", "var n: int; step { }"),
    ("reads speed; step { }", "subscribes speed; step { }"),
    ("on speed { }", "step { }"),
    ("step { speed.publish(1.0); }", "step { publish speed = 1.0; }"),
    ("step { publish(speed, 1.0); }", "step { publish speed = 1.0; }"),
]

IN_A_PLANT = [
    ("state v: float; v_dot = 1.0;", "state v: float; der v = 1.0;"),
    ("state v: float; v(k + 1) = v(k) + u;", "state v: float; next v = v + u;"),
    ("state v: float; v += 1.0;", "state v: float; next v = v + 1.0;"),
    ("state v = 0.5;", "state v: float = 0.5;"),
    ("disturbance w: float +- 0.5;", "disturbance w: float in [-0.5, 0.5];"),
    ("measured t by 0.1;", "measured t within 0.1;"),
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
    *(("system S {{ p: P; {} }}", wrong, right) for wrong, right in IN_A_SYSTEM),
    *(("plant P period 10ms {{ {} }}", wrong, right) for wrong, right in IN_A_PLANT),
]


@all_rows(("around", "wrong", "right"), CASES)
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


ADVISED = [
    ("fun f(): float {{ {} return x; }}", wrong, said)
    for wrong, said in [
        ("path.pop();", "push"),
        ("rospy.sleep(0.1);", "leave it out"),
        ("logger.info(x);", "publish"),
        ("let a = min(r for r in path);", "for r in path"),
        ("let a = [2.0 * r for r in path];", "push ys"),
        ("let a = path[1:3];", "for i in 1..3"),
        ("let a = path[:-1];", "for i in 0.."),
        ("a, b = b, a;", "let old"),
        ("let a = [1 0; 0 1] * v;", "components"),
        ("let a = 0.0 -> b;", "a = b;"),
        ("let g = lambda v: v + 1.0;", "fun name"),
        ("let a = pre b;", "var last"),
        ("let a = b << 2;", "operators"),
        ("raise Fault(x);", "assert"),
        ("unless x > 0.0 { }", "if !"),
        ("static int n = 0;", "beside its step"),
        ("if x > 0.0 then x = 1.0;", "{ ... }"),
    ]
]


@all_rows(("around", "wrong", "said"), ADVISED)
def test_a_phrase_without_a_counterpart_is_told_what_to_do(
    around: str, wrong: str, said: str
) -> None:
    diagnostics = Diagnostics()
    parse(Source("t.soter", f"soter 1;\n{around.format(wrong)}\n"), diagnostics)
    first, *_ = diagnostics.items
    assert said in " ".join([*first.notes, *first.helps]), first
    assert "missing" not in first.message


def test_a_case_of_an_enum_is_named_for_its_text() -> None:
    text = (
        "soter 1;\ntype Light = enum { Red, Green };\n"
        'fun f(l: Light): bool { return l == "green"; }\n'
    )
    source, diagnostics = Source("t.soter", text), Diagnostics()
    parse(source, diagnostics)
    (fix,) = diagnostics.items[0].fixes
    assert "l == Light.Green;" in applied(fix)[source]


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("topic t float;", "topic t: float;"),
        ("topic t: float max_age: 20ms;", "topic t: float max_age 20ms;"),
        ("topic t: float, max_age 20ms;", "topic t: float max_age 20ms;"),
        ("plant P period 10ms { state x: float; der x: 1.0; }",
         "plant P period 10ms { state x: float; der x = 1.0; }"),
        ("node N period 10ms: { step { } }", "node N period 10ms { step { } }"),
        ("node N period 10ms { step { publish u 1.0; } }",
         "node N period 10ms { step { publish u =  1.0; } }"),
        ('node N period 10ms { subscribes "t"; step { } }',
         "node N period 10ms { subscribes t; step { } }"),
        ("fun f(a: float b: float): float { return a; }",
         "fun f(a: float , b: float): float { return a; }"),
    ],
)  # fmt: skip
def test_one_token_that_is_wrong_is_mended(text: str, right: str) -> None:
    source, diagnostics = Source("t.soter", f"soter 1;\n{text}\n"), Diagnostics()
    parse(source, diagnostics)
    (first,) = diagnostics.items
    (fix,) = first.fixes
    again = applied(fix)[source]
    mended = Diagnostics()
    parse(Source("t.soter", again), mended)
    assert not mended.items
    assert again.split() == f"soter 1;\n{right}\n".split() or "".join(again.split()) == "".join(
        f"soter 1;{right}".split()
    )


def test_an_edit_that_leads_to_another_error_is_not_offered() -> None:
    diagnostics = Diagnostics()
    text = "soter 1;\nfun f(): float { let a = 1.0 -> 2.0 + ; return a; }\n"
    parse(Source("t.soter", text), diagnostics)
    assert all(not d.fixes for d in diagnostics.items)


def test_a_right_program_is_never_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def find(*_: object) -> None:
        asked.append(1)

    monkeypatch.setattr("soter.language.syntax.parsing.token_cursor.find", find)
    diagnostics = Diagnostics()
    parse(Source("t.soter", "soter 1;\nconst A: float = 3.0;\n"), diagnostics)
    assert not diagnostics.items
    assert not asked
