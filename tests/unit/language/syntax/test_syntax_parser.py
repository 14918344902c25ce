"""The parser: every construct, exact spans, precedence, literals."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Any

import pytest

from soter.diagnostics.diagnostic import Source, Span
from soter.language.syntax import tree
from tables import all_rows
from work import work_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.diagnostics.diagnostic import Diagnostic

    Parsed = Callable[[str], tuple[tree.File, tuple[Diagnostic, ...]]]


def nodes(node: object) -> Iterator[Any]:
    """Every tree node inside `node`, itself included."""
    if isinstance(node, tuple):
        for part in node:
            yield from nodes(part)
    elif dataclasses.is_dataclass(node) and not isinstance(node, (type, Span, Source)):
        yield node
        for field in dataclasses.fields(node):
            yield from nodes(getattr(node, field.name))


def expression(parsed: Parsed, text: str) -> tree.SyntaxExpr:
    file, problems = parsed(f"soter 1;\nconst X: float = {text};")
    assert problems == ()
    (declaration,) = file.declarations
    assert isinstance(declaration, tree.ConstDecl)
    assert declaration.value is not None
    return declaration.value


def grouped(expr: tree.SyntaxExpr) -> str:
    """The expression with a pair of parentheses for every operator."""
    if isinstance(expr, tree.BinaryExpr):
        return f"({grouped(expr.left)}{expr.op}{grouped(expr.right)})"
    if isinstance(expr, tree.UnaryExpr):
        return f"({expr.op}{grouped(expr.operand)})"
    if isinstance(expr, tree.ConditionalExpr):
        parts = [expr.condition, expr.then, expr.otherwise]
        return "({}?{}:{})".format(*map(grouped, parts))
    return expr.span.text


def test_sample_files_parse_without_a_word(parsed: Parsed, sample: Any) -> None:
    file, problems = parsed(sample.read_text(encoding="utf-8"))
    assert problems == ()
    assert file.edition == 1
    assert file.broken == frozenset()


def test_everything_uses_every_kind_of_node(parsed: Parsed, everything: str) -> None:
    file, problems = parsed(everything)
    assert problems == ()
    used = {type(node) for node in nodes(file)}
    bases = {
        tree.SyntaxExpr,
        tree.TypeExpr,
        tree.SyntaxStmt,
        tree.Decl,
        tree.ErrorExpr,
        tree.ErrorTypeExpr,
    }
    classes = {
        kind
        for kind in vars(tree).values()
        if isinstance(kind, type) and dataclasses.is_dataclass(kind) and kind is not Span
    }
    assert classes - bases - used == set()


def test_every_span_covers_the_text_of_its_node(parsed: Parsed, everything: str) -> None:
    file, _ = parsed(everything)
    checked = 0
    for node in nodes(file):
        if isinstance(node, tree.ElementName):
            assert node.span.text.startswith(f"{node.text}[")
        elif isinstance(node, tree.Name):
            assert node.span.text == node.text
            checked += 1
        elif isinstance(node, tree.FloatLit | tree.DurationLit):
            assert node.span.text == node.text
        elif isinstance(node, tree.Ref | tree.DottedPath):
            written = re.sub(r"\[.*?\]", "", "".join(node.span.text.split()))
            assert written == node.text  # of elements without their indices
        elif isinstance(node, tree.IntervalExpr | tree.ListExpr):
            assert (node.span.text[0], node.span.text[-1]) == ("[", "]")
        elif isinstance(node, tree.Block | tree.RecordSet | tree.RecordExpr):
            assert (node.span.text[0], node.span.text[-1]) == ("{", "}")
        elif isinstance(node, tree.SyntaxStmt):
            assert node.span.text[-1] in ";}"
    assert checked > 250


def test_spans_of_children_lie_inside_their_parents(parsed: Parsed, everything: str) -> None:
    file, _ = parsed(everything)
    for node in nodes(file):
        span = getattr(node, "span", None)
        if span is None:
            continue
        for child in nodes(tuple(getattr(node, f.name) for f in dataclasses.fields(node))):
            inner = getattr(child, "span", None)
            if inner is not None:
                assert span.start <= inner.start <= inner.end <= span.end


def test_spans_give_line_and_column(parsed: Parsed) -> None:
    file, _ = parsed("soter 1;\n\nfun f(x: float): float {\n  return (x + 1.0) * 2.0;\n}\n")
    (fun,) = file.declarations
    assert isinstance(fun, tree.FunDecl)
    assert fun.body is not None
    (statement,) = fun.body.statements
    assert isinstance(statement, tree.ReturnStmt)
    assert (fun.span.line, fun.span.column) == (3, 1)
    assert (statement.value.span.line, statement.value.span.column) == (4, 10)
    assert statement.value.span.text == "(x + 1.0) * 2.0"


@all_rows(
    ("text", "meaning"),
    [
        ("a + b + c", "((a+b)+c)"),
        ("a - b * c / d % e", "(a-(((b*c)/d)%e))"),
        ("-a * b", "((-a)*b)"),
        ("- -a - -b", "((-(-a))-(-b))"),
        ("!a && b || c && !d", "(((!a)&&b)||(c&&(!d)))"),
        ("a < b + c == false", None),
        ("a + b < c * d && e", "(((a+b)<(c*d))&&e)"),
        ("a ? b : c ? d : e", "(a?b:(c?d:e))"),
        ("a ? b ? c : d : e", "(a?(b?c:d):e)"),
        ("a || b ? c + d : e && f", "((a||b)?(c+d):(e&&f))"),
        ("(a + b) * c", "((a+b)*c)"),
        ("a * (b + c)", "(a*(b+c))"),
        ("-a.b[1].c(2)", "(-a.b[1].c(2))"),
        ("(a == b) != c", "((a==b)!=c)"),
    ],
)
def test_operators_bind_as_the_grammar_says(parsed: Parsed, text: str, meaning: str | None) -> None:
    if meaning is None:
        _, problems = parsed(f"soter 1; const X: bool = {text};")
        assert [p.code for p in problems] == ["S017"]
    else:
        assert grouped(expression(parsed, text)) == meaning


@pytest.mark.parametrize(
    ("text", "value_ns"),
    [
        ("10ms", 10_000_000),
        ("1.5us", 1_500),
        ("0.1s", 100_000_000),
        ("2min", 120_000_000_000),
        ("1h", 3_600_000_000_000),
        ("1e3ns", 1_000),
        ("1_000ns", 1_000),
        ("0s", 0),
        ("0.5ns", None),
        ("1e-400s", None),
        ("0.0000000001s", None),
    ],
)
def test_durations_are_exact_nanoseconds(parsed: Parsed, text: str, value_ns: int | None) -> None:
    literal = expression(parsed, text)
    assert isinstance(literal, tree.DurationLit)
    assert literal.value_ns == value_ns


def test_numbers_have_their_values(parsed: Parsed) -> None:
    integer, floating = expression(parsed, "1_000"), expression(parsed, "1_0.2_5e-1")
    assert isinstance(integer, tree.IntLit)
    assert isinstance(floating, tree.FloatLit)
    assert (integer.value, floating.value) == (1000, 1.025)


@pytest.mark.parametrize("text", ["300000000h", "1e400", "9" * 41, "1e9999999999s"])
def test_numbers_too_large_for_their_type_are_refused(parsed: Parsed, text: str) -> None:
    _, problems = parsed(f"soter 1; const X: float = {text};")
    assert [p.code for p in problems] == ["L005"]


def test_contextual_words_are_names_elsewhere(parsed: Parsed) -> None:
    words = [
        "ac",
        "sc",
        "safe",
        "safer",
        "ttf",
        "clean",
        "verify",
        "grid",
        "abstracts",
        "by",
        "horizon",
        "levels",
        "reads",
        "drives",
        "disturbance",
        "hold",
        "integrate",
        "rk4",
        "euler",
        "substeps",
        "measured",
        "within",
        "default",
        "module",
        "until",
        "always",
        "never",
        "force",
        "replace",
        "set",
        "input",
        "every",
        "skew",
        "eventually",
        "leadsto",
        "data",
        "from",
        "queue",
        "drop_oldest",
        "fault",
        "failsafe",
        "assumes",
        "guarantees",
        "on",
        "takeover",
        "max_age",
        "fair",
        "quantum",
        "late",
        "skip",
        "overrun",
        "at",
        "most",
        "invariant",
        "invariants",
    ]
    body = "".join(f"  let {w} = {w}_0;\n  place.{w} = {w};\n" for w in words)
    file, problems = parsed(f"soter 1;\nfun f(): float {{\n{body}  return 1.0;\n}}\n")
    assert problems == ()
    assert file.broken == frozenset()


@pytest.mark.parametrize(
    ("text", "fair", "kind"),
    [
        ("choose bool", False, tree.BuiltinType),
        ("fair choose iris.Mode", True, tree.NamedType),
        ("choose [1, fair]", False, tree.IntervalExpr),
        ("fair choose { fair, choose bool, }", True, tuple),
        ("choose { }", False, tuple),
    ],
)
def test_a_choice_says_what_it_is_from(
    parsed: Parsed, text: str, *, fair: bool, kind: type
) -> None:
    choice = expression(parsed, text)
    assert isinstance(choice, tree.ChooseExpr)
    assert choice.fair is fair
    assert isinstance(choice.type or choice.interval or choice.options, kind)
    assert choice.span.text == text


def test_a_choice_binds_like_a_name(parsed: Parsed) -> None:
    sum_ = expression(parsed, "choose [0, 1] + fair choose { 2 } * fair")
    assert isinstance(sum_, tree.BinaryExpr)
    assert sum_.op == "+"
    assert isinstance(sum_.left, tree.ChooseExpr)
    assert isinstance(sum_.right, tree.BinaryExpr)


def test_a_test_has_faults_and_inputs(parsed: Parsed) -> None:
    text = "late M.dm by 1ms; skip a; skip b at most 3; overrun late by 2ms; quantum 1ms; "
    file, problems = parsed(f"soter 1; test T {{ {text} input t in {{ 1, 2 }} every 1s; }}")
    assert problems == ()
    (test,) = file.declarations
    assert isinstance(test, tree.TestDecl)
    faults = [
        (f.kind, f.component.text, f.by is None, f.at_most is None)
        for f in test.faults
        if isinstance(f, tree.TimingFaultItem)
    ]
    assert faults == [
        ("late", "M.dm", False, True),
        ("skip", "a", True, True),
        ("skip", "b", True, False),
        ("overrun", "late", False, True),
    ]
    assert test.quantum is not None
    (drawn,) = test.inputs
    assert isinstance(drawn, tree.DriveInput)
    assert len(drawn.values or ()) == 2


def test_a_loop_is_one_for_each_kind_of_item_in_it(parsed: Parsed) -> None:
    items = "r[i]: R { a = r[1].b, set K = i }; always x; for j in i..2 { q[i][j]: R; }"
    file, problems = parsed(f"soter 1; system S {{ for i in 0..2 {{ {items} }} }}")
    assert problems == ()
    (system,) = file.declarations
    assert isinstance(system, tree.SystemDecl)
    (instances,), (properties,) = system.instances, system.properties
    assert isinstance(instances, tree.Repeated)
    assert isinstance(properties, tree.Repeated)
    assert instances.span == properties.span
    one, inner = instances.items
    assert isinstance(one, tree.Instance)
    assert isinstance(one.name, tree.ElementName)
    assert (one.name.text, len(one.renames), len(one.sets)) == ("r", 1, 1)
    assert isinstance(inner, tree.Repeated)
    (element,) = inner.items
    assert isinstance(element, tree.Instance)
    assert isinstance(element.name, tree.ElementName)
    assert len(element.name.indices) == 2


def test_int_range_of_a_disturbance_belongs_to_the_disturbance(parsed: Parsed) -> None:
    file, problems = parsed("soter 1; plant P period 1ms { disturbance k: int in [0, 3]; }")
    assert problems == ()
    (plant,) = file.declarations
    assert isinstance(plant, tree.PlantDecl)
    (disturbance,) = plant.disturbances
    assert isinstance(disturbance.type, tree.BuiltinType)
    assert disturbance.interval.span.text == "[0, 3]"


def test_long_flat_programs_are_fine(parsed: Parsed) -> None:
    statements = "  let a = 1.0;\n" * 10_000
    elements = ", ".join(["1.5"] * 5_000)
    choices = "if a { } " + "elseif b { } " * 2_000
    text = (
        f"soter 1;\nconst A: float[5000] = [{elements}];\n"
        f"fun f(): float {{\n{statements}{choices}return 1.0;\n}}\n"
    )
    file, problems = parsed(text)
    assert problems == ()
    fun = file.declarations[1]
    assert isinstance(fun, tree.FunDecl)
    assert fun.body is not None
    assert len(fun.body.statements) == 10_002


def test_nesting_up_to_the_limit_is_fine(parsed: Parsed) -> None:
    assert parsed(f"soter 1; const X: float = {'(' * 190}1.0{')' * 190};")[1] == ()
    assert parsed(f"soter 1; const X: float = {'1.0 + ' * 190}1.0;")[1] == ()


def test_the_work_of_parsing_grows_with_the_text(parsed: Parsed, everything: str) -> None:
    body = everything.split("\n", 1)[1].replace("import", "//import")
    times = 1500 // everything.count("\n")
    _, once = work_of(lambda: parsed("soter 1;\n" + body))
    _, often = work_of(lambda: parsed("soter 1;\n" + body * times))
    assert often <= 1.1 * times * once
