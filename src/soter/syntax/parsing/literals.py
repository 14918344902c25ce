"""Numbers and durations: a token to a literal.

Purpose: what a FLOAT, INT or DURATION token is worth, exactly, or that it is too large.
Non-goals: how digits are grouped into tokens (`tokens.py`).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.syntax import tree
from soter.syntax.tokens import DURATION, FLOAT, INT, UNIT_NS

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.syntax.parsing.cursor import Cursor

NUMBERS = frozenset([FLOAT, INT, DURATION])

_INT_DIGITS_MAX = 40
_DURATION_NS_MAX = 2**63 - 1


def number(cursor: Cursor, span: Span, kind: str) -> tree.Expr:
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


def _duration(cursor: Cursor, span: Span, text: str) -> tree.Expr:
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


def _too_large(cursor: Cursor, span: Span, what: str) -> tree.Expr:
    cursor.i -= 1
    cursor.report("L005", f"this number is too large for {what}", span)
    cursor.i += 1
    return tree.ErrorExpr(span)
