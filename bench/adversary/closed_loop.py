"""The adversary's closed loop from Python, and the search for a run of it that leaves C.

Purpose: compile `adversary_loop.c` once, mirror its structures, run; `attack`: policies of the
adversary, and better ones from good ones.
Non-goals: which modules (`random_modules.py`), why one is proved.
"""

from __future__ import annotations

import ctypes as ct
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.native.cache import cached_folder, digest
from soter.native.compiler import STRICT, compile_with, find_compiler
from soter.native.shared_library import c_texts

if TYPE_CHECKING:
    import numpy.typing as npt
    from bench.adversary.random_modules import Module

    Array = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int32]
    Rng = np.random.Generator

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
    compiler = find_compiler()
    flags = (*STRICT, "-O2", "-fPIC", "-shared")
    content = digest((compiler.identity, *flags, *c_texts(SOURCE)))

    def make(work: Path) -> None:
        command = [*compiler.command, *flags, str(SOURCE), "-o", str(work / LOOP), "-lm"]
        compile_with(command, work, "the adversary's loop does not compile")

    target = cached_folder("adversary", content, (LOOP,), make) / LOOP
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


ELITE = 10
LATENESS = (0, 1, 1, 2, 3, 4, 5, 5, 5, 6, 7)
CHOICES: dict[str, tuple[int, ...]] = {
    "gkind": (0, 0, 0, 1, 1, 2, 3),
    "gindex": tuple(range(12)),
    "wind": (0, 0, 0, 0, 1, 2, 3),
    "ac": (0, 0, 0, 1, 2, 3, 4),
    "err_ac": (0, 1, 1, 2, 3, 4, 5, 6),
    "err_sc": (0, 1, 2, 3, 3, 3, 4, 5, 6),
    "seen": (0, 0, 1, 2),
    "drop": (0, 1, 1, 2, 5, 6),
    "near": tuple(range(4, 17)),
    "side": (0, 1),
    "tries": (0, 1, 1, 1, 2, 2, 3, 3, 4, 5, 5, 5, 6),
    "oldest": (0, 1, 2),
    **{
        name: LATENESS for name in POLICY if name.startswith(("late", "response")) or name == "acts"
    },
}


@dataclass(frozen=True, eq=False)
class Run:
    """All that is needed to have a run again, as its `repr` is."""

    policy: Ints
    seed: int
    ticks: int
    x0: tuple[float, ...]
    t0: int = 0
    shown: tuple[float, ...] | None = None
    """Where AC starts in control: what the sensor publishes at `t0`."""
    held: tuple[float, ...] | None = None
    """And the command that acts then, of a module with a shield."""

    def again(self, machine: Machine, *, log: bool = False) -> Outcome:
        """Run it."""
        shown = None if self.shown is None else np.array(self.shown)
        held = None if self.held is None else np.array(self.held)
        told = (self.policy, self.seed, self.ticks, np.array(self.x0))
        return machine.run(*told, t0=self.t0, shown=shown, held=held, log=log)


@dataclass
class Attack:
    """What was tried on one module."""

    runs: int = 0
    steps: int = 0
    switches: int = 0
    closest: float = 0.0
    """The largest |x| relative to the border of C; above 1 it is outside."""
    closest_sc: float = 0.0
    """The same while SC was in control."""
    violations: int = 0
    """Runs that left C, or in which a command acted that was in no V of a shield."""
    found: Run | None = None
    declared: bool = True
    """Whether `found` starts where the program does, SC in control."""
    outcome: Outcome | None = None
    best: list[tuple[float, Run]] = field(default_factory=list)


def attack(
    machine: Machine,
    module: Module,
    steps: int,
    seed: int,
    *,
    runs: int = 0,
    stop: bool = True,
    border: bool = True,
) -> Attack:
    """At least so many steps and runs, unless a violation is found first (`stop`).

    `border`: also from where AC is in control at the border of `not ttf`, which is claimed as well.
    """
    rng = np.random.default_rng([77, seed])
    told = Attack()
    while told.steps < steps or told.runs < runs:
        run = _next(machine, module, told, rng, border=border)
        seen = run.again(machine)
        told.runs += 1
        told.steps += seen.steps
        told.switches += seen.switches
        told.closest = max(told.closest, seen.worst)
        told.closest_sc = max(told.closest_sc, seen.worst_sc)
        told.best.append((seen.worst_sc, run))
        told.best = sorted(told.best, key=lambda b: -b[0])[:ELITE]
        if seen.left or seen.forgot:
            told.violations += 1
            better = told.found is None or (run.shown is None and not told.declared)
            if better:
                told.found, told.outcome, told.declared = run, seen, run.shown is None
            if stop:
                break
    return told


def _next(machine: Machine, module: Module, told: Attack, rng: Rng, *, border: bool) -> Run:
    if told.best and rng.random() < 0.5:
        _, parent = told.best[int(rng.integers(0, len(told.best)))]
        policy = _changed(parent.policy, module, rng)
        if rng.random() < 0.6:  # the same start
            return replace(parent, policy=policy, seed=int(rng.integers(2**62)))
    else:
        policy = _policy(module, rng)
    return _started(machine, module, policy, rng, border=border)


def _policy(module: Module, rng: Rng) -> Ints:
    return np.array([_one(name, module, rng) for name in POLICY], dtype=np.int32)


def _one(name: str, module: Module, rng: Rng) -> int:
    if name in CHOICES:
        options = CHOICES[name]
        return options[int(rng.integers(0, len(options)))]
    if name == "pattern":
        return int(rng.integers(2, 12))
    # how long, in ticks, until the direction flips or is chosen otherwise; mostly never
    if rng.random() < 0.6:
        return 0
    long = 40 * module.times.dm if name == "gswitch" else 20 * module.times.sc
    return int(rng.integers(2, max(3, long)))


def _changed(policy: Ints, module: Module, rng: Rng) -> Ints:
    new_policy: Ints = policy.copy()
    for _ in range(int(rng.integers(1, 4))):
        k = int(rng.integers(0, len(POLICY)))
        new_policy[k] = _one(POLICY[k], module, rng)
    return new_policy


def _started(machine: Machine, module: Module, policy: Ints, rng: Rng, *, border: bool) -> Run:
    seed = int(rng.integers(2**62))
    seconds = float(rng.choice([1.0, 4.0, 12.0, 30.0]))
    ticks = int(seconds / (module.tick_us * 1e-6)) if not module.is_map else int(40 * seconds)
    ticks = max(ticks, 8 * module.times.dm)
    if border and not module.nodes and rng.random() < 0.5:
        there = _border(machine, module, rng)
        if there is not None:
            shown, x0, held = there
            t0 = int(rng.integers(0, 1000)) * module.times.sensor
            return Run(policy, seed, ticks, x0, t0, shown, held)
    half = np.array(module.starts)
    side = rng.choice([-1.0, 1.0], size=module.n)
    share = np.ones(module.n) if rng.random() < 0.5 else rng.random(module.n)
    return Run(policy, seed, ticks, tuple(float(v) for v in half * side * share))


def _border(
    machine: Machine, module: Module, rng: Rng
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...] | None] | None:
    """An estimate just inside `not ttf`, and a state in C that it may be the estimate of.

    And the command that is held, below a shield: one that is permitted there.
    """
    held = None
    if module.shield:
        held = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], size=module.m) * np.array(module.control)

    def inside(y: Array) -> bool:
        return machine.level(y) > 0 if held is None else machine.permitted(y, held)

    way = rng.normal(size=module.n) * np.array(module.box)
    way /= np.max(np.abs(way) / np.array(module.box))
    low, high = 0.0, 1.0
    if not inside(low * way):
        return None
    for _ in range(30):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if inside(mid * way) else (low, mid)
    y = low * way
    x = y + rng.choice([-1.0, 0.0, 1.0], size=module.n) * np.array(module.error)
    if np.any(np.abs(x) >= np.array(module.box)):
        return None
    command = None if held is None else tuple(float(v) for v in held)
    return tuple(float(v) for v in y), tuple(float(v) for v in x), command
