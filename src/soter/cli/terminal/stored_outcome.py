"""Stores the outcome of a command, and tells it again while nothing that it rests on has changed.

Purpose: `Printout` is the output of a command before its width and colours are known;
`store_outcome` keeps it and the JSON document in the cache, and `stored_outcome` finds them for the
same options and files of the same bytes, with the same Soter, compiler, Python and packages.
Non-goals: which outcomes may be told again: the command decides that.

A look-up does not parse the program: for each program a small file lists the files that it was made
of, and an outcome is stored under the hashes of their contents as they were when the program was
read. A change in a listed file gives another hash; and no file can join the program without a
change in a listed one.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import stat
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.cli.terminal.console import Console, painted
from soter.diagnostics.diagnostic import SoterError
from soter.native.cache import (
    cache_dir,
    digest,
    find_cached,
    is_trusted_file,
    new_entry,
    soter_sha256,
)
from soter.native.compiler import find_compiler

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from soter.report.tables import Styled
    from soter.verify.claims.results import VerifyReport

NAME = "proof-outcome"
FILE = "outcome.json"
PACKAGES = ("cffi", "numpy", "z3-solver")
"""Installed packages whose version a result may depend on."""
LIST_MAX = 1024 * 1024
PAINT = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(eq=False)
class Printout:
    """The output of a command in order, as JSON: coloured texts, and tables `[headers, rows]`."""

    parts: list[Any] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """Adds a text of one line or several."""
        self.parts.append(text)

    def add_table(self, headers: Sequence[str], rows: Iterable[Sequence[str | Styled]]) -> None:
        """Adds a table."""
        cells = [[c if isinstance(c, str) else asdict(c) for c in row] for row in rows]
        self.parts.append([list(headers), cells])

    @staticmethod
    def paint(style: str, text: str) -> str:
        """`text` in colour; `print_to` removes the colour for a console without colours."""
        return painted(style, text)

    def print_to(self, console: Console) -> None:
        """Prints all parts, unless the console is for JSON."""
        for part in self.parts if not console.json else ():
            if isinstance(part, str):
                console.say(part if console.color_out else PAINT.sub("", part))
            else:
                from soter.report.tables import Styled  # noqa: PLC0415 - needs NumPy

                rows = [[c if isinstance(c, str) else Styled(**c) for c in row] for row in part[1]]
                console.say(console.table(part[0], rows))


@dataclass(frozen=True)
class StoredOutcome:
    """The output, fields and exit code of a command. `warned`: it had warnings, not stored here."""

    exit: int
    fields: dict[str, object]
    printed: Printout
    warned: bool = False


def stored_outcome(file: str, words: Sequence[str]) -> StoredOutcome | None:
    """The outcome stored for the program in `file` and these words; None if anything changed."""
    try:
        contents = {path: _file_sha256(path) for path in _stored_files(file)}
        entry = (
            find_cached(NAME, _content_hash(file, words, contents), (FILE,)) if contents else None
        )
        if entry is None:
            return None
        stored = json.loads((entry / FILE).read_text(encoding="utf-8"))
        printed = Printout(stored["printed"])
        return StoredOutcome(stored["exit"], stored["fields"], printed, stored["warned"])
    except (OSError, ValueError, SoterError):
        return None


def store_outcome(
    file: str, words: Sequence[str], contents: Mapping[Path, str], outcome: StoredOutcome
) -> None:
    """Stores an outcome; ignores an error of the cache.

    `words`: the command and its options. `contents`: by path, the SHA-256 of every file that the
    program in `file` was made of, as the file was when it was read.
    """
    absolute = {_absolute_path(path): sha256 for path, sha256 in contents.items()}
    fields = {"exit": outcome.exit, "fields": outcome.fields, "warned": outcome.warned}
    text = json.dumps({**fields, "printed": outcome.printed.parts}, allow_nan=False)
    try:
        with new_entry(NAME, _content_hash(file, words, absolute), (FILE,)) as entry:
            (entry / FILE).write_text(text, encoding="utf-8")
        _write_file_list(file, list(absolute))
    except (OSError, SoterError):
        return  # the next command computes it again


def _content_hash(file: str, words: Sequence[str], contents: Mapping[str, str]) -> str:
    """A hash over everything on which an outcome depends."""
    compiler = find_compiler()
    made_by = [soter_sha256(), compiler.identity, *compiler.flags, sys.version, platform.platform()]
    made_by += [f"{name} {_package_version(name)}" for name in PACKAGES]
    files = [part for pair in sorted(contents.items()) for part in pair]
    return digest([*made_by, str(len(files)), *files, _absolute_path(file), file, *words])


def _package_version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _absolute_path(path: str | Path) -> str:
    """The absolute path; keeps links and `..`, as the targets of links may change."""
    return str(Path(path).absolute())


def _file_sha256(path: str) -> str:
    """The SHA-256 of a plain file; OSError for other files, which may differ on each read."""
    if not stat.S_ISREG(os.stat(path).st_mode):  # noqa: PTH116 - follows links on purpose
        raise OSError(f"{path} is no plain file")
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


# ---------------------------------------------------------------- which files


def _file_list_path(file: str) -> Path:
    """The path of the file that lists a program's files; clearing the cache does not remove it."""
    return cache_dir() / "verdicts" / f"{digest([_absolute_path(file)])[:32]}.files"


def _stored_files(file: str) -> list[str]:
    """The files of which the program was made when its outcome was stored; [] if unknown."""
    path = _file_list_path(file)
    status = path.stat()
    if not is_trusted_file(status) or status.st_size > LIST_MAX:
        return []
    return [str(name) for name in json.loads(path.read_text(encoding="utf-8"))]


def _write_file_list(file: str, paths: list[str]) -> None:
    to = _file_list_path(file)
    to.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    handle, made = tempfile.mkstemp(dir=to.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        json.dump(paths, stream)
    Path(made).replace(to)


def remember_verdicts(report: VerifyReport) -> None:
    """Stores the verdicts for editors to show (`soter lsp`)."""
    from soter.verify.proof_cache import store_verdicts_of_file  # noqa: PLC0415 - only for new verdicts

    kept: dict[str, dict[str, object]] = {}
    for m in report.modules:
        sets = m.problem.kind != "nodes"
        kept[m.name] = {
            "verdict": m.verdict,
            "headline": m.headline,
            "seconds": m.seconds,
            "system": report.system,
            "properties": {n: f.verdict for n, f in m.findings.items()},
            "horizon_ns": m.problem.times.horizon_ns if sets else None,
            "horizon_needed_ns": m.problem.times.h_star if sets else None,
        }
    store_verdicts_of_file(Path(report.path), report.program_sha256, kept)
