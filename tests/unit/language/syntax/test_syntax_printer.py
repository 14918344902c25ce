"""The printer: canonical layout, nothing lost, and stable under itself."""

# ruff: noqa: E501 - the ugly program has long lines

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.syntax import tree
from soter.language.syntax.lexer import lex
from soter.language.syntax.printer import WIDTH_MAX, expression_text, format_source
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic

    Parsed = Callable[[str], tuple[tree.File, tuple[Diagnostic, ...]]]

UGLY = """

soter   1 ;
/* header
   block */   import   "iris.soter"as iris;
type T={x:float,y:int in[0,5],z:bool[3][<=4]};type E=enum{A,B,
C};


const X:float=-  3.0+ - -4.0*!true;// trailing  \nconst M: float[2][2] = [ [1.0,2.0],
[3.0,4.0]];
const N: float[2][2] = [
[1.0,2.0],   // first
      [3.0,4.0]
];
const L: float = alpha_long_name_number_one * beta_long_name_number_two + gamma_long * delta - eps;
const Q: float[20] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
fun   f ( a:float , b:T ):float{if a>b.x{return a;}
else{ return  b . x [ 0 ] . y ( 1 , 2 )  ; } }
fun g(a: float): float { let b = a * a; let c = b * b; let d = c * c; let e = d * d; return e + d; }
fun h(a: float): float { if a > 1.0 && a < 20000000.0 { return clamp(a, -1.0, 1.0); } elseif a > 3 { return 2.0; } else { return 3.0; } }
fun k(alpha: float, beta: float, gamma: float, delta: float, epsilon: float, zeta: float): float {
  // comment one

  /* c2 */ let x = a ? b : c ;
  for i in 0 .. 10{ push   l , i ; } for e in l {}


  // last
}
extern   fun   q( ):float[3]from"c:q.c:q";
input topic goal:float in[-1.0,1.0]=0.0 max_age 20ms;
topic t : T in{x in[0,1],y in[0,2]};
node N period 10ms phase 1ms{subscribes a queue 3 drop_oldest,b.c;publishes u;
  // inner
  step{
    publish u=very_long_function_name(argument_number_one, argument_number_two, argument_number_three);
    publish u = a
      + b
        - c;
  }

}
rta R{verify{grid a.x in[0,1]/600,b in[0,1]/2*3;}}
system S { c: Cart { a = b, c = d }; module M; until 30s; }
test C { always!a;a leadsto -b within 1s; }
// the end
"""


def formatted(text: str) -> str:
    diagnostics = Diagnostics()
    result = format_source(Source("t", text), diagnostics)
    assert diagnostics.items == ()
    assert result is not None
    return result


def comments_of(text: str) -> list[str]:
    return [text[a:b].rstrip() for a, b in lex(Source("t", text)).comments]


def test_ugly_program_is_laid_out_as_the_golden_says(golden: Callable[[str, str], None]) -> None:
    golden("language/syntax/formatted.soter", formatted(UGLY))


def test_formatting_again_changes_nothing() -> None:
    once = formatted(UGLY)
    assert formatted(once) == once


def test_formatting_keeps_tree_and_comments(parsed: Parsed, shape: Callable[[object], Any]) -> None:
    text = formatted(UGLY)
    assert shape(parsed(text)[0]) == shape(parsed(UGLY)[0])
    assert comments_of(text) == comments_of(UGLY)


def test_sample_files_keep_tree_and_comments(
    parsed: Parsed, shape: Callable[[object], Any], sample: Path
) -> None:
    text = sample.read_text(encoding="utf-8")
    result = formatted(text)
    assert shape(parsed(result)[0]) == shape(parsed(text)[0])
    assert comments_of(result) == comments_of(text)
    assert formatted(result) == result


def test_the_sample_with_every_construct_is_canonical(everything: str) -> None:
    assert formatted(everything) == everything


def test_lines_are_not_longer_than_they_need_to_be() -> None:
    for line in formatted(UGLY).split("\n"):
        assert len(line.partition("//")[0].rstrip()) <= WIDTH_MAX


def test_a_file_with_errors_is_left_alone() -> None:
    diagnostics = Diagnostics()
    assert format_source(Source("t", "soter 1;\nconst X float = ;"), diagnostics) is None
    assert diagnostics.has_errors


@all_rows(
    ("before", "after"),
    [
        ("soter 1;", "soter 1;\n"),
        ("\ufeffsoter 1;\r\n\r\n\r\n\r\n// a\r\n", "soter 1;\n\n// a\n"),
        ("soter 1;// a", "soter 1;  // a\n"),
        ("/* a */soter/* b */1;", "/* a */ soter /* b */ 1;\n"),
        ("soter 1;const X:T=a//why\n+b;", "soter 1;\nconst X: T = a  // why\n    + b;\n"),
        ("soter 1; rta R {\n\n\n}", "soter 1;\nrta R { }\n"),
        ("soter 1; rta R {\n// why\n}", "soter 1;\nrta R {\n  // why\n}\n"),
        ("soter 1; rta R { // why\n}", "soter 1;\nrta R {  // why\n}\n"),
        ("soter 1;\nconst X: T = [ ];", "soter 1;\nconst X: T = [];\n"),
        ("soter 1;\nconst X: T = f( -a , ! b );", "soter 1;\nconst X: T = f(-a, !b);\n"),
        ("soter 1;\nconst X: T = 1 .x;", "soter 1;\nconst X: T = 1 .x;\n"),
        (
            (
                "soter 1; rta R { rest abs(vehicle.speed) < LARGEST_SPEED_AT_REST   moves vehicle.way "
                "by 0.1 // why\n  , gap_to_the_one_in_front by LARGEST_LOSS_OF_THE_GAP*2.0 down ,"
                "vehicle.heading by 0.25 within TIME_TO_REST ; }"
            ),
            (
                "soter 1;\nrta R {\n  rest abs(vehicle.speed) < LARGEST_SPEED_AT_REST moves "
                "vehicle.way by 0.1  // why\n      , gap_to_the_one_in_front by LARGEST_LOSS_OF_THE_GAP * 2.0 down,\n"
                "      vehicle.heading by 0.25 within TIME_TO_REST;\n}\n"
            ),
        ),
    ],
)
def test_small_cases(before: str, after: str) -> None:
    if "//why" in before:
        after = after.replace("// why", "//why")
    assert formatted(before) == after
    assert formatted(after) == after


@all_rows(
    "text",
    [
        "a",
        "a.b[1].c",
        "f(a, -1, [1.5, 2e3], { x: 10ms, y: true })",
        "-(a + b) * c",
        "--a",
        "a - (b - c)",
        "a - b - c",
        "(a < b) == (c < d)",
        "!(a && b) || c && d",
        "(a || b) && c",
        "a ? b : c ? d : e",
        "(a ? b : c) ? d : e",
        "(a ? b : c) + 1",
        "iris.f(x)[2]",
        "float(n) / 2.0",
        "choose bool",
        "fair choose iris.Mode",
        "choose [a, b] + 1",
        "fair choose { a, { x: 1 }, choose bool }",
    ],
)
def test_expressions_print_as_they_are_written(parsed: Parsed, text: str) -> None:
    file, problems = parsed(f"soter 1; const X: float = {text};")
    assert problems == ()
    (declaration,) = file.declarations
    assert isinstance(declaration, tree.ConstDecl)
    assert declaration.value is not None
    assert expression_text(declaration.value) == text


def test_needless_parentheses_are_not_printed(parsed: Parsed) -> None:
    file, _ = parsed("soter 1; const X: float = ((a) * (b)) + ((c));")
    (declaration,) = file.declarations
    assert isinstance(declaration, tree.ConstDecl)
    assert declaration.value is not None
    assert expression_text(declaration.value) == "a * b + c"


def test_an_expression_that_was_not_parsed_prints_as_dots(parsed: Parsed) -> None:
    file, _ = parsed("soter 1; const X: float = 1 + ;")
    (declaration,) = file.declarations
    assert isinstance(declaration, tree.ConstDecl)
    assert declaration.value is not None
    assert expression_text(declaration.value) == "..."
