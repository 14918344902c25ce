"""What all searches of an engine have seen, as arrays that the C adds to.

Purpose: `soter_explore_coverage`, empty at first. Non-goals: names of what was seen
(`coverage.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.explore.model.explorer_model import ExplorerModel
    from soter.language.model.system import System

    Bytes = npt.NDArray[np.uint8]
    Words = npt.NDArray[np.uint64]


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
