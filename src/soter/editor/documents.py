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
    """Reads files for an editor; `open_text` gives the text of an open document, else None."""

    def __init__(self, open_text: Callable[[Path], str | None]) -> None:
        self._open_text = open_text
        self._tree = lru_cache(KEPT_TREES)(self._parse)
        self._data: OrderedDict[tuple[object, ...], tuple[Value, bytes]] = OrderedDict()
        self._constants: OrderedDict[tuple[str, ...], dict[str, tuple[Value, int]]] = OrderedDict()

    def text_of(
        self, path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
    ) -> str | None:
        """The text in the editor if the file is open in it, else the text on the disk."""
        text = self._open_text(path)
        return text if text is not None else super().text_of(path, shown, diagnostics, span)

    def parse(self, shown: str, text: str, diagnostics: Diagnostics) -> tuple[Source, tree.File]:
        """The syntax tree of a text; keeps the tree and its diagnostics for the next call."""
        source, file, items = self._tree(shown, text)
        for item in items:
            diagnostics.add(item)
        return source, file

    def _parse(self, shown: str, text: str) -> tuple[Source, tree.File, tuple[Diagnostic, ...]]:
        own_diagnostics = Diagnostics()
        source, file = super().parse(shown, text, own_diagnostics)
        return source, file, own_diagnostics.items

    def data_value(self, path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
        """The value of a data file; reads the file again only after a change."""
        try:
            status = path.stat()
        except (OSError, ValueError):
            return super().data_value(path, t, tell)
        key = (str(path), t, status.st_mtime_ns, status.st_size, status.st_ino)
        known = self._data.get(key)
        if known is None:
            self._constants.clear()  # they may depend on the file's old content
            known = self._data[key] = super().data_value(path, t, tell)
            if len(self._data) > KEPT_DATA:
                self._data.popitem(last=False)
        self._data.move_to_end(key)
        return known

    def known_constants(self, file: LoadedFile) -> dict[str, tuple[Value, int]]:
        """The constants of an imported file; keeps them until a text or data file changes."""
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
    """Paths and texts of a file and its imports, in turn; None if one cannot be read."""
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
    """An open document. `path`: the path of its file, or a made-up name if it was never saved."""

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
        """The index of the last text without errors; None if each text so far had errors."""
        if self.good is None or self.good.loaded is None:
            return None
        if self._good_index is None or self._good_index[0] is not self.good:
            self._good_index = self.good, index_of(self.good.loaded)
        return self._good_index[1]


class Documents:
    """All open documents; `publish` is called with a file's URI, version and diagnostics."""

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
        """The open document that a URI means; None if the document is not open."""
        return self._open.get(real_path(path_of(uri)))

    def text_of(self, path: Path) -> str | None:
        """The text of an open document; None if the document is not open."""
        document = self._open.get(real_path(path))
        return None if document is None else document.text

    def uri(self, path: Path) -> str:
        """The URI of a file; for an open file, the URI that the editor uses."""
        document = self._open.get(real_path(path))
        return document.uri if document is not None else uri_of(Path(os.path.normpath(path)))

    def open(self, uri: str, version: int | None, text: str) -> None:
        """Notes that a document was opened, or opened again."""
        path = path_of(uri)
        self._open[real_path(path)] = Document(uri, path, version, text)
        self.mark_changed([path])

    def update(self, uri: str, version: int | None, text: str) -> None:
        """Notes that a document has a new text."""
        document = self.document_of(uri)
        if document is None:
            self.open(uri, version, text)
            return
        document.version = version
        document.text = text
        self.mark_changed([document.path])

    def close(self, uri: str) -> None:
        """Notes that a document was closed, so that its file on the disk counts again."""
        document = self._open.pop(real_path(path_of(uri)), None)
        if document is None:
            return
        self._waiting.pop(real_path(document.path), None)
        self._publish_found(document.found)
        self.mark_changed([document.path])

    # ------------------------------------------------------------ checking

    def mark_changed(self, paths: Iterable[Path]) -> None:
        """Notes changed files, so that the open documents that use them wait for a check."""
        for path in paths:
            key = real_path(path)
            if key in self._open:
                self._waiting.setdefault(key)
            for other, document in self._open.items():
                if other != key and key in self._files_of(document):
                    self._waiting.setdefault(other)

    def mark_all_changed(self) -> None:
        """Notes a change of a data file: all documents wait for a check, as any may read it."""
        self._waiting.update(dict.fromkeys(self._open))

    @property
    def waiting(self) -> bool:
        """Whether a document waits for a check."""
        return bool(self._waiting)

    def check_next(self) -> None:
        """Checks the document that waits longest, if any, and publishes the result."""
        if self._waiting:
            self._check(self._open[next(iter(self._waiting))])

    def check_if_waiting(self, document: Document) -> None:
        """Checks a document now if it waits, so that answers are about its present text."""
        if real_path(document.path) in self._waiting:
            self._check(document)

    def _check(self, document: Document) -> None:
        del self._waiting[real_path(document.path)]
        checked = check_file(str(document.path), document.text, reading=self.reading)
        document.checked = checked
        if checked.ok:
            document.good = checked
        before = document.found
        document.found = shown_by_file(checked.diagnostics.items, document.path, self.lines_of)
        self._publish_found({document.path: [], **document.found, **before})

    def _publish_found(self, files: Iterable[Path]) -> None:
        """Publishes for each file the diagnostics from the checks of all documents."""
        for key in dict.fromkeys(real_path(path) for path in files):
            items: dict[str, lsp.Diagnostic] = {}
            for document in self._open.values():
                for path, diagnostics in document.found.items():
                    if real_path(path) == key:
                        items |= {f"{d.range} {d.code} {d.message}": d for d in diagnostics}
            document_here = self._open.get(key)
            version = None if document_here is None else document_here.version
            self._publish(self.uri(key), version, list(items.values()))

    def _files_of(self, document: Document) -> set[Path]:
        """The paths of the files that the last check of a document read."""
        loaded = None if document.checked is None else document.checked.loaded
        return set() if loaded is None else {real_path(f.path) for f in loaded.files}

    # ------------------------------------------------------------ for questions

    def parsed_program(self, document: Document) -> LoadedProgram:
        """The syntax trees of a document's present text and of its imports."""
        return self.parsed_names(document)[0]

    def name_index(self, document: Document) -> NameIndex:
        """The index of the names in a document's present text and in its imports."""
        return self.parsed_names(document)[1]

    def parsed_names(self, document: Document) -> tuple[LoadedProgram, NameIndex]:
        """Trees and index of a document; makes them again only if a text has changed."""
        loaded = load(str(document.path), Diagnostics(), document.text, self.reading)
        assert loaded is not None, "a text can always be read"
        key = tuple(id(f.file) for f in loaded.files)
        if document.indexed is None or document.indexed[0] != key:
            document.indexed = key, loaded, index_of(loaded)
        return document.indexed[1:]

    def every_file(self) -> Iterator[LoadedFile]:
        """Yields every file of the workspace, parsed; open files come first."""
        for path in self.programs():
            if (text := self.reading.text_of(path, str(path), Diagnostics())) is not None:
                source, file = self.reading.parse(str(path), text, Diagnostics())
                yield LoadedFile(path, source, file, "", library=False)

    def programs(self, about: Document | None = None) -> list[Path]:
        """The paths of programs: open documents, files in the workspace and beside `about`."""
        paths = {real_path(d.path): d.path for d in self}
        beside = () if about is None else (about.path.parent,)
        for folder in (*self.folders, *beside):
            for path in islice(_soter_files(folder), FILES_MAX):
                paths.setdefault(real_path(path), path)
        return list(paths.values())

    def programs_naming(self, name: str, about: Document) -> list[tuple[Path, NameIndex]]:
        """The document `about`, and the programs whose main file contains the name."""
        word = re.compile(rf"\b{re.escape(name)}\b")
        programs = [(about.path, self.name_index(about))]
        for path in self.programs(about):
            if real_path(path) == real_path(about.path):
                continue
            text = self.reading.text_of(path, str(path), Diagnostics())
            if text is None or not word.search(text):
                continue
            loaded = load(str(path), Diagnostics(), text, self.reading)
            assert loaded is not None
            programs.append((path, index_of(loaded)))
        return programs

    def lines_of(self, span: Span) -> Lines:
        """The lines of the text in which a span lies."""
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
        """The place of a span in the editor's protocol."""
        lines = self.lines_of(span)
        return lsp.Location(self.uri(path_of_span(span)), lines.range(span.start, span.end))


def _soter_files(folder: Path) -> Iterator[Path]:
    """Yields the programs below a folder, except in hidden folders and environments."""
    for at, folders, files in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith(".") and f not in LEFT_OUT)
        yield from (Path(at) / f for f in sorted(files) if f.endswith(".soter"))


@lru_cache(maxsize=1024)
def real_path(path: Path) -> Path:
    """The resolved path of a file, which is the same for every path to the file."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path
