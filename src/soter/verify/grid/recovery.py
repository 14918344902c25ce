"""P2b on a grid: SC leads from every cell of K to where AC gets control back.

Purpose: `enter_recovery` finds Q, the cells that SC keeps inside a target (where `safer` holds at
every estimate), and W, the cells from which SC leads to Q. The rank of a cell says how many chains
lead to Q (`recovery_ranks`; docs/verification.md, section 3; symbols: head of `sets.py`).
Non-goals: targets and the time T (`verify/claims/claims.py`); Q where it is empty on the declared
cells (`finer_cells.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.current_phase import share_done
from soter.verify.grid import sets as grids
from soter.verify.grid.finer_cells import (
    engine_for_cells,
    find_q_on_finer_cells,
    index_of_declared_cells,
    target_on_small_cells,
)
from soter.verify.grid.sets import LONGEST

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from soter.core.layout import Bools, Bytes
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.case import Case
    from soter.verify.grid.finer_cells import FinerQ
    from soter.verify.grid.sets import GridGroup

    Lengths = Sequence[Sequence[int]]


HOLDS = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 135, 200)
"""Lengths of chains, in periods of SC, that are tried on the way to Q."""
LENGTHS = ((2, 4, 8, 16, 32), (8, 24, 64, 150), HOLDS)
"""Lists of chain lengths, tried in turn until nearly every cell is in W."""
SHORT = ((2, 4, 8), (16, 32), *LENGTHS[1:])
"""`LENGTHS` for a nonlinear flow, where each period is expensive: with short lengths first W grows,
and most cells reach it without a long chain. The time T may become longer."""
FINER = (tuple(range(1, 41)), HOLDS)
"""`LENGTHS` for small cells: more lengths cost little beside the longest one, and with only a few a
tenth of K or more was left outside W."""
HIGHEST = 2**16 - 2
"""The highest rank: ranks are kept in 16 bits."""
LONG = 96
"""Where a chain of K is longer than this, lists of short lengths are not tried."""
STRAGGLERS_MAX = 2000
"""If no more cells than this are left, every length is tried for them."""
WAY_MAX = 80_000
"""For more small cells of K the way to Q is not computed: for 70,000 it takes a minute."""


@dataclass(frozen=True)
class RecoveryRanks:
    """W by cell: `rank` (0: not in W, 1: in Q), `holds` (N of a chain), `time_ns` to Q at most."""

    rank: npt.NDArray[np.uint16]
    holds: Bytes
    time_ns: npt.NDArray[np.int64]
    steps: int
    """The number of periods of SC that were computed, a measure of the work."""

    @property
    def cells(self) -> Bools:
        """Whether each cell is in W, in the grid's shape."""
        return np.asarray(self.rank != 0)

    @property
    def longest_ns(self) -> int:
        """The longest time from W to Q, in ns."""
        return int(self.time_ns[self.cells].max(initial=0))


def recovery_ranks(
    group: GridGroup,
    core: Bools,
    constraint: Bools,
    goal: Bools,
    *,
    holds: Sequence[int] = HOLDS,
    before: RecoveryRanks | None = None,
) -> RecoveryRanks:
    """The ranks of W, the cells of `core` from which the law reaches `goal` (Q) on every run.

    W_0 = Q. W_(k+1) has W_k and each cell of `core` for which, with some N of `holds`, the tube is
    in `constraint` and the image over [N delta - j, N delta + j] in W_k and in `core`. P2b requires
    that W covers K. `before` is a W to extend by more cells. Sets have the grid's shape.
    """
    ffi, lib = group.library.ffi, group.library.lib
    steps = np.array(sorted({h for h in holds if h <= grids.LONGEST}), dtype=np.int32)
    initial_way = before or _initial_ranks(goal & core)
    rank, taken, time_ns = (
        initial_way.rank.copy(),
        initial_way.holds.copy(),
        initial_way.time_ns.copy(),
    )
    asked = core & (rank == 0)
    slot = np.where(asked, np.cumsum(asked, dtype=np.int32).reshape(core.shape) - 1, -1)
    slot = np.ascontiguousarray(slot, dtype=np.int32)
    image = np.empty((int(asked.sum()), len(steps), len(group.axes), 2), dtype=np.uint16)
    w = ffi.new("soter_reach_way *")
    memory = group.allocate_rounds(w.r)
    memory["kept"][:] = group.bits_of(rank != 0)
    inside, allowed = group.bits_of(constraint), group.bits_of(core)
    at = group.pointer
    w.allowed, w.inside = at(allowed, "uint64_t *"), at(inside, "uint64_t *")
    w.holds, w.count = at(steps, "int32_t *"), len(steps)
    w.slot, w.image = at(slot, "int32_t *"), at(image, "uint16_t *")
    w.rank, w.taken = at(rank, "uint16_t *"), at(taken, "uint8_t *")
    w.time = at(time_ns, "int64_t *")
    w.base = max(0, int(rank.max(initial=0)) - 1)
    w.period_ns, w.jitter_ns = group.inputs.period_ns, group.inputs.jitter_ns
    lib.soter_reach_way_begin(group.c, w)
    while not lib.soter_reach_way_continue(group.c, w, grids.SLICE_S, group.threads):
        share_done(0.0, "way")  # nobody knows how many rounds are left
    del memory, inside, allowed, image, slot
    return RecoveryRanks(rank, taken, time_ns, sum(w.r.steps))


def _initial_ranks(goal: Bools) -> RecoveryRanks:
    """The ranks of W before the first chain, when W has only the cells of Q."""
    none = np.zeros(goal.shape, np.int64)
    return RecoveryRanks(goal.astype(np.uint16), none.astype(np.uint8), none, 0)


def cells_in_way(part: GroupSets) -> Bools:
    """The declared cells, in their grid's shape, of which all small cells lie in W."""
    assert part.rank is not None
    if part.finer is None:
        return part.rank > 0
    led = np.ones(part.core.shape, dtype=np.bool_)
    np.logical_and.at(led, index_of_declared_cells(part, part.finer[1]), part.rank > 0)
    return led


def enter_recovery(
    case: Case, proof: object, engine: GridGroup, part: GroupSets, target: Bools
) -> None:
    """Computes Q, W and the time to Q for `target`, in the grid's shape; enters failures of P2b."""
    case.failures = [f for f in case.failures if (f.proof, f.claim) != (proof, "P2b")]
    part.target = target
    inside = target & part.allowed
    if case.problem.computed and _mend_recovery(case, engine, part, inside):
        return
    if not inside.any() and (empty := case.failures_of("safer")):
        case.fail("P2b", empty[0].text, proof, empty[0].hint).cells = inside
        return
    part.home, part.finer = engine.compute_core(inside).witness, None
    if not part.home.any():
        found, tried = (
            find_q_on_finer_cells(case, engine, part) if case.problem.computed else (None, "")
        )
        if found is not None:
            _enter_finer_q(case, proof, part, found)
            return
        text = "SC keeps no set inside `safer`"
        near = f"nor where SC rests on cells of {tried} the size, the DM's table as declared"
        text += f", {near}" * bool(tried)
        hint = "let SC come to rest where `safer` holds"
        case.fail("P2b", text, proof, hint).cells = inside
        return
    # SC keeps Q inside `safer`, so Q may be added to K; mostly it is a part of K already
    part.core = np.where(part.core > 0, part.core, part.home)
    every_length = SHORT if engine.c.is_local else LENGTHS
    first = len(every_length) - 2 if part.core.max() > LONG else 0
    home = part.home > 0
    return_way = _ranks_by_lengths(engine, part.core > 0, part.allowed, home, every_length[first:])
    _enter_ranks(part, return_way)
    _enter_failure_of_stuck_cells(case, proof, (part.core > 0) & (return_way.rank == 0))


def _enter_finer_q(case: Case, proof: object, part: GroupSets, found: FinerQ) -> None:
    """Enters Q, found on small cells, and W on the same cells; it leaves K unchanged."""
    core = (part.core > 0)[found.origin]
    part.home, part.finer = found.home, (found.size, found.group)
    home = found.home > 0
    far = int(np.count_nonzero(core & ~home))
    if far > WAY_MAX:
        text = f"SC keeps a set inside `safer` with cells of {found.size} the size; the way there "
        text += f"from {far:,} such cells of K was not looked at (at most {WAY_MAX:,})"
        case.fail("P2b", text, proof, "fewer cells; a `safer` of your own")
        return
    return_way = _ranks_by_lengths(
        found.engine, core | home, part.allowed[found.origin], home, FINER
    )
    _enter_ranks(part, return_way)
    _enter_failure_of_stuck_cells(case, proof, found.declared_cells(core & (return_way.rank == 0)))


def _mend_recovery(case: Case, engine: GridGroup, part: GroupSets, inside: Bools) -> bool:
    """Adapts an earlier Q and W after K has lost cells; returns whether this was possible.

    The new Q has the cells of the old Q that SC keeps inside the target. The old W leads to the old
    Q, and short chains lead from the old Q to the new Q.
    """
    if part.home is None or part.rank is None or part.rank_holds is None or not part.home.any():
        return False
    allowed, covered, before = part.allowed, part.core > 0, part.home > 0
    if part.finer is not None:
        origin = index_of_declared_cells(part, part.finer[1])
        engine = engine_for_cells(case, engine, part.finer[1])
        inside = target_on_small_cells(case, engine, part, origin)
        allowed, covered = allowed[origin], covered[origin]
    if (covered & (part.rank == 0)).any():
        return False
    home = engine.compute_core(inside, members=before).witness
    if not home.any():
        return False
    inner_way = recovery_ranks(engine, before, allowed, home > 0, holds=FINER[0])
    later = part.rank.astype(np.int64) + (int(inner_way.rank.max()) - 1)
    if (before & (inner_way.rank == 0)).any() or int(later.max()) > HIGHEST:
        return False
    part.home, part.return_ns = home, part.return_ns + inner_way.longest_ns
    part.rank_holds = np.where(before, inner_way.holds, part.rank_holds)
    part.rank = np.where(before, inner_way.rank, np.where(part.rank > 0, later, 0))
    part.rank = part.rank.astype(np.uint16)
    return True


def _enter_ranks(part: GroupSets, return_way: RecoveryRanks) -> None:
    part.rank, part.rank_holds = return_way.rank, return_way.holds
    part.return_ns = return_way.longest_ns


def _enter_failure_of_stuck_cells(case: Case, proof: object, stuck: Bools) -> None:
    """Enters a failure of P2b if there are `stuck` cells, from which no way back was found."""
    if stuck.any():
        text = f"from {int(stuck.sum()):,} cells of K no way back to `safer` was found"
        hint = "an SC that returns to where `safer` holds"
        failure = case.fail("P2b", text, proof, hint)
        failure.cells, failure.stuck = stuck, True


def _ranks_by_lengths(
    engine: GridGroup, core: Bools, allowed: Bools, home: Bools, lengths_tried: Lengths
) -> RecoveryRanks:
    """The ranks of W by each list of chain lengths, then by all lengths if few cells are left."""
    few = min(STRAGGLERS_MAX, int(core.sum()) // 20)
    return_way: RecoveryRanks | None = None
    for lengths in lengths_tried:
        return_way = recovery_ranks(engine, core, allowed, home, holds=lengths, before=return_way)
        if int((core & ~return_way.cells).sum()) <= few:
            break
    assert return_way is not None
    if 0 < int((core & ~return_way.cells).sum()) <= STRAGGLERS_MAX:
        # at the border of K only few lengths of chains end inside W
        every = range(1, LONGEST + 1)
        return_way = recovery_ranks(engine, core, allowed, home, holds=every, before=return_way)
    return return_way
