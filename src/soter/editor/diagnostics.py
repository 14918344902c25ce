"""Diagnostics of the checker as an editor shows them.

Purpose: one diagnostic to the protocol's, file by file: range, code, related places, and the notes
and helps in its text.
Non-goals: rendering for terminals (`diagnostics/render.py`), edits (`code_actions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lsprotocol import types as lsp

from soter.diagnostics.diagnostic import Severity
from soter.editor.positions import path_of_span, uri_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic, Label
    from soter.diagnostics.span import Span
    from soter.editor.positions import Lines

SEVERITIES = {
    Severity.ERROR: lsp.DiagnosticSeverity.Error,
    Severity.WARNING: lsp.DiagnosticSeverity.Warning,
}
UNUSED = "W001"
AGAIN = "and here"
"""What `language/diagnostic_filter.py` writes at the further places of one mistake."""


def by_file(
    diagnostics: Iterable[Diagnostic], main: Path, lines_of: Callable[[Span], Lines]
) -> dict[Path, list[lsp.Diagnostic]]:
    """The diagnostics of each file; what is about no place stands at the start of `main`."""
    files: dict[Path, list[lsp.Diagnostic]] = {main: []}
    for d in diagnostics:
        if d.primary is None:
            nowhere = lsp.Range(lsp.Position(0, 0), lsp.Position(0, 0))
            files[main].append(_shown(d, nowhere, "", lines_of))
            continue
        again = [label for label in d.secondary if label.text == AGAIN]
        for label in (d.primary, *again):
            path = path_of_span(label.span)
            text = d.primary.text
            shown = _shown(d, range_of(label.span, lines_of), text, lines_of, leave_out=label)
            files.setdefault(path, []).append(shown)
    return files


def range_of(span: Span, lines_of: Callable[[Span], Lines]) -> lsp.Range:
    """The range of a span, of one character at least where there is one on its line."""
    return lines_of(span).range(span.start, span.end)


def _shown(
    d: Diagnostic,
    where: lsp.Range,
    label: str,
    lines_of: Callable[[Span], Lines],
    leave_out: Label | None = None,
) -> lsp.Diagnostic:
    first = f"{d.message}: {label}" if label else d.message
    lines = [first, *(f"note: {n}" for n in d.notes), *(f"help: {h}" for h in d.helps)]
    related = [
        lsp.DiagnosticRelatedInformation(
            lsp.Location(uri_of(path_of_span(other.span)), range_of(other.span, lines_of)),
            other.text or "here",
        )
        for other in d.secondary
        if other is not leave_out
    ]
    return lsp.Diagnostic(
        range=where,
        message="\n".join(lines),
        severity=SEVERITIES[d.severity],
        code=d.code,
        source="soter",
        related_information=related or None,
        tags=[lsp.DiagnosticTag.Unnecessary] if d.code == UNUSED else None,
    )
