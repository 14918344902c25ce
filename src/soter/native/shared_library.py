"""Shared libraries: generated C compiled once for each content, loaded, and run on a state.

Purpose: `library` compiles a `Unit` and keeps it in the cache, by everything that matters. This is
the one place that knows cffi (ABI mode): declarations are read from the headers themselves, so that
Python and C cannot disagree. A `Library` is a loaded program, the thinnest Python face of
`runtime/soter.h`; states and traces are numpy arrays of bytes.
Non-goals: generating C, packages for targets, the cache itself (`cache.py`), decoding
(`core/layout.py`), answering externs (`simulate/`).
"""

from __future__ import annotations

import ctypes
import re
import sys
from enum import IntEnum
from functools import lru_cache
from pathlib import Path
from runpy import run_path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.arithmetic import require_plain
from soter.native.cache import SOTER, cached, computes_names, digest, included
from soter.native.compiler import DEFECT, STRICT, compile_with, find

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.codegen.unit import Unit
    from soter.core.layout import Bytes


RUNTIME = SOTER / "runtime"
NEVER_SHIPPED = SOTER / "native" / "c"
"""The folder of C that is used on this machine alone, and is in no package."""
KERNEL = ("soter_kernel.c", "soter_virtual.c")
CHECK_FAILED = NEVER_SHIPPED / "soter_check_failed_exit.c"
"""The C that says what happens on this machine when a check of the run-time or an engine fails."""
FAULTS = "soter_faults.h"
"""The header of programs whose system has faults."""
LIBRARY = "program.so"
TELLING = ("error", "undefined", "previous de")
"""Words of those lines of a C compiler's output that are worth showing."""
OWN_SYMBOLS = (
    ("-Wl,-Bsymbolic", "-fno-semantic-interposition") if sys.platform.startswith("linux") else ()
)
"""A library calls its own functions: without it an extern named `step` would be that of libc."""

REPORT = "this is a defect of soter: please report it with your compiler's version"


def texts(*sources: str | Path) -> list[str]:
    """Path and text of C files and of every header that they include, our own ones too.

    Where a header is not known, a random text is added, so that no key of a cache matches.
    """
    known = included(*sources, folders=(RUNTIME, NEVER_SHIPPED)).items()
    never = [uuid4().hex] if computes_names([t for _, t in known]) else []
    return never + [x for p, t in known for x in (p.name if p.is_relative_to(SOTER) else str(p), t)]


def library_flags(optimise: str = "-O2") -> tuple[str, ...]:
    """The compiler flags of every shared library."""
    return (*STRICT, optimise, "-fPIC", "-shared", *OWN_SYMBOLS)


def without_link(flags: Iterable[str]) -> tuple[str, ...]:
    """These flags without those of the linker, for a compiler that does not link."""
    return tuple(f for f in flags if f != "-shared" and not f.startswith("-Wl,"))


def library(
    unit: Unit, optimise: str = "-O2", extra: tuple[str, ...] = (), engine: tuple[Path, ...] = ()
) -> Path:
    """The shared library of a unit, from the cache or freshly compiled.

    `engine`: files that are needed besides the kernel, headers included.
    """
    compiler = find()
    flags = (*library_flags(optimise), *extra)
    kernel = (*(RUNTIME / name for name in KERNEL), CHECK_FAILED)
    parts = [unit.header, unit.source, compiler.identity, *flags]
    parts += texts(*kernel, RUNTIME / FAULTS, *engine, *unit.c_sources)
    parts += library_flags() if unit.c_sources else ()

    def make(work: Path) -> None:
        sources = (*kernel, *(file for file in engine if file.suffix == ".c"))
        runtime = objects(sources, (*without_link(flags), *include_flags(*engine)))
        compile_in(work, unit, (*flags, *include_flags(*engine)), tuple(map(str, runtime)))

    path = cached(unit.prefix[:40], digest(parts), (LIBRARY,), make) / LIBRARY
    if unit.decisions:
        from soter.codegen.conditions import note_library  # noqa: PLC0415 - only then

        note_library(unit.decisions, path)
    return path


def objects(sources: tuple[Path, ...], flags: tuple[str, ...]) -> tuple[Path, ...]:
    """The compiled objects of C files of Soter, which many programs are linked with."""
    compiler = find()
    names = tuple(f"{s.stem}.o" for s in sources)
    content = digest((compiler.identity, *flags, *texts(*sources)))

    def make(work: Path) -> None:
        for source, name in zip(sources, names, strict=True):  # zig makes only the first of several
            command = [*compiler.command, *flags, "-c", str(source), "-o", name]
            compile_with(command, work, "the run-time does not compile", (REPORT,))

    folder = cached("objects", content, names, make)
    return tuple(folder / name for name in names)


def checked_extern(work: Path, number: int, source: str, prefix: str) -> str:
    """The file with an extern's C and then the header, so that a wrong signature is an error.

    The header comes last, so that the C can ask for features of the system before any header.
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


def include_flags(*files: Path) -> tuple[str, ...]:
    """Flags that find headers: beside these files, in the run-time, in `native/c/`."""
    folders = dict.fromkeys((*(f.parent for f in files), RUNTIME, NEVER_SHIPPED))
    return tuple(f"-I{folder}" for folder in folders)


def compile_in(work: Path, unit: Unit, flags: tuple[str, ...], runtime: tuple[str, ...]) -> Path:
    """Write the unit into `work` and compile it there; X004 with the compiler's words.

    C of externs gets the same flags always, not `flags`, as it may test for them (`__AVX2__`): so
    it is the same C in runs, campaigns and where its objects are examined.

    `runtime`: sources or objects of the kernel and of what else is needed. The user's C comes
    first: a mistake in it is reported before a large program is compiled for minutes.
    """
    (work / f"{unit.prefix}.h").write_text(unit.header, encoding="utf-8")
    source = work / f"{unit.prefix}.c"
    source.write_text(unit.source, encoding="utf-8")
    built = work / LIBRARY
    compiler = [*find().command, *flags, f"-I{RUNTIME}", f"-I{work}"]
    message = "the C of this program does not compile"
    helps = _helps(unit) if unit.c_sources else (DEFECT,)
    externs = [checked_extern(work, i, s, unit.prefix) for i, s in enumerate(unit.c_sources)]
    words = [*find().command, *without_link(library_flags()), *include_flags(), f"-I{work}"]
    for i, extern in enumerate(externs):
        if extern.endswith(".c"):
            externs[i] = f"{work / f'extern_{i + 1}.o'}"
            command = [*words, "-c", extern, "-o", externs[i]]
            compile_with(command, work, message, helps, TELLING)
    command = [*compiler, "-o", str(built), str(source), *externs, *runtime, "-lm"]
    compile_with(command, work, message, helps, TELLING)
    return built


COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
INLINE = re.compile(r"^SOTER_INLINE.*?^\}$", re.DOTALL | re.MULTILINE)
CPLUSPLUS = re.compile(r"^#ifdef __cplusplus$.*?^#endif$", re.DOTALL | re.MULTILINE)
DIRECTIVE = re.compile(r"^[ \t]*#(?:.*\\\n)*.*$", re.MULTILINE)
NUMBER = re.compile(r"^#define ([A-Z_]+) (\d+)U?$")
TABLES = "interface.py"

_opened: list[Any] = []
"""All libraries: cffi closes one that nobody holds, even if a function of it is still held."""


def declarations(header: Path) -> str:
    """What a header of Soter declares: types, functions and numbers; no comments, no inline code.

    Headers that it includes are not read: give their declarations before.
    """

    def kept(match: re.Match[str]) -> str:
        number = NUMBER.match(match.group(0).rstrip())
        return f"#define {number.group(1)} {number.group(2)}" if number else ""

    text = COMMENT.sub("", header.read_text(encoding="utf-8"))
    return DIRECTIVE.sub(kept, INLINE.sub("", CPLUSPLUS.sub("", text)))


@lru_cache(maxsize=64)
def interface(*declared: str) -> Any:  # noqa: ANN401 - cffi has no types
    """The cffi object for these declarations; the same one for the same texts.

    They are parsed once and cffi's tables of them are cached, as parsing takes longer than most
    runs. SoterError X006 where the cache cannot be used.
    """
    import _cffi_backend  # noqa: PLC0415 - only what is compiled pays for it

    def make(work: Path) -> None:
        from cffi import FFI, recompiler  # noqa: PLC0415 - and only the first time for the parser

        ffi = FFI()
        for text in declared:
            ffi.cdef(text)
        recompiler.make_py_source(ffi, "soter_interface", str(work / TABLES))

    content = digest(("cffi", _cffi_backend.__version__, *declared))
    return run_path(str(cached("interface", content, (TABLES,), make) / TABLES))["ffi"]


def opened(
    ffi: Any,  # noqa: ANN401 - cffi has no types
    path: Path,
    owners: Mapping[str, str] | None = None,
) -> Any:  # noqa: ANN401 - the same
    """The loaded library; SoterError X004 where a function that it needs is missing.

    X012 where this thread's floating-point settings are not those that the library assumes.

    `owners`: by linked function, the C file that should have it.
    """
    require_plain()
    try:
        held = ffi.dlopen(str(path))
    except OSError as error:
        _, _, missing = str(error).partition("undefined symbol: ")
        if missing:
            symbol = missing.split()[0].rstrip(".")
            file = (owners or {}).get(symbol)
            message = (
                f"`{file}` has no function `{symbol}`"
                if file
                else f"no C file of this program has the function `{symbol}`"
            )
            helps: tuple[str, ...] = (
                "is its name right in `c:file.c:name`, and is it not static?",
            )
        else:
            message, helps = f"the compiled program cannot be loaded: {error}", ()
        raise SoterError((Diagnostic("X004", message, helps=helps),)) from error
    _opened.append(held)
    return held


def address(ffi: Any, path: Path, symbol: str, type_: str) -> Any:  # noqa: ANN401 - cdata
    """The address of a constant of the library, as a pointer of this type."""
    held = ctypes.c_char.in_dll(ctypes.CDLL(str(path)), symbol)
    return ffi.cast(type_, ctypes.addressof(held))


class RunStatus(IntEnum):
    """Why `soter_run` came back."""

    END = 0
    EXTERN = 1
    FULL = 2


def kernel_interface() -> Any:  # noqa: ANN401 - cffi has no types
    """The cffi interface of `runtime/soter.h`."""
    return interface(declarations(RUNTIME / "soter.h"))


class Library:
    """One compiled program; holds no state of its own."""

    def __init__(
        self, path: Path, prefix: str, state_size: int, owners: Mapping[str, str] | None = None
    ) -> None:
        self.ffi = kernel_interface()
        self.lib = opened(self.ffi, path, owners)
        self._program = address(self.ffi, path, f"{prefix}_program", "const soter_program *")
        self.state_size = state_size

    def new_state(self, seed: int) -> Bytes:
        """A fresh state, (state_size,), started."""
        import numpy as np  # noqa: PLC0415 - channels of a robot need none of it

        state = np.zeros(self.state_size, dtype=np.uint8)
        self.lib.soter_start(self._program, self._pointer(state), seed & (2**64 - 1))
        return state

    def _pointer(self, array: Bytes) -> Any:  # noqa: ANN401 - a cdata pointer
        return self.ffi.cast("void *", array.ctypes.data)

    def run(
        self, state: Bytes, until_ns: int, trace: Bytes | None = None
    ) -> tuple[RunStatus, int, int]:
        """Run instants up to `until_ns`; `trace` has shape (room, state_size).

        Returns the status, how many states were written, and the extern component that is due.
        """
        room = 0 if trace is None else len(trace)
        target = self.ffi.NULL if trace is None else self._pointer(trace)
        written, due = self.ffi.new("size_t *"), self.ffi.new("uint32_t *")  # threads share `self`
        status = self.lib.soter_run(
            self._program, self._pointer(state), until_ns, target, room, written, due
        )
        return RunStatus(status), int(written[0]), int(due[0])

    def next_instant(self, state: Bytes) -> int:
        """Time of the next instant in ns; `state` (state_size,)."""
        return int(self.lib.soter_next_instant(self._program, self._pointer(state)))

    def publish(self, state: Bytes, topic: int, value: bytes, time_ns: int) -> int:
        """A value from outside, measured at `time_ns`; 0, or why not. `state`: (bytes,)."""
        pointer = self.ffi.cast("void *", self.ffi.from_buffer(value))
        return int(
            self.lib.soter_publish(self._program, self._pointer(state), topic, pointer, time_ns)
        )

    def answer(self, state: Bytes, component: int, fault: int, answer: bytes | None) -> None:
        """Give the answer for the extern step that is due; `state` (state_size,)."""
        data = self.ffi.NULL if answer is None else self.ffi.from_buffer(answer)
        self.lib.soter_answer(
            self._program, self._pointer(state), component, fault, self.ffi.cast("void *", data)
        )
