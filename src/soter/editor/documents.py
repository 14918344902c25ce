"""Keeps the open documents, checks them, and publishes what was found.

Purpose: checks every open document as a program of its own; the checker reads open documents
first, then the disk, and reads no text and no data file twice. The diagnostics of a file are those
that any of these checks found in it.
Non-goals: when to check (`server.py`), what to answer to a question.
"""

from __future__ import annotations

import os
import re
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from lsprotocol import types as lsp

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Source, Span
from soter.editor.name_resolution import index_of
from soter.editor.protocol_conversions import Lines, path_of, path_of_span, shown_by_file, uri_of
from soter.language.front_end import CheckResult, check_file
from soter.language.load.loader import LoadedFile, LoadedProgram, SourceAccess, load

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from soter.editor.name_definitions import NameIndex
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

    Publish = Callable[[str, int | None, list[lsp.Diagnostic]], None]


KEPT_TREES = 64
"""How many parsed texts are kept: a program has a few files, and one of them changes."""
KEPT_DATA = 32
KEPT_CONSTANTS = 64
"""How many files' constants are kept."""


class Overlay(SourceAccess):
    """Reads files for an editor; `open_text` returns the text of an open document, else None."""

    def __init__(self, open_text: Callable[[Path], str | None]) -> None:
        self._open_text = open_text
        self._tree = lru_cache(KEPT_TREES)(self._parse)
        self._data: OrderedDict[tuple[object, ...], tuple[Value, bytes]] = OrderedDict()
        self._constants: OrderedDict[tuple[str, ...], dict[str, tuple[Value, int]]] = OrderedDict()

    def text(
        self, path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
    ) -> str | None:
        """The text in the editor, or the one on the disk if the file is not open."""
        text = self._open_text(path)
        return text if text is not None else super().text(path, shown, diagnostics, span)

    def parsed(self, shown: str, text: str, diagnostics: Diagnostics) -> tuple[Source, tree.File]:
        """The tree of a text, kept with its diagnostics for the next time."""
        source, file, items = self._tree(shown, text)
        for item in items:
            diagnostics.add(item)
        return source, file

    def _parse(self, shown: str, text: str) -> tuple[Source, tree.File, tuple[Diagnostic, ...]]:
        own_diagnostics = Diagnostics()
        source, file = super().parsed(shown, text, own_diagnostics)
        return source, file, own_diagnostics.items

    def data(self, path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
        """The value in a data file, which is read again after it was written."""
        try:
            status = path.stat()
        except (OSError, ValueError):
            return super().data(path, t, tell)
        key = (str(path), t, status.st_mtime_ns, status.st_size, status.st_ino)
        known = self._data.get(key)
        if known is None:
            self._constants.clear()  # they may depend on the file's old content
            known = self._data[key] = super().data(path, t, tell)
            if len(self._data) > KEPT_DATA:
                self._data.popitem(last=False)
        self._data.move_to_end(key)
        return known

    def constants(self, file: LoadedFile) -> dict[str, tuple[Value, int]]:
        """The known constants of an imported file, kept while no text or data file changes."""
        texts = _texts_with_imports(file) if file.library else None
        if texts is None:
            return {}
        if texts not in self._constants:
            self._constants[texts] = {}
            if len(self._constants) > KEPT_CONSTANTS:
                self._constants.popitem(last=False)
        self._constants.move_to_end(texts)
        return self._constants[texts]


def _texts_with_imports(file: LoadedFile) -> tuple[str, ...] | None:
    """Paths and texts of a file and of all its imports; None if one could not be read."""
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


KEPT_LINES = 64
FILES_MAX = 2000
"""In how many files of a folder a name is searched."""
LEFT_OUT = {"node_modules", "__pycache__", "build"}


@dataclass(eq=False)
class Document:
    """An open document. `path` is that of its file, or a made-up name if it is not saved."""

    uri: str
    path: Path
    version: int | None
    text: str
    checked: CheckResult | None = None
    """The result of the last check, of this text or an older one."""
    good: CheckResult | None = None
    """The last check without errors."""
    found: dict[Path, list[lsp.Diagnostic]] = field(default_factory=dict)
    """Diagnostics of the last check, by file."""
    indexed: tuple[tuple[int, ...], LoadedProgram, NameIndex] | None = None
    _good_index: tuple[CheckResult, NameIndex] | None = None

    @property
    def good_index(self) -> NameIndex | None:
        """The names of the last text without errors."""
        if self.good is None or self.good.loaded is None:
            return None
        if self._good_index is None or self._good_index[0] is not self.good:
            self._good_index = self.good, index_of(self.good.loaded)
        return self._good_index[1]


class Documents:
    """All open documents; `publish` is called with URI, version and diagnostics of a file."""

    def __init__(self, publish: Publish) -> None:
        self.encoding = "utf-16"
        self.folders: tuple[Path, ...] = ()
        """The folders of the workspace."""
        self.reading = Overlay(self.text_of)
        self._publish = publish
        self._open: dict[Path, Document] = {}
        self._waiting: dict[Path, None] = {}
        self._lines: dict[int, tuple[Source, Lines]] = {}

    # ------------------------------------------------------------ what is open

    def __iter__(self) -> Iterator[Document]:
        return iter(tuple(self._open.values()))

    def document_of(self, uri: str) -> Document | None:
        """The open document that a URI means."""
        return self._open.get(whole(path_of(uri)))

    def text_of(self, path: Path) -> str | None:
        """The text of an open document."""
        document = self._open.get(whole(path))
        return None if document is None else document.text

    def uri(self, path: Path) -> str:
        """The URI of a file: the one the editor uses, where it is open."""
        document = self._open.get(whole(path))
        return document.uri if document is not None else uri_of(Path(os.path.normpath(path)))

    def open(self, uri: str, version: int | None, text: str) -> None:
        """Notes that a document was opened, or opened again."""
        path = path_of(uri)
        self._open[whole(path)] = Document(uri, path, version, text)
        self.mark_changed([path])

    def update(self, uri: str, version: int | None, text: str) -> None:
        """Notes that a document got a new text."""
        document = self.document_of(uri)
        if document is None:
            self.open(uri, version, text)
            return
        document.version = version
        document.text = text
        self.mark_changed([document.path])

    def close(self, uri: str) -> None:
        """Notes that a document was closed: the file on the disk counts from now on."""
        document = self._open.pop(whole(path_of(uri)), None)
        if document is None:
            return
        self._waiting.pop(whole(document.path), None)
        self._publish_found(document.found)
        self.mark_changed([document.path])

    # ------------------------------------------------------------ checking

    def mark_changed(self, paths: Iterable[Path]) -> None:
        """Notes that files have changed: open documents that have them wait for a check."""
        for path in paths:
            key = whole(path)
            if key in self._open:
                self._waiting.setdefault(key)
            for other, document in self._open.items():
                if other != key and key in self._files_of(document):
                    self._waiting.setdefault(other)

    def mark_all_changed(self) -> None:
        """Notes that a data file was written: all documents wait, as any may read it."""
        self._waiting.update(dict.fromkeys(self._open))

    @property
    def waiting(self) -> bool:
        """Whether a document waits for a check."""
        return bool(self._waiting)

    def check_next(self) -> None:
        """Checks the document that has waited longest, if any, and publishes the result."""
        if self._waiting:
            self._check(self._open[next(iter(self._waiting))])

    def check_if_waiting(self, document: Document) -> None:
        """Checks a document now if it waits, so that answers are about its present text."""
        if whole(document.path) in self._waiting:
            self._check(document)

    def _check(self, document: Document) -> None:
        del self._waiting[whole(document.path)]
        checked = check_file(str(document.path), document.text, reading=self.reading)
        document.checked = checked
        if checked.ok:
            document.good = checked
        before = document.found
        document.found = shown_by_file(checked.diagnostics.items, document.path, self.lines_of)
        self._publish_found({document.path: [], **document.found, **before})

    def _publish_found(self, files: Iterable[Path]) -> None:
        """Publishes what all checks together found in each of some files."""
        for key in dict.fromkeys(whole(path) for path in files):
            items: dict[str, lsp.Diagnostic] = {}
            for document in self._open.values():
                for path, diagnostics in document.found.items():
                    if whole(path) == key:
                        items |= {f"{d.range} {d.code} {d.message}": d for d in diagnostics}
            document_here = self._open.get(key)
            version = None if document_here is None else document_here.version
            self._publish(self.uri(key), version, list(items.values()))

    def _files_of(self, document: Document) -> set[Path]:
        """The files that a document was made of when it was last checked or parsed."""
        loaded = None if document.checked is None else document.checked.loaded
        return set() if loaded is None else {whole(f.path) for f in loaded.files}

    # ------------------------------------------------------------ for questions

    def parsed_program(self, document: Document) -> LoadedProgram:
        """The trees of a document's text as it is now, and of what it imports."""
        return self.parsed_names(document)[0]

    def name_index(self, document: Document) -> NameIndex:
        """The names of a document's text as it is now, and of what it imports."""
        return self.parsed_names(document)[1]

    def parsed_names(self, document: Document) -> tuple[LoadedProgram, NameIndex]:
        """Trees and names of a document, made again only if a text has changed."""
        loaded = load(str(document.path), Diagnostics(), document.text, self.reading)
        assert loaded is not None, "a text can always be read"
        key = tuple(id(f.file) for f in loaded.files)
        if document.indexed is None or document.indexed[0] != key:
            document.indexed = key, loaded, index_of(loaded)
        return document.indexed[1:]

    def every_file(self) -> Iterator[LoadedFile]:
        """Yields every file of the workspace, parsed, open ones first."""
        for path in self.programs():
            if (text := self.reading.text(path, str(path), Diagnostics())) is not None:
                source, file = self.reading.parsed(str(path), text, Diagnostics())
                yield LoadedFile(path, source, file, "", library=False)

    def programs(self, about: Document | None = None) -> list[Path]:
        """Every program of the workspace: open documents, files of its folders and beside one."""
        paths = {whole(d.path): d.path for d in self}
        beside = () if about is None else (about.path.parent,)
        for folder in (*self.folders, *beside):
            for path in islice(_soter_files(folder), FILES_MAX):
                paths.setdefault(whole(path), path)
        return list(paths.values())

    def programs_naming(self, name: str, about: Document) -> list[tuple[Path, NameIndex]]:
        """The programs whose main file contains a name, and the document itself."""
        word = re.compile(rf"\b{re.escape(name)}\b")
        programs = [(about.path, self.name_index(about))]
        for path in self.programs(about):
            if whole(path) == whole(about.path):
                continue
            text = self.reading.text(path, str(path), Diagnostics())
            if text is None or not word.search(text):
                continue
            loaded = load(str(path), Diagnostics(), text, self.reading)
            assert loaded is not None
            programs.append((path, index_of(loaded)))
        return programs

    def lines_of(self, span: Span) -> Lines:
        """The lines of the text that a span is of."""
        return self.lines(span.source)

    def lines(self, source: Source) -> Lines:
        """The lines of a source."""
        known = self._lines.get(id(source))
        if known is None:
            known = self._lines[id(source)] = source, Lines(source.text, self.encoding)
            if len(self._lines) > KEPT_LINES:
                del self._lines[next(iter(self._lines))]
        return known[1]

    def location(self, span: Span) -> lsp.Location:
        """The place of a span, for the editor."""
        lines = self.lines_of(span)
        return lsp.Location(self.uri(path_of_span(span)), lines.range(span.start, span.end))


def _soter_files(folder: Path) -> Iterator[Path]:
    """The programs below a folder, hidden folders and environments left out."""
    for at, folders, files in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith(".") and f not in LEFT_OUT)
        yield from (Path(at) / f for f in sorted(files) if f.endswith(".soter"))


@lru_cache(maxsize=1024)
def whole(path: Path) -> Path:
    """The one path by which a file is known, however it is reached."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path
