"""Finds a C compiler, and runs it with limits of output and time.

Purpose: the compiler is the system's `cc`, gcc or clang; otherwise the one in the Python package
`ziglang`, which `python_command` starts so that it imports nothing from the current folder. Output
and time are limited, as bad input can make a compiler write gigabytes or never end. Its child
processes end with it, and it ends with Soter. `vector_flags` and `FAST` are for C that is used on
this machine only.
Non-goals: cross compilers (`targets/`); fused multiply-add, which rounds once instead of twice.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import passing_phase
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.report.wording import visible
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Sequence


START = "import sys; sys.path[:] = [p for p in sys.path if p] + [{root!r}]; "
"""Code that takes the current folder, `""`, off `sys.path`; `sys` is built in, not a file."""


ROOT = Path(__file__).resolve().parents[2]
"""The folder that this Soter is imported from."""


def python_command(code: str, *words: str) -> list[str]:
    """A command that runs Python code and lets it import this Soter; `words` are `sys.argv[1:]`."""
    return [sys.executable, "-c", START.format(root=str(ROOT)) + code, *words]


def module_command(name: str, *words: str) -> list[str]:
    """A command that runs a module by name, like `python -m`; `words` are the arguments."""
    run = f"import runpy; runpy.run_module({name!r}, run_name='__main__', alter_sys=True)"
    return python_command(run, *words)


OUTPUT_MAX = 2**18
"""The most bytes of output; a compiler that writes more is ended."""
LOOK_S = 0.5
GROUP = (
    'exec 3<&0; "$@" 3<&- </dev/null & p=$!; '
    "{ read -r x; kill -KILL 0; } <&3 >/dev/null 2>&1 & exec 3<&- </dev/null; wait $p"
)
"""Shell code that runs a command, and kills its process group when our end of a pipe closes."""


@dataclass(frozen=True)
class CompilerOutput:
    """A compiler's output `text` and exit `code`; `code` is None if Soter ended it for `why`."""

    code: int | None
    text: str
    why: str = ""


def run_compiler(command: Sequence[str], work: Path, limit_s: float) -> CompilerOutput:
    """Runs a command in `work` until it ends, or exceeds its limits of time or output."""
    if os.name != "posix":
        return _run_without_groups(command, work, limit_s)
    group_command = ("/bin/sh", "-c", GROUP, "sh", *command)
    process = subprocess.Popen(
        group_command,
        cwd=work,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    _running.add(process.pid)
    try:
        output, why = _read_output(process, time.monotonic() + limit_s, limit_s)
        code = None if why else process.wait()
    finally:
        _kill_group(process.pid)
        _running.discard(process.pid)
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            stream.close()
        process.wait()
    return CompilerOutput(code, output.decode("utf-8", "replace"), why)


_running: set[int] = set()
"""The process groups of all running compilers, of any thread."""


def end_compilers() -> None:
    """Kills all running compilers, after a user's Ctrl-C."""
    for group in tuple(_running):
        _kill_group(group)


def _kill_group(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _read_output(process: subprocess.Popen[bytes], end: float, limit_s: float) -> tuple[bytes, str]:
    """The output of a process, and why reading stopped early; "" if it read to the end."""
    assert process.stdout is not None
    output, source = bytearray(), process.stdout.fileno()
    while (left := end - time.monotonic()) > 0:
        if select.select([source], [], [], min(left, LOOK_S))[0]:
            part = os.read(source, 2**16)
            if not part:
                return bytes(output), ""
            output += part
            if len(output) > OUTPUT_MAX:
                why = f"the compiler was ended: it wrote more than {OUTPUT_MAX:,} bytes"
                return bytes(output), why
    return bytes(output), f"the compiler was ended after {limit_s:g} s"


def _run_without_groups(command: Sequence[str], work: Path, limit_s: float) -> CompilerOutput:
    """Runs a command with a limit of time alone, on systems without process groups."""
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=limit_s, cwd=work)
    except subprocess.TimeoutExpired:
        return CompilerOutput(None, "", f"the compiler was ended after {limit_s:g} s")
    return CompilerOutput(done.returncode, (done.stdout + done.stderr).decode("utf-8", "replace"))


CPU = Path("/proc/cpuinfo")
VECTORS = (("-mavx512f", "-mavx512dq"), ("-mavx2",))
"""Compiler flags for vectors of eight doubles, and of four."""
FAST = ("-fno-trapping-math",)
"""Nothing reads the floating-point exceptions, so clang may compute both branches of a choice."""


def processor_flags(cpuinfo: str) -> tuple[str, ...]:
    """The compiler flags for vectors that all cores support, from the text of /proc/cpuinfo."""
    cores = [line.split() for line in cpuinfo.splitlines() if line.startswith("flags")]
    for flags in VECTORS:
        if cores and all(flag.removeprefix("-m") in core for flag in flags for core in cores):
            return flags
    return ()


@cache
def vector_flags() -> tuple[str, ...]:
    """The compiler flags for this machine's vectors; () if it has none, or none is known."""
    if platform.machine() not in {"x86_64", "AMD64"} or not CPU.exists():
        return ()
    return processor_flags(CPU.read_text(encoding="utf-8", errors="replace"))


CANDIDATES = ("cc", "gcc", "clang")
STANDARD = "-std=c99"
MEANING = (
    *("-ffp-contract=off", "-fno-fast-math", "-fno-unsafe-math-optimizations"),
    *("-fno-finite-math-only", "-fno-reciprocal-math", "-fno-associative-math", "-fsigned-zeros"),
    "-fno-math-errno",
)
"""Flags that fix the meaning of the C: one rounding for each operation, on every compiler."""
STRICT = (STANDARD, *MEANING)
TIMEOUT_S = 300
LINES, LINE_MAX = 8, 1000
"""How many lines of a compiler's output are shown, and how many characters of each."""
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
    """A command that compiles C, and a text that identifies the compiler in cache keys."""

    command: tuple[str, ...]
    identity: str
    flags: tuple[str, ...] = ()
    """The words of $SOTER_CC after its first one."""


def _compiler_identity(command: tuple[str, ...]) -> str | None:
    path = shutil.which(command[0])
    if path is None:
        return None
    try:
        stat = os.stat(os.path.realpath(path))  # noqa: PTH116 - follows links on purpose
    except OSError:
        return None
    parts = (os.path.realpath(path), stat.st_size, stat.st_mtime_ns, *command[1:])
    return hashlib.sha256(" ".join(map(str, parts)).encode()).hexdigest()


def _zig_compiler() -> Compiler | None:
    if importlib.util.find_spec("ziglang") is None:
        return None
    version = subprocess.run(
        module_command("ziglang", "version"), capture_output=True, text=True, check=False
    ).stdout.strip()
    return Compiler(tuple(module_command("ziglang", "cc")), f"zig {version}")


@lru_cache(maxsize=1)
def find_compiler() -> Compiler:
    """The compiler: $SOTER_CC, else the system's, else zig; raises X005 if none is found."""
    chosen = os.environ.get("SOTER_CC", "").split()
    if chosen == ["zig"]:
        zig = _zig_compiler()
        if zig is not None:
            return zig
        chosen = []
    for command in (tuple(chosen),) if chosen else tuple((x,) for x in CANDIDATES):
        identity = _compiler_identity(command)
        if identity is not None:
            return Compiler(command, identity, command[1:])
    zig = None if chosen else _zig_compiler()
    if zig is not None:
        return zig
    tried = f"`{' '.join(chosen)}` (from SOTER_CC)" if chosen else "`cc`, `gcc` or `clang`"
    raise SoterError(
        (
            Diagnostic(
                "X005",
                f"there is no C compiler: {tried} was not found",
                helps=(
                    *(("take the system's: unset SOTER_CC",) if chosen else ()),
                    f"install one as a Python package: {pip_command('compiler')}",
                    "or run without one: soter run FILE --engine interp",
                ),
            ),
        )
    )


def compiler_version(compiler: Compiler) -> str:
    """The first line of a compiler's version text; the compiler's command if it prints nothing."""
    done = run_compiler((*compiler.command, "--version"), Path.cwd(), TIMEOUT_S)
    lines = done.text.strip().splitlines() if done.code == 0 else []
    return visible(lines[0][:LINE_MAX]) if lines else " ".join(compiler.command)


def _require_disk_space(work: Path) -> None:
    """Raises SoterError D006 unless the folders that a compiler writes to have 4 MiB free."""
    for folder in (os.environ.get("TMPDIR") or tempfile.gettempdir(), work):
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(4 << 20))
        except OSError as error:
            text = f"nothing compiles without room in `{visible(str(folder))}`: {reason(error)}"
            raise mistake("D006", text, "make room there; TMPDIR names another folder") from error


def compile_with(
    command: Sequence[str],
    work: Path,
    message: str,
    helps: tuple[str, ...] = (DEFECT,),
    telling: tuple[str, ...] = (),
) -> None:
    """Runs a compiler in `work`; SoterError X004 with its lines (those with `telling` if any)."""
    with passing_phase("compiling"):
        done = run_compiler(command, work, TIMEOUT_S)
    if done.code == 0:
        return
    _require_disk_space(work)
    lines = done.text.replace(str(work) + os.sep, "").strip().splitlines()
    shown = [x for x in lines if any(word in x for word in telling)] or lines
    notes = [visible(x[:LINE_MAX]) for x in shown[:LINES]]
    if done.why:
        notes.append(done.why)
    raise SoterError((Diagnostic("X004", message, notes=tuple(notes), helps=helps),))
