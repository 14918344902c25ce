"""Recovery: one mistake gives one message, every mistake gives one, and nothing else does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.render import render_all
from soter.language.syntax import tree
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostic

    Parsed = Callable[[str], tuple[tree.File, tuple[Diagnostic, ...]]]

CART = """soter 1;
const A: float = 3.0;
type Motion = { x: float, v: float };
topic motion : Motion max_age 20ms;
input topic goal : float in [-50.0, 50.0] = 9.5;
topic accel : float in [-A, A] = 0.0;

plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.02, motion.v within 0.05;
}

node Fast period 10ms {
  subscribes motion, goal;
  publishes accel;
  step {
    publish accel = clamp(4.0 * (goal - motion.x), -A, A);
  }
}

fun Clear(m: Motion): bool { return m.x < 10.0; }

rta SafeCart {
  ac Fast;
  sc Fast;
  period 50ms;
  safe Clear(motion);
  ttf 10.0 - motion.x < 2.0;
  verify { grid motion.x in [-20.0, 10.0] / 600; }
}

system Protected default {
  c: Cart;
  module SafeCart;
  force SafeCart ac;
  until 30s;
  always Clear(c.truth);
}

test Corridor { system Protected; skew 5ms; motion.x > 1.0 leadsto motion.x < 1.0 within 2s; }
"""
NAMES = (
    "A Motion motion goal accel Cart Fast Clear SafeCart Protected Corridor".split()  # noqa: SIM905
)

# What is replaced by what, and the one error that follows.
SLIPS = [
    # the first line
    ("soter 1;", "", "S001"),
    ("soter 1;", "soter;", "S001"),
    ("soter 1;", "soter 1", "S004"),
    ("soter 1;", "soter 2;", "S002"),
    # semicolons
    ("20ms;", "20ms", "S004"),
    ("reads accel;", "reads accel", "S004"),
    ("goal;\n  pub", "goal\n  pub", "S004"),
    ("A, A);", "A, A)", "S004"),
    ("10.0; }", "10.0 }", "S004"),
    ("ac Fast;\n", "ac Fast\n", "S004"),
    ("ac Fast;\n ", "ac Fast ", "S004"),
    ("c: Cart;", "c: Cart", "S004"),
    ("SafeCart;\n", "SafeCart\n", "S004"),
    ("30s;", "30s", "S004"),
    ("    publish accel =", "    let a = 3.0 4.0; publish accel =", "S004"),
    ("    publish accel =", "    let a = 10 ms; publish accel =", "S004"),
    ("-A, A);\n  }", "-A, A);\n  };", "S014"),
    ("10.0; }", "10.0;; }", "S014"),
    # braces and brackets
    ("-A, A);\n  }\n", "-A, A);\n\n", "S012"),
    ("  step {\n", "  step\n", "S005"),
    ("node Fast period 10ms {", "node Fast period 10ms", "S005"),
    ("A, A);\n  }\n}", "A, A);\n  }\n}\n}", "S013"),
    ("x < 10.0; }", "x < 10.0;", "S012"),
    ("goal - motion.x)", "goal - motion.x", "S005"),
    ("Clear(motion)", "Clear(motion", "S005"),
    ("in [-A, A]", "in [-A, A", "S005"),
    ("in [-A, A]", "in (-A, A)", "S005"),
    ("in [-A, A]", "in [-A .. A]", "S005"),
    # choices
    ("    publish accel =", "    let a = choose; publish accel =", "S007"),
    ("    publish accel =", "    let a = choose int; publish accel =", "S007"),
    ("    publish accel =", "    let a = choose { 1 2 }; publish accel =", "S005"),
    ("    publish accel =", "    let a = choose (1, 2); publish accel =", "S007"),
    ("    publish accel =", "    let a = choose [1; publish accel =", "S005"),
    ("    publish accel =", "    let choose = 1.0; publish accel =", "S006"),
    # tests
    ("skew 5ms;", "late Fast;", "S005"),
    ("skew 5ms;", "late by 5ms;", "S005"),
    ("skew 5ms;", "overrun Fast by 5;", "S019"),
    ("skew 5ms;", "skip Fast at 5;", "S005"),
    ("skew 5ms;", "skip Fast at most 5", "S004"),
    ("skew 5ms;", "quantum 5;", "S019"),
    ("skew 5ms;", "quantum 5ms; quantum 1ms;", "S022"),
    ("skew 5ms;", "input goal in [0, 1] every 1s;", "S005"),
    ("skew 5ms;", "input goal in { 0 1 } every 1s;", "S005"),
    ("skew 5ms;", "until 5ms;", "S010"),
    ("skew 5ms;", "invariant(SafeCart);", "S010"),
    ("skew 5ms;", "invariant(a.SafeCart);", "S010"),
    ("skew 5ms;", "invariants;", "S010"),
    ("skew 5ms;", "whatever (3);", "S010"),
    ("until 30s;", "invariant(SafeCart);", "S010"),
    ("  drives motion = { x: x, v: v };", "  drives motion = { x: x, v: v }, a = x;", "S004"),
    ("  drives motion = { x: x, v: v };", "  drives motion = { x: x, v: v }, 3;", "S004"),
    ("until 30s;", "eventually Clear(c.truth) within 1s;", "S010"),
    ("until 30s;", "c.truth.x > 1.0 leadsto c.truth.x < 1.0 within 1s;", "S010"),
    # units
    ("accel : float", "accel : float unit m", "S005"),
    ("accel : float", "accel : float unit m/s", "S005"),
    ("state x: float", "state x: float unit m", "S005"),
    ("period 10ms", "period 10", "S019"),
    ("period 10ms", "period 10 ms", "S019"),
    ("period 10ms", "period 100 Hz", "S019"),
    ("period 10ms", "period 0.01", "S019"),
    ("max_age 20ms", "max_age 20", "S019"),
    ("until 30s", "until 30", "S019"),
    ("within 2s", "within 2", "S019"),
    ("period 10ms", "period 10msec", "L006"),
    # words
    ("node Fast", "nod Fast", "S009"),
    ("fun Clear", "def Clear", "S009"),
    ("fun Clear", "function Clear", "S009"),
    ("rta SafeCart", "module SafeCart", "S009"),
    ("subscribes", "subscribe", "S010"),
    ("  step {", "  stepp {", "S010"),
    ("publishes accel", "publish accel", "S010"),
    ("period 10ms", "priod 10ms", "S005"),
    ("period 10ms", "", "S005"),
    ("x within 0.02", "x withn 0.02", "S005"),
    ("grid motion", "gird motion", "S010"),
    ("until 30s", "until: 30s", "S005"),
    ("ac Fast;", "ac: Fast;", "S005"),
    ("c: Cart;", "c Cart;", "S005"),
    ("motion, goal", "motion goal", "S005"),
    # types and values
    ("A: float", "A float", "S005"),
    ("A: float =", "A =", "S005"),
    ("float = 3.0", "float := 3.0", "S015"),
    ("float = 3.0", "float == 3.0", "S015"),
    ("float = 3.0", "float 3.0", "S005"),
    ("float = 3.0", "float = 3.", "L004"),
    ("float = 3.0", "float = .5", "L004"),
    ("float = 3.0", "float = ", "S007"),
    ("float = 3.0", "float = (3.0", "S005"),
    ("float = 3.0", "float = +3.0", "S007"),
    ("float = 3.0", 'float = "3.0"', "S007"),
    ("float = 3.0", "float = 3.0 +", "S007"),
    ("float = 3.0", "Array<float> = 3.0", "S008"),
    ("float = 3.0", "[float] = 3.0", "S008"),
    ("float = 3.0", "float = f(1)(2)", "S023"),
    ("float = 3.0", "float = [1, 2", "S005"),
    ("float = 3.0", "float = { 1, 2 }", "S007"),
    ("float = 3.0", "float = { x = 2 }", "S005"),
    ("= { x: float, v: float }", "{ x: float, v: float }", "S005"),
    ("x: float, v: float", "x: float v: float", "S005"),
    ("(m: Motion)", "(Motion m)", "S005"),
    ("(m: Motion)", "(m)", "S005"),
    ("): bool {", ") -> bool {", "S015"),
    ("): bool {", ") {", "S005"),
    ("state x: float", "state x", "S005"),
    ("wind: float in [-0.2, 0.2]", "wind: float", "S005"),
    ("drives motion = { x: x, v: v }", "drives motion", "S024"),
    # expressions
    ("Clear(motion);", "Clear(motion) and goal > 1.0;", "S015"),
    ("Clear(motion);", "Clear(motion) or !mode;", "S015"),
    ("Clear(motion);", "not mode;", "S015"),
    ("Clear(motion);", "Clear(motion) = true;", "S016"),
    ("Clear(motion);", "0.0 < x < 3.0;", "S017"),
    ("Clear(motion);", "x ? y;", "S005"),
    ("Clear(motion);", "x ** 2 > 1;", "S015"),
    ("Clear(motion);", "x & y;", "L001"),
    ("return m.x", "return if m.x { 1 } else { 2 }; return m.x", "S007"),
    # statements
    ("return m.x", "if m.x { return 1; } else if m.v { } return m.x", "S015"),
    ("return m.x", "if m.x { return 1; } elif m.v { } return m.x", "S015"),
    ("return m.x", "if m.x = 1 { } return m.x", "S016"),
    ("return m.x", "if (m.x == 1 { } return m.x", "S005"),
    ("return m.x", "if m.x == 1 return 1; return m.x", "S005"),
    ("return m.x", "if { } return m.x", "S007"),
    ("return m.x", "while m.x < 1 { let a = 1; } return m.x", "S018"),
    ("return m.x", "for (i = 0; i < 3; i = i + 1) { a = 3; } return m.x", "S006"),
    ("return m.x", "for i = 0..3 { } return m.x", "S005"),
    ("return m.x", "let node = 3; let b = node + node; return m.x", "S006"),
    ("return m.x", "let = 3; return m.x", "S006"),
    ("return m.x", "let a = ; return m.x", "S007"),
    ("return m.x", "let a; return m.x", "S005"),
    ("return m.x", "var a: float 3.0; return m.x", "S005"),
    ("return m.x", "a += 1; return m.x", "S015"),
    ("return m.x", "a++; return m.x", "S015"),
    ("return m.x", "f(a); return m.x", "S011"),
    ("return m.x", "m.x; return m.x", "S011"),
    ("return m.x", "break; return m.x", "S011"),
    ("return m.x", "float y = 3.0; return m.x", "S011"),
    ("return m.x", "retrun m.x", "S011"),
    ("return m.x", "else { } return m.x", "S011"),
    ("return m.x", "publish accel 3.0; return m.x", "S005"),
    ("return m.x", "assert m.x, 3; return m.x", "S005"),
    ("return m.x", "push a; return m.x", "S005"),
    ("return m.x", "\n  const X: float = 1.0;\n  return m.x", "S009"),
    # blocks around statements
    ("  step {\n", "", "S010"),
    ("  step {\n", "    a = 1.0;\n    let b = 2.0;\n", "S010"),
    ("  subscribes motion, goal;", "  on takeover {\n    a = 1.0;\n  subscribes motion;", "S012"),
    # what stands twice or is missing
    ("  sc Fast;", "  sc Fast; sc Fast;", "S022"),
    ("  subscribes motion", "  step { }\n  subscribes motion", "S022"),
    ("  step {\n    publish accel = clamp(4.0 * (goal - motion.x), -A, A);\n  }\n", "", "S024"),
    ("node Fast", "extern node Fast", "S025"),
    ("node Fast period 10ms", 'node Fast period 10ms from "c:f.c:f"', "S025"),
    # comments and strings
    ("topic accel", "/* topic accel", "L002"),
    ("const A", "# const\nconst A", "L001"),
]


@all_rows(("old", "new", "code"), SLIPS)
def test_one_slip_gives_one_error(parsed: Parsed, old: str, new: str, code: str) -> None:
    assert old in CART
    _, problems = parsed(CART.replace(old, new, 1))
    assert [p.code for p in problems] == [code]


@all_rows(("old", "new", "code"), SLIPS)
def test_no_name_is_lost_to_a_slip(parsed: Parsed, old: str, new: str, code: str) -> None:
    del code
    file, _ = parsed(CART.replace(old, new, 1))
    known = {declaration.name.text for declaration in file.declarations} | file.broken
    assert set(NAMES) <= known


def test_slips_are_shown_as_the_golden_says(
    parsed: Parsed, golden: Callable[[str, str], None]
) -> None:
    shown = [
        render_all(parsed(CART.replace(old, new, 1))[1]).rpartition("\n\n")[0]
        for old, new, _ in SLIPS
    ]
    golden("language/syntax/slips.txt", "\n\n".join(shown) + "\n")


def test_all_errors_of_a_file_are_found_in_one_pass(parsed: Parsed) -> None:
    text = CART
    for old, new in [
        ("period 5ms", "period 5"),
        ("reads accel;", "reads accel"),
        ("goal - motion.x)", "goal - motion.x"),
        ("x < 10.0", "x = 10.0"),
        ("period 50ms", "priod 50ms"),
        ("motion.x > 1.0", "motion.x > "),
    ]:
        assert old in text
        text = text.replace(old, new, 1)
    _, problems = parsed(text)
    lines = [(p.primary.span.line, p.code) for p in problems if p.primary]
    assert lines == [
        (8, "S019"),
        (9, "S004"),
        (23, "S005"),
        (27, "S016"),
        (32, "S010"),
        (46, "S005"),
    ]


def test_missing_semicolon_is_shown_behind_the_token_before_it(parsed: Parsed) -> None:
    _, (problem,) = parsed(CART.replace("A, A);", "A, A)"))
    assert problem.message == "expected `;` after the publish statement, found `}`"
    assert problem.primary is not None
    assert problem.primary.text == "`;` is missing here"
    span = problem.primary.span
    assert (span.start, span.end) == (span.start, span.start)
    assert span.source.text[: span.start].endswith("-A, A)")


def test_missing_brace_points_at_the_one_without_an_end(parsed: Parsed) -> None:
    text = CART.replace("    publish accel =", "    if goal > 0.0 {\n    publish accel =")
    _, (problem,) = parsed(text)
    assert problem.code == "S012"
    labels = [label.text for label in problem.secondary]
    assert "this `{` may be the one without an end" in labels


def test_broken_expression_becomes_an_error_node(parsed: Parsed) -> None:
    file, _ = parsed("soter 1; const X: float = 1.0 + ; const Y: Lst<x> = 2.0;")
    first, second = file.declarations
    assert isinstance(first, tree.ConstDecl)
    assert isinstance(second, tree.ConstDecl)
    assert isinstance(first.value, tree.ErrorExpr)
    assert isinstance(second.type, tree.ErrorTypeExpr)
    assert isinstance(second.value, tree.FloatLit)


def test_a_variable_with_a_broken_value_is_still_declared(parsed: Parsed) -> None:
    file, problems = parsed("soter 1; fun f(): float { let a = (1; var b: int = ]; return a; }")
    assert [p.code for p in problems] == ["S005", "S007"]
    (fun,) = file.declarations
    assert isinstance(fun, tree.FunDecl)
    assert fun.body is not None
    names = [s.name.text for s in fun.body.statements if isinstance(s, tree.LetStmt | tree.VarStmt)]
    assert names == ["a", "b"]


def test_names_of_dropped_declarations_are_told(parsed: Parsed) -> None:
    file, _ = parsed("soter 1;\nclass Foo { x }\nextern thing Bar;\nconst Good: float = 1.0;")
    assert file.broken >= {"Foo"}
    assert [d.name.text for d in file.declarations] == ["Good"]


def test_names_in_text_that_was_not_read_are_told(parsed: Parsed) -> None:
    file, _ = parsed("soter 1;\n/* const Swallowed: float = 1.0;\n")
    assert "Swallowed" in file.broken


def test_alias_of_a_broken_import_is_guessed_from_the_file(parsed: Parsed) -> None:
    file, problems = parsed('soter 1;\nimport "lib/iris.soter";\nconst X: float = iris.Y;')
    assert [p.code for p in problems] == ["S005"]
    assert file.broken == {"iris"}


def test_a_word_that_is_no_beginning_is_also_no_declaration(parsed: Parsed) -> None:
    """Two mistakes at one token, where the first one lets the next be told."""
    _, problems = parsed("node2 1;\nconst X: float = 1.0;\n")
    at = [(p.code, p.primary and p.primary.span.start) for p in problems]
    assert at == [("S001", 0), ("S009", 0)]


def test_import_after_a_declaration_is_reported_and_kept(parsed: Parsed) -> None:
    file, problems = parsed('soter 1; const X: float = 1.0; import "a.soter" as a;')
    assert [p.code for p in problems] == ["S003"]
    assert [i.name.text for i in file.imports] == ["a"]


@pytest.mark.parametrize("last", ["return i", "push out, 1.0", "publish u = 1.0"])
def test_the_last_statement_of_a_block_may_lack_its_semicolon(parsed: Parsed, last: str) -> None:
    text = "soter 1;\nfun f(i: int): int {\n  if i > 0 {\n    @\n  }\n  return 1;\n}\n"
    _, problems = parsed(text.replace("@", last))
    assert [d.code for d in problems] == ["S004"]
