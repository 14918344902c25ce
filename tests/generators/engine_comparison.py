"""Both engines on the same programs, and where their traces first differ.

Purpose: check, compile many programs in one compiler call, run, compare byte by byte.
Non-goals: making programs (`random_programs.py`), statistics (`run_statistics.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

import processes
from soter.codegen.unit import Unit, generate
from soter.core.layout import StateLayout, state_dtype, state_layout
from soter.language.front_end import check_file, system_of
from soter.native.cache import SOTER, cached_folder, digest
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.loaded_program import Library, RunStatus
from soter.native.shared_library import (
    CHECK_FAILED,
    KERNEL,
    LIBRARY,
    RUNTIME,
    c_texts,
    include_flags,
    objects,
)
from soter.semantics.interpreter import Interpreter
from soter.simulate.run import state_bytes

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from soter.language.front_end import CheckResult
    from soter.language.model.system import System

    Bytes = npt.NDArray[np.uint8]


SETS = SOTER / "verify" / "engine"
"""The C of the set engine."""


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
        return state_dtype(self.layout)

    @cached_property
    def unit(self) -> Unit:
        """The generated C; its names start with the subject's."""
        return generate(self.system, prefix=self.name)


def subject(
    name: str,
    text: str,
    seed: int,
    instants: int,
    system: str | None = None,
    path: Path | None = None,
) -> Subject:
    """Check a program and find out until when it has so many instants."""
    checked = check_file(str(path) if path else f"{name}.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    return subject_of(checked, name, text, seed, until=instants, system=system)


def subject_of(
    checked: CheckResult,
    name: str,
    text: str,
    seed: int,
    *,
    until: int,
    system: str | None,
) -> Subject:
    """A system of a checked program, `until` so many instants have passed."""
    flat = system_of(checked, system)
    return Subject(name, text, flat, state_layout(flat), until_of(flat, until), seed)


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
        unit = s.unit
        (folder / f"{s.name}.h").write_text(unit.header, encoding="utf-8")
        (folder / f"{s.name}.c").write_text(unit.source, encoding="utf-8")
    together = folder / "all_programs.c"
    together.write_text("".join(f'#include "{s.name}.c"\n' for s in subjects), encoding="utf-8")
    return together


def call_compiler(folder: Path, *arguments: str) -> None:
    """One strict call: a warning is an error."""
    headers = include_flags(SETS / "soter_form.h")
    command = [*find_compiler().command, *STRICT, *WARNINGS, *headers, f"-I{folder}", *arguments]
    done = processes.run(command, capture_output=True, text=True, check=False, cwd=folder)
    if done.returncode != 0:
        raise CompileError(done.stderr)


def kernel_sources() -> list[str]:
    """The kernel's C files."""
    return [str(RUNTIME / name) for name in KERNEL]


def compile_library(subjects: list[Subject], folder: Path, optimise: str) -> Path:
    """All subjects and one kernel as a shared library, kept by content as compiled programs are;
    the kernel is compiled once for all.
    """
    flags = (*STRICT, *WARNINGS, optimise, "-fPIC")
    sources = (*(RUNTIME / name for name in KERNEL), CHECK_FAILED)
    kernel = objects(sources, (*flags, *include_flags(RUNTIME / "soter.h")))
    own = [x for s in subjects for x in (s.name, s.unit.header, s.unit.source)]
    headers = c_texts(*sources, *sorted(RUNTIME.glob("*.h")), *sorted(SETS.glob("*.h")))

    def make(at: Path) -> None:
        source = write_units(subjects, folder)
        shared = (optimise, "-fPIC", "-shared", "-o", str(at / LIBRARY))
        call_compiler(folder, *shared, str(source), *map(str, kernel), "-lm")

    content = digest((find_compiler().identity, *flags, *own, *headers))
    return cached_folder("compared", content, (LIBRARY,), make) / LIBRARY


def native_trace(library: Path, s: Subject) -> Bytes:
    """Every state of a run of the generated C: shape (instants, size)."""
    size = s.layout.size
    loaded = Library(library, s.name, size)
    state = loaded.new_state(s.seed)
    parts: list[Bytes] = []
    status = RunStatus.FULL
    while status is RunStatus.FULL:
        room = np.zeros((2000, size), dtype=np.uint8)
        status, written, _ = loaded.run_until(state, s.until_ns, room)
        parts.append(room[:written].copy())
    assert status is RunStatus.END
    return np.concatenate(parts)


DRIVER = """\
#include "soter.h"

#include <stdio.h>
#include <stdlib.h>

%(externs)s

static const struct {
  const soter_program *program;
  uint64_t seed;
  int64_t until_ns;
} runs[] = {
%(runs)s
};

/* Runs every program in a heap block of exactly its state's size, so that a sanitizer sees whoever
 * leaves it, and writes the final states one after the other. */
int main(void) {
  for (size_t i = 0; i < sizeof runs / sizeof runs[0]; i++) {
    const soter_program *const p = runs[i].program;
    void *const state = malloc(p->state_size);
    size_t written = 0;
    uint32_t due = 0;
    if (state == NULL) {
      return 3;
    }
    soter_start(p, state, runs[i].seed);
    if (soter_run(p, state, runs[i].until_ns, NULL, 0, &written, &due) != SOTER_RUN_END) {
      return 2;
    }
    if (fwrite(state, p->state_size, 1, stdout) != 1) {
      return 4;
    }
    free(state);
  }
  return 0;
}
"""


def final_states(subjects: list[Subject], folder: Path, *flags: str) -> list[bytes]:
    """Final states from an executable of all subjects; AssertionError with what it complained."""
    source, driver, target = write_units(subjects, folder), folder / "driver.c", folder / "driver"
    externs = "\n".join(f"extern const soter_program {s.name}_program;" for s in subjects)
    runs = "\n".join(
        f"    {{&{s.name}_program, UINT64_C({s.seed}), INT64_C({s.until_ns})}}," for s in subjects
    )
    driver.write_text(DRIVER % {"externs": externs, "runs": runs}, encoding="utf-8")
    sources = (str(driver), str(source), *kernel_sources(), str(CHECK_FAILED))
    call_compiler(folder, *flags, "-o", str(target), *sources, "-lm")
    done = processes.run([str(target)], capture_output=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stderr.decode("utf-8", "replace")
    states, at = [], 0
    for s in subjects:
        states.append(done.stdout[at : at + s.layout.size])
        at += s.layout.size
    assert at == len(done.stdout)
    return states


# ---------------------------------------------------------------- the interpreter


def interpreted_trace(s: Subject) -> Bytes:
    """Every state of a run of the reference interpreter: shape (instants, size)."""
    images: list[bytes] = []
    Interpreter(s.system, s.seed).run(
        s.until_ns,
        lambda c, record: images.append(state_bytes(s.system, s.layout, c, record, s.seed)),
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
    lines = [f"instant {at} (t = {ct} ns), C against interpreter:"]
    lines += _members(s, one, other, "")
    if len(lines) == 1:
        offsets = np.flatnonzero(native[at] != interpreted[at])
        lines.append(f"  bytes {offsets.tolist()} that belong to no member")
    return "\n".join(lines[:12])


def _members(s: Subject, one: Any, other: Any, path: str) -> list[str]:
    """Differing leaves below a member."""
    names = one.dtype.names
    if names is not None and one.shape == ():
        return [line for n in names for line in _members(s, one[n], other[n], f"{path}.{n}")]
    if one.shape:
        label = {
            ".components": s.system.components,
            ".modules": s.system.modules,
            ".properties": s.system.properties,
            ".stamps": s.system.topics,
        }.get(path)
        return [
            line
            for i in range(len(one))
            for line in _members(s, one[i], other[i], f"{path}[{i}{_called(label, i)}]")
        ]
    if one.tobytes() == other.tobytes():
        return []
    return [f"  {path[1:]}: {one!r} against {other!r}"]


def _called(label: Any, index: int) -> str:
    name = getattr(label[index], "name", "") if label is not None else ""
    return f" {name}" if name else ""
