"""P2b: SC gives control back.

Purpose: sets Q_g that SC keeps inside the states whose every estimate satisfies `safer`, and ranks
that lead there from all of K (docs/verification.md, section 3). T counts from SC's first acting
output to the instant at which the verdict that gives control back is in force.
Non-goals: whether AC then does anything useful.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.program.durations import show_ns
from soter.reach import polytope_claims
from soter.reach.grids import LONGEST
from soter.reach.levels import targets
from soter.reach.policies import HOLDS, Way, way
from soter.reach.products import parts, product_holds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.reach.claims import Case
    from soter.reach.grids import GridGroup
    from soter.reach.results import GroupSets

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


def recover(case: Case) -> None:
    """Q, W and the time to Q of every group; enters failures of P2b."""
    targets = _targets(case)
    if targets is None:
        return
    longest = 0
    for i, (engine, part, target) in enumerate(
        zip(case.groups, case.sets.groups, targets, strict=True)
    ):
        if not case.fresh[i] and part.target is not None and np.array_equal(part.target, target):
            longest = max(longest, part.return_ns)
            continue
        case.failures = [f for f in case.failures if (f.group, f.claim) != (i, "P2b")]
        part.target = target
        inside = target & part.allowed
        part.home = engine.core(inside).witness
        if not part.home.any():
            case.fail(
                "P2b",
                "SC keeps no set inside `safer`",
                i,
                inside,
                "let SC come to rest where `safer` holds",
            )
            continue
        # what SC keeps inside `safer` it keeps: as good as K, and mostly part of it
        part.core = np.where(part.core > 0, part.core, part.home)
        found = _way(engine, part, part.home > 0)
        part.rank, part.rank_holds = found.rank, found.holds
        part.return_ns = found.longest_ns
        longest = max(longest, part.return_ns)
        stuck = (part.core > 0) & (found.rank == 0)
        if stuck.any():
            case.fail(
                "P2b",
                f"from {int(stuck.sum()):,} cells of K no way back to `safer` was found",
                i,
                stuck,
                "an SC that returns to where `safer` holds; a finer grid",
                stuck=True,
            )
    longest = max(longest, polytope_claims.recover(case))
    times = case.problem.times
    case.counts["recover_ns"] = longest + times.decision + times.response_dm
    in_time(case)


def _way(engine: GridGroup, part: GroupSets, home: Bools) -> Way:
    """W: a few lengths of chain for all cells, then every length for those that are left."""
    core = part.core > 0
    few = min(STRAGGLERS_MAX, int(core.sum()) // 20)
    every_length = SHORT if engine.c.is_local else LENGTHS
    first = len(every_length) - 2 if part.core.max() > LONG else 0
    found: Way | None = None
    for lengths in every_length[first:]:
        found = way(engine, core, part.allowed, home, holds=lengths, before=found)
        if int((core & ~found.cells).sum()) <= few:
            break
    assert found is not None
    if 0 < int((core & ~found.cells).sum()) <= STRAGGLERS_MAX:
        # at the border of K chains fit W at few lengths only
        every = range(1, LONGEST + 1)
        found = way(engine, core, part.allowed, home, holds=every, before=found)
    return found


def _targets(case: Case) -> list[Bools] | None:
    """Per group the states all of whose estimates satisfy `safer`."""
    if case.problem.computed:
        held = targets(case)
        if held is None:
            case.fail("P2b", "not every case has sets: the DM never gives control back")
        return held
    ranges = polytope_claims.targets(case)
    found = None if ranges is None else parts(case.problem, case.groups, "safer")
    if found is None or ranges is None:
        case.fail("P2b", "no state was found on which `safer` surely holds")
        return None
    if not product_holds(case.forms.within(ranges), case.groups, found, "safer"):
        case.fail("P2b", "`safer` is no product over the groups")
        return None
    return found


def in_time(case: Case) -> None:
    """The declared T, where there is one."""
    wanted, needed = case.problem.recover_ns, case.counts["recover_ns"]
    if wanted is not None and needed > wanted and not case.failed("P2b"):
        case.fail(
            "P2b",
            f"SC may need {show_ns(needed)}, longer than the {show_ns(wanted)} of `recover within`",
            hint="allow more time, or a quicker SC",
        )
