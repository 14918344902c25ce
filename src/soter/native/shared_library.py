"""Compiles generated C to a shared library, once for each content.

Purpose: `library` compiles a `Unit` and keeps it in the cache, by a hash of all its inputs.
Non-goals: generating C, packages for targets, the cache itself (`cache.py`), loading what was
compiled (`c_interface.py`, `loaded_program.py`).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from soter.native.cache import SOTER, cached_folder, digest, has_macro_includes, included_files
from soter.native.compiler import DEFECT, STRICT, compile_with, find_compiler

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.codegen.unit import Unit


RUNTIME = SOTER / "runtime"
NEVER_SHIPPED = SOTER / "native" / "c"
"""The folder of C that is used on this machine only, and is in no package."""
KERNEL = ("soter_kernel.c", "soter_virtual.c")
CHECK_FAILED = NEVER_SHIPPED / "soter_check_failed_exit.c"
"""The C that says what happens on this machine when a check of the run-time or an engine fails."""
FAULTS = "soter_faults.h"
"""The header of programs whose system has faults."""
LIBRARY = "program.so"
TELLING = ("error", "undefined", "previous de")
"""Words in those lines of a C compiler's output that are shown."""
OWN_SYMBOLS = (
    ("-Wl,-Bsymbolic", "-fno-semantic-interposition") if sys.platform.startswith("linux") else ()
)
"""Linker flags: a library calls its own functions first, also if the C library has the name."""

REPORT = "this is a defect of soter: please report it with your compiler's version"


def c_texts(*sources: str | Path) -> list[str]:
    """The path and text of C files and of all headers that they include, also Soter's.

    If a macro makes the name of a header, a random text is added to match no key of the cache.
    """
    known = included_files(*sources, folders=(RUNTIME, NEVER_SHIPPED)).items()
    never = [uuid4().hex] if has_macro_includes([t for _, t in known]) else []
    return never + [x for p, t in known for x in (p.name if p.is_relative_to(SOTER) else str(p), t)]


def library_flags(optimise: str = "-O2") -> tuple[str, ...]:
    """The compiler flags of every shared library."""
    return (*STRICT, optimise, "-fPIC", "-shared", *OWN_SYMBOLS)


def compile_only_flags(flags: Iterable[str]) -> tuple[str, ...]:
    """The compiler flags in `flags`, without the flags for the linker."""
    return tuple(f for f in flags if f != "-shared" and not f.startswith("-Wl,"))


def library(
    unit: Unit, optimise: str = "-O2", extra: tuple[str, ...] = (), engine: tuple[Path, ...] = ()
) -> Path:
    """The path of the shared library of a unit, from the cache or compiled now.

    `engine` are C files and headers that the unit needs in addition to the kernel.
    """
    compiler = find_compiler()
    flags = (*library_flags(optimise), *extra)
    kernel = (*(RUNTIME / name for name in KERNEL), CHECK_FAILED)
    parts = [unit.header, unit.source, compiler.identity, *flags]
    parts += c_texts(*kernel, RUNTIME / FAULTS, *engine, *unit.c_sources)
    parts += library_flags() if unit.c_sources else ()

    def compile_library(work: Path) -> None:
        sources = (*kernel, *(file for file in engine if file.suffix == ".c"))
        runtime = objects(sources, (*compile_only_flags(flags), *include_flags(*engine)))
        compile_unit(work, unit, (*flags, *include_flags(*engine)), tuple(map(str, runtime)))

    path = cached_folder(unit.prefix[:40], digest(parts), (LIBRARY,), compile_library) / LIBRARY
    if unit.decisions:
        from soter.codegen.conditions import note_library  # noqa: PLC0415 - only then

        note_library(unit.decisions, path)
    return path


def objects(sources: tuple[Path, ...], flags: tuple[str, ...]) -> tuple[Path, ...]:
    """The paths of the compiled objects of C files of Soter, which many programs share."""
    compiler = find_compiler()
    names = tuple(f"{s.stem}.o" for s in sources)
    content = digest((compiler.identity, *flags, *c_texts(*sources)))

    def compile_objects(work: Path) -> None:
        for source, name in zip(sources, names, strict=True):  # given several, zig compiles one
            command = [*compiler.command, *flags, "-c", str(source), "-o", name]
            compile_with(command, work, "the run-time does not compile", (REPORT,))

    folder = cached_folder("objects", content, names, compile_objects)
    return tuple(folder / name for name in names)


def wrapped_extern_path(work: Path, number: int, source: str, prefix: str) -> str:
    """Writes a file that includes an extern's C and then the header, to check its signature.

    The header comes last, so that the C can define feature macros before any header.
    """
    path = str(Path(source).resolve())
    if Path(source).suffix != ".c" or '"' in path or "\\" in path:
        return path
    wrapped = work / f"extern_{number + 1}.c"
    wrapped.write_text(f'#include "{path}"\n#include "{prefix}.h"\n', encoding="utf-8")
    return str(wrapped)


def _signature_helps(unit: Unit) -> tuple[str, ...]:
    files = ", ".join(f"`{s}`" for s in unit.c_sources)
    return (
        f"the mistake is most likely in {files}",
        f"#include `{unit.prefix}.h`, named after the main program file: it has their signatures",
    )


def include_flags(*files: Path) -> tuple[str, ...]:
    """The flags by which headers are found: beside these files, in the run-time, in `native/c/`."""
    folders = dict.fromkeys((*(f.parent for f in files), RUNTIME, NEVER_SHIPPED))
    return tuple(f"-I{folder}" for folder in folders)


def compile_unit(work: Path, unit: Unit, flags: tuple[str, ...], runtime: tuple[str, ...]) -> Path:
    """Compiles a unit in the folder `work`; raises SoterError X004 with the compiler's lines.

    The C of externs does not get `flags` but always the same flags, because it may test them
    (`__AVX2__`): it is then the same in runs, in campaigns and in checks of its objects. It is
    compiled first, to report a mistake before minutes of other compiling. `runtime` are sources or
    objects of the kernel, and other objects to link.
    """
    (work / f"{unit.prefix}.h").write_text(unit.header, encoding="utf-8")
    source = work / f"{unit.prefix}.c"
    source.write_text(unit.source, encoding="utf-8")
    built = work / LIBRARY
    found = find_compiler().command
    compiler = [*found, *flags, f"-I{RUNTIME}", f"-I{work}"]
    message = "the C of this program does not compile"
    helps = _signature_helps(unit) if unit.c_sources else (DEFECT,)
    externs = [wrapped_extern_path(work, i, s, unit.prefix) for i, s in enumerate(unit.c_sources)]
    words = [*found, *compile_only_flags(library_flags()), *include_flags(), f"-I{work}"]
    for i, extern in enumerate(externs):
        if extern.endswith(".c"):
            externs[i] = f"{work / f'extern_{i + 1}.o'}"
            command = [*words, "-c", extern, "-o", externs[i]]
            compile_with(command, work, message, helps, TELLING)
    command = [*compiler, "-o", str(built), str(source), *externs, *runtime, "-lm"]
    compile_with(command, work, message, helps, TELLING)
    return built
