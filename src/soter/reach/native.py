"""The grid engine as a shared library: enclosures of one module and `soter_reach*.c`.

Purpose: compile a generated enclosure unit together with the engine, once for each content, and
reach both through cffi.
Non-goals: generating the unit (`codegen/enclosures.py`), meaning of the calls (`reach/grids.py`).
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

from soter.codegen.conjuncts import PARTS_MAX
from soter.codegen.enclosures import CONTROLS_MAX
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.build import OWN_SYMBOLS, RUNTIME, TIMEOUT_S, cache_dir
from soter.native.compiler import STRICT, find

PARTS = ("", "_hold", "_kept", "_linear", "_grid", "_pool", "_rounds", "_safe", "_choice", "_way")
ENGINE = tuple(f"soter_reach{part}.c" for part in PARTS)
NUMBERS = ("law", "derivative", "next", "drives", *(f"law_{k}" for k in range(CONTROLS_MAX)))
TRUTHS = (
    *("safe", "core", "ttf", "safer"),
    *(f"{name}_{k}" for name in ("safe", "safer") for k in range(PARTS_MAX)),
)
FLAGS = (*STRICT, "-O3", "-fPIC", "-pthread")
LINKED = ("-shared", *OWN_SYMBOLS)


def _declarations() -> str:
    text = (RUNTIME / "soter_reach.h").read_text(encoding="utf-8")
    shared = text.split("/* cdef */", 1)[1].split("/* end of cdef */", 1)[0]
    functions = [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in NUMBERS]
    functions += [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in TRUTHS]
    return "typedef void *soter_reach_map;\n" + shared + "\n".join(functions)


@lru_cache(maxsize=1)
def ffi() -> Any:  # noqa: ANN401 - cffi has no types
    """The engine's declarations."""
    from cffi import FFI  # noqa: PLC0415 - only proofs pay for it

    found = FFI()
    found.cdef(_declarations())
    return found


def _inputs_of(source: str) -> int:
    found = re.search(r"^#define SOTER_INPUTS (\d+)$", source, re.MULTILINE)
    if found is None:
        raise ValueError("an enclosure unit defines SOTER_INPUTS")
    return int(found.group(1))


def _content(source: str, identity: str, flags: tuple[str, ...]) -> str:
    """Hash of everything a library, or with source "" the engine's objects, are made of."""
    digest = hashlib.sha256()
    headers = sorted(p for p in RUNTIME.iterdir() if p.suffix == ".h")
    parts = [source, identity, *flags, *LINKED, *(p.read_text(encoding="utf-8") for p in headers)]
    parts += [(RUNTIME / name).read_text(encoding="utf-8") for name in ENGINE]
    for part in parts:
        data = part.encode("utf-8")
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


class ReachLibrary:
    """A loaded engine with one module's enclosures; holds no state."""

    def __init__(self, source: str, extra: tuple[str, ...] = ()) -> None:
        """`source`: the text of the enclosure unit; `extra`: more compiler flags (tests)."""
        self.inputs = _inputs_of(source)
        self.ffi = ffi()
        self.path = compiled(source, self.inputs, extra)
        """The library's file; its name is a hash of all that it was made of."""
        self.lib = self.ffi.dlopen(str(self.path))

    def symbol(self, name: str) -> Any:  # noqa: ANN401 - cdata
        """The address of `soter_NAME` of the unit, or NULL where the unit has no such function."""
        try:
            return self.ffi.cast("void *", self.ffi.addressof(self.lib, f"soter_{name}"))
        except AttributeError:
            return self.ffi.NULL


def compiled(source: str, inputs: int, extra: tuple[str, ...] = ()) -> Path:
    """The shared library, from the cache or freshly built; SoterError X004, X006."""
    compiler = find()
    flags = (*FLAGS, f"-DSOTER_INPUTS={inputs}", *extra)
    folder = cache_dir()
    target = folder / f"reach-{_content(source, compiler.identity, flags)[:32]}.so"
    seal = target.with_suffix(".sha256")
    try:
        if seal.read_text(encoding="utf-8") == hashlib.sha256(target.read_bytes()).hexdigest():
            return target
    except (OSError, UnicodeDecodeError):
        pass
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as name:
            work = Path(name)
            command = (*compiler.command, *flags)
            content = _content("", compiler.identity, flags)
            with ThreadPoolExecutor(2) as both:
                engine = both.submit(_engine, work, folder, content, command)
                both.submit(_unit, work, source, command).result()
                built = _linked(work, command, engine.result())
            (work / "seal").write_text(
                hashlib.sha256(built.read_bytes()).hexdigest(), encoding="utf-8"
            )
            built.replace(target)
            (work / "seal").replace(seal)
    except OSError as error:
        message = f"cannot write to the cache folder `{folder}`: {error.strerror or error}"
        helps = ("choose another with the environment variable SOTER_CACHE",)
        raise SoterError((Diagnostic("X006", message, helps=helps),)) from error
    return target


def _engine(work: Path, folder: Path, content: str, command: tuple[str, ...]) -> list[str]:
    """The engine's objects, which depend on a module only by its number of inputs.

    Kept in the cache with the hash of each; anything damaged or missing is built again.
    """
    kept = folder / f"engine-{content[:32]}"
    names = [name.replace(".c", ".o") for name in ENGINE]
    try:
        seals = (kept / "seals").read_text(encoding="utf-8").split()
        if seals == [hashlib.sha256((kept / n).read_bytes()).hexdigest() for n in names]:
            return [str(kept / n) for n in names]
    except (OSError, UnicodeDecodeError):
        pass
    made = work / "engine"
    made.mkdir()
    _run([*command, f"-I{RUNTIME}", "-c", *(str(RUNTIME / name) for name in ENGINE)], made)
    kept.mkdir(exist_ok=True)
    seals = []
    for n in names:
        seals.append(hashlib.sha256((made / n).read_bytes()).hexdigest())
        copied = made / f"{n}.copy"
        copied.write_bytes((made / n).read_bytes())
        copied.replace(kept / n)
    (made / "seals").write_text("\n".join(seals), encoding="utf-8")
    (made / "seals").replace(kept / "seals")
    return [str(made / n) for n in names]


def _unit(work: Path, source: str, command: tuple[str, ...]) -> None:
    (work / "enclosures.c").write_text(source, encoding="utf-8")
    _run([*command, f"-I{RUNTIME}", "-c", "enclosures.c"], work)


def _linked(work: Path, command: tuple[str, ...], engine: list[str]) -> Path:
    built = work / "reach.so"
    _run([*command, *LINKED, "-o", str(built), "enclosures.o", *engine, "-lm"], work)
    return built


def _run(command: list[str], work: Path) -> None:
    """The compiler in `work`; X004 with its words."""
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S, cwd=work
    )
    if done.returncode != 0:
        lines = done.stderr.replace(str(work) + os.sep, "").strip().splitlines()
        helps = ("this is a defect of soter: please report it with the program",)
        message = "the C of this module's enclosures does not compile"
        raise SoterError((Diagnostic("X004", message, notes=tuple(lines[:8]), helps=helps),))
