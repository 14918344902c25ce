"""How deep expressions and types may nest.

Purpose: the bound that keeps this parser, and any recursive pass after it, within the stack on
hostile input; its two messages, and the height of a tree. Blocks that have no end.
Non-goals: nested blocks of statements (`statements.py`).
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from soter.diagnostics.span import Span
from soter.language.syntax import tree

if TYPE_CHECKING:
    from typing import NoReturn

    from soter.language.syntax.parsing.token_cursor import Cursor

#: Levels an expression or a type may nest: brackets and operators count one each.
LEVELS_MAX = 200


def too_deep(cursor: Cursor, what: str) -> NoReturn:
    """Report what nests deeper than `LEVELS_MAX`; raises Panic."""
    raise cursor.failure(
        "S020",
        f"this {what} is nested too deeply",
        notes=(f"at most {LEVELS_MAX} levels: brackets and operators count one each",),
        helps=("name parts of it with `let`",),
    )


def report_nesting(cursor: Cursor, span: Span, what: str) -> None:
    """Report an expression whose tree turned out higher than `LEVELS_MAX`."""
    cursor.quiet = -1
    cursor.report(
        "S020",
        f"{what} is nested too deeply",
        Span(span.source, span.start, min(span.end, span.start + 40)),
        "this expression",
        notes=(f"at most {LEVELS_MAX} levels: a chain of n operators has n of them",),
        helps=("name parts of it with `let`, or use a loop",),
    )
    cursor.quiet = -1


def height(expr: tree.SyntaxExpr) -> int:
    """Levels of an expression tree, without recursion; stops counting past `LEVELS_MAX`."""
    level = 0
    row: list[tree.SyntaxExpr] = [expr]
    while row and level <= LEVELS_MAX:
        level += 1
        row = [child for parent in row for child in children(parent)]
    return level


def children(expr: tree.SyntaxExpr) -> list[tree.SyntaxExpr]:
    """The expressions directly inside `expr`, in source order."""
    subexpressions: list[tree.SyntaxExpr] = []
    for field in fields(expr):
        value = getattr(expr, field.name)
        if isinstance(value, tree.SyntaxExpr):
            subexpressions.append(value)
        elif isinstance(value, tree.IntervalExpr):
            subexpressions += [value.low, value.high]
        elif isinstance(value, tuple):
            for part in value:
                if isinstance(part, tree.SyntaxExpr):
                    subexpressions.append(part)
                elif isinstance(part, tuple):
                    subexpressions.extend(p for p in part if isinstance(p, tree.SyntaxExpr))
    return subexpressions


def unclosed(cursor: Cursor, opener: int, what: str) -> None:
    """Report that the block opened at token `opener` has no end before the cursor."""
    begins = "it" if what == "this block" else f"the body of {what}"
    also = [(cursor.token_span(opener), f"{begins} begins here")]
    suspect = _suspect(cursor, opener)
    if suspect is not None:
        opening, closing = suspect
        also.append((cursor.token_span(opening), "this `{` may be the one without an end"))
        also.append((cursor.token_span(closing), "this `}` is indented less"))
    message = f"expected `}}` to close {what}, found {cursor.found()}"
    cursor.report("S012", message, also=tuple(also))


def _suspect(cursor: Cursor, opener: int) -> tuple[int, int] | None:
    """The first pair of braces inside `opener` whose indentation does not match."""
    stack: list[int] = []
    for index in range(opener, min(cursor.i, opener + 20_000)):
        kind = cursor.kinds[index]
        if kind == "{":
            stack.append(index)
        elif kind == "}" and stack:
            opening = stack.pop()
            indent = cursor.line_indent(index)
            if cursor.first_on_line(index) and indent < cursor.line_indent(opening):
                return (opening, index) if opening != opener else None
    return None
