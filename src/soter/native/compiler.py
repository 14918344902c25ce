"""Find a C compiler, and run it.

Purpose: the system's `cc`, gcc or clang; otherwise the one in the Python package `ziglang`.
Non-goals: cross compilers (`targets/`).
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import passing_phase
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.compiler_process import run_compiler
from soter.native.python_child import python_module
from soter.report.printable_text import visible

if TYPE_CHECKING:
    from collections.abc import Sequence

CANDIDATES = ("cc", "gcc", "clang")
STANDARD = "-std=c99"
MEANING = (
    *("-ffp-contract=off", "-fno-fast-math", "-fno-unsafe-math-optimizations"),
    *("-fno-finite-math-only", "-fno-reciprocal-math", "-fno-associative-math", "-fsigned-zeros"),
    "-fno-math-errno",
)
"""Flags that belong to the meaning: one rounding an operation, on every compiler."""
STRICT = (STANDARD, *MEANING)
TIMEOUT_S = 300
LINES, LINE_MAX = 8, 1000
"""So many lines of a compiler's words are shown, and of each so many letters."""
DEFECT = "this is a defect of soter: please report it with the program"
WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Werror",
)


@dataclass(frozen=True)
class Compiler:
    """A command that compiles C, and what identifies it for the cache."""

    command: tuple[str, ...]
    identity: str
    flags: tuple[str, ...] = ()
    """Of the command: what $SOTER_CC says behind its first word."""


def _identity(command: tuple[str, ...]) -> str | None:
    path = shutil.which(command[0])
    if path is None:
        return None
    try:
        stat = os.stat(os.path.realpath(path))  # noqa: PTH116 - follows links on purpose
    except OSError:
        return None
    said = (os.path.realpath(path), stat.st_size, stat.st_mtime_ns, *command[1:])
    return hashlib.sha256(" ".join(map(str, said)).encode()).hexdigest()


def _zig() -> Compiler | None:
    if importlib.util.find_spec("ziglang") is None:
        return None
    version = subprocess.run(
        python_module("ziglang", "version"), capture_output=True, text=True, check=False
    ).stdout.strip()
    return Compiler(tuple(python_module("ziglang", "cc")), f"zig {version}")


@lru_cache(maxsize=1)
def find() -> Compiler:
    """The compiler to use: $SOTER_CC, else the system's, else zig; SoterError X005 if none."""
    chosen = os.environ.get("SOTER_CC", "").split()
    if chosen == ["zig"]:
        zig = _zig()
        if zig is not None:
            return zig
        chosen = []
    for command in (tuple(chosen),) if chosen else tuple((x,) for x in CANDIDATES):
        identity = _identity(command)
        if identity is not None:
            return Compiler(command, identity, command[1:])
    zig = None if chosen else _zig()
    if zig is not None:
        return zig
    what = f"`{' '.join(chosen)}` (from SOTER_CC)" if chosen else "`cc`, `gcc` or `clang`"
    raise SoterError(
        (
            Diagnostic(
                "X005",
                f"there is no C compiler: {what} was not found",
                helps=(
                    *(("take the system's: unset SOTER_CC",) if chosen else ()),
                    "install one as a Python package: pip install 'soter[zig]'",
                    "or run without one: soter run FILE --engine interp",
                ),
            ),
        )
    )


def told_version(compiler: Compiler) -> str:
    """The first line of what a compiler says of its version; its command where it says nothing."""
    done = run_compiler((*compiler.command, "--version"), Path.cwd(), TIMEOUT_S)
    lines = done.text.strip().splitlines() if done.code == 0 else []
    return visible(lines[0][:LINE_MAX]) if lines else " ".join(compiler.command)


def compile_with(
    command: Sequence[str],
    work: Path,
    message: str,
    helps: tuple[str, ...] = (DEFECT,),
    telling: tuple[str, ...] = (),
) -> None:
    """Run a compiler in `work`; SoterError X004 with its words, those of `telling` if any are."""
    with passing_phase("compiling"):
        done = run_compiler(command, work, TIMEOUT_S)
    if done.code == 0:
        return
    lines = done.text.replace(str(work) + os.sep, "").strip().splitlines()
    shown = [x for x in lines if any(word in x for word in telling)] or lines
    notes = [visible(x[:LINE_MAX]) for x in shown[:LINES]]
    if done.why:
        notes.append(done.why)
    raise SoterError((Diagnostic("X004", message, notes=tuple(notes), helps=helps),))
