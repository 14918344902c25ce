"""One run of a system in real time: the package of target `posix` is compiled, kept and run.

Purpose: `run_real_time` serves `soter run --real-time`, and `run_recorded` serves `--recorded`, for
a run that was made with the package. A `FlightRecording` gives the states after all instants, in
order, and how late decision modules were. A recording of something else, or one that contradicts
itself, is a `SoterError`; one that lacks its end, or some instants, is read up to there. The result
is like that of any run; `Run.timing` has the driver's report, if the run was made now.
Non-goals: the driver and what writes recordings (`runtime/posix/`), processes of externs
(`externs/extern_process.py`), what is told of a run (`run_observer.py`).
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import NEVER, state_dtype, state_layout
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake, reason
from soter.language.load.named_files import is_in_python, opened
from soter.native.cache import cached, digest
from soter.native.compiler import STRICT, compile_with, find, python_module
from soter.report.wording import visible
from soter.simulate.externs.extern_process import write_spec
from soter.simulate.result import Run
from soter.simulate.run_observer import Observer, make_observer, named_parts
from soter.targets.posix_package import FIRST_LINE, head_of, nodes_of, posix_package
from soter.workers.child_process import end_with, resume

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from typing import BinaryIO

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.native.bindings import Bindings
    from soter.simulate.interrupt import StopRequest
    from soter.simulate.run_observer import Kept

    Looks = Mapping[tuple[int, str], tuple[int, int]]
    """Of steps of a DM, by time (ns) and module: how late it began, and ended, ns."""


HEAD_MAX = 1 << 20
END = re.compile(rb"end (\d{20}) ([0-9a-f]{64})\n")
END_BYTES = 4 + 20 + 1 + 64 + 1
BLOCK = 1024
READ_BYTES = 1 << 20
CUT = "its end is missing: the program that flew was killed, or the file was cut"
UNRECORDED = "none of its states was recorded"


@dataclass
class FlightRecording:
    """A recording of a system, whose beginning was read.

    `cut`: why it was not read to its end, "" where it was. `misses`: how often the trusted part
    was late, as the driver counted. `last_ns`: the time of the last instant that was read.
    """

    path: Path
    system: System
    seed: int = 0
    cut: str = ""
    misses: int = 0
    last_ns: int = 0
    _looks: dict[tuple[int, str], tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Reads the beginning; `SoterError` D006 for no recording, D023 for another system's."""
        self._layout = state_layout(self.system)
        modules = max(len(self.system.modules), 1)
        self._record = np.dtype(
            [
                ("number", "<u8"),
                *((name, "<i8") for name in ("ct", "wake_ns", "done_ns", "independent_ns")),
                *((name, "<u4") for name in ("misses", "modes")),
                *((name, "<i8", (modules,)) for name in ("late_ns", "done_by_module_ns")),
                ("state", "u1", (self._layout.size,)),
            ]
        )
        with self._open_file() as file:
            self.seed = self._read_head(file)

    def show_to(self, observer: Observer, also: Callable[..., None] | None = None) -> None:
        """Shows all states to an observer; `also` is then given the `Looks` of its states.

        `SoterError` D006 where the recording contradicts itself, or has an impossible state.
        """
        if also is not None:
            observer.also = partial(also, looks=self._looks)
        for rows in self._blocks():
            try:
                observer.see(rows)
            except (ValueError, LookupError) as error:
                why = f"up to {self.last_ns} ns a state is none: {error}"
                raise self._cannot_read(f"it is damaged: {why}") from error

    # ------------------------------------------------------------ the file

    @contextmanager
    def _open_file(self) -> Iterator[BinaryIO]:
        try:
            with opened(self.path) as file:
                yield file
        except OSError as error:
            raise self._cannot_read(reason(error)) from error

    def _read_head(self, file: BinaryIO) -> int:
        """Reads and compares which system flew; returns the seed."""
        head, _, _ = file.read(HEAD_MAX).partition(b"\n\n")
        file.seek(len(head) + 2)
        first, *lines = head.decode("utf-8", "replace").split("\n")
        if first != FIRST_LINE:
            raise self._cannot_read("it does not begin as a recording does")
        fields_of_head = dict(line.partition("=")[::2] for line in lines)
        seed, now = fields_of_head.pop("seed", ""), head_of(self.system, self._layout)
        for name in sorted(now.keys() | fields_of_head.keys()):
            was, here = (fields_of_head.get(name, "the default"), now.get(name, "the default"))
            if was != here:
                name_shown = visible(name.removeprefix("param "))
                raise self._another_flight(
                    f"{name_shown} was {visible(was)[:80]} in it, and is {here} here"
                )
        if not seed.isdecimal():
            raise self._cannot_read("it does not say its seed")
        return int(seed)

    def _blocks(self) -> Iterator[npt.NDArray[np.uint8]]:
        """The states in blocks, (n, size) bytes, up to where something is missing."""
        with self._open_file() as file:
            self._read_head(file)
            begin, announced, size = file.tell(), self._read_end(file), self._record.itemsize
            file.seek(begin)
            number = 0
            while data := file.read(size * BLOCK):
                records = np.frombuffer(data[: len(data) // size * size], dtype=self._record)
                whole = self._in_sequence(records, number)
                number += len(whole)
                if len(whole):
                    yield self._note_records(whole)
                if len(whole) < len(records):
                    missing = int(records["number"][len(whole)]) - number
                    self.cut = self._missing_text(missing)
                    return
        if announced is None:
            self.cut = CUT
        elif announced < number:
            raise self._cannot_read("it is damaged: it has more instants than its end says")
        elif announced > number:
            self.cut = self._missing_text(announced - number)

    def _read_end(self, file: BinaryIO) -> int | None:
        """How many instants it claims to have, with its hash compared; None: its end is missing."""
        begin = file.tell()
        size = file.seek(0, 2)
        file.seek(max(size - END_BYTES, begin))
        end = END.fullmatch(file.read())
        if end is None or (size - END_BYTES - begin) % self._record.itemsize:
            return None
        file.seek(0)
        digest, left = hashlib.sha256(), size - END_BYTES
        while left and (data := file.read(min(left, READ_BYTES))):
            digest.update(data)
            left -= len(data)
        if digest.hexdigest().encode() != end[2]:
            raise self._cannot_read("it is damaged: its end has the hash of something else")
        return int(end[1])

    def _in_sequence(self, records: npt.NDArray[Any], number: int) -> npt.NDArray[Any]:
        """The records up to the first one out of sequence; `SoterError` D006 for wrong ones."""
        numbers = records["number"].astype(np.int64)
        due = np.arange(number, number + len(records))
        fits = numbers == due
        whole = records[: len(records) if fits.all() else int(np.argmin(fits))]
        cts = whole["state"][:, :8].copy().view("<i8")[:, 0]
        times = np.concatenate(([self.last_ns if number else -1], whole["ct"]))
        backwards = len(whole) < len(records) and numbers[len(whole)] < due[len(whole)]
        if backwards or (np.diff(times) <= 0).any() or (cts != whole["ct"]).any():
            raise self._cannot_read(f"it is damaged: instants behind {times[-1]} ns in no order")
        return whole

    def _note_records(self, records: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
        """The states of records; what else they say is noted."""
        self.misses += int(records["misses"].sum())
        self.last_ns = int(records["ct"][-1])
        self._looks.clear()
        for module in self.system.modules:
            late, done = (
                records[name][:, module.index] for name in ("late_ns", "done_by_module_ns")
            )
            for row in np.flatnonzero(late != NEVER):
                key = int(records["ct"][row]), module.name
                self._looks[key] = int(late[row]), int(done[row])
        return np.ascontiguousarray(records["state"])

    def _missing_text(self, count: int) -> str:
        are = "instants are" if count != 1 else "instant is"
        return (
            f"{count:,} {are} missing behind {self.last_ns / 1e9:.9g} s: the logger of the program "
            "had no room for more"
        )

    def _cannot_read(self, why: str) -> SoterError:
        helps = ("`--record FILE` of a program of `soter build --target posix` writes one",)
        text = f"cannot read the recording `{visible(str(self.path))}`: {why}"
        return mistake("D006", text, *helps)

    def _another_flight(self, why: str) -> SoterError:
        helps = ("the same program, system and parameters as were built, by the same Soter",)
        text = f"`{visible(str(self.path))}` is of another flight: {why}"
        return mistake("D023", text, *helps)


LOOK_S = 0.05
WAIT_S = 60
"""How many seconds the processes of externs may take to load."""
MEMORY_MIB = 16_384
"""The memory limit of such a process, in MiB: Python reserves much more than it uses."""
FINE = (0, 3, 4, 130)
RECORDED = "recorded"
"""Stands in the place of an engine's name."""


@dataclass(frozen=True)
class BuiltPackage:
    """The folder of a built package and the program in it."""

    folder: Path
    program: str


def why_not(bindings: Bindings, engine: str) -> str:
    """Why a run cannot be in real time, only paced by the clock; "": it can."""
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


def build(system: System, core: CoreSystem) -> BuiltPackage:
    """The package, from the cache or compiled now; `SoterError` X004, X008."""
    if system.externals:
        raise SoterError((_nobody_speaks(system),))
    compiler = find()
    package = posix_package(system, core, Path())
    flags = (*STRICT, "-O2")
    program = next(iter(package.programs))
    texts = [x for f in package.files for x in (f.path, f.text)]
    names = tuple(package.programs)

    def make(work: Path) -> None:
        package.folder = work / "sources"
        package.write()
        for name, rest in package.programs.items():
            command = [*compiler.command, *flags, "-o", str(work / name), *rest, "-lm"]
            compile_with(command, package.folder, "the C of this program does not compile")

    folder = cached(
        f"posix-{program[:32]}", digest((compiler.identity, *flags, *texts)), names, make
    )
    return BuiltPackage(folder, program)


def _nobody_speaks(system: System) -> Diagnostic:
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
    """Runs in real time, to `until_ns` or until `stop` is wanted; the trace is (instants,).

    `SoterError` X004, X008 where it cannot be built, X011 where the driver does not run.
    """
    system = bindings.system
    built = build(system, bindings.core)
    observer = make_observer(system, state_layout(system), keep_trace, hash_trace=hash_trace)
    with tempfile.TemporaryDirectory(prefix="soter-") as place:
        work = Path(place)
        began = time.perf_counter()
        timing = _run_driver(built, bindings, work, until_ns, seed, stop, quiet=quiet)
        wall = time.perf_counter() - began
        cut = UNRECORDED
        if (work / "states").exists():
            recording = FlightRecording(work / "states", system)
            recording.show_to(observer, also)
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
    """The run that was recorded; `cut` says why the recording was not read to its end."""
    system, began = recording.system, time.perf_counter()
    observer = make_observer(system, state_layout(system), keep_trace, hash_trace=hash_trace)
    recording.show_to(observer, also)
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
    """The result of what an observer saw."""
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
    """Runs the driver and returns its report; `SoterError` X011 where there is none."""
    program = _executable_copy(built, work)
    command = [str(program), "--json", "--seed", str(seed), "--until", f"{until_ns / 1e9!r}"]
    command += ["--record", str(work / "states"), "--wait", str(WAIT_S)]
    command += ["--worker-memory", str(MEMORY_MIB), "--quiet", *([] if quiet else ["--live"])]
    for node in nodes_of(bindings.system):
        if is_in_python(node.binding):
            spec = work / f"worker_{node.index}"
            write_spec(bindings.system, node, seed, spec)
            words = python_module("soter.simulate.externs.extern_process", str(spec))
            command += ["--worker", f"{node.name}=exec {shlex.join(words)}"]
    out, errors = (os.fdopen(os.memfd_create(name), "w+b") for name in ("report", "said"))
    with out, errors:  # on no disk, which may be full
        process = subprocess.Popen(
            command,
            stdout=out,
            stderr=errors if quiet else None,
            preexec_fn=partial(end_with, os.getpid()),  # noqa: PLW1509 - no thread runs yet
        )
        while process.poll() is None:
            if stop.wanted:
                process.terminate()
            resume(process.pid)
            time.sleep(LOOK_S)
        out.seek(0)
        errors.seek(0)
        text = out.read().decode("utf-8", "replace")
        words = errors.read().decode("utf-8", "replace").splitlines()
    if process.returncode not in FINE or not text:
        raise SoterError((_without_report(process.returncode, words),))
    document: dict[str, Any] = json.loads(text)
    return document


def _executable_copy(built: BuiltPackage, work: Path) -> Path:
    """The path of an executable copy of the program: files in the cache may not be executed."""
    for path in built.folder.iterdir():
        if path.name != "seals":
            (work / path.name).symlink_to(path) if path.is_dir() else shutil.copy2(path, work)
            (work / path.name).chmod(0o700)
    return work / built.program


def _without_report(status: int, error_lines: list[str]) -> Diagnostic:
    return Diagnostic(
        "X011",
        "the process of the real-time driver is gone, without a report",
        notes=(f"its exit status is {status}", *error_lines[-4:]),
    )
