"""Places as editors count them: lines from 0, and units of the encoding that was agreed on.

Purpose: offsets of characters to positions and back, whatever the text holds; files to URIs.
Non-goals: what stands at a place.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from pathlib import Path
from typing import TYPE_CHECKING

from lsprotocol import types as lsp
from pygls import uris

from soter.language.load.loader import PRELUDE_DIR

if TYPE_CHECKING:
    from soter.diagnostics.span import Span

UNIT_BYTES = {"utf-8": 1, "utf-16": 2, "utf-32": 4}
"""Bytes of a unit of each encoding a client may ask for."""
_CODECS = {"utf-8": "utf-8", "utf-16": "utf-16-le", "utf-32": "utf-32-le"}
_BREAK = re.compile(r"\r\n|\n|\r")
_PRELUDE = "<prelude>/"


class Lines:
    r"""The lines of one text. The protocol ends a line at `\n`, `\r\n` and a lone `\r`.

    `encoding`: "utf-8", "utf-16" or "utf-32".
    """

    def __init__(self, text: str, encoding: str = "utf-16") -> None:
        self.text = text
        self._starts = [0, *(m.end() for m in _BREAK.finditer(text))]
        self._codec = _CODECS[encoding]
        self._bytes = UNIT_BYTES[encoding]
        self._ascii = text.isascii()

    def position(self, offset: int) -> lsp.Position:
        """The position of a character offset; beyond the text it is the text's end."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self._starts, offset) - 1
        before = self.text[self._starts[line] : offset]
        return lsp.Position(line, self._units(before))

    def offset(self, position: lsp.Position) -> int:
        """The character offset of a position; beyond its line it is the line's end."""
        if position.line >= len(self._starts):
            return len(self.text)
        start = self._starts[position.line]
        end = self._end(position.line)
        if self._ascii:
            return min(start + position.character, end)
        units = 0
        for offset in range(start, end):
            if units >= position.character:
                return offset
            units += self._units(self.text[offset])
        return end

    def range(self, start: int, end: int) -> lsp.Range:
        """The range from one offset to another."""
        return lsp.Range(self.position(start), self.position(end))

    def whole(self) -> lsp.Range:
        """The range of the whole text."""
        return self.range(0, len(self.text))

    def _units(self, text: str) -> int:
        if self._ascii:
            return len(text)
        return len(text.encode(self._codec, "surrogatepass")) // self._bytes

    def _end(self, line: int) -> int:
        """Where the line ends, before its line break."""
        if line + 1 == len(self._starts):
            return len(self.text)
        end = self._starts[line + 1] - 1
        is_pair = self.text[end] == "\n" and end and self.text[end - 1] == "\r"
        return end - 1 if is_pair else end


def path_of(uri: str) -> Path:
    """The file that a URI means; a name of its own for what is in no file (`untitled:`)."""
    fs_path = uris.to_fs_path(uri) if uri.startswith("file:") else None
    return Path(fs_path) if fs_path else Path(re.sub(r"[^\w.-]", "_", uri))


def uri_of(path: Path) -> str:
    """The URI of a file."""
    uri = uris.from_fs_path(str(path))
    assert uri is not None, path
    return str(uri)


def path_of_span(span: Span) -> Path:
    """The file that a span is in: what the prelude is called in messages is no path."""
    name = span.source.name
    if name.startswith(_PRELUDE):
        return PRELUDE_DIR / name.removeprefix(_PRELUDE)
    return Path(name)
