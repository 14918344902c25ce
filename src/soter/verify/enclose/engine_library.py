"""The grid engine as a shared library: enclosures of one module and `soter_reach*.c`.

Purpose: compile a generated enclosure unit together with the engine, once for each content, and
reach both through cffi.
Non-goals: generating the unit (`verify/enclose/enclosure_code.py`), meaning of the calls
(`verify/grid/sets.py`).
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from soter.language.evaluate.conjuncts import PARTS_MAX
from soter.native.build import CHECK_FAILED, OWN_SYMBOLS, include_flags, objects, texts
from soter.native.cache import cached, digest
from soter.native.cffi_interface import declarations, interface, opened
from soter.native.compiler import STRICT, compile_with, find
from soter.native.package_sources import files_below
from soter.native.vector_instructions import vector_flags
from soter.verify.enclose.enclosure_code import CONTROLS_MAX

if TYPE_CHECKING:
    from collections.abc import Mapping

HERE = Path(__file__).resolve().parents[1] / "engine"
ENGINE = tuple(file.name for file in files_below(HERE, "*.c"))
NUMBERS = ("law", "derivative", "next", "drives", *(f"law_{k}" for k in range(CONTROLS_MAX)))
TRUTHS = (
    *("safe", "constraint", "core", "ttf", "safer", "back", "enters"),
    *(f"{name}_{k}" for name in ("safe", "constraint", "safer", "back") for k in range(PARTS_MAX)),
)
FLAGS = (*STRICT, "-O3", "-fPIC", "-pthread")
UNIT_LEVEL = "-O3"
"""How the enclosures of a module are optimised; the bits are the same at every level. Tests prove
many small modules, each once, and would compile most of the time."""
LINKED = ("-shared", *OWN_SYMBOLS)
FORMS = "typedef struct soter_form soter_form; typedef unsigned char soter_truth;"
"""What Python sees of `soter_form.h`: only where its numbers are."""
UNIT = "enclosures.c"
MESSAGE = "the C of this module's enclosures does not compile"


def ffi() -> Any:  # noqa: ANN401 - cffi has no types
    """The declarations of the engine and of every function that a unit may have."""
    functions = [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in NUMBERS]
    functions += [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in TRUTHS]
    return interface(FORMS, declarations(HERE / "soter_reach.h"), "\n".join(functions))


def _inputs_of(source: str) -> int:
    match = re.search(r"^#define SOTER_INPUTS (\d+)$", source, re.MULTILINE)
    if match is None:
        raise ValueError("an enclosure unit defines SOTER_INPUTS")
    return int(match.group(1))


class ReachLibrary:
    """A loaded engine with one module's enclosures; holds no state."""

    def __init__(
        self,
        source: str,
        extra: tuple[str, ...] = (),
        reads: Mapping[str, frozenset[int]] = MappingProxyType({}),
    ) -> None:
        """`source`: the text of the enclosure unit; `extra`: more compiler flags (tests).

        `reads`: the inputs that each function of the unit reads, where they are known.
        """
        self.inputs, self.reads = _inputs_of(source), reads
        self.ffi = ffi()
        self.path = compiled(source, self.inputs, extra)
        """The library's file; its name is a hash of all that it was made of."""
        self.lib = opened(self.ffi, self.path)

    def symbol(self, name: str) -> Any:  # noqa: ANN401 - cdata
        """The address of `soter_NAME` of the unit, or NULL where the unit has no such function."""
        try:
            return self.ffi.cast("void *", self.ffi.addressof(self.lib, f"soter_{name}"))
        except (AttributeError, self.ffi.error):
            return self.ffi.NULL


def compiled(source: str, inputs: int, extra: tuple[str, ...] = ()) -> Path:
    """The shared library, from the cache or freshly built; SoterError X004, X006."""
    compiler = find()
    more = (f"-DSOTER_INPUTS={inputs}", *vector_flags(), *extra)
    flags, unit_flags = (*FLAGS, *more), (*FLAGS, UNIT_LEVEL, *more)
    engine = (*(HERE / name for name in ENGINE), CHECK_FAILED)
    headers = texts(*engine, *files_below(HERE, "*.h"))
    content = digest((source, compiler.identity, *flags, *unit_flags, *LINKED, *headers))
    name = f"reach-{content[:32]}.so"

    def make(work: Path) -> None:
        (work / UNIT).write_text(source, encoding="utf-8")
        command = (*compiler.command, *unit_flags, *include_flags(HERE / "soter_form.h"))
        with ThreadPoolExecutor(2) as both:
            made = both.submit(objects, engine, (*flags, *include_flags(HERE / "soter_form.h")))
            both.submit(compile_with, (*command, "-c", UNIT), work, MESSAGE).result()
        linked = (UNIT.replace(".c", ".o"), *map(str, made.result()))
        compile_with((*command, *LINKED, "-o", name, *linked, "-lm"), work, MESSAGE)

    return cached("reach", content, (name,), make) / name
