"""Runs a system in virtual time, natively or in the interpreter, at full speed or paced.

Purpose: `NativeProgram.run` and `run_interpreted` run a system, and hash or keep its states. The
result has the final state and, if wanted, the state after every instant, as numpy records of the
documented layout. A run that is stopped early has a result up to there. `state_bytes` writes a
configuration of the interpreter as bytes of the generated program's state: both engines give one
trace. A `Pacer` delays each instant to its time on the clock, and notes the greatest lateness.
Non-goals: guarantees of time (the real-time runtime has priorities and a driver of its own);
printing, logs, many runs at once (campaigns), finding externs (`native/extern_bindings.py`).
"""

from __future__ import annotations

import os
import struct
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.core.layout import (
    COMPONENT,
    HEADER,
    MODULE,
    PROPERTY,
    encode_into,
    state_dtype,
    state_layout,
)
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.evaluate.arithmetic import require_default_float_rules
from soter.native.kept_state import library_copy, why_it_keeps_state
from soter.native.loaded_program import Library, RunStatus
from soter.native.shared_library import library
from soter.semantics.draws import splitmix64
from soter.semantics.externs import ExternResetError, Stop, reset_extern
from soter.semantics.faults import group_by_component, next_release
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_instant
from soter.simulate.externs.c_extern import linked_symbols
from soter.simulate.externs.python_answers import ExternAnswers, callables_with_notes, failure_text
from soter.simulate.externs.python_extern import end_forked_copy
from soter.simulate.interrupt import StopRequest
from soter.simulate.module_safe_check import CompiledSafe, JudgedUnit
from soter.simulate.result import Run
from soter.simulate.run_observer import Observer, keeps_anything, make_observer, named_parts

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.core.layout import Bytes, StateLayout
    from soter.language.model.system import Component, System
    from soter.semantics.configuration import Configuration
    from soter.semantics.run_record import Record
    from soter.simulate.externs.python_answers import Tally
    from soter.simulate.module_safe_check import SafeJudge
    from soter.simulate.run_observer import Also, Kept

    Progress = Callable[[float], None]


NAP_S = 0.01
"""The longest single sleep in s, so that Ctrl-C is answered at once."""


class Pacer:
    """Waits on the wall clock for virtual times; the clock starts with the first wait."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self.lag_s_max = 0.0

    def wait(self, time_ns: int, stop: StopRequest) -> None:
        """Sleeps until the virtual time `time_ns`, or until `stop` asks to stop."""
        now_s = time.perf_counter()
        if self._began_s is None:
            self._began_s = now_s - time_ns / 1e9
        due_s = self._began_s + time_ns / 1e9
        self.lag_s_max = max(self.lag_s_max, now_s - due_s)
        while now_s < due_s and not stop.wanted:
            time.sleep(min(due_s - now_s, NAP_S))
            now_s = time.perf_counter()


MASK = 2**64 - 1


def state_bytes(
    system: System, layout: StateLayout, c: Configuration, record: Record, seed: int
) -> bytes:
    """The bytes of the state struct for a configuration at the end of an instant."""
    out = bytearray(layout.size)
    HEADER.pack_into(
        out,
        0,
        ct=c.ct,
        seed=seed & MASK,
        seed_key=splitmix64((seed + 0x9E3779B97F4A7C15) & MASK),
        violations=record.violations,
    )
    at = layout.component_offset
    late = group_by_component(system, changes_releases=True)
    for component in system.components:
        counts = record.components[component.index]
        COMPONENT.pack_into(
            out,
            at,
            next=_next_release(component, c.ct)
            if component.index not in late
            else next_release(system, late[component.index], component, seed, c.ct),
            faults=counts.faults,
            last_fault=counts.last_fault,
            oe=c.OE[component.index],
            latched=c.latched[component.index],
            had_control=c.had_control[component.index],
            pending=False,
        )
        at += COMPONENT.size
    for module in system.modules:
        module_record = record.modules[module.index]
        MODULE.pack_into(
            out,
            at,
            ac_ns=module_record.ac_ns,
            mode_since=module_record.mode_since_ns,
            to_sc=module_record.switches_to_sc,
            to_ac=module_record.switches_to_ac,
            gate_faults=module_record.gate_faults,
            clean_needed=c.clean_needed[module.index],
            mode=module_record.mode,
            gate_fault=c.gate_fault[module.index],
            ttf=module_record.ttf,
            safer=module_record.safer,
            stale=module_record.stale,
            saw_gate_fault=module_record.gate_fault,
            nan_looks=module_record.nan_looks,
        )
        at += MODULE.size
    for prop in record.properties:
        PROPERTY.pack_into(out, at, first_ns=prop.first_ns, count=prop.count, active=prop.active)
        at += PROPERTY.size
    struct.pack_into(f"<{layout.topics}q", out, layout.stamp_offset, *c.stamps)
    for group in layout.groups:
        values = c.Topics if group.owner < 0 else c.L[group.owner]
        for member in group.struct.members:
            encode_into(out, group.offset + member.offset, member.type, values[member.index])
    return bytes(out)


def _next_release(x: Component, ct: int) -> int:
    """The first release of a component after `ct`, in ns."""
    if ct < x.phase_ns:
        return x.phase_ns
    return x.phase_ns + ((ct - x.phase_ns) // x.period_ns + 1) * x.period_ns


CHUNK_BYTES = 4 * 1024 * 1024
BLOCK = 1024
"""With externs, the most states that wait before the observer, and so the log, gets them."""
SLICE_NS = 1_000_000_000
"""Without a trace, how much virtual time passes, in ns, between two checks for Ctrl-C."""
LARGE_C = 800_000
"""From this many characters on, C is compiled with less optimisation: for a thousand nodes in 2 s
instead of 5. The program then takes 1.4 times as long, and computes the same bits."""
BATCH = 64
"""How many states of the interpreter the observer gets at a time."""


class LoadedProgram(NamedTuple):
    """A loaded compiled system, and the object that evaluates `safe` of its modules."""

    library: Library
    judge: SafeJudge


class NativeProgram:
    """A compiled system, ready to run any number of times.

    `optimise`: the compiler's flag, by default chosen by the size of the C. `core`: the lowered
    system, if it differs from the program (`native/extern_bindings.py`).
    """

    def __init__(
        self,
        system: System,
        optimise: str | None = None,
        extra: tuple[str, ...] = (),
        core: CoreSystem | None = None,
    ) -> None:
        self.system = system
        builder = JudgedUnit(system, core or lower(system))
        self.unit: Unit = builder.build_unit()
        self.layout = self.unit.layout
        self.dtype = state_dtype(self.layout)
        level = "-O2" if len(self.unit.source) < LARGE_C else "-Og"
        path = library(self.unit, optimise or level, extra)
        self._builder, self._path = builder, path
        self._owners = linked_symbols(system, core)
        self._shared = self._load_library(path)
        self._keeps = bool(why_it_keeps_state(self.unit))

    def load(self) -> LoadedProgram:
        """The loaded program, as a fresh copy if its C may keep state between calls."""
        if not self._keeps:
            return self._shared
        with library_copy(self._path) as path:
            return self._load_library(path)

    def _load_library(self, path: Path) -> LoadedProgram:
        found = Library(path, self.unit.prefix, self.layout.size, self._owners)
        return LoadedProgram(found, CompiledSafe(found, path, self._builder))

    def __repr__(self) -> str:
        return f"<soter.NativeProgram {self.system.name}>"

    def run(
        self,
        until_ns: int,
        seed: int,
        bound: Mapping[str, object] | None = None,
        *,
        keep_trace: Kept = False,
        hash_trace: bool = False,
        observed: bool = False,
        progress: Progress | None = None,
        stop: StopRequest | None = None,
        pacer: Pacer | None = None,
        also: Also | None = None,
    ) -> Run:
        """Runs from the start to `until_ns`, or until `stop` asks to stop.

        Instants, changes of mode and first faults are counted if the run is hashed, traced or
        `observed`. `also` gets the observed states block by block: records (n,) and the changes of
        mode in them. Raises `SoterError` U001 if `keep_trace` names no part of the system.
        """
        require_default_float_rules()
        bound = bound or {}
        _reset_all(bound, seed)
        observer, loaded = None, self.load()
        if keeps_anything(keep_trace) or hash_trace or observed:
            observer = make_observer(
                self.system,
                self.layout,
                keep_trace,
                hash_trace=hash_trace,
                also=also,
                judge=loaded.judge,
            )
        drive = _Drive(self, loaded.library, bound, seed, observer, stop or StopRequest())
        began = time.perf_counter()
        finished = drive.run_to(until_ns, progress, pacer)
        wall = time.perf_counter() - began
        last, seen = drive.state, dict[str, Any](trace=None, instants=0, trace_sha256=None)
        if observer is not None:
            last = last if observer.last is None else observer.last
            seen = observer.run_fields()
        return Run(
            system=self.system,
            layout=self.layout,
            dtype=self.dtype,
            seed=seed,
            engine="native",
            final=last.view(self.dtype)[0],
            recorded=named_parts(keep_trace),
            duration_s=until_ns / 1e9,
            wall_s=wall,
            extern_failures=drive.answers.failures,
            interrupted=not finished,
            lag_s_max=pacer.lag_s_max if pacer else None,
            extern_tallies=drive.answers.tallies,
            **seen,
        )


class _Drive:
    """The Python half of the virtual-time driver: a state, a trace buffer, answers of externs."""

    def __init__(
        self,
        program: NativeProgram,
        library: Library,
        bound: Mapping[str, object],
        seed: int,
        observer: Observer | None,
        stop: StopRequest,
    ) -> None:
        self.library = library
        self.answers = ExternAnswers(program.system, program.layout, library, bound)
        self.state: Bytes = self.library.new_state(seed)
        self.observer = observer
        self.stop = stop
        self.process = os.getpid()
        self.filled = 0
        self.buffer: Bytes | None = None
        if observer is not None:
            room = max(CHUNK_BYTES // program.layout.size, 16)
            self.buffer = np.zeros((room, program.layout.size), dtype=np.uint8)

    def run_to(self, until_ns: int, progress: Progress | None, pacer: Pacer | None) -> bool:
        """Runs to `until_ns`; returns False if a stop was requested before."""
        limit_ns = -1
        try:
            while True:
                ended = self._run_part(limit_ns)
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
            self._show_filled()

    def _next_limit(self, limit_ns: int, until_ns: int, pacer: Pacer | None) -> int:
        """The virtual time at which the run next checks Ctrl-C, progress and clock."""
        if pacer is not None:
            due_ns = min(self.library.next_instant_ns(self.state), until_ns)
            pacer.wait(due_ns, self.stop)
            return due_ns
        return until_ns if self.buffer is not None else min(limit_ns + SLICE_NS, until_ns)

    def _run_part(self, limit_ns: int) -> bool:
        """Runs to `limit_ns`, a full buffer or an extern, which it answers; True at the limit."""
        part = self.buffer[self.filled :] if self.buffer is not None else None
        status, written, due = self.library.run_until(self.state, limit_ns, part)
        _check_process(self.process)
        self.filled += written
        if status is RunStatus.EXTERN:
            self.answers.answer_step(self.state, due)
            if self.filled >= BLOCK:
                self._show_filled()
        elif self.filled:
            self._show_filled()
        return status is RunStatus.END

    def _show_filled(self) -> None:
        if self.observer is not None and self.buffer is not None:
            self.observer.observe_states(self.buffer[: self.filled])
        self.filled = 0


def run_interpreted(
    system: System,
    until_ns: int,
    seed: int,
    bound: Mapping[str, object] | None = None,
    *,
    keep_trace: Kept = False,
    hash_trace: bool = True,
    progress: Progress | None = None,
    stop: StopRequest | None = None,
    pacer: Pacer | None = None,
    also: Also | None = None,
) -> Run:
    """Runs in the reference interpreter; raises `SoterError` X003 if an extern's `reset` raises.

    `also` gets the observed states block by block: records (n,) and the changes of mode in them.
    """
    layout = state_layout(system)
    dtype = state_dtype(layout)
    observer = make_observer(system, layout, keep_trace, hash_trace=hash_trace, also=also)
    request, process = stop or StopRequest(), os.getpid()
    waiting: list[bytes] = []

    def show_waiting() -> None:
        if waiting:
            rows = np.frombuffer(b"".join(waiting), np.uint8).reshape(-1, layout.size)
            observer.observe_states(rows)
            waiting.clear()

    def observe(c: Configuration, record: Record) -> None:
        _check_process(process)
        waiting.append(state_bytes(system, layout, c, record, seed))
        if len(waiting) == BATCH:
            show_waiting()
        if progress is not None:
            progress(c.ct / max(until_ns, 1))
        if request.wanted:
            raise Stop
        if pacer is not None:
            pacer.wait(min(next_instant(interpreter.machine, c), until_ns), request)

    failures: dict[str, str] = {}
    tallies: dict[str, Tally] = {}
    began = time.perf_counter()
    noting = callables_with_notes(system, bound or {}, failures, tallies)
    interpreter = Interpreter(system, seed, noting)
    finished = _interpret(interpreter, until_ns, observe)
    show_waiting()
    last = observer.last if observer.last is not None else np.zeros(layout.size, dtype=np.uint8)
    return Run(
        system=system,
        layout=layout,
        dtype=dtype,
        seed=seed,
        engine="interp",
        wall_s=time.perf_counter() - began,
        final=last.view(dtype)[0],
        recorded=named_parts(keep_trace),
        duration_s=until_ns / 1e9,
        extern_failures=failures,
        interrupted=not finished,
        lag_s_max=pacer.lag_s_max if pacer else None,
        extern_tallies=tallies,
        **observer.run_fields(),
    )


def _interpret(
    interpreter: Interpreter, until_ns: int, observe: Callable[[Configuration, Record], None]
) -> bool:
    """Runs the interpreter to `until_ns`; returns False if a stop was requested before."""
    require_default_float_rules()
    try:
        interpreter.run(until_ns, observe)
    except Stop:
        return False
    except ExternResetError as error:
        raise _reset_error(error) from error
    return True


def _check_process(process: int) -> None:
    """Ends a process that an extern forked; raises `SoterError` X012 for changed float settings."""
    end_forked_copy(process)
    require_default_float_rules()


def _reset_all(bound: Mapping[str, object], seed: int) -> None:
    try:
        for name, extern in bound.items():
            reset_extern(name, extern, seed)
    except ExternResetError as error:
        raise _reset_error(error) from error


def _reset_error(error: ExternResetError) -> SoterError:
    why = failure_text(error.__cause__ or error)
    message = f"extern `{error.name}` could not be reset: {why}"
    return mistake("X003", message)
