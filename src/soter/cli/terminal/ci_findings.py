"""What continuous integration is told of: a verdict or a diagnostic with its place in a program.

Purpose: `CiFinding` before it has a format; `diagnostic_findings` makes one of each diagnostic.
Non-goals: the formats (`ci_formats.py`); exit codes (`command_outcome.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from soter.diagnostics.diagnostic import Diagnostic, Severity, Span

if TYPE_CHECKING:
    from collections.abc import Iterable


Kind = Literal["pass", "fail", "open", "warning"]
"""`fail`: shown to be wrong; `open`: nothing is shown either way, which is no success."""


@dataclass(frozen=True)
class CiFinding:
    """A finding. `rule`: a diagnostic's code, a property or a command; `name`: its subject."""

    kind: Kind
    rule: str
    name: str
    text: str
    span: Span | None = None
    """Where the finding stands in a program; None: in no file."""
    details: tuple[str, ...] = ()
    seconds: float = 0.0


def diagnostic_findings(items: Iterable[Diagnostic]) -> list[CiFinding]:
    """A finding for every diagnostic: `fail` for an error, `warning` for any other."""
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


def place_in_file(span: Span | None) -> tuple[str, int, int, int, int] | None:
    """File, line, column, end line, end column (one past the last); None without a file."""
    if span is None or span.source.name.startswith("<"):
        return None  # standard input, the prelude
    source, end = span.source, span.end
    return source.name, span.line, span.column, source.line_of(end), source.column_of(end)
