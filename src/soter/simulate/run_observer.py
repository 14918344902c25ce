"""Observes the states of a run, and keeps a hash, a trace and changes of mode.

Purpose: an `Observer` gets the state after each instant, in blocks. It hashes states, keeps them if
a trace is wanted, and notes mode changes and first faults for the summary. Both engines use the
same observer, so both give the same record. `TraceParts` finds the parts of a trace by
names (topics, `<plant>.truth`, modules). `decided_rows` and `moved_rows` find the states in which
decision modules decided, and in which a shield moved a command.
Non-goals: reasons (`decisions.py`), reading a trace (`result.py`); changing a run: without an
observer it is the same.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import field_name_of_group, state_dtype
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.model.types import ArrayType, RecordType
from soter.semantics.faults import group_by_component, is_released
from soter.simulate.module_safe_check import InterpretedSafe, SafeTally

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import IO

    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.language.model.types import Type
    from soter.simulate.module_safe_check import SafeJudge, SafeLooks

    Kept = bool | str | Collection[str]
    """Which parts of a trace are kept: all, none, or the named ones."""
    Rows = npt.NDArray[np.uint8]
    Also = Callable[[npt.NDArray[Any], Sequence["ModeChange"]], None]


def decided_rows(system: System, states: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Whether each module's DM stepped in the instant of each of n states: (n, modules)."""
    times_ns = states["header"]["ct"]
    periods = np.array([m.period_ns for m in system.modules], dtype=np.int64)
    due: npt.NDArray[np.bool_] = times_ns[:, np.newaxis] % periods == 0
    late = group_by_component(system, changes_releases=True)
    for m in system.modules:
        if m.dm in late and len(states):
            dm, seed = system.components[m.dm], int(states["header"]["seed"][0])
            release_flags = [is_released(system, late[m.dm], dm, seed, int(t)) for t in times_ns]
            due[:, m.index] = release_flags
    return due


def moved_rows(
    system: System, module: Module, states: npt.NDArray[Any]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """The states, (n,), in which AC in control has published, and those its shield moved.

    Both arrays are (n,), and False everywhere if the module has no shield `toward sc`.
    """
    published, was_moved = np.zeros((2, len(states)), dtype=np.bool_)
    shield = module.shield
    if shield is None or shield.proposed is None:
        return published, was_moved
    proposals = states["topics"][system.topics[shield.proposed].name]
    in_ac = states["modules"]["mode"][:, module.index] != 0
    first = 0
    for output in module.outputs:
        numbers = plain_numbers(
            system.topics[output].type, states["topics"][system.topics[output].name]
        )
        proposed = proposals[:, first : first + numbers.shape[-1]]
        first += numbers.shape[-1]
        commanded = in_ac & (states["stamps"][:, output] == states["header"]["ct"])
        published |= commanded
        was_moved |= commanded & (numbers != proposed).any(axis=-1)
    return published, was_moved


def plain_numbers(t: Type, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """The k numbers in each value, (..., k), in declared order; `t` must not contain lists."""
    if isinstance(t, RecordType):
        return np.concatenate([plain_numbers(f, values[n]) for n, f in t.fields], axis=-1)
    if isinstance(t, ArrayType):
        parts = plain_numbers(t.element, values)
        return parts.reshape(*parts.shape[:-2], -1)
    return values.astype(np.float64)[..., np.newaxis]


def named_parts(keep: Kept) -> tuple[str, ...] | None:
    """The names of the kept parts of a trace; None if the run keeps all of it, or nothing."""
    if isinstance(keep, str):
        return (keep,)
    return tuple(dict.fromkeys(keep)) if isinstance(keep, Collection) else None


def keeps_anything(keep: Kept) -> bool:
    """Whether a run keeps any part of its trace, even if only the times."""
    return named_parts(keep) is not None or bool(keep)


def _fields_of_truths(system: System, layout: StateLayout) -> dict[str, str]:
    """Maps each `<plant>.truth` to the field of a state record that holds it."""
    return {
        f"{system.components[g.owner].name}.truth": field_name_of_group(g)
        for g in layout.groups
        if g.owner >= 0 and system.components[g.owner].plant is not None
    }


class TraceParts:
    """Selects parts of states: the header, and the topics, truths and modules that are named."""

    def __init__(
        self, system: System, layout: StateLayout, dtype: np.dtype[Any], names: tuple[str, ...]
    ) -> None:
        topics = {t.name for t in system.topics}
        truths = _fields_of_truths(system, layout)
        modules = {m.name for m in system.modules}
        every = [*topics, *truths, *modules]
        for name in names:
            if name not in every:
                known = nearest_or_all(name, every)
                message = f"the run has no topic, truth or module `{name}` to record"
                raise mistake("U001", message, known)
        self._topics = [n for n in names if n in topics]
        self._whole = ["header"]
        if modules.intersection(names):
            self._whole.append("modules")
        self._whole += [truths[n] for n in names if n in truths]
        fields = [(part, dtype[part]) for part in self._whole]
        if self._topics:
            fields.append(("topics", np.dtype([(n, dtype["topics"][n]) for n in self._topics])))
        self.dtype: np.dtype[Any] = np.dtype(fields)

    def copy_parts(self, states: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A copy, (n,), of the selected parts of n states."""
        copies = np.empty(len(states), dtype=self.dtype)
        for part in self._whole:
            copies[part] = states[part]
        for name in self._topics:
            copies["topics"][name] = states["topics"][name]
        return copies


IN_MEMORY_BYTES = 512 * 1024 * 1024
"""A longer trace is kept in a temporary file, which ends with the process."""
EXPLAINED_MAX = 1000
EXPLAINED_BYTES = 64 * 1024 * 1024
"""The most changes, and the most bytes, of which the states are kept for explanations."""


@dataclass(frozen=True)
class ModeChange:
    """A DM step that changed the mode: time, module index, new mode, facts of the DM."""

    time_ns: int
    module: int
    to: str
    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    states: tuple[bytes | None, bytes] | None = field(default=None, repr=False, compare=False)
    """The states after the instant before (None if there is none) and after its own instant; kept
    for the first `EXPLAINED_MAX` changes."""


@dataclass(frozen=True)
class FirstFault:
    """The first step fault of a component; `latched_ns` is None if the component goes on."""

    time_ns: int
    latched: bool


class Observer:
    """Receives the states of one run in order, and keeps the wanted parts of them."""

    def __init__(
        self,
        system: System,
        dtype: np.dtype[Any],
        judge: SafeJudge,
        *,
        keep_trace: bool,
        hash_trace: bool,
        parts: TraceParts | None = None,
        also: Also | None = None,
    ) -> None:
        """`judge` evaluates `safe` of modules; `parts` selects parts of a state, by default all."""
        self.instants = 0
        self.changes: list[ModeChange] = []
        self.first_faults: dict[int, FirstFault] = {}
        self.last: Rows | None = None
        """The last state seen, (size,) bytes."""
        self.also = also
        self._dtype = dtype
        self._parts = parts
        self._digest = hashlib.sha256() if hash_trace else None
        self._kept: list[Rows] | None = [] if keep_trace else None
        self._kept_bytes = 0
        self._file: IO[bytes] | None = None
        self._modes = np.array([m.forced == "ac" for m in system.modules], dtype=np.uint8)
        self._system = system
        self._decided = np.zeros((2, len(system.modules)), dtype=np.int64)
        self._moved = np.zeros((2, len(system.modules)), dtype=np.int64)
        self._safe = SafeTally(system, judge)

    def observe_states(self, rows: Rows) -> None:
        """Receives the next states, (n, size) bytes; the caller may reuse the array afterwards."""
        if len(rows) == 0:
            return
        self.instants += len(rows)
        earlier = self.last
        self.last = rows[-1].copy()
        if self._digest is not None:
            self._digest.update(np.ascontiguousarray(rows).data)
        states = np.ascontiguousarray(rows).view(self._dtype).reshape(-1)
        if self._kept is not None:
            parts = self._parts
            self._keep_rows(rows if parts is None else _as_rows(parts.copy_parts(states)))
        known = len(self.changes)
        if len(self._modes):
            self._see_modes(states, earlier)
        self._see_faults(states)
        if self.also is not None:
            self.also(states, self.changes[known:])

    def run_fields(self) -> dict[str, Any]:
        """The fields of a `Run` that the observer provides."""
        names = ("instants", "changes", "first_faults", "decided", "moved_commands", "safe_looks")
        observed = {name: getattr(self, name) for name in names}
        return {"trace": self.trace(), "trace_sha256": self.sha256, **observed}

    @property
    def decided(self) -> list[tuple[int, int]]:
        """For each module the number of DM steps, and how often ttf and safer held together."""
        return [(int(n), int(both)) for n, both in self._decided.T]

    @property
    def moved_commands(self) -> list[tuple[int, int]]:
        """By module: AC's published commands, and those that a shield `toward sc` moved."""
        return [(int(n), int(moved)) for n, moved in self._moved.T]

    @property
    def safe_looks(self) -> list[SafeLooks]:
        """By module: after how many looks of its DM its own `safe` was false."""
        return self._safe.looks

    @property
    def sha256(self) -> str | None:
        """The SHA-256 of all states so far; None if the run is not hashed."""
        return self._digest.hexdigest() if self._digest is not None else None

    def trace(self) -> npt.NDArray[Any] | None:
        """All states, or their parts, as records, (instants,); None if they were not kept.

        It may be called only once, at the end.
        """
        if self._kept is None:
            return None
        dtype = self._dtype if self._parts is None else self._parts.dtype
        if self._file is not None:
            self._spill()
            with self._file as file:  # a map keeps what it needs of a file
                file.flush()
                return np.memmap(file, dtype=dtype, mode="r", shape=(self.instants,))
        none = np.zeros((0, dtype.itemsize), dtype=np.uint8)
        rows = np.concatenate(self._kept) if self._kept else none
        return np.ascontiguousarray(rows).view(dtype).reshape(-1)

    # ------------------------------------------------------------ keeping

    def _keep_rows(self, rows: Rows) -> None:
        assert self._kept is not None
        self._kept.append(rows.copy() if self._parts is None else rows)  # parts are copies
        self._kept_bytes += rows.size
        if self._kept_bytes > IN_MEMORY_BYTES:
            self._spill()

    def _spill(self) -> None:
        """Moves the states in memory to the temporary file."""
        assert self._kept is not None
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="soter-trace-")  # noqa: SIM115 - lives on
        for rows in self._kept:
            self._file.write(rows.tobytes())
        self._kept.clear()
        self._kept_bytes = 0

    # ------------------------------------------------------------ looking

    def _see_modes(self, states: npt.NDArray[Any], earlier: Rows | None) -> None:
        modules = states["modules"]
        modes = modules["mode"]
        before = np.vstack([self._modes, modes[:-1]])
        for row, module in np.argwhere(modes != before):
            seen = modules[row, module]
            self.changes.append(
                ModeChange(
                    int(states["header"]["ct"][row]),
                    int(module),
                    "AC" if seen["mode"] else "SC",
                    ttf=bool(seen["ttf"]),
                    safer=bool(seen["safer"]),
                    stale=bool(seen["stale"]),
                    gate_fault=bool(seen["saw_gate_fault"]),
                    states=self._states_to_explain(states, earlier, int(row)),
                )
            )
        self._modes = modes[-1].copy()
        due = decided_rows(self._system, states)
        together = due & (modules["ttf"] == 1) & (modules["safer"] == 1)
        self._decided += np.array([due.sum(axis=0), together.sum(axis=0)])
        for m in self._system.modules:
            self._moved[:, m.index] += [x.sum() for x in moved_rows(self._system, m, states)]
        self._safe.count_looks(states, due)

    def _states_to_explain(
        self, states: npt.NDArray[Any], earlier: Rows | None, row: int
    ) -> tuple[bytes | None, bytes] | None:
        """The states before and after an instant; None if the room for such states is used up."""
        known = len(self.changes)
        if known >= EXPLAINED_MAX or 2 * known * states.dtype.itemsize > EXPLAINED_BYTES:
            return None
        if row:
            return states[row - 1].tobytes(), states[row].tobytes()
        return None if earlier is None else earlier.tobytes(), states[row].tobytes()

    def _see_faults(self, states: npt.NDArray[Any]) -> None:
        faults = states["components"]["faults"]
        for component in np.flatnonzero(faults[-1]):
            if int(component) not in self.first_faults:
                row = int(np.argmax(faults[:, component] != 0))
                latched = bool(states["components"]["latched"][row, component])
                time_ns = int(states["header"]["ct"][row])
                self.first_faults[int(component)] = FirstFault(time_ns, latched)


def make_observer(
    system: System,
    layout: StateLayout,
    keep_trace: Kept,
    *,
    hash_trace: bool,
    also: Also | None = None,
    judge: SafeJudge | None = None,
) -> Observer:
    """The observer of a run of a system; `judge`: by default `safe` is evaluated in Python.

    `also` gets the observed states block by block: records (n,) and the changes of mode in them.
    `SoterError` U001 if `keep_trace` names no part of the system.
    """
    dtype, names = state_dtype(layout), named_parts(keep_trace)
    return Observer(
        system,
        dtype,
        judge or InterpretedSafe(system, layout),
        keep_trace=keeps_anything(keep_trace),
        hash_trace=hash_trace,
        parts=None if names is None else TraceParts(system, layout, dtype, names),
        also=also,
    )


def _as_rows(records: npt.NDArray[Any]) -> Rows:
    """The memory of records, (n,), as (n, size) bytes, without a copy."""
    return records.view(np.uint8).reshape(len(records), -1)
