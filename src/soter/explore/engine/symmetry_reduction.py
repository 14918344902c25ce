"""Equal instances, for the engine: which of them a search may let change places, and what it saw.

Purpose: the families of `explore/model/symmetric_blocks.py` as `soter_explore_options` has them;
and coverage: what was reached by one instance can be reached by the others, as the same execution
with the instances swapped is one, too.
Non-goals: finding them.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.explore.methods import EXHAUSTIVE, REDUCTIONS, SYMMETRY
from soter.explore.model.symmetric_blocks import families_of
from soter.explore.trace.allowed_steps import plan_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.explore.engine.coverage_counters import CoverageCounters
    from soter.explore.model.explorer_model import ExplorerModel
    from soter.explore.model.independent_parts import IndependentPart
    from soter.explore.model.symmetric_blocks import Family
    from soter.explore.model.symmetry import Renaming
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import System


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
