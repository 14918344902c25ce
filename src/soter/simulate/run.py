"""One virtual-time run of a system, on either engine.

Purpose: run, hash and keep what is asked for; the result is the final state plus, if wanted, the
state after every instant, both as numpy records of the documented layout. A run that is stopped
half-way is a run until there.
Non-goals: printing, logs, many runs at once (campaigns), finding externs (`bindings.py`).
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import Unit, generate
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.lower.layout import NEVER, StateLayout, state_dtype, state_layout
from soter.native.build import library
from soter.native.library import Library, RunStatus
from soter.program.arith import FaultKind
from soter.semantics.externs import ExternResetError, Stop, reset
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_release
from soter.simulate import views
from soter.simulate.c_extern import linked_symbols
from soter.simulate.externs import ExternAnswers, described, noting
from soter.simulate.image import image
from soter.simulate.interrupt import StopRequest
from soter.simulate.notes import notes_of
from soter.simulate.observe import Observer
from soter.simulate.settings import usage_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy.typing as npt

    from soter.diagnostics.span import Span
    from soter.lower.core import CoreSystem
    from soter.native.library import Bytes
    from soter.program.system import Component, System
    from soter.program.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.record import Record
    from soter.simulate.externs import Tally
    from soter.simulate.observe import FirstFault, ModeChange
    from soter.simulate.pace import Pacer

    Progress = Callable[[float], None]

CHUNK_BYTES = 4 * 1024 * 1024
SLICE_NS = 1_000_000_000
"""Without a trace, how much virtual time may pass until Ctrl-C is looked at."""
BATCH = 64
"""States of the interpreter that are observed together."""


@dataclass(frozen=True)
class Violation:
    """Something that counts: an onset of a violated property, or a latched component.

    `time_s` is the first onset; `count` how many onsets there were; `span` where the property
    or the component's declaration stands.
    """

    what: str
    kind: str
    time_s: float | None
    count: int
    span: Span | None = None


@dataclass(frozen=True)
class ModuleSummary:
    """What one module did. `ac_share` is the share of time in mode AC."""

    ac_share: float
    switches_to_sc: int
    switches_to_ac: int
    gate_faults: int


@dataclass(eq=False, repr=False)
class Run:
    """The result of a run (docs/python.md).

    `trace` has one record per instant (dtype `state_dtype`), or is None.

    `duration_s` is what was asked for, `reached_s` the time of the last instant; they differ
    where the run was `interrupted`. `changes` and `first_faults` are filled where the run was
    hashed or traced.
    """

    system: System
    layout: StateLayout
    dtype: np.dtype[Any]
    seed: int
    engine: str
    final: Any
    trace: npt.NDArray[Any] | None
    instants: int
    duration_s: float
    wall_s: float
    trace_sha256: str | None
    extern_failures: dict[str, str] = field(default_factory=dict)
    """First failure of each extern that had one."""
    changes: list[ModeChange] = field(default_factory=list)
    first_faults: dict[int, FirstFault] = field(default_factory=dict)
    interrupted: bool = False
    lag_s_max: float | None = None
    """How late the latest instant was, where the run was paced against the clock."""
    externs: dict[str, str] = field(default_factory=dict)
    """What answered each extern, in words."""
    computed: list[str] = field(default_factory=list)
    """A note on each module whose `ttf` and `safer` were computed."""
    extern_tallies: dict[str, Tally] = field(default_factory=dict)
    """Steps of each extern that Python answered, and those in which it published nothing."""
    decided: list[tuple[int, int]] = field(default_factory=list)
    """By module: DM steps, and those in which ttf and safer held both (hashed or traced runs)."""

    def __repr__(self) -> str:
        count = f"{self.violations} violation{'' if self.violations == 1 else 's'}"
        stopped = f" of {self.duration_s:g} s, interrupted" if self.interrupted else ""
        time_s = self.reached_s if self.interrupted else self.duration_s
        return f"<soter.Run {self.system.name} seed {self.seed}: {time_s:g} s{stopped}, {count}>"

    @property
    def notes(self) -> list[str]:
        """What a person should know about this run, in words (`notes.py`)."""
        return notes_of(self)

    @property
    def params(self) -> dict[str, Value]:
        """Every parameter as it was set, by full name; durations in ns."""
        return dict(self.system.params)

    @property
    def reached_s(self) -> float:
        """Time of the last instant, s."""
        return max(int(self.final["header"]["ct"]), 0) / 1e9

    @property
    def violations(self) -> int:
        """Number of violations."""
        return int(self.final["header"]["violations"])

    @property
    def violation_list(self) -> list[Violation]:
        """Each violated property and latched component."""
        found = []
        for p in self.system.properties:
            row = self.final["properties"][p.index]
            if row["count"]:
                first_s = int(row["first_ns"]) / 1e9
                what = f"{p.kind} {p.text}"
                found.append(Violation(what, "property", first_s, int(row["count"]), p.span))
        for x in self.system.components:
            row = self.final["components"][x.index]
            if row["latched"]:
                kind = FaultKind(int(row["last_fault"])).name.lower()
                first = self.first_faults.get(x.index)
                found.append(
                    Violation(
                        f"{x.role} {x.name}: step fault `{kind}`",
                        "fault",
                        None if first is None else first.time_ns / 1e9,
                        1,
                        _declaration(x),
                    )
                )
        return found

    @property
    def modules(self) -> dict[str, ModuleSummary]:
        """Per module: share of time in AC and switches."""
        found = {}
        end = int(self.final["header"]["ct"])
        for m in self.system.modules:
            row = self.final["modules"][m.index]
            ac_ns = int(row["ac_ns"])
            if row["mode"]:
                ac_ns += end - int(row["mode_since"])
            share = ac_ns / end if end > 0 else 0.0
            found[m.name] = ModuleSummary(
                share, int(row["to_sc"]), int(row["to_ac"]), int(row["gate_faults"])
            )
        return found

    # Everything below needs a trace: SoterError U001 without one, or for an unknown name.

    def require_trace(self) -> npt.NDArray[Any]:
        """The trace; SoterError U001 where none was kept."""
        if self.trace is None:
            raise usage_error("U001", "this run kept no trace", "ask for it: simulate(trace=True)")
        return self.trace

    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the instants in s, (n,)."""
        return self.require_trace()["header"]["ct"] / 1e9

    def topic(self, name: str) -> npt.NDArray[Any]:
        """Values of a topic after every instant, (n,); records have fields.

        `<plant>.truth` is a plant's true state.
        """
        return views.values(self, name)[1]

    def truth(self, plant: str) -> npt.NDArray[Any]:
        """True state of a plant after every instant, (n,), a field for each state."""
        return self.topic(f"{plant}.truth")

    def mode(self, module: str) -> npt.NDArray[np.uint8]:
        """Mode of a module after every instant, (n,): 1 is AC, 0 is SC."""
        return views.mode(self, module)

    def array(self, path: str) -> npt.NDArray[np.float64]:
        """A topic, a truth or a part of one (`boat.truth.p`) as plain floats.

        (n,) for a number, (n, k) for records and arrays of k numbers, in declared order.
        """
        return views.array(self, path)


class NativeProgram:
    """A compiled system, ready to run any number of times.

    `core`: the lowered system where it differs from what the program says (`bindings.py`).
    """

    def __init__(
        self,
        system: System,
        optimise: str = "-O2",
        extra: tuple[str, ...] = (),
        core: CoreSystem | None = None,
    ) -> None:
        self.system = system
        self.unit: Unit = generate(system, core)
        self.layout = self.unit.layout
        self.dtype = state_dtype(system, self.layout)
        path = library(self.unit, optimise, extra)
        owners = linked_symbols(system, core)
        self.library = Library(path, self.unit.prefix, self.layout.size, owners)

    def __repr__(self) -> str:
        return f"<soter.NativeProgram {self.system.name}>"

    def run(
        self,
        until_ns: int,
        seed: int,
        bound: Mapping[str, object] | None = None,
        *,
        keep_trace: bool = False,
        hash_trace: bool = False,
        progress: Progress | None = None,
        stop: StopRequest | None = None,
        pacer: Pacer | None = None,
    ) -> Run:
        """Run from the start to `until_ns`, or until `stop` is wanted."""
        bound = bound or {}
        _reset_all(bound, seed)
        observer = None
        if keep_trace or hash_trace:
            observer = Observer(
                self.system, self.dtype, keep_trace=keep_trace, hash_trace=hash_trace
            )
        drive = _Drive(self, bound, seed, observer, stop or StopRequest())
        began = time.perf_counter()
        finished = drive.to(until_ns, progress, pacer)
        wall = time.perf_counter() - began
        last = drive.state
        if observer is not None and observer.last is not None:
            last = observer.last
        return Run(
            self.system,
            self.layout,
            self.dtype,
            seed,
            "native",
            last.view(self.dtype)[0],
            observer.trace() if observer else None,
            observer.instants if observer else 0,
            until_ns / 1e9,
            wall,
            observer.sha256 if observer else None,
            drive.answers.failures,
            observer.changes if observer else [],
            observer.first_faults if observer else {},
            interrupted=not finished,
            lag_s_max=pacer.lag_s_max if pacer else None,
            extern_tallies=drive.answers.tallies,
            decided=observer.decided if observer else [],
        )


class _Drive:
    """The virtual-time driver's Python half: one state, its trace buffer, its extern answers."""

    def __init__(
        self,
        program: NativeProgram,
        bound: Mapping[str, object],
        seed: int,
        observer: Observer | None,
        stop: StopRequest,
    ) -> None:
        self.library = program.library
        self.answers = ExternAnswers(program.system, program.layout, program.library, bound)
        self.state: Bytes = self.library.new_state(seed)
        self.observer = observer
        self.stop = stop
        self.filled = 0
        self.buffer: Bytes | None = None
        if observer is not None:
            room = max(CHUNK_BYTES // program.layout.size, 16)
            self.buffer = np.zeros((room, program.layout.size), dtype=np.uint8)

    def to(self, until_ns: int, progress: Progress | None, pacer: Pacer | None) -> bool:
        """Run; False where a stop was wanted before the end."""
        limit_ns = -1
        try:
            while True:
                ended = self._advance(limit_ns)
                if progress is not None:
                    progress(max(float(self.state.view(np.int64)[0]), 0.0) / max(until_ns, 1))
                if ended and limit_ns >= until_ns:
                    return True
                if self.stop.wanted:
                    return False
                if ended:
                    limit_ns = self._next_limit(limit_ns, until_ns, pacer)
        except Stop:
            return False
        finally:
            self._flush()

    def _next_limit(self, limit_ns: int, until_ns: int, pacer: Pacer | None) -> int:
        """How far to run before looking up again."""
        if pacer is not None:
            due_ns = min(self.library.next_instant(self.state), until_ns)
            pacer.wait(due_ns, self.stop)
            return due_ns
        return until_ns if self.buffer is not None else min(limit_ns + SLICE_NS, until_ns)

    def _advance(self, limit_ns: int) -> bool:
        """Run to `limit_ns`, a full trace, or an extern, which is answered; True at the limit."""
        part = self.buffer[self.filled :] if self.buffer is not None else None
        status, written, due = self.library.run(self.state, limit_ns, part)
        self.filled += written
        if status is RunStatus.EXTERN:
            self.answers.answer(self.state, due)
        elif self.filled:
            self._flush()
        return status is RunStatus.END

    def _flush(self) -> None:
        if self.observer is not None and self.buffer is not None:
            self.observer.see(self.buffer[: self.filled])
        self.filled = 0


def run_interpreted(
    system: System,
    until_ns: int,
    seed: int,
    bound: Mapping[str, object] | None = None,
    *,
    keep_trace: bool = False,
    progress: Progress | None = None,
    stop: StopRequest | None = None,
    pacer: Pacer | None = None,
) -> Run:
    """The same run in the reference interpreter."""
    layout = state_layout(system)
    dtype = state_dtype(system, layout)
    observer = Observer(system, dtype, keep_trace=keep_trace, hash_trace=True)
    request = stop or StopRequest()
    waiting: list[bytes] = []

    def flush() -> None:
        if waiting:
            rows = np.frombuffer(b"".join(waiting), dtype=np.uint8)
            observer.see(rows.reshape(-1, layout.size))
            waiting.clear()

    def observe(c: Configuration, record: Record) -> None:
        waiting.append(image(system, layout, c, record, seed))
        if len(waiting) == BATCH:
            flush()
        if progress is not None:
            progress(c.ct / max(until_ns, 1))
        if request.wanted:
            raise Stop
        if pacer is not None:
            pacer.wait(min(next_release(interpreter.machine, c.ct), until_ns), request)

    failures: dict[str, str] = {}
    tallies: dict[str, Tally] = {}
    noted = noting(system, bound or {}, failures, tallies)
    began = time.perf_counter()
    interpreter = Interpreter(system, seed, noted)
    finished = False
    try:
        with suppress(Stop):
            interpreter.run(until_ns, observe)
            finished = True
    except ExternResetError as error:
        raise _reset_failed(error) from error
    flush()
    wall = time.perf_counter() - began
    last = observer.last if observer.last is not None else np.zeros(layout.size, dtype=np.uint8)
    return Run(
        system,
        layout,
        dtype,
        seed,
        "interp",
        last.view(dtype)[0],
        observer.trace(),
        observer.instants,
        until_ns / 1e9,
        wall,
        observer.sha256,
        failures,
        observer.changes,
        observer.first_faults,
        interrupted=not finished,
        lag_s_max=pacer.lag_s_max if pacer else None,
        extern_tallies=tallies,
        decided=observer.decided,
    )


def _declaration(x: Component) -> Span:
    """Where the code of a component stands, not where a system makes use of it."""
    declared = x.node or x.plant
    return declared.span if declared is not None else x.span


def _reset_all(bound: Mapping[str, object], seed: int) -> None:
    try:
        for name, extern in bound.items():
            reset(name, extern, seed)
    except ExternResetError as error:
        raise _reset_failed(error) from error


def _reset_failed(error: ExternResetError) -> SoterError:
    why = described(error.__cause__ or error)
    message = f"extern `{error.name}` could not be reset: {why}"
    return SoterError((Diagnostic("X003", message),))


__all__ = ["NEVER", "ModuleSummary", "NativeProgram", "Run", "Violation", "run_interpreted"]
