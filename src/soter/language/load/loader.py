"""Reads a program's files: the main file, its imports, the prelude, data files.

Purpose: `load` parses every source of a program once, in a fixed order, and hashes all of them;
missing files, wrong encodings and import cycles become diagnostics. `read_data` reads the json, csv
or npy file of `const NAME: T = data "file";` and checks it against a Soter type, so that wrong data
is a diagnostic.
Non-goals: names and types of a program (`scope.py` and the checkers); units, partial reads.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
import warnings
from dataclasses import dataclass, field
from functools import cache
from itertools import accumulate
from operator import mul
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.diagnostics.system_texts import utf8_text
from soter.language.load.identified_data import IDENTIFIED, DataError, held_out_episodes
from soter.language.load.named_files import ReadError, near_name_helps, parse_json, read_bytes
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.language.model.values import Table, ValueShapeError, check_length, from_json, is_table
from soter.language.syntax.parsing.parser import parse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree


MAX_DATA_BYTES = 16 * 1024 * 1024
MAX_TABLE_BYTES = 128 * 1024 * 1024
"""Most bytes of a file that holds a table."""
MAX_ITEMS = 10_000_000
"""Most lists and numbers in a file's array, since nested empty lists take few bytes."""
NPY_MAGIC = b"\x93NUMPY"
NUMBER_BYTES = 8
TOLD_EVERY = 4096
KINDS = {".json", ".csv", ".npy"}


def read_data(path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
    """Gives the value of type `t` in the file and the file's bytes (for the program's hash).

    `tell` is called repeatedly with a text about progress if the reading takes long. Raises
    `ReadError` if the file cannot be read, `DataError` if its content is wrong.
    """
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        kind = f"a file called `*{suffix}`" if suffix else "a file without an ending"
        raise DataError(f"{kind} cannot be read as data: .json, .csv and .npy can")
    raw = read_bytes(path, MAX_TABLE_BYTES if is_table(t) else MAX_DATA_BYTES)
    tell(f"reading `{path.name}`")
    if suffix == ".json":
        document = _json_document(raw)
    elif suffix == ".csv":
        document = _csv_document(raw, t)
    else:
        document = _npy_document(raw, t)
    try:
        value = _value_in(t, document, lambda n: tell(f"reading `{path.name}`: {n} elements"))
    except (ValueShapeError, RecursionError) as error:
        raise DataError(str(error)) from error
    wrong = _nan_path(t, value, "")
    if wrong is not None:
        raise DataError(wrong)
    return value, raw


def _value_in(t: Type, document: object, tell: Callable[[int], None]) -> Value:
    """Gives the value in a parsed document; it is a `Table` if `is_table` holds of the type."""
    if isinstance(document, Table):
        check_length(t, len(document), "")
        return document
    if not is_table(t) or not isinstance(document, list):
        return from_json(t, document)
    check_length(t, len(document), "")
    return Table.of_values(t.element, _element_values(t.element, document, tell))


def _element_values(
    t: Type, documents: list[object], tell: Callable[[int], None]
) -> Iterator[Value]:
    for i, document in enumerate(documents):
        if i % TOLD_EVERY == 0:
            tell(i)
        yield from_json(t, document, f"[{i}]")


def _nan_path(t: Type, value: Value, path: str) -> str | None:
    """Gives the path of a NaN or an infinity in the value; None if it has neither."""
    if isinstance(t, FloatType):
        if math.isfinite(value):
            return None
        return (f"{path}: " if path else "") + f"{value} is no number a constant may have"
    parts: list[tuple[str, Type, Value]] = []
    if isinstance(value, Table):
        at = value.index_of_first_not_finite()
        return None if at is None else _nan_path(value.element, value[at], f"{path}[{at}]")
    if isinstance(t, RecordType):
        pairs = zip(t.fields, value, strict=True)
        parts = [(f"{path}.{n}" if path else n, f, v) for (n, f), v in pairs]
    elif isinstance(t, (ArrayType, ListType)):
        parts = [(f"{path}[{i}]", t.element, v) for i, v in enumerate(value)]
    return next((w for at, f, v in parts if (w := _nan_path(f, v, at))), None)


def _json_document(raw: bytes) -> object:
    """Gives a JSON document without its keys `"$comment"` and `IDENTIFIED`."""
    try:
        document: object = parse_json(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"it is not valid JSON: {error}") from error
    if isinstance(document, dict):
        document.pop("$comment", None)
        if held_out_episodes(raw) is not None:
            del document[IDENTIFIED]
    return document


def _csv_document(raw: bytes, t: Type) -> object:
    """Gives the rows of a csv file: records with a header line, or plain numbers without one."""
    if not isinstance(t, (ArrayType, ListType)):
        raise DataError(f"a csv file gives an array or a list, not `{t}`")
    try:
        text = raw.decode("utf-8-sig")
        rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    except (ValueError, csv.Error) as error:
        raise DataError(f"it is not a csv file: {error}") from error
    element = t.element
    if isinstance(element, RecordType):
        return _row_records(rows, element)
    if isinstance(element, (ArrayType, ListType)):
        return [[_cell_value(c, element.element, n) for c in row] for n, row in enumerate(rows, 1)]
    return [_cell_value(c, element, n) for n, row in enumerate(rows, 1) for c in row]


def _row_records(rows: list[list[str]], element: RecordType) -> list[dict[str, object]]:
    """Gives a record for each row; the header names the columns, not all of which are used."""
    if not rows:
        raise DataError("it is empty: a header line is expected")
    header = [h.strip() for h in rows[0]]
    if len(set(header)) != len(header):
        twice = next(h for h in header if header.count(h) > 1)
        raise DataError(f"the header names the column `{twice}` twice")
    types = dict(element.fields)
    missing = [n for n in types if n not in header]
    if missing:
        raise DataError(f"the header has no column `{missing[0]}`")
    records = []
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise DataError(f"row {number} has {len(row)} columns, the header {len(header)}")
        cells = zip(header, row, strict=True)
        records.append({h: _cell_value(cell, types[h], number) for h, cell in cells if h in types})
    return records


def _cell_value(text: str, t: Type, row: int) -> object:
    text = text.strip()
    if isinstance(t, (FloatType, IntType)):
        kind = "a number" if isinstance(t, FloatType) else "a whole number"
        try:
            if "_" in text or not text.isascii():  # Python reads 1_000, and digits of any script
                raise ValueError  # noqa: TRY301
            return float(text) if isinstance(t, FloatType) else int(text)
        except ValueError:
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise DataError(f"row {row}: expected {kind}, found `{shown}`") from None
    if isinstance(t, BoolType) and text in {"true", "false"}:
        return text == "true"
    if isinstance(t, (BoolType, EnumType)):
        return text
    raise DataError(f"a cell of a csv file cannot hold a `{t}`")


def _npy_document(raw: bytes, t: Type) -> object:
    if not raw.startswith(NPY_MAGIC):
        raise DataError("it is not an npy file")
    import numpy as np  # noqa: PLC0415 - only programs with npy data pay for it

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            array = np.load(io.BytesIO(raw), allow_pickle=False)
    except Exception as error:  # a broken header can break the reader in any way
        reason = " ".join(str(error).split())[:100]
        raise DataError(f"it is not a complete npy file: {reason}") from error
    if array.dtype.kind not in "biuf":
        raise DataError(f"its elements are `{array.dtype}`, not numbers or bools")
    if sum(accumulate(array.shape, mul)) > MAX_ITEMS:
        raise DataError(f"its shape {array.shape} is too large")
    if is_table(t) and array.dtype.itemsize <= NUMBER_BYTES:
        shape = _array_shape(t.element)
        if shape == array.shape[1:] and array.dtype.kind in "iuf":
            return Table(t.element, array.astype("<f8", order="C").tobytes())
    return array.tolist()


def _array_shape(t: Type) -> tuple[int, ...] | None:
    """Gives the shape of a value that is a float or nested arrays of floats; else None."""
    if isinstance(t, FloatType):
        return ()
    inner = _array_shape(t.element) if isinstance(t, ArrayType) else None
    return (t.size, *inner) if isinstance(t, ArrayType) and inner is not None else None


MAX_FILE_BYTES = 4 * 1024 * 1024
MAX_NAMES_IN_CYCLE = 8
BEFORE = re.compile(r"(?:\s|//[^\n]*)*")
PRELUDE_DIR = Path(__file__).resolve().parents[1] / "prelude"


class SourceAccess:
    """Reads the files of a program: here from the disk, anew each time.

    The editor's subclass (`editor/documents.py`) knows texts that are not saved, and caches trees.
    """

    def text_of(
        self, path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
    ) -> str | None:
        """Gives the text of a source file; None, after a diagnostic, if it cannot be read."""
        return read_text(path, shown, diagnostics, span)

    def parse(self, shown: str, text: str, diagnostics: Diagnostics) -> tuple[Source, tree.File]:
        """Gives the tree of a text, and the source to which the tree's spans refer."""
        source = Source(shown, text)
        return source, parse(source, diagnostics)

    def data_value(self, path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
        """Gives a data file's value and bytes; raises the errors of `read_data`."""
        return read_data(path, t, tell)

    def known_constants(self, _: LoadedFile) -> dict[str, tuple[Value, int]]:
        """Gives constant -> (value, operations it took), for an unchanged file.

        The checker does not compute these again, and adds those that it computes.
        """
        return {}


FROM_DISK = SourceAccess()


@dataclass(eq=False)
class LoadedFile:
    """A parsed file. `imports` maps the local name of an import to its file, None if unread."""

    path: Path
    source: Source
    file: tree.File
    prefix: str
    """Prefix of the full names of its declarations: "" for the main file, else `name.`"""
    library: bool
    """Whether it is imported or of the prelude: then unused declarations get no warning."""
    prelude: bool = False
    imports: dict[str, LoadedFile | None] = field(default_factory=dict)


@dataclass(eq=False)
class LoadedProgram:
    """All files of a program; more data can still be added to `digest`."""

    main: LoadedFile
    files: list[LoadedFile]
    prelude: list[LoadedFile]
    digest: hashlib._Hash
    reading: SourceAccess = FROM_DISK
    """How the sources were read, and how data files are."""
    data: dict[Path, str] = field(default_factory=dict)
    """Path of a data file that was read so far -> its SHA-256."""
    identified: dict[str, int] = field(default_factory=dict)
    """Name of a data file that `soter identify` wrote -> how many episodes were held out."""

    def add_data(self, name: str, path: Path, raw: bytes) -> None:
        """Adds a data file, called `name` by the program, to the program's files and hash."""
        self.digest.update(f"data {name}\0{len(raw)}\0".encode())
        self.digest.update(raw)
        self.data[path] = hashlib.sha256(raw).hexdigest()
        if path.suffix.lower() == ".json" and (episodes := held_out_episodes(raw)) is not None:
            self.identified[name] = episodes

    def may_quote(self, path: Path) -> bool:
        """Whether messages may quote a data file, as a stranger's program may name any file.

        It must be in the folder of the program, or of the file that the program's path links to.
        """
        folders = (self.main.path.parent, _resolved_path(self.main.path).parent)
        return any(_resolved_path(path).is_relative_to(_resolved_path(f)) for f in folders)

    @property
    def contents(self) -> dict[Path, str]:
        """Gives path -> SHA-256 of each file that was read; for a source, of its text in UTF-8."""
        texts = {f.path: f.source.text.encode("utf-8", "surrogatepass") for f in self.files}
        return {**{p: hashlib.sha256(raw).hexdigest() for p, raw in texts.items()}, **self.data}


def read_text(
    path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
) -> str | None:
    """Gives the text of a UTF-8 file; None after reporting D001 or D005."""
    if (name := utf8_text(shown)) != shown:
        why = "its name is not UTF-8, which everything that is written of it is"
        diagnostics.error("D005", f"cannot read `{name}`: {why}", span)
        return None
    try:
        data = read_bytes(path, MAX_FILE_BYTES, special=span is None)
    except ReadError as error:
        if error.missing:
            diagnostics.error("D001", f"cannot find `{shown}`", span, helps=near_name_helps(path))
        else:
            diagnostics.error("D005", f"cannot read `{shown}`: {error}", span)
        return None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        diagnostics.error(
            "D005",
            f"cannot read `{shown}`: it is not UTF-8",
            span,
            notes=(f"the first wrong byte is number {error.start}, in line {line}",),
        )
        return None
    if span is not None and not begins_as_program(text):
        why = "it does not begin with `soter 1;`, so nothing of it is shown"
        diagnostics.error("D005", f"cannot read `{shown}`: {why}", span)
        return None
    return text


def begins_as_program(text: str) -> bool:
    """Whether a text begins as a program; messages do not quote other files."""
    begun = BEFORE.match(text)
    return begun is not None and text.startswith("soter", begun.end())


def load(
    path: str, diagnostics: Diagnostics, text: str | None = None, reading: SourceAccess = FROM_DISK
) -> LoadedProgram | None:
    """Loads the program in `path`, or `text`, and all imports; None if nothing could be read."""
    main_path = Path(path)
    if text is None:
        text = reading.text_of(main_path, path, diagnostics)
        if text is None:
            return None
    loader = _Loader(diagnostics, reading)
    prelude = [loader.load_prelude_file(p) for p in _prelude_paths()]
    main = loader.load(main_path, path, text, prefix="", library=False)
    loader.follow_imports(main)
    return LoadedProgram(main, loader.files, prelude, loader.digest, reading)


@cache
def _prelude_paths() -> tuple[Path, ...]:
    paths = tuple(sorted(PRELUDE_DIR.rglob("*.soter")))
    assert paths, "soter is not whole: it has no prelude"
    return paths


@cache
def _prelude_file(path: Path) -> LoadedFile:
    """Gives a file of the prelude, which is parsed once for all programs of this process."""
    source = Source(f"<prelude>/{path.name}", path.read_text(encoding="utf-8"))
    problems = Diagnostics()
    parsed = parse(source, problems)
    assert not problems.has_errors, path
    return LoadedFile(path, source, parsed, "", library=True, prelude=True)


class _Loader:
    """Loads each file once, however often it is imported."""

    def __init__(self, diagnostics: Diagnostics, reading: SourceAccess) -> None:
        self.diagnostics = diagnostics
        self.reading = reading
        self.digest = hashlib.sha256(b"soter 1\0")
        self.files: list[LoadedFile] = []
        self._by_path: dict[Path, LoadedFile] = {}
        self._prefixes: set[str] = set()

    def load_prelude_file(self, path: Path) -> LoadedFile:
        loaded = _prelude_file(path)
        self._add_to_digest(path.name, loaded.source.text)
        return loaded

    def load(self, path: Path, shown: str, text: str, *, prefix: str, library: bool) -> LoadedFile:
        self._add_to_digest(prefix, text)
        source, parsed = self.reading.parse(shown, text, self.diagnostics)
        loaded = LoadedFile(path, source, parsed, prefix, library)
        self.files.append(loaded)
        self._by_path[_resolved_path(path)] = loaded
        return loaded

    def _add_to_digest(self, name: str, text: str) -> None:
        data = text.encode("utf-8", "surrogatepass")
        self.digest.update(f"{name}\0{len(data)}\0".encode())
        self.digest.update(data)

    def follow_imports(self, main: LoadedFile) -> None:
        """Loads imports depth first, in written order; without recursion, as chains may be long."""
        chain = {_resolved_path(main.path): main}
        waiting = [iter(main.file.imports)]
        while waiting:
            imported = next(waiting[-1], None)
            if imported is None:
                waiting.pop()
                chain.popitem()
                continue
            importer = next(reversed(chain.values()))
            name = imported.name.text
            if name in importer.imports:
                first = next(i for i in importer.file.imports if i.name.text == name)
                self.diagnostics.error(
                    "N002",
                    f"`{name}` is imported twice",
                    imported.name.span,
                    "second import",
                    also=((first.name.span, "first import"),),
                    helps=("give one of them another name",),
                )
                continue
            loaded_file, fresh = self._load_import(importer, imported, chain)
            importer.imports[name] = loaded_file
            if fresh and loaded_file is not None:
                chain[_resolved_path(loaded_file.path)] = loaded_file
                waiting.append(iter(loaded_file.file.imports))

    def _load_import(
        self, importer: LoadedFile, imported: tree.ImportDecl, chain: dict[Path, LoadedFile]
    ) -> tuple[LoadedFile | None, bool]:
        """Gives the imported file (None if unreadable), and whether to follow its imports."""
        path = importer.path.parent / imported.path
        resolved = _resolved_path(path)
        if resolved in chain:
            self._report_import_cycle(resolved, imported, chain)
            return None, False
        known = self._by_path.get(resolved)
        if known is not None:
            return known, False
        shown = str(path)
        text = self.reading.text_of(path, shown, self.diagnostics, imported.path_span)
        if text is None:
            return None, False
        prefix = self._unused_prefix(imported.name.text)
        return self.load(path, shown, text, prefix=prefix, library=True), True

    def _unused_prefix(self, name: str) -> str:
        prefix, count = f"{name}.", 1
        while prefix in self._prefixes:
            count += 1
            prefix = f"{name}_{count}."
        self._prefixes.add(prefix)
        return prefix

    def _report_import_cycle(
        self, closing: Path, imported: tree.ImportDecl, chain: dict[Path, LoadedFile]
    ) -> None:
        paths = list(chain)
        names = [p.name for p in (*paths[paths.index(closing) :], closing)]
        if len(names) > MAX_NAMES_IN_CYCLE:
            names[3:-3] = ["..."]
        itself = len(names) == 2
        self.diagnostics.error(
            "D002",
            "a file imports itself" if itself else "the imports go round in a circle",
            imported.path_span,
            "this import closes the circle",
            notes=("a file is meant to stand on what it imports: " + " -> ".join(names),),
            helps=("leave this import out",)
            if itself
            else ("move what the files share into one of its own, and import that",),
        )


def _resolved_path(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path
