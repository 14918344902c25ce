"""The paper's regions R1 to R5 of a group's cells.

Purpose: from the sets of a group to one number a cell, for figures.
Non-goals: drawing (`report/regions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof import R1, R2, R3, R4, R5

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.reach.results import GroupSets


def regions(sets: GroupSets) -> NDArray[np.uint8]:
    """R1 to R5 for every cell of a group."""
    found = np.full(sets.allowed.shape, R1, dtype=np.uint8)
    found[sets.allowed] = R2
    found[sets.core > 0] = R3
    if sets.free is not None:
        found[sets.free] = R4
        if sets.gives_back is not None:
            found[sets.free & sets.gives_back] = R5
    return found
