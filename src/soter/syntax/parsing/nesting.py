"""How deep expressions and types may nest.

Purpose: the bound that keeps this parser, and any recursive pass after it, within the stack on
hostile input; its two messages, and the height of a tree.
Non-goals: nested blocks of statements (`statements.py`).
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from soter.diagnostics.span import Span
from soter.syntax import tree

if TYPE_CHECKING:
    from typing import NoReturn

    from soter.syntax.parsing.cursor import Cursor

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


def height(expr: tree.Expr) -> int:
    """Levels of an expression tree, without recursion; stops counting past `LEVELS_MAX`."""
    level = 0
    row: list[tree.Expr] = [expr]
    while row and level <= LEVELS_MAX:
        level += 1
        row = [child for parent in row for child in children(parent)]
    return level


def children(expr: tree.Expr) -> list[tree.Expr]:
    """The expressions directly inside `expr`, in source order."""
    found: list[tree.Expr] = []
    for field in fields(expr):
        value = getattr(expr, field.name)
        if isinstance(value, tree.Expr):
            found.append(value)
        elif isinstance(value, tree.Interval):
            found += [value.low, value.high]
        elif isinstance(value, tuple):
            for part in value:
                if isinstance(part, tree.Expr):
                    found.append(part)
                elif isinstance(part, tuple):
                    found.extend(p for p in part if isinstance(p, tree.Expr))
    return found
