"""The adversary's closed loop from Python.

Purpose: compile `adversary_loop.c` once, mirror its structures, run.
Non-goals: which policies (`policy_search.py`), which modules (`random_modules.py`).
"""

from __future__ import annotations

import ctypes as ct
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.native.cache import cached, digest
from soter.native.compiler import STRICT, compile_with, find
from soter.native.shared_library import texts

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int32]

SLIPS = {
    "silence is not judged": 1,
    "a command acts before it is judged": 2,
    "what was held before is not in V": 3,
    "what is held is judged, not what AC would publish": 4,
    "a command counts from when it was published, not until it was replaced": 5,
    "one of two groups is judged": 6,
    "memory behind the gate: commands act later than is declared": 7,
    "commands are judged on the estimate of the DM's last look": 8,
    "what a command is moved to is not judged": 9,
    "SC's command is judged, not what AC's is moved to": 10,
    "what AC proposed is remembered, not what it was moved to": 11,
}
"""Wrong shields that the loop can have (`adversary_gate.h`)."""
SOURCE = Path(__file__).with_name("adversary_loop.c")
LOOP = "loop.so"
N, U, TERMS, LAWS, NODES, GROUPS, AXES = 4, 2, 2, 2, 4, 2, 3
POLICY = (
    *("gkind", "gindex", "flip", "wind", "ac", "err_ac", "err_sc"),
    *("late_dm", "response_dm", "late_sc", "response_sc", "acts", "late_node", "response_node"),
    *("seen", "pattern", "drop", "near", "gswitch", "side", "tries", "oldest"),
)
EVENTS = {1: "sensor silent", 2: "DM reads, verdict", 3: "AC in control", 4: "SC reads, age"}
EVENTS |= {5: "command 0 acts", 6: "command 1 acts"}
ROOM = 200_000


def _ints(*names: str) -> list[tuple[str, Any]]:
    return [(n, ct.c_int32) for n in names]


class Loop(ct.Structure):
    """`loop` of adversary_loop.c."""

    _fields_ = (
        *_ints("n", "m", "linear", "is_map", "substeps", "terms", "laws", "pred_tables", "groups"),
        ("faces", ct.c_int32 * 2),
        *_ints("dm_period", "dm_phase", "sc_period", "sc_phase", "sensor_period", "sensor_phase"),
        *_ints("j_dm", "r_dm", "j_sc", "r_sc"),
        ("acts", ct.c_int32 * U),
        ("acts_least", ct.c_int32 * U),
        *_ints("max_age", "dropout", "nodes"),
        *((n, ct.c_int32 * NODES) for n in ("node_period", "node_phase", "node_j", "node_r")),
        *_ints("drivers", "in_step"),
        *((n, ct.c_int32 * NODES) for n in ("driver_period", "driver_phase")),
        *((n, ct.c_int32 * NODES) for n in ("driver_j", "driver_r")),
        *_ints("rows", "grads"),
        *((n, ct.c_int32 * TERMS) for n in ("term_kind", "term_of", "term_to")),
        ("axes", ct.c_int32 * GROUPS),
        ("axis", ct.c_int32 * (GROUPS * AXES)),
        ("cells", ct.c_int32 * (GROUPS * AXES)),
        *_ints("shield", "slip", "acted"),
        ("moving", ct.c_int32 * GROUPS),
        ("moved", ct.c_int32 * (GROUPS * U)),
        *_ints("toward"),
        ("h", ct.c_double),
        ("phi", ct.c_double * (N * N)),
        ("gam_u", ct.c_double * (N * U)),
        ("gam_w", ct.c_double * (N * N)),
        ("a", ct.c_double * (N * N)),
        ("b", ct.c_double * (N * U)),
        ("term_k", ct.c_double * TERMS),
        *((n, ct.c_double * U) for n in ("u_low", "u_high", "u_first")),
        *((n, ct.c_double * N) for n in ("wind", "error", "low", "high")),
        ("gain", ct.c_double * (LAWS * U * N)),
        ("bias", ct.c_double * U),
        ("force", ct.c_double * U),
        ("edges", ct.c_void_p * (GROUPS * AXES)),
        ("level", ct.c_void_p * GROUPS),
        ("tops", ct.c_void_p * GROUPS),
        ("lasting", ct.c_void_p * GROUPS),
        ("face", ct.c_void_p * 2),
        ("row", ct.c_void_p),
        ("grad", ct.c_void_p),
    )


class _Outcome(ct.Structure):
    _fields_ = (
        ("worst", ct.c_double),
        ("worst_sc", ct.c_double),
        ("x", ct.c_double * N),
        ("steps", ct.c_int64),
        ("at", ct.c_int64),
        ("switches", ct.c_int64),
        ("left", ct.c_int32),
        ("forgot", ct.c_int32),
    )


class _Event(ct.Structure):
    _fields_ = (("t", ct.c_int64), ("what", ct.c_int32), ("value", ct.c_double))


@dataclass(frozen=True)
class Outcome:
    """What one run showed; `worst` is the largest |x| relative to C's border, 1 being on it."""

    left: bool
    worst: float
    worst_sc: float
    steps: int
    at: int
    """The tick at which it was seen outside."""
    x: tuple[float, ...]
    switches: int
    forgot: bool
    """Whether a command acted, below a shield, that was in no V."""
    log: list[tuple[int, str, float]] = field(default_factory=list)


@lru_cache(maxsize=1)
def library() -> ct.CDLL:
    """The compiled loop, kept by content."""
    compiler = find()
    flags = (*STRICT, "-O2", "-fPIC", "-shared")
    content = digest((compiler.identity, *flags, *texts(SOURCE)))

    def make(work: Path) -> None:
        command = [*compiler.command, *flags, str(SOURCE), "-o", str(work / LOOP), "-lm"]
        compile_with(command, work, "the adversary's loop does not compile")

    target = cached("adversary", content, (LOOP,), make) / LOOP
    lib = ct.CDLL(str(target))
    lib.adversary_level.restype = lib.adversary_permitted.restype = ct.c_int
    return lib


class Machine:
    """A filled-in `Loop` with the arrays that it points to."""

    def __init__(self) -> None:
        self.c = Loop()
        self._kept: list[Any] = []

    def pointer(self, values: Any, dtype: str = "f8") -> int:  # noqa: ANN401 - array-like
        """The address of a copy that lives as long as this."""
        array = np.ascontiguousarray(values, dtype=dtype)
        self._kept.append(array)
        return int(array.ctypes.data)

    def fill(self, name: str, values: Any, width: int = 1) -> None:  # noqa: ANN401 - array-like
        """A matrix or vector into the corner of a field whose rows are `width` wide."""
        target = getattr(self.c, name)
        rows = np.atleast_1d(np.asarray(values))
        if rows.ndim == 1:
            for i, v in enumerate(rows.tolist()):
                target[i] = v
            return
        for i, row in enumerate(rows.tolist()):
            for k, v in enumerate(row):
                target[i * width + k] = v

    def level(self, y: Array) -> int:
        """0: ttf, 1: AC may keep control, 2: it may have it back; without what a shield permits."""
        full = np.zeros(N)
        full[: len(y)] = y
        return int(library().adversary_level(ct.byref(self.c), ct.c_void_p(full.ctypes.data)))

    def permitted(self, y: Array, u: Array) -> bool:
        """Whether the shield permits a command that acts since long."""
        full, command = np.zeros(N), np.zeros(U)
        full[: len(y)], command[: len(u)] = y, u
        places = (ct.c_void_p(a.ctypes.data) for a in (full, command))
        return bool(library().adversary_permitted(ct.byref(self.c), *places))

    def run(
        self,
        policy: Ints,
        seed: int,
        ticks: int,
        x0: Array,
        *,
        t0: int = 0,
        shown: Array | None = None,
        held: Array | None = None,
        log: bool = False,
    ) -> Outcome:
        """One run; `shown`: what the sensor publishes at `t0` while AC has control.

        `held`: the command that acts then, where the module has a shield.
        """
        x = np.zeros(N)
        y = np.zeros(N)
        command = np.zeros(U)
        x[: len(x0)] = x0
        if held is not None:
            command[: len(held)] = held
        if shown is not None:
            y[: len(shown)] = shown
        out = _Outcome()
        room = ct.c_int32(ROOM)
        events = (_Event * ROOM)() if log else None
        policy = np.ascontiguousarray(policy, dtype=np.int32)
        library().adversary_run(
            ct.byref(self.c),
            ct.c_void_p(policy.ctypes.data),
            ct.c_uint64(seed),
            ct.c_int64(t0),
            ct.c_int64(ticks),
            ct.c_void_p(x.ctypes.data),
            ct.c_int(shown is not None),
            ct.c_void_p(y.ctypes.data),
            ct.c_void_p(command.ctypes.data),
            ct.byref(out),
            events,
            ct.byref(room),
        )
        told = []
        if events is not None:
            told = [(e.t, EVENTS[e.what], e.value) for e in events[: room.value]]
        return Outcome(
            bool(out.left),
            out.worst,
            out.worst_sc,
            out.steps,
            out.at,
            tuple(out.x[: self.c.n]),
            out.switches,
            bool(out.forgot),
            told,
        )
