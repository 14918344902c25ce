"""Read a program's files: the main file, its imports, the prelude.

Purpose: every text that belongs to a program, parsed once, in a fixed order, with a hash of
the whole; missing files, bad encodings and import cycles become diagnostics.
Non-goals: names and types (`scope.py` and the checkers).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

from soter.diagnostics.diagnostic import Diagnostics
from soter.diagnostics.source import Source
from soter.syntax import tree
from soter.syntax.parser import parse

MAX_FILE_BYTES = 4 * 1024 * 1024
PRELUDE_DIR = Path(__file__).resolve().parent.parent / "prelude"


@dataclass(eq=False)
class LoadedFile:
    """One parsed file. `imports` maps the local name of an import to its file."""

    path: Path
    source: Source
    file: tree.File
    prefix: str
    """Prefix of the full names of its declarations: "" for the main file, else `name.`"""
    library: bool
    """Imported or prelude: unused declarations are not worth a warning."""
    prelude: bool = False
    imports: dict[str, LoadedFile | None] = field(default_factory=dict)


@dataclass(eq=False)
class LoadedProgram:
    """Everything that was read; `digest` is still open so that data files can be added."""

    main: LoadedFile
    files: list[LoadedFile]
    prelude: list[LoadedFile]
    digest: hashlib._Hash


def read_text(path: Path, shown: str, diagnostics: Diagnostics, span: object = None) -> str | None:
    """Read a UTF-8 file; None, with a diagnostic (D001, D005), when that is not possible."""
    from soter.diagnostics.span import Span  # noqa: PLC0415 - typing helper only

    at = span if isinstance(span, Span) else None
    try:
        if path.is_dir():
            diagnostics.error("D001", f"`{shown}` is a folder, not a file", at)
            return None
        data = path.read_bytes()
    except FileNotFoundError:
        diagnostics.error("D001", f"cannot find `{shown}`", at, helps=_near(path))
        return None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        diagnostics.error("D005", f"cannot read `{shown}`: {reason.lower()}", at)
        return None
    if len(data) > MAX_FILE_BYTES:
        diagnostics.error(
            "D005",
            f"`{shown}` is too large: {len(data)} bytes, at most {MAX_FILE_BYTES} are read",
            at,
        )
        return None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        diagnostics.error("D005", f"`{shown}` is not UTF-8: byte {error.start} is wrong", at)
        return None


def _near(path: Path) -> tuple[str, ...]:
    import difflib  # noqa: PLC0415 - only on the way to an error

    try:
        names = [p.name for p in path.parent.iterdir() if p.is_file()]
    except OSError:
        return (f"there is no folder `{path.parent}`",)
    close = difflib.get_close_matches(path.name, names, n=1)
    return (f"did you mean `{path.parent / close[0]}`?",) if close else ()


def load(path: str, diagnostics: Diagnostics, text: str | None = None) -> LoadedProgram | None:
    """Load `path` (or `text` in its place) and all it imports; None when nothing was read."""
    main_path = Path(path)
    if text is None:
        text = read_text(main_path, path, diagnostics)
        if text is None:
            return None
    digest = hashlib.sha256(b"soter 1\0")
    loader = _Loader(diagnostics, digest)
    prelude = [loader.prelude(p) for p in sorted(PRELUDE_DIR.glob("*.soter"))]
    main = loader.file(main_path, path, text, prefix="", library=False)
    loader.follow_imports(main, (main.path.resolve(),))
    return LoadedProgram(main, loader.files, prelude, digest)


class _Loader:
    """Loads each file once, however often it is imported."""

    def __init__(self, diagnostics: Diagnostics, digest: hashlib._Hash) -> None:
        self.diagnostics = diagnostics
        self.digest = digest
        self.files: list[LoadedFile] = []
        self.by_path: dict[Path, LoadedFile] = {}

    def prelude(self, path: Path) -> LoadedFile:
        text = path.read_text(encoding="utf-8")
        self._hash(path.name, text)
        source = Source(f"<prelude>/{path.name}", text)
        parsed = parse(source, self.diagnostics)
        return LoadedFile(path, source, parsed, "", library=True, prelude=True)

    def file(self, path: Path, shown: str, text: str, *, prefix: str, library: bool) -> LoadedFile:
        self._hash(prefix, text)
        source = Source(shown, text)
        loaded = LoadedFile(path, source, parse(source, self.diagnostics), prefix, library)
        self.files.append(loaded)
        self.by_path[path.resolve()] = loaded
        return loaded

    def _hash(self, name: str, text: str) -> None:
        data = text.encode("utf-8", "surrogatepass")
        self.digest.update(f"{name}\0{len(data)}\0".encode())
        self.digest.update(data)

    def follow_imports(self, loaded: LoadedFile, chain: tuple[Path, ...]) -> None:
        for imported in loaded.file.imports:
            name = imported.name.text
            if name in loaded.imports:
                self.diagnostics.error(
                    "N002", f"`{name}` is imported twice", imported.name.span, "second import"
                )
                continue
            loaded.imports[name] = self._import(loaded, imported, chain)

    def _import(
        self, loaded: LoadedFile, imported: tree.ImportDecl, chain: tuple[Path, ...]
    ) -> LoadedFile | None:
        path = loaded.path.parent / imported.path
        try:
            resolved = path.resolve()
        except (OSError, ValueError, RuntimeError):
            resolved = path
        if resolved in chain:
            cycle = " -> ".join(p.name for p in (*chain[chain.index(resolved) :], resolved))
            self.diagnostics.error(
                "D002",
                f"import cycle: {cycle}",
                imported.path_span,
                "this import closes the cycle",
                helps=("move what both files need into a third file and import that",),
            )
            return None
        known = self.by_path.get(resolved)
        if known is not None:
            return known
        shown = str(path)
        text = read_text(path, shown, self.diagnostics, imported.path_span)
        if text is None:
            return None
        prefix = f"{imported.name.text}."
        if any(f.prefix == prefix for f in self.files):
            prefix = f"{imported.name.text}_{len(self.files)}."
        child = self.file(path, shown, text, prefix=prefix, library=True)
        self.follow_imports(child, (*chain, resolved))
        return child
