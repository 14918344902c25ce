"""Knows the targets of `soter build --target T`, and writes the files of a package.

Purpose: `TARGETS` is the table of targets, each of which a file here makes. `build_package` writes
a package, text in, a folder out, without harming files that soter did not write.
Non-goals: what the files say (`c99.py`).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.addons import load_module
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import ReadError, read_bytes
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.report.atomic_write import atomic_write, path_without_links
from soter.report.templates import filled

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.targets.cortex_m_board import Board, Replay


MANIFEST = ".soter-files.json"
"""A file in every folder that soter builds, with the SHA-256 of each file as soter wrote it."""

BYTES_MAX = 2**28
"""The most bytes of a file: `soter` writes none that is longer, so it reads none."""


@dataclass(frozen=True)
class PackageFile:
    """A file of a package. If it is `yours`, soter writes it once and then the user keeps it."""

    path: str
    text: str
    yours: bool = False


def filled_file(path: str, template: str, /, **context: object) -> PackageFile:
    """The file made from a template below this folder, which also gets the flags of its C."""
    text = filled(
        f"targets/{template}.j2",
        **context,
        standard=STANDARD,
        meaning=" ".join(MEANING),
        warnings=" ".join(w for w in WARNINGS if w != "-Werror"),
    )
    return PackageFile(path, text)


def shipped_file(source: Path, folder: str = "") -> PackageFile:
    """A run-time file, copied unchanged into `folder` (with its slash) of a package."""
    return PackageFile(f"{folder}{source.name}", source.read_text("utf-8"))


@dataclass
class Package:
    """The files that a target writes, with notes for the person who builds them.

    `write` fills `written` and `kept` with paths in `folder`. `build_package` sets `target`,
    because one target may make its package from that of another.
    """

    folder: Path
    files: list[PackageFile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    programs: dict[str, list[str]] = field(default_factory=dict)
    """By program that is built: its flags and sources; only of some targets."""
    written: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    target: str = ""
    entries: str = ""
    """The beginning of the names of functions for a loop of one's own; "" where there are none."""
    image: str = ""
    """The file that `make` makes for targets without an operating system."""
    trusted: str = ""
    """The folder of the trusted part, where it has one of its own."""
    world: tuple[str, ...] = ()
    """The functions of plants, which do not run on a robot."""
    inherits: list[str] = field(default_factory=list)
    """The claims that a deployed system inherits, in lines."""
    inherited: dict[str, object] = field(default_factory=dict)
    """The claims that a deployed system inherits, as a document; empty for others."""

    def write(self) -> Package:
        """Writes all files; raises SoterError D006, or D008 before anything is written."""
        if foreign := [f.path for f in self.files if not f.yours and self._is_foreign(f)]:
            names = ", ".join(f"`{name}`" for name in foreign[:5])
            raise mistake(
                "D008",
                f"`{self.folder}` has files that soter did not write, or that were changed since: "
                f"{names}",
                "choose another folder with -o, or move them away",
            )
        for file in self.files:
            if file.yours and (self.folder / file.path).exists():
                self.kept.append(file.path)
                continue
            self._write_file(file.path, file.text)
            self.written.append(file.path)
        ours = {f.path: _text_digest(f.text) for f in self.files if not f.yours}
        self._write_file(MANIFEST, json.dumps(ours, indent=1) + "\n")
        return self

    def _is_foreign(self, file: PackageFile) -> bool:
        """Whether this path holds a file that soter neither wrote before nor would write now."""
        path = self.folder / file.path
        try:
            digest = hashlib.sha256(read_bytes(path, BYTES_MAX)).hexdigest()
        except ReadError as error:
            if error.missing or path.is_file():
                return not error.missing
            raise _write_error(path, error) from error
        return digest not in {self._earlier_digests().get(file.path), _text_digest(file.text)}

    def _earlier_digests(self) -> dict[str, str]:
        """The file digests that an earlier build noted, by path; {} without an earlier build."""
        try:
            noted = json.loads(read_bytes(self.folder / MANIFEST))
        except (OSError, ValueError, RecursionError):
            return {}
        return noted if isinstance(noted, dict) else {}

    def _write_file(self, name: str, text: str) -> None:
        try:
            with atomic_write(path_without_links(self.folder, name)) as stream:
                stream.write(text.encode("utf-8", "surrogatepass"))
        except OSError as error:
            raise _write_error(self.folder / name, error) from error


def _text_digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _write_error(path: Path, error: OSError) -> SoterError:
    return mistake("D006", f"cannot write `{path}`: {reason(error)}")


@dataclass(frozen=True)
class Target:
    """A target: the function that makes its package, and what it needs beside system and Core."""

    make: str
    """`MODULE:FUNCTION`, imported when it is needed; called with (system, core, folder), and with a
    mapping, or a board and a run, if the target needs them."""
    page: str = ""
    """The page that tells about its package, which then has no README.md."""
    mapped: bool = False
    """Whether it speaks with a middleware: a mapping says which topic is which message."""
    boarded: bool = False
    """Whether it makes an image, for which a board says where everything lies."""
    drops_bindings: bool = False
    """Whether its package leaves out, without a word, what externs are bound to outside C."""


TARGETS = {
    "c": Target("soter.targets.c99:c99_package", drops_bindings=True),
    "posix": Target("soter.targets.posix_package:posix_package"),
    "ros1": Target("soter.targets.ros_packages:ros1_package", "docs/ros.md", mapped=True),
    "ros2": Target("soter.targets.ros_packages:ros2_package", "docs/ros.md", mapped=True),
    "dds": Target("soter.targets.dds_package:dds_package", "docs/dds.md", mapped=True),
    "mavlink": Target(
        "soter.targets.mavlink_package:mavlink_package", "docs/mavlink.md", mapped=True
    ),
    "cortex-m": Target("soter.targets.cortex_m_package:cortex_m_package", boarded=True),
}
"""The targets by name, the default first; all code that asks about targets reads this table."""


def build_package(
    target: str,
    system: System,
    core: CoreSystem,
    folder: Path,
    mapping: object = None,
    more: Sequence[PackageFile] = (),
    onto: tuple[Board, Replay] | None = None,
    *,
    write: bool = True,
) -> Package:
    """Writes the package of a target; SoterError U001 without such a target, or a mapping.

    `mapping`: as `soter.mapping.read_mapping.make_log_map` gives it. `more`: files that the package
    has besides, whatever the target. `onto`: a board, and the run that an image of it repeats.

    `system`, `core`: with every binding to C entered (`native/extern_bindings.py`); whatever else
    an extern is bound to does not leave this machine.
    """
    require_options(target, mapping=mapping is not None, board=onto is not None)
    others = onto or (() if mapping is None else (mapping,))
    module, _, name = TARGETS[target].make.partition(":")
    package: Package = getattr(load_module(module), name)(system, core, folder, *others)
    package.target = target
    package.files += more
    return package.write() if write else package


def require_options(target: str, *, mapping: bool, board: bool) -> None:
    """Raises SoterError U001 for an unknown target, or a missing or needless mapping or board."""
    if target not in TARGETS:
        known = f"there is {', '.join(f'`{t}`' for t in TARGETS)}"
        raise mistake("U001", f"the target `{target}` does not exist", known)
    wants = TARGETS[target]
    if board != wants.boarded:
        verb = "is for no board" if board else "needs a board: where everything lies"
        help_ = "leave --board out" if board else "--board NAME or FILE (docs/bare-metal.md)"
        raise mistake("U001", f"the target `{target}` {verb}", help_)
    if wants.mapped and not mapping:
        message = f"the target `{target}` needs a mapping: which topic is which of its messages"
        raise mistake("U001", message, "--map FILE (docs/mapping.md)")
    if mapping and not wants.mapped:
        message = f"the target `{target}` speaks with no middleware: it has no use for a mapping"
        raise mistake("U001", message, "leave --map out")
