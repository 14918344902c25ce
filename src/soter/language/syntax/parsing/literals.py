"""Numbers and durations: a token to a literal.

Purpose: what a FLOAT, INT or DURATION token is worth, exactly, or that it is too large; units that
stand apart, rates in Hz.
Non-goals: how digits are grouped into tokens (`tokens.py`).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import made
from soter.diagnostics.fix import Edit, Fix, replace
from soter.diagnostics.span import Span
from soter.language.syntax import tree
from soter.language.syntax.tokens import DURATION, FLOAT, INT, NAME, UNIT_NS

if TYPE_CHECKING:
    from soter.diagnostics.fix import Help
    from soter.language.syntax.parsing.token_cursor import Cursor

NUMBERS = frozenset([FLOAT, INT, DURATION])

_INT_DIGITS_MAX = 40
_DURATION_NS_MAX = 2**63 - 1


def number(cursor: Cursor, span: Span, kind: str) -> tree.SyntaxExpr:
    """The token before the cursor, of a kind among NUMBERS, as a literal."""
    text = cursor.texts[cursor.i - 1]
    if kind == FLOAT:
        value = float(text)
        if math.isinf(value):
            return _too_large(cursor, span, "a float")
        return tree.FloatLit(span, value, text)
    if kind == INT:
        if len(text) > _INT_DIGITS_MAX:
            return _too_large(cursor, span, "an int")
        return tree.IntLit(span, int(text))
    return _duration(cursor, span, text)


def _duration(cursor: Cursor, span: Span, text: str) -> tree.SyntaxExpr:
    digits = text.rstrip("nusmih")
    unit = UNIT_NS[text[len(digits) :]]
    approximate = float(digits) * unit
    if not approximate <= _DURATION_NS_MAX:
        return _too_large(cursor, span, "a duration (about 292 years at most)")
    if 0 < approximate < 1e-3 or (approximate == 0 and "e" in digits.lower()):
        return tree.DurationLit(span, None, text)  # far below a nanosecond
    exact = Fraction(digits.replace("_", "")) * unit
    value = exact.numerator if exact.denominator == 1 else None
    return tree.DurationLit(span, value, text)


def _too_large(cursor: Cursor, span: Span, what: str) -> tree.SyntaxExpr:
    cursor.i -= 1
    cursor.report("L005", f"this number is too large for {what}", span)
    cursor.i += 1
    return tree.ErrorExpr(span)


def explain_unit(cursor: Cursor, i: int) -> None:
    """`10 ms`: extend the error just reported by a help."""
    if cursor.kinds[i] == NAME and cursor.texts[i] in UNIT_NS and i and cursor.problems:
        last = cursor.problems[-1]
        here = last.primary is not None and last.primary.span.start == cursor.ends[i - 1]
        if here and last.code == "S004" and cursor.kinds[i - 1] in (INT, FLOAT):
            time = f"{cursor.texts[i - 1]}{cursor.texts[i]}"
            whole = cursor.token_span(i - 1).to(cursor.token_span(i))
            help_ = replace(whole, time, f"write `{time}`, without a space")
            cursor.problems[-1] = made(
                last.code, last.message, last.primary, last.secondary, last.notes, (help_,)
            )


def period_of(rate: tree.IntLit | tree.FloatLit) -> str:
    """The period of a rate in Hz, as it would be written."""
    if not 1e-3 < rate.value < 1e9:
        return "10ms"
    period_ms = 1e3 / rate.value
    return f"{period_ms:g}ms" if period_ms >= 1.0 else f"{round(period_ms * 1e6)}ns"


def in_brackets(cursor: Cursor, opener: int) -> Help:
    """`[a, b]` for the braces opened at a token."""
    level = 0
    for i in range(opener, len(cursor.kinds)):
        level += (cursor.kinds[i] == "{") - (cursor.kinds[i] == "}")
        if level == 0 and cursor.kinds[i] == "}":
            edits = (Edit(cursor.token_span(opener), "["), Edit(cursor.token_span(i), "]"))
            return Fix("arrays and lists are written `[a, b]`", edits)
    return "arrays and lists are written `[a, b]`"


def named_fields(cursor: Cursor, opener: int) -> tuple[Help, ...]:
    """`{ x, v }` opened at a token: a record says its fields, an array has other brackets."""
    names: list[str] = []
    i = opener + 1
    while cursor.kinds[i] == NAME and cursor.kinds[i + 1] in (",", "}"):
        names.append(cursor.texts[i])
        i += 2
        if cursor.kinds[i - 1] == "}":
            break
    mixed = names and cursor.kinds[i - 1] == "," and cursor.kinds[i + 1] == ":"
    if mixed and cursor.kinds[i] == NAME:
        last = cursor.token_span(i - 2)
        first = Span(cursor.source, cursor.starts[opener + 1], last.end)
        return (replace(first, ", ".join(f"{name}: {name}" for name in names)),)
    if not names or cursor.kinds[i - 1] != "}" or cursor.texts[opener - 1] == "in":
        return (in_brackets(cursor, opener),)
    whole = Span(cursor.source, cursor.starts[opener], cursor.ends[i - 1])
    record = "{ " + ", ".join(f"{name}: {name}" for name in names) + " }"
    fix = Fix(f"write `{record}`: a record names its fields", (Edit(whole, record),))
    return fix, f"an array or a list is written `[{', '.join(names)}]`"
