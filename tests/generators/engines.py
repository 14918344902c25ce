"""Both engines on the same programs, and where their traces first differ.

Purpose: check, compile many programs in one compiler call, run, compare byte by byte.
Non-goals: making programs (`programs.py`), statistics (`tally.py`).
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import Unit, generate
from soter.lower.layout import StateLayout, state_dtype, state_layout
from soter.native.build import KERNEL, RUNTIME
from soter.native.compiler import STRICT, WARNINGS, find
from soter.native.library import Library
from soter.program.build import check_file, system_of
from soter.semantics.interpreter import Interpreter
from soter.simulate.image import image

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from soter.program.system import System

    Bytes = npt.NDArray[np.uint8]


class CompileError(Exception):
    """The C of some programs does not compile; the message is the compiler's."""


@dataclass(eq=False)
class Subject:
    """One program, ready for both engines."""

    name: str
    text: str
    system: System
    layout: StateLayout
    until_ns: int
    seed: int

    @property
    def dtype(self) -> np.dtype[Any]:
        """One state as a record."""
        return state_dtype(self.system, self.layout)

    def unit(self) -> Unit:
        """The generated C; its names start with the subject's."""
        return generate(self.system, prefix=self.name)


def subject(name: str, text: str, seed: int, instants: int, system: str | None = None) -> Subject:
    """Check a program and find out until when it has so many instants."""
    checked = check_file(f"{name}.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    flat = system_of(checked, system)
    return Subject(name, text, flat, state_layout(flat), until_of(flat, instants), seed)


def until_of(system: System, instants: int) -> int:
    """The time of instant number `instants` (the first is 1)."""
    calendars = [(x.phase_ns, x.period_ns) for x in system.components]
    calendars += [(0, i.every_ns) for i in system.inputs]
    times: set[int] = set()
    horizon = min(p for _, p in calendars) * instants
    for phase, period in calendars:
        times.update(range(phase, horizon + 1, period))
    return sorted(times)[:instants][-1]


# ---------------------------------------------------------------- the C engine


def write_units(subjects: list[Subject], folder: Path) -> Path:
    """Write the generated C of all subjects; gives one file that includes them all, which a
    compiler reads in half the time.
    """
    for s in subjects:
        unit = s.unit()
        (folder / f"{s.name}.h").write_text(unit.header, encoding="utf-8")
        (folder / f"{s.name}.c").write_text(unit.source, encoding="utf-8")
    together = folder / "all_programs.c"
    together.write_text("".join(f'#include "{s.name}.c"\n' for s in subjects), encoding="utf-8")
    return together


def call_compiler(folder: Path, *arguments: str) -> None:
    """One strict call: a warning is an error."""
    command = [*find().command, *STRICT, *WARNINGS, f"-I{RUNTIME}", f"-I{folder}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    if done.returncode != 0:
        raise CompileError(done.stderr)


def kernel_sources() -> list[str]:
    """The kernel's C files."""
    return [str(RUNTIME / name) for name in KERNEL]


def compile_library(subjects: list[Subject], folder: Path, optimise: str) -> Path:
    """All subjects and one kernel as a shared library."""
    source = write_units(subjects, folder)
    target = folder / f"all{optimise}.so"
    shared = ("-fPIC", "-shared", "-o", str(target))
    call_compiler(folder, optimise, *shared, str(source), *kernel_sources(), "-lm")
    return target


def native_trace(library: Path, s: Subject) -> Bytes:
    """Every state of a run of the generated C: shape (instants, size)."""
    size = s.layout.size
    loaded = Library(library, s.name, size)
    state = loaded.new_state(s.seed)
    trace = np.zeros((2000, size), dtype=np.uint8)
    _, written, _ = loaded.run(state, s.until_ns, trace)
    assert written < len(trace)
    return trace[:written].copy()


# ---------------------------------------------------------------- the interpreter


def interpreted_trace(s: Subject) -> Bytes:
    """Every state of a run of the reference interpreter: shape (instants, size)."""
    images: list[bytes] = []
    Interpreter(s.system, s.seed).run(
        s.until_ns, lambda c, record: images.append(image(s.system, s.layout, c, record, s.seed))
    )
    return np.frombuffer(b"".join(images), dtype=np.uint8).reshape(-1, s.layout.size)


# ---------------------------------------------------------------- comparison


def first_difference(s: Subject, native: Bytes, interpreted: Bytes) -> str | None:
    """Where two traces first differ, in words; None where they are the same."""
    if native.shape == interpreted.shape and (native == interpreted).all():
        return None
    common = min(len(native), len(interpreted))
    unequal = np.flatnonzero((native[:common] != interpreted[:common]).any(axis=1))
    if not len(unequal):
        return f"{len(native)} instants in C, {len(interpreted)} in the interpreter"
    at = int(unequal[0])
    one, other = native[at].view(s.dtype)[0], interpreted[at].view(s.dtype)[0]
    ct = int(native[at].view(np.int64)[0])
    found = [f"instant {at} (t = {ct} ns), C against interpreter:"]
    found += _members(s, one, other, "")
    if len(found) == 1:
        offsets = np.flatnonzero(native[at] != interpreted[at])
        found.append(f"  bytes {offsets.tolist()} that belong to no member")
    return "\n".join(found[:12])


def _members(s: Subject, one: Any, other: Any, path: str) -> list[str]:
    """Differing leaves below a member."""
    names = one.dtype.names
    if names is not None and one.shape == ():
        return [line for n in names for line in _members(s, one[n], other[n], f"{path}.{n}")]
    if one.shape:
        label = {".components": s.system.components, ".modules": s.system.modules,
                 ".properties": s.system.properties, ".stamps": s.system.topics}.get(path)  # fmt: skip
        return [
            line
            for i in range(len(one))
            for line in _members(
                s, one[i], other[i], f"{path}[{i}{_called(label, i)}]"
            )
        ]
    if one.tobytes() == other.tobytes():
        return []
    return [f"  {path[1:]}: {one!r} against {other!r}"]


def _called(label: Any, index: int) -> str:
    name = getattr(label[index], "name", "") if label is not None else ""
    return f" {name}" if name else ""
