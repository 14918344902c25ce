"""What a search of a part keeps of the ends of instants, and what it looks for among them.

Purpose: plain data for `soter_explore_options` (`noted`, `goal`, `sought`, `noted_bytes`).
Non-goals: what it is for (`properties_across_parts.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Words = npt.NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class Observations:
    """Which bits a search notes at ends of instants, (words,), and perhaps what it looks for.

    `goal`, (words,): an end with these bits violates property `sought`. `memory`: bytes.
    """

    mask: Words
    memory: int
    goal: Words | None = None
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
