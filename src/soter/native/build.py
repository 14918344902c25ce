"""Compile generated C into a shared library, once for each content.

Purpose: from a `Unit` to a loaded program; the cache is keyed by everything that matters.
Non-goals: generating C, packages for targets.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.compiler import STRICT, find
from soter.native.includes import included
from soter.native.objects import kept_objects

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.codegen.unit import Unit
    from soter.native.compiler import Compiler

RUNTIME = Path(__file__).resolve().parent.parent / "runtime"
KERNEL = ("soter_kernel.c", "soter_virtual.c")
HEADERS = ("soter.h", "soter_adversary.h")
TIMEOUT_S = 300
TELLING = ("error", "undefined", "previous de")
"""What makes a line of a C compiler worth showing."""
OWN_SYMBOLS = ("-Wl,-Bsymbolic",) if sys.platform.startswith("linux") else ()
"""A library calls its own functions: without it an extern named `step` would be that of libc."""


def cache_dir() -> Path:
    """$SOTER_CACHE, else the user's cache folder."""
    chosen = os.environ.get("SOTER_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "soter"


def _content(
    unit: Unit, flags: tuple[str, ...], identity: str, runtime: tuple[str, ...] = ()
) -> str:
    parts = [unit.header, unit.source, identity, *flags, "externs are checked by the header"]
    parts += _texts(runtime)
    for source in unit.c_sources:
        parts += [x for path, text in included(source).items() for x in (str(path), text)]
    return _digest(parts)


def _texts(runtime: tuple[str, ...]) -> list[str]:
    names = (*KERNEL, *HEADERS, *runtime)
    return [(RUNTIME / name).read_text(encoding="utf-8") for name in names]


def _digest(parts: Sequence[str]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8", "surrogatepass")
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def _seal_of(target: Path) -> Path:
    return target.with_suffix(".sha256")


def _seal(library_: Path) -> str:
    return hashlib.sha256(library_.read_bytes()).hexdigest()


def _is_whole(target: Path) -> bool:
    """Whether the cache has it, and undamaged: loading half a library kills the process."""
    try:
        return _seal_of(target).read_text(encoding="utf-8") == _seal(target)
    except (OSError, UnicodeDecodeError):
        return False


def library(
    unit: Unit,
    optimise: str = "-O2",
    extra: tuple[str, ...] = (),
    runtime: tuple[str, ...] = (),
) -> Path:
    """The shared library of a unit, from the cache or freshly compiled.

    `runtime`: files of the run-time that are needed besides the kernel, headers included.
    """
    compiler = find()
    flags = (*STRICT, optimise, "-fPIC", "-shared", *OWN_SYMBOLS, *extra)
    folder = cache_dir()
    content = _content(unit, flags, compiler.identity, runtime)
    target = folder / f"{unit.prefix[:40]}-{content[:32]}.so"
    if _is_whole(target):
        return target
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as name:
            work = Path(name)
            objects = _runtime_objects(folder, flags, compiler, runtime)
            built = compile_in(work, unit, flags, objects)
            seal = work / "seal"
            seal.write_text(_seal(built), encoding="utf-8")
            built.replace(target)
            seal.replace(_seal_of(target))
    except OSError as error:
        raise SoterError(
            (
                Diagnostic(
                    "X006",
                    f"cannot write to the cache folder `{folder}`: {error.strerror or error}",
                    helps=("choose another with the environment variable SOTER_CACHE",),
                ),
            )
        ) from error
    return target


def _checked(work: Path, number: int, source: str, prefix: str) -> str:
    """An extern's C, followed by the header: a wrong signature is an error, not undefined.

    The header comes last, so that the file may still ask the system for its features first.
    """
    path = str(Path(source).resolve())
    if Path(source).suffix != ".c" or '"' in path or "\\" in path:
        return path
    wrapped = work / f"extern_{number + 1}.c"
    wrapped.write_text(f'#include "{path}"\n#include "{prefix}.h"\n', encoding="utf-8")
    return str(wrapped)


def _helps(unit: Unit) -> tuple[str, ...]:
    files = ", ".join(f"`{s}`" for s in unit.c_sources)
    return (
        f"the mistake is most likely in {files}",
        f"#include `{unit.prefix}.h`, named after the main program file: it has their signatures",
    )


def _runtime_objects(
    folder: Path, flags: tuple[str, ...], compiler: Compiler, runtime: tuple[str, ...]
) -> tuple[str, ...]:
    """The kernel alone as sources; with more of the run-time everything as objects, kept."""
    if not runtime:
        return tuple(str(RUNTIME / name) for name in KERNEL)
    content = _digest((compiler.identity, *flags, *_texts(runtime)))
    sources = tuple(RUNTIME / name for name in (*KERNEL, *runtime) if name.endswith(".c"))
    wanted = tuple(f for f in flags if f != "-shared" and not f.startswith("-Wl,"))
    return kept_objects(sources, (*compiler.command, *wanted, f"-I{RUNTIME}"), folder, content)


def compile_in(work: Path, unit: Unit, flags: tuple[str, ...], runtime: tuple[str, ...]) -> Path:
    """Write the unit into `work` and compile it there; X004 with the compiler's words.

    `runtime`: sources or objects of the kernel and of what else is needed.
    """
    (work / f"{unit.prefix}.h").write_text(unit.header, encoding="utf-8")
    source = work / f"{unit.prefix}.c"
    source.write_text(unit.source, encoding="utf-8")
    built = work / "program.so"
    externs = [_checked(work, i, s, unit.prefix) for i, s in enumerate(unit.c_sources)]
    command = [
        *find().command,
        *flags,
        f"-I{RUNTIME}",
        f"-I{work}",
        "-o",
        str(built),
        str(source),
        *externs,
        *runtime,
        "-lm",
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S, cwd=work
    )
    if done.returncode != 0:
        lines = done.stderr.replace(str(work) + os.sep, "").strip().splitlines()
        shown = [x for x in lines if any(word in x for word in TELLING)] or lines
        raise SoterError(
            (
                Diagnostic(
                    "X004",
                    "the C of this program does not compile",
                    notes=tuple(shown[:8]),
                    helps=_helps(unit)
                    if externs
                    else ("this is a defect of soter: please report it with the program",),
                ),
            )
        )
    return built
