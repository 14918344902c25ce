"""Parses types and sets of values.

Purpose: reads type expressions with their sizes and ranges, and the values that a topic may have.
Non-goals: enumerations, which only a declaration makes (`parser.py`); what a name means.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF, INT, NAME, STRING, printable, string_value
from soter.language.syntax.parsing.literals_and_operators import ANY, LEVELS_MAX, refuse_depth
from soter.language.syntax.parsing.token_cursor import Panic

if TYPE_CHECKING:
    from soter.language.syntax.parsing.expressions import ExpressionParser

_IN_UNITS = frozenset(["/", "*", "^"])
_BUILTIN = frozenset(["bool", "float", "duration", "int"])


def type_expression(parser: ExpressionParser, subject: str) -> tree.TypeExpr:
    """Parses a type expression; gives an ErrorTypeExpr if it is broken."""
    start, depth = parser.i, parser.depth
    try:
        return _parse_type(parser, subject)
    except Panic:
        parser.depth = depth
        _skip_type(parser, start)
        return tree.ErrorTypeExpr(parser.span_from(parser.starts[start]))


def _skip_type(parser: ExpressionParser, start: int) -> None:
    kinds = parser.kinds
    level = sum(1 if k in "{[(" else -1 for k in kinds[start : parser.i] if k in "{}[]()")
    while True:
        kind = kinds[parser.i]
        if kind in (";", EOF, "=") or parser.is_at_declaration():
            break
        if level <= 0 and kind in (",", ")", "}", "{", "in", "]"):
            break
        if kind in ("{", "[", "("):
            level += 1
        elif kind in ("}", "]", ")"):
            level -= 1
        parser.i += 1
    parser.quiet = parser.i


def _parse_type(parser: ExpressionParser, subject: str) -> tree.TypeExpr:
    parser.depth += 1
    if parser.depth > LEVELS_MAX:
        refuse_depth(parser, "type")
    start = parser.starts[parser.i]
    result = _parse_base_type(parser, subject)
    suffixes = 0
    while parser.kinds[parser.i] == "[":
        opener = parser.take()
        parser.tight.append(opener)
        suffixes += 1
        if suffixes > LEVELS_MAX:
            refuse_depth(parser, "type")
        bounded = parser.accept("<=")
        parser.strict = True
        size = parser.expression(ANY)
        parser.strict = False
        parser.close("]", "the size", opener)
        kind = tree.ListTypeExpr if bounded else tree.ArrayTypeExpr
        result = kind(parser.span_from(start), result, size)
    if parser.is_word("unit") and parser.kinds[parser.i + 1] == STRING:
        parser.i += 2
        where, unit = parser.token_span(parser.i - 1), string_value(parser.texts[parser.i - 1])
        result = tree.UnitTypeExpr(parser.span_from(start), result, unit, where)
    elif parser.is_word("unit") and parser.kinds[parser.i + 1] == NAME:
        _report_missing_quotes(parser)
    parser.depth -= 1
    return result


def _report_missing_quotes(parser: ExpressionParser) -> None:
    parser.i += 1
    last = parser.i
    while parser.kinds[last + 1] in _IN_UNITS and parser.kinds[last + 2] in (NAME, INT):
        last += 2
    written = parser.token_span(parser.i).to(parser.token_span(last))
    fix = replace(written, f'"{written.text}"')
    parser.report("S005", "a unit stands in quotes", written, helps=(fix,))
    parser.i = last + 1


def _parse_base_type(parser: ExpressionParser, subject: str) -> tree.TypeExpr:
    i = parser.i
    kind = parser.kinds[i]
    if kind in _BUILTIN:
        parser.i = i + 1
        if kind == "int" and parser.kinds[i + 1] == "in" and parser.kinds[i + 2] != "{":
            parser.i += 1
            interval = parser.interval("the range of an int")
            return tree.RangedIntType(parser.span_from(parser.starts[i]), interval)
        return tree.BuiltinType(parser.token_span(i), kind)
    if kind == "{":
        return _parse_record_type(parser)
    if kind == NAME:
        ref = parser.ref("a type")
        _refuse_foreign_type(parser, ref, i)
        return tree.NamedType(ref.span, ref)
    notes: tuple[str, ...] = ()
    helps: tuple[str, ...] = ()
    if kind == "enum":
        helps = ("declare it first: `type Name = enum { ... };`",)
    elif kind == "[":
        notes = ("the size of an array follows its type: `float[3]`",)
    message = f"expected {subject}, found {parser.found()}"
    raise parser.failure("S008", message, notes=notes, helps=helps)


def _refuse_foreign_type(parser: ExpressionParser, ref: tree.Ref, i: int) -> None:
    """Reports a foreign type such as `List<float>`; leaves `double` to the checker."""
    if parser.kinds[parser.i] != "<":
        return
    parser.i = i
    raise parser.failure(
        "S008",
        f"`{printable(ref.text)}<...>` is not a type",
        helps=("an array is `float[8]`, a list of at most eight is `float[<=8]`",),
    )


def _parse_record_type(parser: ExpressionParser) -> tree.TypeExpr:
    opener = parser.take()
    entries: list[tuple[tree.Name, tree.TypeExpr]] = []
    while True:
        if parser.kinds[parser.i] == "}" and not entries:
            raise parser.failure(
                "S008", "expected a field, found `}`", notes=("a record has fields",)
            )
        field = parser.name("the name of a field")
        parser.expect(":", f"after the field `{printable(field.text)}`")
        entries.append((field, _parse_type(parser, "the type of the field")))
        if not parser.accept_comma("}", "the field", opener):
            break
    return tree.RecordTypeExpr(parser.span_from(parser.starts[opener]), tuple(entries))


def parse_value_set(parser: ExpressionParser) -> tree.IntervalExpr | tree.RecordSet:
    """Parses an interval, or a set for each field of a record; raises Panic if it finds neither."""
    opener = parser.i
    if parser.kinds[opener] != "{":
        return parser.interval("a set of values")
    parser.depth += 1
    if parser.depth > LEVELS_MAX:
        refuse_depth(parser, "set")
    parser.i += 1
    entries: list[tuple[tree.Name, tree.IntervalExpr | tree.RecordSet]] = []
    while True:
        field = parser.name("the name of a field")
        if parser.kinds[parser.i] == ":":
            parser.report(
                "S005",
                f"expected `in` after the field `{printable(field.text)}`, found `:`",
                helps=(f"write `{printable(field.text)} in [low, high]`",),
                skip=1,
            )
        else:
            parser.expect("in", f"after the field `{printable(field.text)}`")
        entries.append((field, parse_value_set(parser)))
        if not parser.accept_comma("}", "the field", opener):
            break
    parser.depth -= 1
    return tree.RecordSet(tuple(entries), parser.span_from(parser.starts[opener]))
