"""`faults { ... }` of a system: what goes wrong in its runs, and how often.

Purpose: the items of that body.
Non-goals: what they mean (`language/elaborate/tests_and_faults/faults.py`), faults of tests
(`systems.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.syntax import tree
from soter.language.syntax.parsing import instance_arrays
from soter.language.syntax.parsing.items import Items, often, semicolon, spanned, word

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.syntax.parsing.bodies import BodyParser

GIVEN = ("late", "overrun", "bias", "noise", "scale")
"""Kinds that say by how much."""
TIMED = ("late", "overrun")
"""Those of them that say it in time."""


def _fault(parser: BodyParser, kind: str, start: int) -> tree.SystemFault:
    """`kind target [by X] [at N per T] [for T];`."""
    target = instance_arrays.path(parser, f"what `{kind}` is about")
    by: tuple[tree.SyntaxExpr, ...] = ()
    if kind in GIVEN:
        parser.expect_word("by", f"and how much, after what `{kind}` is about")
        by = _amounts(parser, parser.time if kind in TIMED else parser.expr)
    rate = per = lasts = None
    if kind != "late" or parser.is_word("at"):
        parser.expect_word("at", "and how often: `at 2 per 1h`")
        rate = parser.expr("how often")
        parser.expect_word("per", "after the number: `at 2 per 1h`")
        per = parser.time("`per`")
        if parser.accept("for"):
            lasts = parser.time("`for`")
    parser.semicolon("the fault")
    return tree.SystemFault(kind, target, by, rate, per, lasts, parser.span_from(start))


def _amounts(
    parser: BodyParser, one: Callable[[str], tree.SyntaxExpr]
) -> tuple[tree.SyntaxExpr, ...]:
    """`X`, or `[X, Y, ...]`."""
    if not parser.accept("["):
        return (one("how much"),)
    amounts = [one("how much")]
    while parser.accept(","):
        amounts.append(one("how much"))
    parser.expect("]", "after the last of them")
    return tuple(amounts)


_order = spanned(word("any", "after `order`"), semicolon("the order"))
OF_TESTS = ("late", "skip", "overrun")
"""Kinds that a test knows, too."""
KINDS = (*OF_TESTS, "nan", "stuck", "silent", "saturated", "bias", "noise", "scale")
FAULT_ITEMS: Items = {
    "order": often(
        "faults",
        lambda *at: tree.SystemFault("order", None, (), None, None, None, _order(*at)),
        "order any",
    ),
    **dict.fromkeys(KINDS, often("faults", _fault)),
}
