"""Finds out whether the C of externs may keep state between calls, and copies such libraries.

Purpose: `why_it_keeps_state` reads the compiled objects. C keeps no state if it has no variables of
its own and only calls functions that are known to keep none; all other C may keep state.
`why_input_is_unknown` says why it is unknown on which files and input the C depends. A
`library_copy`, when it is loaded, has its own copy of all variables.
Non-goals: which state the C keeps; assembler and addresses in the C, which can do anything.
"""

from __future__ import annotations

import re
import shutil
import struct
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from soter.native.cache import SOTER, cached_folder, digest, included_files, work_folder
from soter.native.compiler import compile_with, find_compiler
from soter.native.shared_library import (
    NEVER_SHIPPED,
    RUNTIME,
    c_texts,
    include_flags,
    library_flags,
    wrapped_extern_path,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.codegen.unit import Unit

KEEPS, UNKNOWN = "memory.txt", "unknown.txt"
LASTS = "it has variables that last from call to call"
MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim
floor fma fmax fmin fmod frexp hypot ilogb ldexp llrint llround log log10 log1p log2 logb lrint
lround modf nan nearbyint nextafter nexttoward pow remainder remquo rint round scalbln scalbn sin
sincos sinh sqrt tan tanh tgamma trunc
"""
OTHERS = """
abort abs labs llabs memchr memcmp memcpy memmove memset strchr strcmp strcpy strlen strncmp strncpy
__stack_chk_fail _GLOBAL_OFFSET_TABLE_
"""
KEEP_NOTHING = {f"{name}{suffix}" for name in MATH.split() for suffix in ("", "f", "l")}
KEEP_NOTHING.update(OTHERS.split())
"""Functions of libraries whose answer depends only on their arguments."""
FROM_WITHIN = """
__tls_get_addr aligned_alloc calloc fflush fprintf fputc fputs free fwrite malloc printf putchar
puts rand rand_r realloc snprintf sprintf srand stderr stdout vfprintf vsnprintf
"""
READ_NOTHING = KEEP_NOTHING.union(FROM_WITHIN.split())
"""Functions and names that read nothing from outside the process; some keep state."""
WHEN = re.compile(r"__(?:DATE|TIME|TIMESTAMP)__")
WRITABLE, OCCUPIES = 1, 2
SYMBOLS, UNDEFINED, COMMON = 2, 0, 0xFFF2
ELF = b"\x7fELF\x02\x01"
RELOCATED = re.compile(r"\.(data\.rel\.ro|init_array|fini_array)(\.|$)")
"""Sections that are written only while the library is loaded."""
LOCAL = 0
"""The binding of a symbol that other objects do not see."""


@contextmanager
def library_copy(path: Path) -> Iterator[Path]:
    """A temporary copy of a library, to load in a `with` block; it stays loaded. Raises X006."""
    with work_folder() as work:
        yield Path(shutil.copy2(path, work))


def why_it_keeps_state(unit: Unit) -> str:
    """Why the C of a unit's externs may keep state between calls, "" if it cannot; X004."""
    return _examined_text(unit, KEEPS)


def why_input_is_unknown(unit: Unit) -> str:
    """Why it is unknown which files the C of externs depends on, "" if it is known; X004."""
    return _examined_text(unit, UNKNOWN)


def _examined_text(unit: Unit, file_name: str) -> str:
    for source in unit.c_sources:
        if Path(source).suffix != ".c":
            return f"`{Path(source).name}` is no file of C"
    if not unit.c_sources:
        return ""
    compiler, flags = find_compiler(), library_flags()
    parts = [unit.header, compiler.identity, *flags, *c_texts(*unit.c_sources)]
    parts.append(Path(__file__).read_text(encoding="utf-8"))

    def examine(work: Path) -> None:
        (work / f"{unit.prefix}.h").write_text(unit.header, encoding="utf-8")
        files = [wrapped_extern_path(work, k, s, unit.prefix) for k, s in enumerate(unit.c_sources)]
        objects = [work / f"extern_{k + 1}.o" for k in range(len(files))]
        wanted = [f for f in flags if f != "-shared" and not f.startswith("-Wl,")]
        for file, built in zip(files, objects, strict=True):
            words = [*wanted, *include_flags(), f"-I{work}", "-MMD", "-MF", f"{built}.d"]
            words += ["-c", file, "-o", str(built)]
            compile_with([*compiler.command, *words], work, "the C of an extern does not compile")
        made = [o.read_bytes() for o in objects]
        (work / KEEPS).write_text(_why_it_keeps_state(made), encoding="utf-8")
        read = (Path(f"{o}.d").read_text(errors="surrogateescape") for o in objects)
        unknown = _why_unknown(" ".join(read), work, unit.c_sources) or _why_it_reads_outside(made)
        (work / UNKNOWN).write_text(unknown, encoding="utf-8", errors="replace")

    folder = cached_folder(f"memory-{unit.prefix[:32]}", digest(parts), (KEEPS, UNKNOWN), examine)
    return (folder / file_name).read_text(encoding="utf-8")


def _why_unknown(rule: str, work: Path, sources: Iterable[str]) -> str:
    """Why `included_files` misses a file in the compiler's make rule `rule`; "" if it has all."""
    known = included_files(*sources, folders=(RUNTIME, NEVER_SHIPPED))
    for when in (m[0] for text in known.values() for m in WHEN.finditer(text)):
        return f"it says when it was compiled (`{when}`)"
    names = (
        n.replace("\\ ", " ") for n in re.findall(r"(?:\\ |[^\s])+", rule.replace("\\\n", " "))
    )
    for path in (Path(n).resolve() for n in names if not n.endswith(":")):
        ours = path.is_relative_to(work.resolve()) or path.is_relative_to(SOTER)
        if not ours and path not in known:
            return f"it includes `{path.name}` in a way that Soter does not follow"
    return ""


def _why_it_reads_outside(objects: list[bytes]) -> str:
    """Why objects may read files, clocks, the environment or other libraries; "" if they cannot."""
    if any(data[:6] != ELF for data in objects):
        return "the compiler's objects cannot be looked into"
    symbols = [x for data in objects for x in _symbols(data)]
    left = {n for n, section in symbols if section == UNDEFINED}
    left -= {n for n, section in symbols if section != UNDEFINED} | READ_NOTHING | {""}
    return f"it calls `{min(left)}`, which may read anything" if left else ""


def _why_it_keeps_state(objects: list[bytes]) -> str:
    """Why objects may keep state between calls, in words; "" if they cannot."""
    if any(data[:6] != ELF for data in objects):
        return "the compiler's objects cannot be looked into"
    defined, called = set[str](), set[str]()
    for data in objects:
        for name, flags, length in _sections(data):
            writable = flags & WRITABLE and flags & OCCUPIES
            if writable and length and not RELOCATED.match(name):
                return LASTS
        for name, section in _symbols(data):
            if section == COMMON:
                return LASTS
            (called if section == UNDEFINED else defined).add(name)
    left = sorted(called - defined - KEEP_NOTHING - {""})
    return f"it calls `{left[0]}`, which may keep something" if left else ""


def _section_headers(data: bytes) -> list[tuple[int, ...]]:
    (at,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    return [struct.unpack_from("<IIQQQQIIQQ", data, at + k * size) for k in range(count)]


def _string_at(data: bytes, at: int) -> str:
    return data[at : data.index(b"\0", at)].decode("utf-8", "replace")


def _sections(data: bytes) -> Iterator[tuple[str, int, int]]:
    """Yields name, flags and length of each section of an ELF file."""
    table = _section_headers(data)
    names = table[struct.unpack_from("<H", data, 0x3E)[0]][4]
    for name, _, flags, _, _, length, *_ in table:
        yield _string_at(data, names + name), flags, length


def _symbols(data: bytes) -> Iterator[tuple[str, int]]:
    """Yields name and section of each symbol of an ELF file that other objects can see."""
    table = _section_headers(data)
    for _, kind, _, _, offset, length, link, _, _, entry in table:
        if kind == SYMBOLS:
            for at in range(offset + entry, offset + length, entry):
                name, info, _, section = struct.unpack_from("<IBBH", data, at)
                if info >> 4 != LOCAL:
                    yield _string_at(data, table[link][4] + name), section
