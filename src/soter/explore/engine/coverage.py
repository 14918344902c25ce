"""The coverage of a search: how much of a program it reached, and what not; its progress.

Purpose: `Coverage` counts the properties, actors, modes, branches, values that were reached, out of
all there are, and names the others. `CoverageCounters`, `EngineProgress` and `Observations` (what a
part's search notes at ends of instants) are exchanged with the C engine, as numbers and arrays.
Non-goals: running the engine (`explorer_library.py`); judging: the rest may be unreachable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.model.types import ArrayType, BoolType, EnumType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.core.layout import Bytes, Words
    from soter.explore.model.explorer_model import ExplorerModel
    from soter.language.model.system import System
    from soter.language.model.types import Type

    WantedWords = npt.NDArray[np.uint64]


EACH_VALUE_MAX = 64
"""An int with up to this many values has a class for each of them."""
MEMBERS_MAX = 256
"""The first members of an enum, up to this many, have a class each."""
FIRST_INT_CLASS = 8
"""The engine's number for the class of the first value of a small set of ints."""


@dataclass(frozen=True)
class CoverageKind:
    """The coverage of one kind of thing: the number of all, and the names of those not reached."""

    total: int = 0
    unreached: tuple[str, ...] = ()

    @property
    def reached(self) -> int:
        """How many were reached."""
        return self.total - len(self.unreached)

    def merge(self, other: CoverageKind) -> CoverageKind:
        """The coverage of two searches of the same program together."""
        unreached = set(other.unreached)
        return CoverageKind(self.total, tuple([n for n in self.unreached if n in unreached]))


@dataclass(frozen=True)
class Coverage:
    """The coverage of a search, kind by kind, in the order in which reports show the kinds.

    `properties` counts those judged at least once: a contract if its node stepped, an `always` if
    time could pass, a `leadsto` if its premise held and its deadline came before the end.
    """

    properties: CoverageKind = field(default_factory=CoverageKind)
    actors: CoverageKind = field(default_factory=CoverageKind)
    modes: CoverageKind = field(default_factory=CoverageKind)
    switches: CoverageKind = field(default_factory=CoverageKind)
    branches: CoverageKind = field(default_factory=CoverageKind)
    values: CoverageKind = field(default_factory=CoverageKind)

    def kinds_by_name(self) -> Iterator[tuple[str, CoverageKind]]:
        """Yields the name of each kind and its coverage, in order."""
        yield "properties", self.properties
        yield "actors", self.actors
        yield "modes", self.modes
        yield "switches", self.switches
        yield "branches", self.branches
        yield "values", self.values

    @property
    def unreached(self) -> tuple[str, ...]:
        """The names of everything that was not reached."""
        return tuple([name for _, kind in self.kinds_by_name() for name in kind.unreached])


def kind_coverage(named: Iterable[tuple[str, bool]]) -> CoverageKind:
    """The coverage of named things; each name has a flag that says if it was reached."""
    entries = list(named)
    return CoverageKind(len(entries), tuple([name for name, reached in entries if not reached]))


@dataclass(frozen=True)
class CoveredLeaf:
    """A scalar of a topic: full name with path, type, and bounds (infinite if unbounded)."""

    name: str
    type: Type
    low: float
    high: float


def leaf_classes(leaf: CoveredLeaf) -> list[tuple[int, str]]:
    """The classes of a leaf's values, each with the engine's number and a name.

    Each value has one class: an end of its set, or the values between the ends that are below, at
    or above zero.
    """
    if isinstance(leaf.type, BoolType):
        return [(0, f"{leaf.name} = false"), (1, f"{leaf.name} = true")]
    if isinstance(leaf.type, EnumType):
        members = list(enumerate(leaf.type.members))[:MEMBERS_MAX]
        return [(i, f"{leaf.name} = {member}") for i, member in members]
    if isinstance(leaf.type, IntType) and leaf.high - leaf.low < EACH_VALUE_MAX:
        count = int(leaf.high - leaf.low) + 1
        return [(FIRST_INT_CLASS + i, f"{leaf.name} = {int(leaf.low) + i}") for i in range(count)]
    return [(i, _class_name(leaf, i)) for i in _possible_classes(leaf)]


def value_class(leaf: CoveredLeaf, value: float) -> int:
    """The engine's number for the class of a value (`class_of` in soter_explore_step.c).

    -1 for a member of an enum beyond the first `MEMBERS_MAX`, as it has no class.
    """
    if isinstance(leaf.type, (BoolType, EnumType)):
        return int(value) if value < MEMBERS_MAX else -1
    if isinstance(leaf.type, IntType) and leaf.high - leaf.low < EACH_VALUE_MAX:
        return FIRST_INT_CLASS + int(value - leaf.low)
    if value in (leaf.low, leaf.high):
        return 0 if value == leaf.low else 1
    return 2 if value < 0 else 4 if value > 0 else 3


def leaf_value(type_: Type, value: object, path: Sequence[str]) -> object:
    """The scalar at a path of `leaves(t)` in a value; None if the path leads into a list."""
    for part in path:
        assert isinstance(value, tuple)
        if isinstance(type_, RecordType):
            index = [name for name, _ in type_.fields].index(part)
            type_, value = type_.fields[index][1], value[index]
        elif isinstance(type_, ArrayType):
            type_, value = type_.element, value[int(part[1:-1])]
        else:
            return None
    return value


def _possible_classes(leaf: CoveredLeaf) -> list[int]:
    low, high = leaf.low, leaf.high
    bounded_below, bounded_above = low > -float("inf"), high < float("inf")
    classes = [0] if bounded_below else []
    classes += [1] if bounded_above and low < high else []
    gap = 1 if isinstance(leaf.type, IntType) else 0  # from an end to the next value
    classes += [2] if low < 0.0 and low + gap <= min(high - gap, -gap) else []
    classes += [3] if low < 0.0 < high else []
    classes += [4] if high > 0.0 and max(low + gap, gap) <= high - gap else []
    return classes if low < high else classes[:1]


def _class_name(leaf: CoveredLeaf, number: int) -> str:
    """The name of a class of values, such as `speed in (0, 3)`."""
    if number in (0, 1, 3):
        return f"{leaf.name} = {_number_text(leaf, (leaf.low, leaf.high, 0, 0.0)[number])}"
    low, high = (leaf.low, min(leaf.high, 0.0)) if number == 2 else (max(leaf.low, 0.0), leaf.high)
    if isinstance(leaf.type, IntType):
        return f"{leaf.name} in [{int(low) + 1}, {int(high) - 1}]"
    if low == -math.inf:
        return f"{leaf.name} < {_number_text(leaf, high)}"
    if high == math.inf:
        return f"{leaf.name} > {_number_text(leaf, low)}"
    return f"{leaf.name} in ({_number_text(leaf, low)}, {_number_text(leaf, high)})"


def _number_text(leaf: CoveredLeaf, value: float) -> str:
    return str(int(value)) if isinstance(leaf.type, IntType) else f"{value:.9g}"


def values_coverage(leaves: Sequence[CoveredLeaf], seen: Sequence[Sequence[int]]) -> CoverageKind:
    """The coverage of values; `seen[leaf][class number]` is 1 if such a value was published."""
    return kind_coverage(
        (name, bool(row[number]))
        for leaf, row in zip(leaves, seen, strict=True)
        for number, name in leaf_classes(leaf)
    )


def modules_coverage(
    modules: Sequence[tuple[str, str | None]],
    modes: Sequence[Sequence[int]],
    switches: Sequence[Sequence[int]],
) -> tuple[CoverageKind, CoverageKind]:
    """The coverage of modes, and that of switches; `modules`: name and forced mode or None."""
    named_modes: list[tuple[str, bool]] = []
    named_switches: list[tuple[str, bool]] = []
    for (name, forced), seen, switched in zip(modules, modes, switches, strict=True):
        for i, mode in enumerate(("SC", "AC")):
            if forced is None or forced.upper() == mode:
                named_modes.append((f"{name} in {mode}", bool(seen[i])))
            if forced is None:
                named_switches.append((f"{name} to {mode}", bool(switched[i])))
    return kind_coverage(named_modes), kind_coverage(named_switches)


def branches_coverage(names: Sequence[str], bits: Sequence[int]) -> CoverageKind:
    """The coverage of named branches; branch b is bit b % 64 of word b 64 of `bits`."""
    return kind_coverage(
        (name, bool(bits[b // 64] >> (b % 64) & 1)) for b, name in enumerate(names)
    )


@dataclass(frozen=True)
class EngineProgress:
    """The progress of a search. `tracing`: it looks for an execution to a violation that it found.

    `bytes`: of tables, frontiers and remembered steps; `answers`: of the step that is being tried,
    if very many. Everything observable before `covered_ns` was judged (breadth first).
    """

    states: int
    transitions: int
    depth: int
    seconds: float
    tracing: bool = False
    bytes: int = 0
    answers: int = 0
    covered_ns: int = 0


def read_progress(progress: Any, seconds: float) -> EngineProgress:  # noqa: ANN401 - cdata
    """The progress in a `soter_explore_progress`, which the C search updates as it goes."""
    return EngineProgress(
        states=int(progress.states),
        transitions=int(progress.transitions),
        depth=int(progress.depth),
        seconds=seconds,
        tracing=bool(progress.tracing),
        bytes=int(progress.bytes),
        answers=int(progress.answers),
        covered_ns=max(int(progress.covered_ns), 0),
    )


@dataclass(frozen=True, eq=False)
class Observations:
    """The mask (words,) of the bits that a search notes at ends of instants, and a goal or None.

    `goal`, (words,): an end with these bits violates property `sought`. `memory`: bytes for notes.
    """

    mask: WantedWords
    memory: int
    goal: WantedWords | None = None
    sought: int = 0

    def option_fields(self, ffi: Any) -> dict[str, object]:  # noqa: ANN401 - cffi has no types
        """The fields for `soter_explore_options`; their arrays live as long as this object."""
        null = ffi.NULL
        return {
            "noted_bytes": self.memory,
            "noted": ffi.cast("uint64_t *", self.mask.ctypes.data),
            "goal": null if self.goal is None else ffi.cast("uint64_t *", self.goal.ctypes.data),
            "sought": {"what": 0, "index": self.sought},
        }


@dataclass(frozen=True)
class CoverageCounters:
    """The sum of the coverage of all searches of an engine; see `soter_explore_coverage`.

    `branches`: a word for each 64 branches; `classes`: (leaves, 256); `modes` and `switches`:
    (modules, 2), SC first; `fired`: (actors,); `judged`: (properties, then timed properties,).
    """

    branches: Words
    classes: Bytes
    modes: Bytes
    switches: Bytes
    fired: Bytes
    judged: Bytes


def empty_counters(system: System, model: ExplorerModel) -> CoverageCounters:
    """The counters of a flattened test before its first search."""
    assert system.test is not None
    modules, judged = len(system.modules), len(system.properties) + len(system.test.timed) + 1
    return CoverageCounters(
        np.zeros(-(-len(model.unit.branches) // 64) or 1, dtype=np.uint64),
        np.zeros((len(model.leaves), 256), dtype=np.uint8),
        np.zeros((modules, 2), dtype=np.uint8),
        np.zeros((modules, 2), dtype=np.uint8),
        np.zeros(len(model.plan.actors), dtype=np.uint8),
        np.zeros(judged, dtype=np.uint8),
    )


def coverage_struct(seen: CoverageCounters, ffi: Any) -> Any:  # noqa: ANN401 - cdata
    """The `soter_explore_coverage` with which the C search adds its coverage to `seen`."""
    places = {
        name: ffi.cast("uint64_t *" if name == "branches" else "uint8_t *", array.ctypes.data)
        for name, array in vars(seen).items()
    }
    return ffi.new("soter_explore_coverage *", places)
