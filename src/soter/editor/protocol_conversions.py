"""Converts places and diagnostics to the editor's protocol (LSP).

Purpose: converts character offsets to positions and back, in the encoding that client and server
have chosen, and files to URIs. A diagnostic becomes one of the protocol, file by file: range, code,
related places, and the notes and helps in its text.
Non-goals: rendering for terminals (`diagnostics/render.py`), edits (`requests.py`).
"""

from __future__ import annotations

import re
from bisect import bisect_right
from pathlib import Path
from typing import TYPE_CHECKING

from lsprotocol import types as lsp
from pygls import uris

from soter.diagnostics.diagnostic import Diagnostic, Label, Severity, Span
from soter.language.load.loader import PRELUDE_DIR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


UNIT_BYTES = {"utf-8": 1, "utf-16": 2, "utf-32": 4}
"""Bytes of a unit of each encoding a client may ask for."""
_CODECS = {"utf-8": "utf-8", "utf-16": "utf-16-le", "utf-32": "utf-32-le"}
_BREAK = re.compile(r"\r\n|\n|\r")
_PRELUDE = "<prelude>/"


class Lines:
    """The lines of a text by the protocol; `encoding`: "utf-8", "utf-16" or "utf-32"."""

    def __init__(self, text: str, encoding: str = "utf-16") -> None:
        self.text = text
        self._starts = [0, *(m.end() for m in _BREAK.finditer(text))]
        self._codec = _CODECS[encoding]
        self._bytes = UNIT_BYTES[encoding]
        self._ascii = text.isascii()

    def position(self, offset: int) -> lsp.Position:
        """The position of a character offset; for one beyond the text, the end of the text."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self._starts, offset) - 1
        return lsp.Position(line, self._unit_count(self.text[self._starts[line] : offset]))

    def offset(self, position: lsp.Position) -> int:
        """The character offset of a position; beyond its line, the offset of the line's end."""
        if position.line >= len(self._starts):
            return len(self.text)
        start = self._starts[position.line]
        end = self._line_end(position.line)
        if self._ascii:
            return min(start + position.character, end)
        units = 0
        for offset in range(start, end):
            if units >= position.character:
                return offset
            units += self._unit_count(self.text[offset])
        return end

    def range(self, start: int, end: int) -> lsp.Range:
        """The range from one offset to another."""
        return lsp.Range(self.position(start), self.position(end))

    def whole_range(self) -> lsp.Range:
        """The range of the whole text."""
        return self.range(0, len(self.text))

    def _unit_count(self, text: str) -> int:
        if self._ascii:
            return len(text)
        return len(text.encode(self._codec, "surrogatepass")) // self._bytes

    def _line_end(self, line: int) -> int:
        """The offset of the line's end, before its line break."""
        if line + 1 == len(self._starts):
            return len(self.text)
        end = self._starts[line + 1] - 1
        is_pair = self.text[end] == "\n" and end and self.text[end - 1] == "\r"
        return end - 1 if is_pair else end


def path_of(uri: str) -> Path:
    """The path that a URI means; a made-up name for a text without a file (`untitled:`)."""
    fs_path = uris.to_fs_path(uri) if uri.startswith("file:") else None
    return Path(fs_path) if fs_path else Path(re.sub(r"[^\w.-]", "_", uri))


def uri_of(path: Path) -> str:
    """The URI of a file."""
    uri = uris.from_fs_path(str(path))
    assert uri is not None, path
    return str(uri)


def path_of_span(span: Span) -> Path:
    """The path of the file in which a span lies, also for files of the prelude."""
    name = span.source.name
    if name.startswith(_PRELUDE):
        return PRELUDE_DIR / name.removeprefix(_PRELUDE)
    return Path(name)


SEVERITIES = {
    Severity.ERROR: lsp.DiagnosticSeverity.Error,
    Severity.WARNING: lsp.DiagnosticSeverity.Warning,
}
UNUSED = "W001"
AGAIN = "and here"
"""The label that `language/front_end.py` puts at further places of one mistake."""


def shown_by_file(
    diagnostics: Iterable[Diagnostic], main: Path, lines_of: Callable[[Span], Lines]
) -> dict[Path, list[lsp.Diagnostic]]:
    """By file: its diagnostics; a diagnostic without a place is at the start of `main`."""
    files: dict[Path, list[lsp.Diagnostic]] = {main: []}
    for d in diagnostics:
        if d.primary is None:
            nowhere = lsp.Range(lsp.Position(0, 0), lsp.Position(0, 0))
            files[main].append(_lsp_diagnostic(d, nowhere, "", lines_of))
            continue
        again = [label for label in d.secondary if label.text == AGAIN]
        for label in (d.primary, *again):
            path = path_of_span(label.span)
            text = d.primary.text
            shown = _lsp_diagnostic(
                d, range_of(label.span, lines_of), text, lines_of, leave_out=label
            )
            files.setdefault(path, []).append(shown)
    return files


def range_of(span: Span, lines_of: Callable[[Span], Lines]) -> lsp.Range:
    """The range of a span; at least one character long, if the line has a character at the span."""
    return lines_of(span).range(span.start, span.end)


def _lsp_diagnostic(
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
