"""Runs a system in real time, by its package of target `posix`.

Purpose: it compiles the package, caches it and starts it. `run_real_time` is for `soter run
--real-time`; `run_recorded` is for `--recorded`, a run that such a package has recorded. The result
is like that of any run; after `run_real_time`, `Run.timing` has the driver's report.
Non-goals: the driver (`runtime/posix/`), reading recordings (`flight_recording.py`), processes of
externs (`externs/extern_process.py`), the record of a run (`run_observer.py`).
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import state_dtype, state_layout
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import is_answered_by_python
from soter.native.cache import cached_folder, digest
from soter.native.compiler import STRICT, compile_with, find_compiler, module_command
from soter.simulate.externs.extern_process import write_spec
from soter.simulate.flight_recording import FlightRecording
from soter.simulate.result import Run
from soter.simulate.run_observer import Observer, make_observer, named_parts
from soter.targets.posix_package import extern_nodes, posix_package
from soter.workers.child_process import end_with_parent, resume_child

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.native.extern_bindings import Bindings
    from soter.simulate.interrupt import StopRequest
    from soter.simulate.run_observer import Kept


UNRECORDED = "none of its states was recorded"
LOOK_S = 0.05
WAIT_S = 60
"""How many seconds the processes of externs may take to load."""
MEMORY_MIB = 16_384
"""The memory limit of such a process, in MiB: Python reserves much more than it uses."""
FINE = (0, 3, 4, 130)
RECORDED = "recorded"
"""The engine's name of a run that was recorded."""


@dataclass(frozen=True)
class BuiltPackage:
    """The folder of a built package and the program in it."""

    folder: Path
    program: str


def why_not_real_time(bindings: Bindings, engine: str) -> str:
    """The reason why a run cannot be in real time, but only paced by the clock; "" if it can."""
    if engine != "native":
        return "the interpreter has no clock"
    if sys.platform != "linux":
        return "the driver is for Linux"
    for x in bindings.externs:
        name = f"`{x.name}` is bound to "
        if x.kind == "plant" and x.bound is not None:
            return f"extern plant {name}Python"
        if x.bound is not None and not isinstance(x.bound, str):
            return f"{name}an object of this process"
    return ""


def build_package(system: System, core: CoreSystem) -> BuiltPackage:
    """Gives the compiled package, from the cache or compiled now; `SoterError` X004, X008."""
    if system.externals:
        raise SoterError((_external_topics_error(system),))
    compiler = find_compiler()
    package = posix_package(system, core, Path())
    flags = (*STRICT, "-O2")
    program = next(iter(package.programs))
    texts = [x for f in package.files for x in (f.path, f.text)]
    names = tuple(package.programs)

    def build(work: Path) -> None:
        package.folder = work / "sources"
        package.write()
        for name, rest in package.programs.items():
            command = [*compiler.command, *flags, "-o", str(work / name), *rest, "-lm"]
            compile_with(command, package.folder, "the C of this program does not compile")

    folder = cached_folder(
        f"posix-{program[:32]}", digest((compiler.identity, *flags, *texts)), names, build
    )
    return BuiltPackage(folder, program)


def _external_topics_error(system: System) -> Diagnostic:
    return Diagnostic(
        "X008",
        f"system `{system.name}` has external topics, and nobody speaks on them here",
        notes=("its plants are other programs",),
        helps=("build it with `--target posix`, and start them beside it (docs/real-time.md)",),
    )


def run_real_time(
    bindings: Bindings,
    until_ns: int,
    seed: int,
    *,
    keep_trace: Kept = False,
    hash_trace: bool = False,
    stop: StopRequest,
    also: Callable[..., None] | None = None,
    quiet: bool = False,
) -> Run:
    """Runs a system in real time, to `until_ns` or until `stop`; the trace is (instants,).

    Raises `SoterError` X004, X008 if it cannot be built, X011 if the driver does not run.
    """
    system = bindings.system
    built = build_package(system, bindings.core)
    observer = make_observer(system, state_layout(system), keep_trace, hash_trace=hash_trace)
    with tempfile.TemporaryDirectory(prefix="soter-") as place:
        work = Path(place)
        began = time.perf_counter()
        timing = _run_driver(built, bindings, work, until_ns, seed, stop, quiet=quiet)
        wall = time.perf_counter() - began
        cut = UNRECORDED
        if (work / "states").exists():
            recording = FlightRecording(work / "states", system)
            recording.show_states_to(observer, also)
            cut = recording.cut
    run = _finished_run(system, observer, keep_trace, seed, wall_s=wall, duration_s=until_ns / 1e9)
    run.interrupted, run.timing, run.cut = bool(timing["stopped"]), timing, cut
    run.lag_s_max = max(float(timing["wake"]["max_ns"]), 0.0) / 1e9
    return run


def run_recorded(
    recording: FlightRecording,
    *,
    keep_trace: Kept = False,
    hash_trace: bool = False,
    also: Callable[..., None] | None = None,
) -> Run:
    """Reads a recording as a `Run`; `cut` of the result says why it was read only in part."""
    system, began = recording.system, time.perf_counter()
    observer = make_observer(system, state_layout(system), keep_trace, hash_trace=hash_trace)
    recording.show_states_to(observer, also)
    wall, flown = time.perf_counter() - began, recording.last_ns / 1e9
    run = _finished_run(system, observer, keep_trace, recording.seed, wall_s=wall, duration_s=flown)
    run.cut, run.misses_recorded, run.engine = recording.cut, recording.misses, RECORDED
    return run


def _finished_run(
    system: System,
    observer: Observer,
    keep_trace: Kept,
    seed: int,
    *,
    wall_s: float,
    duration_s: float,
) -> Run:
    """Makes the `Run` from the states that an observer got."""
    layout = state_layout(system)
    dtype = state_dtype(layout)
    last = observer.last if observer.last is not None else np.zeros(layout.size, dtype=np.uint8)
    return Run(
        system=system,
        layout=layout,
        dtype=dtype,
        seed=seed,
        engine="native",
        final=last.view(dtype)[0],
        recorded=named_parts(keep_trace),
        duration_s=duration_s,
        wall_s=wall_s,
        **observer.run_fields(),
    )


def _run_driver(
    built: BuiltPackage,
    bindings: Bindings,
    work: Path,
    until_ns: int,
    seed: int,
    stop: StopRequest,
    *,
    quiet: bool,
) -> dict[str, Any]:
    """Runs the driver and gives its report; raises `SoterError` X011 without a report."""
    program = _executable_copy(built, work)
    command = [str(program), "--json", "--seed", str(seed), "--until", f"{until_ns / 1e9!r}"]
    command += ["--record", str(work / "states"), "--wait", str(WAIT_S)]
    command += ["--worker-memory", str(MEMORY_MIB), "--quiet", *([] if quiet else ["--live"])]
    for node in extern_nodes(bindings.system):
        if is_answered_by_python(node.binding):
            spec = work / f"worker_{node.index}"
            write_spec(bindings.system, node, seed, spec)
            words = module_command("soter.simulate.externs.extern_process", str(spec))
            command += ["--worker", f"{node.name}=exec {shlex.join(words)}"]
    out, errors = (os.fdopen(os.memfd_create(name), "w+b") for name in ("report", "said"))
    with out, errors:  # on no disk, which may be full
        process = subprocess.Popen(
            command,
            stdout=out,
            stderr=errors if quiet else None,
            preexec_fn=partial(end_with_parent, os.getpid()),  # noqa: PLW1509 - no thread runs yet
        )
        while process.poll() is None:
            if stop.wanted:
                process.terminate()
            resume_child(process.pid)
            time.sleep(LOOK_S)
        out.seek(0)
        errors.seek(0)
        text = out.read().decode("utf-8", "replace")
        words = errors.read().decode("utf-8", "replace").splitlines()
    if process.returncode not in FINE or not text:
        raise SoterError((_no_report_error(process.returncode, words),))
    document: dict[str, Any] = json.loads(text)
    return document


def _executable_copy(built: BuiltPackage, work: Path) -> Path:
    """Copies the program and makes it executable, because files in the cache are not."""
    for path in built.folder.iterdir():
        if path.name != "seals":
            (work / path.name).symlink_to(path) if path.is_dir() else shutil.copy2(path, work)
            (work / path.name).chmod(0o700)
    return work / built.program


def _no_report_error(status: int, error_lines: list[str]) -> Diagnostic:
    return Diagnostic(
        "X011",
        "the process of the real-time driver is gone, without a report",
        notes=(f"its exit status is {status}", *error_lines[-4:]),
    )
