"""Commands for a grid, and the way back: synthesis of SC, ranks for P2b.

Purpose: K with a table of commands on estimates (`--synthesize`), and W with numbers of holds and
times (docs/verification.md, section 3), for one group.
Non-goals: writing a table as a Soter node; which set Q is.

A table has one entry per cell of the estimate: [low, high) along each axis, the last cell closed.
True cell c and estimate cell e are *compatible* when x in c, x + error in e for some error of E.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import share_done
from soter.verify.grid import sets as grids

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from soter.core.layout import Bools, Bytes, Floats
    from soter.verify.grid.sets import GridGroup

    Masks = npt.NDArray[np.uint64]

ALL = np.uint64(2**64 - 1)
HOLDS = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 135, 200)
"""Numbers of holds that are tried on the way to Q."""


@dataclass(frozen=True)
class CommandTable:
    """A synthesised SC: `cells` is K; `choice` the row of `commands` per estimate cell, 255: none.

    Every state of K stays in C for one period under the command of every estimate of it, and is in
    K again then.
    """

    cells: Bools
    choice: Bytes
    commands: Floats
    admits: Masks
    """Per true cell of K: bit k says that command k, held for a period, leads back into K."""


@dataclass(frozen=True)
class RecoveryRanks:
    """W: rank per cell (0 = not in W, 1 = Q), holds N of each rank, longest time in ns to Q."""

    rank: npt.NDArray[np.uint16]
    holds: Bytes
    time_ns: npt.NDArray[np.int64]
    steps: int
    """Holds that were computed: what it took."""

    @property
    def cells(self) -> Bools:
        """Which cells are in W, in the grid's shape."""
        return np.asarray(self.rank != 0)

    @property
    def longest_ns(self) -> int:
        """The longest time from W to Q."""
        return int(self.time_ns[self.cells].max(initial=0))


def _spread(masks: Masks, first: Any, last: Any, axis: int) -> Masks:  # noqa: ANN401 - int arrays
    """AND over first[i]..last[i] along an axis (within the grid)."""
    n = masks.shape[axis]
    low, high = np.clip(first, 0, n - 1), np.clip(last, 0, n - 1)
    conjunction: Masks = np.take(masks, low, axis=axis)
    for k in range(1, int((high - low).max(initial=0)) + 1):
        conjunction &= np.take(masks, np.minimum(low + k, high), axis=axis)
    return conjunction


class _Synthesis:
    """One run of the fixpoint over commands."""

    def __init__(
        self,
        group: GridGroup,
        allowed: Bools,
        commands: Floats,
        errors: Mapping[int, float],
        prefer: Floats | None,
    ) -> None:
        self.group, self.commands, self.errors, self.prefer = group, commands, errors, prefer
        ffi, n, size = group.library.ffi, len(group.axes), allowed.size
        self.work = ffi.new("soter_reach_choice *")
        self.memory = group.rounds(self.work.r)
        self.allowed = group.bits(allowed)
        self.fine = np.empty(group.shape, dtype=np.uint64)
        self.image = np.empty((*group.shape, len(commands), n, 2), dtype=np.uint16)
        assert self.image.size == size * len(commands) * n * 2
        w, at = self.work, group.pointer
        w.allowed, w.fine = at(self.allowed, "uint64_t *"), at(self.fine, "uint64_t *")
        w.image, w.commands = at(self.image, "uint16_t *"), at(commands, "double *")
        w.count = len(commands)

    def settle(self) -> Bools:
        """Down to the fixpoint; gives K so far."""
        group, lib = self.group, self.group.library.lib
        while not lib.soter_reach_choice_continue(group.c, self.work, grids.SLICE_S, group.threads):
            share_done(0.0, "synthesis")  # nobody knows how many rounds are left
        return group.cells_of(self.memory["kept"])

    def of_estimates(self, kept: Bools) -> Masks:
        """Per estimate cell the commands that serve every compatible cell of K; ALL where none is.

        Where an axis has no error, an estimate on the lower face of its cell also is of the cell
        below, unless its own cell is in K: then it is that cell's as well.
        """
        masks = np.where(kept, self.fine, ALL)
        touched = self.group.touched(self.errors)
        exact = [not self.errors.get(s, 0.0) for s in self.group.axes]
        # exact axes first: while `masks` belong to true cells along the others, as `kept` does
        for a in sorted(range(len(exact)), key=lambda a: not exact[a]):
            first, last = touched[a]
            if not exact[a]:
                masks = _spread(masks, first, last, a)
                continue
            below = np.full_like(masks, ALL)
            into: list[slice] = [slice(None)] * masks.ndim
            out = list(into)
            into[a], out[a] = slice(1, None), slice(None, -1)
            below[tuple(into)] = masks[tuple(out)]
            masks = np.where(kept, masks, masks & below)
        return masks

    def conflicts(self, kept: Bools, masks: Masks) -> Bools:
        """Cells to give up because some estimate of theirs has no command that serves all.

        Of the commands, the one that serves most of the compatible cells is kept.
        """
        wanted, lost = np.argwhere(masks == 0), np.zeros_like(kept)
        reach = self.group.touched(self.errors)
        for at in wanted:
            box = tuple(
                slice(max(0, int(f[i]) - (not self.errors.get(s, 0.0))), int(t[i]) + 1)
                for i, s, (f, t) in zip(at, self.group.axes, reach, strict=True)
            )
            here, fine = kept[box] & ~lost[box], self.fine[box]
            serves = [
                int((here & ((fine >> np.uint64(k)) & np.uint64(1) != 0)).sum())
                for k in range(len(self.commands))
            ]
            best = np.uint64(int(np.argmax(serves)))
            lost[box] |= here & ((fine >> best) & np.uint64(1) == 0)
        return lost

    def run(self) -> CommandTable:
        group, lib = self.group, self.group.library.lib
        lib.soter_reach_choice_begin(group.c, self.work)
        while True:
            kept = self.settle()
            masks = self.of_estimates(kept)
            if masks.all():
                admits = np.where(kept, self.fine, np.uint64(0))
                return CommandTable(kept, self.chosen(kept, masks), self.commands, admits)
            lost = np.ascontiguousarray(self.conflicts(kept, masks)).view(np.uint8)
            lib.soter_reach_choice_remove(group.c, self.work, group.pointer(lost, "uint8_t *"))
            share_done(0.0, "synthesis")

    def chosen(self, kept: Bools, masks: Masks) -> Bytes:
        """One of the commands that serve; 255 where no state of K can be.

        The one whose image of the cell has the least `prefer` at its middle; the first one where
        it does not matter.
        """
        count = len(self.commands)
        serves = (masks[..., None] >> np.arange(count, dtype=np.uint64)) & np.uint64(1) != 0
        choice = np.argmax(serves, axis=-1).astype(np.uint8)
        if self.prefer is not None:
            own = serves & kept[..., None]
            image = np.where(own[..., None, None], self.image, 0)
            middle = tuple(
                (image[..., a, 0].astype(np.int32) + image[..., a, 1]) // 2
                for a in range(len(self.group.axes))
            )
            cost = np.where(own, self.prefer[middle], np.inf)
            choice = np.where(kept, np.argmin(cost, axis=-1), choice).astype(np.uint8)
        return np.asarray(np.where(masks == ALL, 255, choice), dtype=np.uint8)


def core_synthesis(
    group: GridGroup,
    allowed: Bools,
    commands: Sequence[Sequence[float]],
    *,
    errors: Mapping[int, float] | None = None,
    prefer: Floats | None = None,
) -> CommandTable:
    """K and a table of commands, each held for one period (N = 1).

    `allowed`: a set of the grid's shape; `commands`: up to 64 rows with a value of every control;
    `errors`: state -> largest error of the estimate; `prefer`: a cost per cell, in the grid's
    shape, the less the better (distance to a goal, say). A flow must be read without delay and
    jitter: widen `errors` by what the state moves meanwhile.
    """
    rows = np.ascontiguousarray(commands, dtype=np.float64)
    assert 1 <= len(rows) <= 64
    assert rows.shape[1] == len(group.inputs.controls), "a value of every control"
    assert group.inputs.delay_ns == 0
    assert group.inputs.jitter_ns == 0
    return _Synthesis(group, allowed, rows, errors or {}, prefer).run()


def way(
    group: GridGroup,
    core: Bools,
    constraint: Bools,
    goal: Bools,
    *,
    holds: Sequence[int] = HOLDS,
    before: RecoveryRanks | None = None,
) -> RecoveryRanks:
    """W: from which cells of `core` the law reaches `goal` (Q) on every run, and how soon.

    W_0 = Q, W_(k+1) = W_k and {c in `core`: for some N of `holds` the tube lies in `constraint`,
    the image over [N delta - j, N delta + j] in W_k and in `core`}. P2b needs W to cover K.

    `before`: a W to go on from, for what it lacks. The sets have the grid's shape.
    """
    ffi, lib = group.library.ffi, group.library.lib
    steps = np.array(sorted({h for h in holds if h <= grids.LONGEST}), dtype=np.int32)
    initial_way = before or _at_once(goal & core)
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
    memory = group.rounds(w.r)
    memory["kept"][:] = group.bits(rank != 0)
    inside, allowed = group.bits(constraint), group.bits(core)
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
        share_done(0.0, "way")  # the same
    del memory, inside, allowed, image, slot
    return RecoveryRanks(rank, taken, time_ns, sum(w.r.steps))


def _at_once(goal: Bools) -> RecoveryRanks:
    """W = Q."""
    none = np.zeros(goal.shape, np.int64)
    return RecoveryRanks(goal.astype(np.uint16), none.astype(np.uint8), none, 0)
