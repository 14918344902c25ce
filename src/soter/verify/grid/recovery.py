"""P2b of a grid: Q, and ranks that lead there from all of K.

Purpose: the set Q that SC keeps inside a target, and W with its ranks (docs/verification.md,
section 3).
Non-goals: targets, T (`verify/claims/recovery.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.grid.policies import HOLDS, RecoveryRanks, way
from soter.verify.grid.sets import LONGEST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, GroupProof
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.sets import GridGroup

    Bools = NDArray[np.bool_]

LENGTHS = ((2, 4, 8, 16, 32), (8, 24, 64, 150), HOLDS)
"""Lengths of chain: the first that serve nearly every cell are enough."""
SHORT = ((2, 4, 8), (16, 32), *LENGTHS[1:])
"""The same where a hold costs much, the flow not being linear: a cell far from Q takes as many
holds as the longest, and most reach W soon, for it grows meanwhile. T may be longer."""
LONG = 96
"""Where K needs chains so long, the shortest are not tried."""
STRAGGLERS_MAX = 2000
"""So many cells may be looked at after every hold."""


def recover(
    case: Case, proof: GroupProof, engine: GridGroup, part: GroupSets, target: Bools
) -> None:
    """Q, W and the time to Q; enters failures of P2b. `target` has the grid's shape."""
    if not proof.fresh and part.target is not None and np.array_equal(part.target, target):
        return
    case.failures = [f for f in case.failures if (f.proof, f.claim) != (proof, "P2b")]
    part.target = target
    inside = target & part.allowed
    part.home = engine.core(inside).witness
    if not part.home.any():
        hint = "let SC come to rest where `safer` holds"
        case.fail("P2b", "SC keeps no set inside `safer`", proof, hint).cells = inside
        return
    # what SC keeps inside `safer` it keeps: as good as K, and mostly part of it
    part.core = np.where(part.core > 0, part.core, part.home)
    return_way = _way(engine, part, part.home > 0)
    part.rank, part.rank_holds = return_way.rank, return_way.holds
    part.return_ns = return_way.longest_ns
    stuck = (part.core > 0) & (return_way.rank == 0)
    if stuck.any():
        text = f"from {int(stuck.sum()):,} cells of K no way back to `safer` was found"
        hint = "an SC that returns to where `safer` holds; a finer grid"
        failure = case.fail("P2b", text, proof, hint)
        failure.cells, failure.stuck = stuck, True


def _way(engine: GridGroup, part: GroupSets, home: Bools) -> RecoveryRanks:
    """W: a few lengths of chain for all cells, then every length for those that are left."""
    core = part.core > 0
    few = min(STRAGGLERS_MAX, int(core.sum()) // 20)
    every_length = SHORT if engine.c.is_local else LENGTHS
    first = len(every_length) - 2 if part.core.max() > LONG else 0
    return_way: RecoveryRanks | None = None
    for lengths in every_length[first:]:
        return_way = way(engine, core, part.allowed, home, holds=lengths, before=return_way)
        if int((core & ~return_way.cells).sum()) <= few:
            break
    assert return_way is not None
    if 0 < int((core & ~return_way.cells).sum()) <= STRAGGLERS_MAX:
        # at the border of K chains fit W at few lengths only
        every = range(1, LONGEST + 1)
        return_way = way(engine, core, part.allowed, home, holds=every, before=return_way)
    return return_way
