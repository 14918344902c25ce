"""What crosses between Python and the C of the engine: requests, progress, coverage, symmetries.

Purpose: plain data and arrays for `soter_explore_options`, `soter_explore_progress` and
`soter_explore_coverage`: what a search of a part keeps of the ends of instants, how far its thread
is, what all searches have seen, and which equal instances may change places; what one of these
reached the others can reach, too.
Non-goals: running the engine (`explorer_library.py`), names of what was seen (`coverage.py`),
finding equal instances (`explore/model/symmetric_blocks.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.explore.allowed_steps import plan_of
from soter.explore.model.symmetric_blocks import families_of
from soter.explore.search_options import EXHAUSTIVE, REDUCTIONS, SYMMETRY

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.core.layout import Bytes, Words
    from soter.explore.model.explorer_model import ExplorerModel
    from soter.explore.model.independent_parts import IndependentPart
    from soter.explore.model.symmetric_blocks import Family
    from soter.explore.model.symmetry import Renaming
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import System

    WantedWords = npt.NDArray[np.uint64]


@dataclass(frozen=True)
class EngineProgress:
    """How far a search is. `tracing`: something is violated, a way to it is looked for.

    `bytes` of tables, frontiers and remembered steps; `answers` of the one step that is tried,
    where they are very many. What is observed before `covered_ns` was judged (breadth first).
    """

    states: int
    transitions: int
    depth: int
    seconds: float
    tracing: bool = False
    bytes: int = 0
    answers: int = 0
    covered_ns: int = 0


def progress_of(p: Any, seconds: float) -> EngineProgress:  # noqa: ANN401 - cdata
    """From what the explorer writes while it searches (`soter_explore_progress`)."""
    return EngineProgress(
        states=int(p.states),
        transitions=int(p.transitions),
        depth=int(p.depth),
        seconds=seconds,
        tracing=bool(p.tracing),
        bytes=int(p.bytes),
        answers=int(p.answers),
        covered_ns=max(int(p.covered_ns), 0),
    )


@dataclass(frozen=True, eq=False)
class Observations:
    """Which bits a search notes at ends of instants, (words,), and perhaps what it looks for.

    `goal`, (words,): an end with these bits violates property `sought`. `memory`: bytes.
    """

    mask: WantedWords
    memory: int
    goal: WantedWords | None = None
    sought: int = 0

    def options(self, ffi: Any) -> dict[str, object]:  # noqa: ANN401 - cffi has no types
        """Fields of `soter_explore_options`; the arrays live as long as this."""
        null = ffi.NULL
        return {
            "noted_bytes": self.memory,
            "noted": ffi.cast("uint64_t *", self.mask.ctypes.data),
            "goal": null if self.goal is None else ffi.cast("uint64_t *", self.goal.ctypes.data),
            "sought": {"what": 0, "index": self.sought},
        }


@dataclass(frozen=True)
class CoverageCounters:
    """Coverage, added up over all searches of an engine; see `soter_explore_coverage`.

    `branches`: one word for 64 branches; `classes`: (leaves, 256); `modes` and `switches`:
    (modules, 2), SC first; `fired`: (actors,); `judged`: (properties and timed ones,); `nearest`:
    (guides,), the least robustness that `falsify` met, infinity where it did not look.
    """

    branches: Words
    classes: Bytes
    modes: Bytes
    switches: Bytes
    fired: Bytes
    judged: Bytes
    nearest: npt.NDArray[np.float64]


def empty_counters(system: System, model: ExplorerModel) -> CoverageCounters:
    """Of a test that was flattened, before its first search."""
    assert system.test is not None
    modules, judged = len(system.modules), len(system.properties) + len(system.test.timed) + 1
    return CoverageCounters(
        np.zeros(-(-len(model.unit.branches) // 64) or 1, dtype=np.uint64),
        np.zeros((len(model.leaves), 256), dtype=np.uint8),
        np.zeros((modules, 2), dtype=np.uint8),
        np.zeros((modules, 2), dtype=np.uint8),
        np.zeros(len(model.plan.actors), dtype=np.uint8),
        np.zeros(judged, dtype=np.uint8),
        np.full(len(model.aims), math.inf),
    )


def coverage_of(seen: CoverageCounters, ffi: Any) -> Any:  # noqa: ANN401 - cdata
    """`soter_explore_coverage`: what is seen is added to `seen`."""
    kinds = {"branches": "uint64_t *", "nearest": "double *"}
    places = {
        name: ffi.cast(kinds.get(name, "uint8_t *"), array.ctypes.data)
        for name, array in vars(seen).items()
    }
    return ffi.new("soter_explore_coverage *", places)


class SymmetricInstances:
    """The equal instances of one test."""

    def __init__(self, system: System, lowered: CoreSystem, model: ExplorerModel) -> None:
        self._system = system
        self._lowered = lowered
        self._model = model
        self._fields: Any = None

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """All of them; none where an order is declared that puts one before the other."""
        if plan_of(self._system).ordered:
            return ()
        return families_of(self._system, self._lowered, self._model.plan, self._model.fields)

    def of(self, s: SearchOptions, part: IndependentPart | None) -> tuple[Family, ...]:
        """Those that a search of a part of the system (None: all of it) can make use of."""
        if not REDUCTIONS[s.reduction] & SYMMETRY or s.strategy not in EXHAUSTIVE:
            return ()
        return tuple([f for f in self.families if f.is_of(part)])

    def options(self, ffi: Any, some: Sequence[Family]) -> dict[str, object]:  # noqa: ANN401 - cffi
        """Of `soter_explore_options`; what it points to lives until the next ones."""
        self._fields = [ffi.new("soter_field[]", [x for b in f.blocks for x in b]) for f in some]
        rows = [(len(f.blocks), len(f.blocks[0]), x) for f, x in zip(some, self._fields)]  # noqa: B905
        self._fields.append(ffi.new("soter_family[]", rows))
        return {"family": self._fields[-1], "families": len(some)}

    # ------------------------------------------------------------ coverage

    def spread(self, some: Sequence[Family], seen: CoverageCounters) -> None:
        """What was seen of one instance was seen of each."""
        for family in some:
            for r in family.swaps:
                self._spread(r, seen)
            for r in family.swaps:  # and back from the first one to the others
                self._spread(r, seen)

    def _spread(self, r: Renaming, seen: CoverageCounters) -> None:
        """What was seen, and that with the renaming."""
        timed = len(self._system.properties)
        of_timed = {timed + i: timed + j for i, j in r.timeds.items()}
        for rows, to in (
            (seen.classes, self._leaves(r)),
            (seen.modes, r.modules),
            (seen.switches, r.modules),
            (seen.fired, r.actors),
            (seen.judged, r.properties | of_timed),
        ):
            _joined(rows, to)
        bits = np.unpackbits(seen.branches.view(np.uint8), bitorder="little")
        _joined(bits, dict(self._branches(r)))
        seen.branches[:] = np.packbits(bits, bitorder="little").view(np.uint64)

    def _leaves(self, r: Renaming) -> dict[int, int]:
        number = {leaf: i for i, leaf in enumerate(self._model.leaves)}
        moved = {i: number.get((r.topic(t), path), i) for (t, path), i in number.items()}
        return {i: j for i, j in moved.items() if i != j}

    def _branches(self, r: Renaming) -> Iterator[tuple[int, int]]:
        """Of what stands for a component, in the same order."""
        of: dict[str, list[int]] = {}
        for i, b in enumerate(self._model.unit.branches):
            of.setdefault(b.component, []).append(i)
        names: Sequence[str] = [x.name for x in self._system.components]
        for i, j in r.components.items():
            yield from zip(of.get(names[i], ()), of.get(names[j], ()), strict=True)


def _joined(rows: npt.NDArray[Any], to: dict[int, int]) -> None:
    """Rows, and those that stand for them: whatever is set in one is set in the other."""
    before = rows.copy()
    for i, j in to.items():
        rows[j] |= before[i]
