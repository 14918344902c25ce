"""A package: the files a target is made of, and writing them.

Purpose: text in, a folder out, without harming files that soter did not write.
Non-goals: what the files say (`c99.py`).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError, reason
from soter.language.load.bounded_read import ReadError, read_bytes
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.report.atomic_write import atomic_write, own_place
from soter.report.templates import filled

if TYPE_CHECKING:
    from pathlib import Path

MANIFEST = ".soter-files.json"
"""In every folder that soter builds: the SHA-256 of each file as soter wrote it."""

BYTES_MAX = 2**28
"""Of a file: `soter` writes none that is longer, so a longer one is not read."""


@dataclass(frozen=True)
class PackageFile:
    """One file: its path in the package. `yours`: made once, then the person's to change."""

    path: str
    text: str
    yours: bool = False


def filled_file(path: str, template: str, /, **context: object) -> PackageFile:
    """A file from a template below this folder, which is told how its C is compiled as well."""
    text = filled(
        f"targets/{template}.j2",
        **context,
        standard=STANDARD,
        meaning=" ".join(MEANING),
        warnings=" ".join(w for w in WARNINGS if w != "-Werror"),
    )
    return PackageFile(path, text)


@dataclass
class Package:
    """What a target is: files, and what a person must know about them.

    `written` and `kept` are filled by `write`: paths in `folder`. `target` is filled in from the
    table of targets (`target_table.py`), so that one made over another is not called by its name.
    """

    folder: Path
    files: list[PackageFile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    programs: dict[str, list[str]] = field(default_factory=dict)
    """Of some targets: a program that is built, and the flags and sources it is made of."""
    written: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    target: str = ""
    entries: str = ""
    """What the functions begin with that a loop of one's own calls; "" where there are none."""
    image: str = ""
    """Of targets without an operating system: the file that `make` makes."""
    trusted: str = ""
    """The folder of the trusted part, where it has one of its own."""
    world: tuple[str, ...] = ()
    """Functions that are of plants: no part of what runs on a robot."""
    inherits: list[str] = field(default_factory=list)
    """Of a deployed system: what it inherits, in lines."""
    inherited: dict[str, object] = field(default_factory=dict)
    """The same as a document; empty of others."""

    def write(self) -> Package:
        """Write everything; SoterError D006, D008, the latter before anything is written."""
        foreign = [f.path for f in self.files if not f.yours and self._is_foreign(f)]
        if foreign:
            names = ", ".join(f"`{name}`" for name in foreign[:5])
            raise SoterError(
                (
                    Diagnostic(
                        "D008",
                        f"`{self.folder}` has files that soter did not write, or that were changed "
                        f"since: {names}",
                        helps=("choose another folder with -o, or move them away",),
                    ),
                )
            )
        for file in self.files:
            if file.yours and (self.folder / file.path).exists():
                self.kept.append(file.path)
                continue
            self._write(file.path, file.text)
            self.written.append(file.path)
        ours = {f.path: _digest(f.text) for f in self.files if not f.yours}
        self._write(MANIFEST, json.dumps(ours, indent=1) + "\n")
        return self

    def _is_foreign(self, file: PackageFile) -> bool:
        """Whether a file stands there that is neither as soter wrote it nor as it would now."""
        path = self.folder / file.path
        try:
            digest = hashlib.sha256(read_bytes(path, BYTES_MAX)).hexdigest()
        except ReadError as error:
            if error.missing or path.is_file():
                return not error.missing
            raise _cannot_write(path, error) from error
        return digest not in {self._before().get(file.path), _digest(file.text)}

    def _before(self) -> dict[str, str]:
        """What an earlier build noted; empty where there was none."""
        try:
            noted = json.loads(read_bytes(self.folder / MANIFEST))
        except (OSError, ValueError, RecursionError):
            return {}
        return noted if isinstance(noted, dict) else {}

    def _write(self, name: str, text: str) -> None:
        try:
            with atomic_write(own_place(self.folder, name)) as stream:
                stream.write(text.encode("utf-8", "surrogatepass"))
        except OSError as error:
            raise _cannot_write(self.folder / name, error) from error


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _cannot_write(path: Path, error: OSError) -> SoterError:
    return SoterError((Diagnostic("D006", f"cannot write `{path}`: {reason(error)}"),))
