"""What can be done about a problem with one click.

Purpose: the edits that a diagnostic brings (`diagnostics/fix.py`), as code actions.
Non-goals: which edits there are: whoever reports a problem says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lsprotocol import types as lsp

from soter.editor.diagnostics import AGAIN, by_file, range_of
from soter.editor.positions import path_of_span

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.diagnostics.span import Span
    from soter.editor.documents import Document, Documents

ASKED = "did you mean "


def actions(
    document: Document, documents: Documents, wanted: lsp.Range
) -> Iterator[lsp.CodeAction]:
    """The fixes of the problems that touch a range of a document, which has been checked."""
    checked = document.checked
    if checked is None or checked.loaded is None:
        return
    lines = documents.lines(checked.loaded.main.source)
    start, end = lines.offset(wanted.start), lines.offset(wanted.end)
    for d in checked.diagnostics.items:
        if d.primary is None or d.primary.span.source is not checked.loaded.main.source:
            continue
        spans = [d.primary.span, *(o.span for o in d.secondary if o.text == AGAIN)]
        if any(s.start <= end and start <= s.end for s in spans):
            yield from _fixes(d, documents)


def _fixes(d: Diagnostic, documents: Documents) -> Iterator[lsp.CodeAction]:
    assert d.primary is not None
    shown = by_file([d], path_of_span(d.primary.span), documents.lines_of)
    problems = shown[path_of_span(d.primary.span)][:1]
    for number, fix in enumerate(d.fixes):
        yield lsp.CodeAction(
            title=_title(fix.title),
            kind=lsp.CodeActionKind.QuickFix,
            diagnostics=problems,
            is_preferred=number == 0 and len(d.fixes) == 1,
            edit=workspace_edit(((e.span, e.text) for e in fix.edits), documents),
        )


def _title(help_: str) -> str:
    """A help line as an order: `Write ...`, `Change to ...`."""
    if help_.startswith(ASKED):
        help_ = "change to " + help_.removeprefix(ASKED).removesuffix("?")
    return help_[:1].upper() + help_[1:]


def workspace_edit(edits: Iterable[tuple[Span, str]], documents: Documents) -> lsp.WorkspaceEdit:
    """Texts for places in any files, as the editor applies them."""
    changes: dict[str, list[lsp.TextEdit]] = {}
    for span, text in edits:
        uri = documents.uri(path_of_span(span))
        where = range_of(span, documents.lines_of)
        changes.setdefault(uri, []).append(lsp.TextEdit(where, text))
    return lsp.WorkspaceEdit(changes)
