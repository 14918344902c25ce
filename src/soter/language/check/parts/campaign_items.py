"""Check what campaigns read of a system: its measures and its faults.

Purpose: `measure` and `faults { ... }` -> symbols; paths that are mentioned count as used.
Non-goals: flattening and numbers (`elaborate/tests_and_faults/faults.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expression_base import is_error, sound
from soter.language.check.expression_context import Context
from soter.language.model import typed
from soter.language.model.types import DURATION, FLOAT, INT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.span import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type
    from soter.language.syntax import tree


def campaigned(
    shared: Shared,
    system: typed.SystemSymbol,
    decl: tree.SystemDecl,
    inside: Context,
    faults: list[tree.SystemFault],
) -> None:
    """Fill in measures and faults; `inside`: the place of a property of the system."""
    system.measures = tuple(_measures(shared, decl.measures, inside))
    place = Context(inside.scope, f"the faults of `{decl.name.text}`")
    system.faults = tuple(_fault(shared, f, place) for f in faults)


def _measures(
    shared: Shared, items: tuple[tree.MeasureItem, ...], context: Context
) -> Iterator[typed.MeasureSymbol]:
    """What campaigns tell of its runs: a number each, with a name of its own."""
    seen: dict[str, Span] = {}
    place = Context(context.scope, "a measure")
    number = shared.number
    for item in items:
        first = seen.setdefault(item.name.text, item.name.span)
        if first is not item.name.span:
            message = f"measure `{item.name.text}` is said twice"
            also = ((first, "the first time"),)
            shared.diagnostics.error("N002", message, item.name.span, "again", also=also)
        value = shared.check_expr(item.value, context, FLOAT)
        parts = (
            number(item.interval.low, place, FLOAT, "the range of a histogram"),
            number(item.interval.high, place, FLOAT, "the range of a histogram"),
            number(item.bins, place, INT, "the number of bins"),
            number(item.every, place, DURATION, "`every`"),
        )
        if not any(is_error(e) for e in (value, *parts)):
            yield typed.MeasureSymbol(item.name.text, value, *parts, item.span)


def _fault(shared: Shared, item: tree.SystemFault, context: Context) -> typed.SystemFaultSymbol:
    """One item of `faults { ... }`."""
    wanted = DURATION if item.kind in {"late", "overrun"} else FLOAT

    def checked(e: tree.SyntaxExpr | None, what: str, t: Type) -> typed.TypedExpr | None:
        return None if e is None else sound(shared.number(e, context, t, what))

    if item.target is not None:
        mentioned(item.target, context.scope)
    amounts = [checked(e, f"`{item.kind}`", wanted) for e in item.by]
    return typed.SystemFaultSymbol(
        kind=item.kind,
        path=item.target.text if item.target is not None else "",
        by=tuple(e for e in amounts if e is not None),
        rate=checked(item.rate, "how often", FLOAT),
        per=checked(item.per, "`per`", DURATION),
        lasts=checked(item.lasts, "`for`", DURATION),
        text=" ".join(item.span.text.split()).rstrip(" ;"),
        span=item.span,
    )


def mentioned(path: tree.DottedPath, scope: FileScope) -> None:
    """A name that is only replaced or disturbed counts as used."""
    for part in path.parts:
        if part.text in scope.entries:
            scope.entries[part.text].used = True
        elif part.text in scope.imports:
            scope.used_imports.add(part.text)
