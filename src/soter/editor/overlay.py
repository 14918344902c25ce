"""What the checker reads while somebody types: open documents first, then the disk.

Purpose: texts that are not saved, and no text parsed and no data file read twice.
Non-goals: which documents are open (`documents.py`).
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.load.loader import SourceAccess

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.diagnostics.source import Source
    from soter.diagnostics.span import Span
    from soter.language.load.loader import LoadedFile
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

KEPT_TREES = 64
"""Parsed texts that are remembered: a program has a few files, and one of them changes."""
KEPT_DATA = 32
KEPT_CONSTANTS = 64
"""Files whose constants are remembered."""


class Overlay(SourceAccess):
    """Reads for an editor. `open_text` gives the text of a document that is open, else None."""

    def __init__(self, open_text: Callable[[Path], str | None]) -> None:
        self._open_text = open_text
        self._trees: OrderedDict[
            tuple[str, str], tuple[Source, tree.File, tuple[Diagnostic, ...]]
        ] = OrderedDict()
        self._data: OrderedDict[tuple[object, ...], tuple[Value, bytes]] = OrderedDict()
        self._constants: OrderedDict[tuple[str, ...], dict[str, tuple[Value, int]]] = OrderedDict()

    def text(
        self, path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
    ) -> str | None:
        """The text in the editor, or the one on the disk."""
        text = self._open_text(path)
        return text if text is not None else super().text(path, shown, diagnostics, span)

    def parsed(self, shown: str, text: str, diagnostics: Diagnostics) -> tuple[Source, tree.File]:
        """The tree; the same one for the same text, with what was said about it."""
        known = self._trees.get((shown, text))
        if known is None:
            own_diagnostics = Diagnostics()
            source, file = super().parsed(shown, text, own_diagnostics)
            known = self._trees[shown, text] = source, file, own_diagnostics.items
            if len(self._trees) > KEPT_TREES:
                self._trees.popitem(last=False)
        self._trees.move_to_end((shown, text))
        for item in known[2]:
            diagnostics.add(item)
        return known[0], known[1]

    def data(self, path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
        """The value in a data file; read again where the file was written."""
        try:
            status = path.stat()
        except (OSError, ValueError):
            return super().data(path, t, tell)
        key = (str(path), t, status.st_mtime_ns, status.st_size, status.st_ino)
        known = self._data.get(key)
        if known is None:
            self._constants.clear()  # whatever was computed of the file as it was
            known = self._data[key] = super().data(path, t, tell)
            if len(self._data) > KEPT_DATA:
                self._data.popitem(last=False)
        self._data.move_to_end(key)
        return known

    def constants(self, file: LoadedFile) -> dict[str, tuple[Value, int]]:
        """Those of a file that is imported; the same ones while no text that it is made of changes.

        A constant of data is looked up behind the data, which forgets all where a file was written.
        """
        texts = _texts(file) if file.library else None
        if texts is None:
            return {}
        if texts not in self._constants:
            self._constants[texts] = {}
            if len(self._constants) > KEPT_CONSTANTS:
                self._constants.popitem(last=False)
        self._constants.move_to_end(texts)
        return self._constants[texts]


def _texts(file: LoadedFile) -> tuple[str, ...] | None:
    """Places and texts of a file and of all that it imports; None where one was not read."""
    texts: list[str] = []
    todo, seen = [file], {id(file)}
    while todo:
        now = todo.pop()
        texts += [str(now.path), now.source.text]
        for name, imported in now.imports.items():
            if imported is None:
                return None
            texts += [name, str(imported.path)]
            if id(imported) not in seen:
                seen.add(id(imported))
                todo.append(imported)
    return tuple(texts)
