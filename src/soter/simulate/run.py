"""One virtual-time run of a system, on either engine.

Purpose: `simulate` runs, hashes and keeps what is asked for; the result is the final state plus,
if wanted, the state after every instant, both as numpy records of the documented layout.
Non-goals: printing, logs, many runs at once (campaigns).
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import Unit, generate
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.lower.layout import NEVER, StateLayout, state_dtype
from soter.native.build import library
from soter.native.library import Library, RunStatus
from soter.semantics.externs import reset
from soter.semantics.interpreter import Interpreter
from soter.simulate.externs import ExternAnswers
from soter.simulate.image import image

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from soter.program.system import System

    Progress = Callable[[float], None]

CHUNK_BYTES = 4 * 1024 * 1024


@dataclass(frozen=True)
class Violation:
    """Something that counts: an onset of a violated property, or a latched component.

    `time_s` is the first onset; `count` how many onsets there were.
    """

    what: str
    kind: str
    time_s: float | None
    count: int


@dataclass(frozen=True)
class ModuleSummary:
    """What one module did. `ac_share` is the share of time in mode AC."""

    ac_share: float
    switches_to_sc: int
    switches_to_ac: int
    gate_faults: int


@dataclass(eq=False)
class Run:
    """The result of a run. `trace` has one record per instant (dtype `state_dtype`), or is None."""

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
                found.append(
                    Violation(
                        f"{p.kind} {p.text}",
                        "property",
                        int(row["first_ns"]) / 1e9,
                        int(row["count"]),
                    )
                )
        for x in self.system.components:
            row = self.final["components"][x.index]
            if row["latched"]:
                from soter.program.arith import FaultKind  # noqa: PLC0415 - only when it happened

                kind = FaultKind(int(row["last_fault"])).name.lower()
                found.append(Violation(f"{x.role} {x.name}: step fault `{kind}`", "fault", None, 1))
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

    def topic(self, name: str) -> npt.NDArray[Any]:
        """Values of a topic after every instant (needs a trace)."""
        assert self.trace is not None, "run with keep_trace=True"
        return self.trace["topics"][name]

    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the instants in s (needs a trace)."""
        assert self.trace is not None, "run with keep_trace=True"
        return self.trace["header"]["ct"] / 1e9


def unbound_externs(system: System, bound: dict[str, object]) -> list[str]:
    """Extern components that neither Python nor linked C answers."""
    return [
        x.name
        for x in system.components
        if x.extern
        and x.name not in bound
        and not (x.node is not None and x.binding and x.binding.startswith("c:"))
    ]


class NativeProgram:
    """A compiled system, ready to run any number of times."""

    def __init__(self, system: System, optimise: str = "-O2", extra: tuple[str, ...] = ()) -> None:
        self.system = system
        self.unit: Unit = generate(system)
        self.layout = self.unit.layout
        self.dtype = state_dtype(system, self.layout)
        path = library(self.unit, optimise, extra)
        self.library = Library(path, self.unit.prefix, self.layout.size)

    def run(
        self,
        until_ns: int,
        seed: int,
        bound: dict[str, object] | None = None,
        *,
        keep_trace: bool = False,
        hash_trace: bool = False,
        progress: Progress | None = None,
    ) -> Run:
        """Run from the start to `until_ns`."""
        bound = bound or {}
        for extern in bound.values():
            reset(extern, seed)
        answers = ExternAnswers(self.system, self.layout, self.library, bound)
        size = self.layout.size
        digest = hashlib.sha256() if hash_trace else None
        room = max(CHUNK_BYTES // size, 16) if keep_trace or hash_trace else 0
        began = time.perf_counter()
        state = self.library.new_state(seed)
        kept: list[npt.NDArray[np.uint8]] = []
        instants = 0
        buffer = np.zeros((room, size), dtype=np.uint8) if room else None
        filled = 0
        while True:
            part = buffer[filled:] if buffer is not None else None
            status, written, due = self.library.run(state, until_ns, part)
            filled += written
            if status is RunStatus.EXTERN:
                answers.answer(state, due)
                continue
            if buffer is not None:
                instants += filled
                if digest is not None:
                    digest.update(buffer[:filled].data)
                if keep_trace:
                    kept.append(buffer[:filled].copy())
                filled = 0
            if progress is not None:
                progress(float(state.view(np.int64)[0]) / max(until_ns, 1))
            if status is RunStatus.END:
                break
        wall = time.perf_counter() - began
        trace = None
        if keep_trace:
            rows = np.concatenate(kept) if kept else np.zeros((0, size), dtype=np.uint8)
            trace = np.ascontiguousarray(rows).view(self.dtype).reshape(-1)
        return Run(
            self.system,
            self.layout,
            self.dtype,
            seed,
            "native",
            state.view(self.dtype)[0],
            trace,
            instants,
            until_ns / 1e9,
            wall,
            digest.hexdigest() if digest is not None else None,
            answers.failures,
        )


def run_interpreted(
    system: System,
    until_ns: int,
    seed: int,
    bound: dict[str, object] | None = None,
    *,
    keep_trace: bool = False,
    progress: Progress | None = None,
) -> Run:
    """The same run in the reference interpreter."""
    from soter.lower.layout import state_layout  # noqa: PLC0415 - keeps the import list short

    layout = state_layout(system)
    dtype = state_dtype(system, layout)
    digest = hashlib.sha256()
    kept: list[bytes] = []
    last = [b""]
    count = [0]

    def observe(c: Any, record: Any) -> None:  # noqa: ANN401 - the interpreter's own types
        data = image(system, layout, c, record, seed)
        digest.update(data)
        last[0] = data
        count[0] += 1
        if keep_trace:
            kept.append(data)
        if progress is not None and count[0] % 256 == 0:
            progress(c.ct / max(until_ns, 1))

    began = time.perf_counter()
    interpreter = Interpreter(system, seed, bound or {})
    interpreter.run(until_ns, observe)
    wall = time.perf_counter() - began
    trace = None
    if keep_trace:
        trace = np.frombuffer(b"".join(kept), dtype=np.uint8).view(dtype).reshape(-1)
    final = np.frombuffer(last[0] or bytes(layout.size), dtype=np.uint8).view(dtype)[0]
    return Run(
        system,
        layout,
        dtype,
        seed,
        "interp",
        final,
        trace,
        count[0],
        until_ns / 1e9,
        wall,
        digest.hexdigest(),
        {},
    )


def require_bound(system: System, bound: dict[str, object]) -> None:
    """X001 for every extern that nothing is bound to."""
    missing = unbound_externs(system, bound)
    if not missing:
        return
    raise SoterError(
        tuple(
            Diagnostic(
                "X001",
                f"extern `{name}` is not bound to anything",
                helps=(
                    f"bind it: --bind {name.rpartition('.')[2]}=python:file.py:function",
                    'or write `from "python:file.py:function"` in the program',
                ),
            )
            for name in missing
        )
    )


__all__ = [
    "NEVER",
    "ModuleSummary",
    "NativeProgram",
    "Run",
    "Violation",
    "require_bound",
    "run_interpreted",
    "unbound_externs",
]
