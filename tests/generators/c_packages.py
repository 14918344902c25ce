"""Packages of target `c`, made and built for tests.

Purpose: one way to write a package and to compile it with flags of one's choice. What `make` has
built of exactly these files, with this compiler and these settings, is kept in Soter's cache as
compiled programs are: many tests, and every later run, build the same package.
Non-goals: what is in them.
"""

from __future__ import annotations

import hashlib
import tarfile
from pathlib import Path
from typing import TYPE_CHECKING

import processes
import soter
from soter.native.cache import cached, digest
from soter.native.compiler import find

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.targets.package import Package

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
MADE, SAID = "made.tar", "said.txt"

Done = processes.Done
Files = dict[str, str]


class NotMadeError(Exception):
    """What makes a package failed, and has said why: that is never kept."""

    def __init__(self, done: Done) -> None:
        super().__init__(done.stderr)
        self.done = done


def package(source: Path, folder: Path, system: str | None = None) -> Package:
    return soter.load(source).build("c", folder, system)


def command(words: list[str], folder: Path) -> Done:
    return processes.run(words, cwd=folder, capture_output=True, text=True, check=False)


def make(folder: Path, *settings: str, reads: tuple[Path, ...] = ()) -> Done:
    """`make` from nothing, with the compiler that Soter uses; or what it has made of the same.

    `reads`: files outside of the folder that the settings name.
    """
    compiler = find()
    words = ["make", "-B", f"CC={' '.join(compiler.command)}", *settings]
    if any(setting.startswith("CC=") for setting in settings):
        return command(words, folder)  # nothing identifies another compiler
    read = [hashlib.sha256(file.read_bytes()).hexdigest() for file in reads]
    try:
        said = made_or_kept("make", folder, [words], [compiler.identity, *read])
    except NotMadeError as error:
        return error.done
    return Done(words, 0, said, "")


def made_or_kept(
    kind: str,
    folder: Path,
    commands: list[list[str]],
    tools: list[str],
    wanted: Callable[[Path], bool] = Path.is_file,
) -> str:
    """What commands make of the files in a folder, or have made of the same; what they said.

    `tools`: what else that depends on, as text; `wanted`: of the files that are new. NotMadeError
    where one fails.
    """
    before = _files(folder)
    parts = [*tools, *(word for words in commands for word in words)]
    parts += [x for name, sha256 in sorted(before.items()) for x in (name, sha256)]

    def build(at: Path) -> None:
        said = ""
        for words in commands:
            done = command(words, folder)
            if done.returncode != 0:
                raise NotMadeError(done)
            said += done.stdout
        (at / SAID).write_text(said, encoding="utf-8")
        with tarfile.open(at / MADE, "w") as tar:
            for name, sha256 in sorted(_files(folder).items()):
                if before.get(name) != sha256 and wanted(folder / name):
                    tar.add(folder / name, name)

    at = cached(kind, digest(parts), (MADE, SAID), build)
    with tarfile.open(at / MADE) as tar:
        for member in tar:
            file = tar.extractfile(member)
            assert file is not None
            made = folder / member.name
            made.parent.mkdir(parents=True, exist_ok=True)
            made.unlink(missing_ok=True)
            made.write_bytes(file.read())  # and so it is younger than its sources
            made.chmod(member.mode)
    return (at / SAID).read_text(encoding="utf-8")


def _files(folder: Path) -> Files:
    """Every file below a folder, and a hash of what is in it."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file()
    }


def trace(text: str) -> str:
    """The `trace_sha256` that a built program printed."""
    (line,) = [x for x in text.splitlines() if x.startswith("trace_sha256 ")]
    return line.split()[1]
