"""Generated programs and the kernel need no heap, and hardly anything else.

What an object asks for from outside is read from its symbol table.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import pytest

from generators.elf import undefined_symbols
from generators.engine_comparison import (
    call_compiler,
    kernel_sources,
    subject,
    write_units,
)
from generators.random_programs import program
from generators.shipped_programs import files, subjects_of

if TYPE_CHECKING:
    from generators.engine_comparison import Subject

_HEAP = """
malloc calloc realloc reallocarray free aligned_alloc posix_memalign memalign valloc pvalloc strdup
strndup asprintf vasprintf getline alloca brk sbrk mmap munmap
"""
_ALLOWED = """
memset memcpy memmove sqrt floor fabs __stack_chk_fail _GLOBAL_OFFSET_TABLE_
"""
HEAP, ALLOWED = frozenset(_HEAP.split()), frozenset(_ALLOWED.split())

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads ELF objects")


def needs(folder: Path, level: str, sources: list[str]) -> set[str]:
    """What C files need that none of them has."""
    symbols: set[str] = set()
    for number, source in enumerate(sources):
        target = folder / f"object_{number}.o"
        call_compiler(folder, level, "-c", "-o", str(target), source)
        symbols |= undefined_symbols(target.read_bytes())
    return {name for name in symbols if not name.startswith("soter_")}


def programs_and_kernel(subjects: list[Subject], folder: Path, level: str) -> set[str]:
    return needs(folder, level, [str(write_units(subjects, folder))]) | of_kernel(level)


@cache
def of_kernel(level: str) -> set[str]:
    with TemporaryDirectory() as folder:
        return needs(Path(folder), level, kernel_sources())


@pytest.mark.parametrize("level", ["-O0", "-O2"])
def test_random_programs_need_only_what_is_allowed(level: str, tmp_path: Path) -> None:
    subjects = [subject(f"p{n}", program(n), n, 10) for n in range(40_000, 40_020)]
    symbols = programs_and_kernel(subjects, tmp_path, level)
    assert not symbols & HEAP
    assert symbols <= ALLOWED


@pytest.mark.parametrize(
    ("folder", "level"),
    [
        *(("examples/wall", "-O0"), ("examples/wall", "-O2"), ("examples/generality", "-O2")),
        *(pytest.param("examples", level, marks=pytest.mark.long) for level in ("-O0", "-O2")),
    ],
)
def test_examples_need_only_what_is_allowed(folder: str, level: str, tmp_path: Path) -> None:
    subjects = [s for path in files(folder) for s in subjects_of(path, 10)]
    assert subjects
    symbols = programs_and_kernel(subjects, tmp_path, level)
    assert not symbols & HEAP
    assert symbols <= ALLOWED


def test_a_call_of_the_heap_would_be_seen(tmp_path: Path) -> None:
    (tmp_path / "bad.c").write_text(
        "#include <stdlib.h>\nvoid *soter_bad(void);\nvoid *soter_bad(void) { return malloc(8); }\n"
    )
    assert needs(tmp_path, "-O2", [str(tmp_path / "bad.c")]) & HEAP == {"malloc"}
