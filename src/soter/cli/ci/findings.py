"""What a command found, one by one, before it is written in a format of somebody else.

Purpose: `CiFinding`: a verdict or a diagnostic with its place; diagnostics as such.
Non-goals: the formats (`sarif.py`, `junit.py`, `github.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from soter.diagnostics.diagnostic import Severity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.diagnostics.span import Span

Kind = Literal["pass", "fail", "open", "warning"]
"""`fail`: wrong, as is shown; `open`: nothing is shown either way, which is no success either."""


@dataclass(frozen=True)
class CiFinding:
    """One finding. `rule`: a code that `soter explain` knows; `name`: what it is about."""

    kind: Kind
    rule: str
    name: str
    text: str
    span: Span | None = None
    """Where it stands; None: in no file."""
    details: tuple[str, ...] = ()
    seconds: float = 0.0


def of_diagnostics(items: Iterable[Diagnostic]) -> list[CiFinding]:
    """A finding for every diagnostic."""
    return [
        CiFinding(
            "fail" if d.severity is Severity.ERROR else "warning",
            d.code,
            d.code,
            d.message,
            None if d.primary is None else d.primary.span,
            (
                *((d.primary.text,) if d.primary is not None and d.primary.text else ()),
                *d.notes,
                *(f"help: {text}" for text in d.helps),
            ),
        )
        for d in items
    ]


def place(span: Span | None) -> tuple[str, int, int, int, int] | None:
    """File, line, column, end line, end column (one past the last); None where there is no file."""
    if span is None or span.source.name.startswith("<"):
        return None  # standard input, the prelude
    source, end = span.source, span.end
    return source.name, span.line, span.column, source.line_of(end), source.column_of(end)
