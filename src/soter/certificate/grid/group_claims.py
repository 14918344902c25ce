"""The inclusions of sets of cells that the claims about a grid consist of, computed anew.

Purpose: `cells_not_led` and `cells_not_nearer` show for `grid_group.py` where SC leads from the
cells of K, Q and W, along chains (`ChainCheck`); `cells_driven_out` where any command leads from
those of R(H) (`FreeCheck`).
Non-goals: predicates (`cell_predicates.py`), which claims there are (`grid_group.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cell_sets import (
    Axes,
    Cells,
    Grid,
    block_index,
    cell_count,
    cells_uncovered,
    cells_unshown,
    holds_in_parts,
)
from soter.certificate.grid.sc_chains import (
    EVERY,
    Window,
    free_phase_steps,
    sc_chain,
    windows_of_runs,
)
from soter.certificate.terms.compile_terms import form_of_box
from soter.certificate.terms.linear_enclosures import HALF, larger, lower, smaller, upper

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Block
    from soter.certificate.grid.sc_chains import Chain
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.compile_terms import Step

CELLS_AT_ONCE = 256
PIECES = (1, 4)
"""Into how many pieces a tube is cut, first and where that was not enough."""
FREE_PIECES = (4, 16, 64)  # the prover cuts as finely as the last
SPLITS = 6
"""How often a single cell is halved before it counts as failed."""
SPLITS_CUT = 4
"""How often it is halved where sets are halved on the way as well."""
MID_CUTS = (4, 7)
"""How often sets are halved on the way, at equal distances; each time doubles the work left."""
LED_IN = ((0, 0), (SPLITS_CUT, MID_CUTS[0]), (SPLITS, 0), (SPLITS_CUT, MID_CUTS[1]))
"""(how often a cell is halved, how often sets on the way are): tried one after the other."""
UNRANKED = 1 << 20
RESTS = 255
"""The number of a cell from which SC comes to rest (`extras/resting.py`), in place of holds."""


@dataclass(eq=False)
class GroupTables(Axes):
    """The sets of a group in the certificate (`certificate/__init__.py` explains the letters).

    Each table is shaped as the grid; the tables of the way back are shaped as `finer` if present.
    """

    core: NDArray[np.uint8]
    """K: after how many holds of SC the state is in K again; 0: the cell is none of K.

    `RESTS` in place of a number: from there SC stays in C for ever."""
    free: NDArray[np.bool_] | None = None
    """R(H)."""
    home: NDArray[np.uint8] | None = None
    """Q: after how many holds of SC the state is in Q again; 0: the cell is none of Q."""
    rank: NDArray[np.uint16] | None = None
    """W: 1 on Q, k + 1 on W_k; 0: the cell is none of W."""
    rank_holds: NDArray[np.uint8] | None = None
    """W_N: in how many holds SC leads from a cell of W to lower ranks; 0 on Q."""
    levels: list[NDArray[np.bool_]] = field(default_factory=list)
    """S_0, S_1, ..., S_(m-2), of estimates."""
    given_back: NDArray[np.bool_] | None = None
    """Estimates on which the table of the DM gives control back to AC: S_(m-2) of all cases."""
    tops: NDArray[np.uint8] | None = None
    """The table of a shield, (*grid, command cells): for each cell of estimates and least command
    cell the number of cells up to the greatest that is permitted with it, 0 where none is."""
    command: int | None = None
    """The control that it is about; None: none moves the group."""
    finer: Grid | None = None
    """The smaller cells of `home`, `rank` and `rank_holds`; None: they are those of all else."""


# ---------------------------------------------------------------- chains


@dataclass(frozen=True)
class _TargetCells:
    """Cells in which runs from a box, and runs from beyond the ends of axes, are to be."""

    cells: Cells
    start: list[tuple[arb, arb]]

    def contains_all(self, boxes: Sequence[float]) -> bool:
        """Whether all boxes, and runs from beyond the axes' ends, lie in the set."""
        return self.cells.contains_all(boxes) and self.holds_beyond(boxes)

    def holds_beyond(self, boxes: Sequence[float]) -> bool:
        """Whether these boxes also enclose runs from beyond the axes' ends."""
        return self.cells.grid.holds_beyond_ends(self.start, boxes)


class ChainCheck:
    """Asks whether SC leads from boxes into a set, and stays in another set on the way."""

    def __init__(self, model: CaseModel, group: GroupTables) -> None:
        self.model, self.group = model, group
        self.delay_ns = model.facts.delay_ns
        """How old the reads of its chains may be: as the manifest claims or, where that is too
        much, as old as the program's are."""
        self._chains: dict[tuple[int, Window], Chain] = {}

    def compiled_chain(self, pieces: int, window: Window = EVERY) -> Chain:
        """The chain of a window, compiled on first use."""
        key = pieces, window
        if key not in self._chains:
            of = self.model, self.group.states, self.delay_ns
            self._chains[key] = sc_chain(*of, pieces, window)
        return self._chains[key]

    def _window_splits(self) -> list[tuple[Window, ...]]:
        """Lists ways to split all runs into windows, in the order to try; the first is unsplit."""
        of = self.model, self.group.states, self.delay_ns
        parts, aged = windows_of_runs(*of), windows_of_runs(*of, by_age=True)
        return list(dict.fromkeys([(EVERY,), parts, aged]))

    def leads_to(
        self,
        box: list[tuple[arb, arb]],
        holds: int,
        within: Cells,
        target: Callable[[Sequence[float]], bool],
        pieces: int,
        *,
        cuts: int = 0,
        window: Window = EVERY,
    ) -> bool:
        """Whether all runs from a box are in `target` after `holds`, and `within` until then."""
        reached = self.follow(box, [holds], within, pieces, cuts=cuts, window=window)
        return any(all(map(target, ends)) for _, ends in reached)

    def follow(
        self,
        box: list[tuple[arb, arb]],
        wanted: Sequence[int],
        within: Cells,
        pieces: int,
        *,
        cuts: int = 0,
        window: Window = EVERY,
    ) -> Iterator[tuple[int, list[tuple[float, ...]]]]:
        """Yields (N, boxes of all states after N holds) for each wanted N, while all is within.

        N is left out if the boxes may leave `within` before N delta + j. `cuts`: how often sets are
        halved on the way, along the effect of errors and disturbances. `window`: which runs are
        followed.
        """
        chain, set_ = self.compiled_chain(pieces, window), _TargetCells(within, box)
        forms, step, last = [form_of_box(box, symbols=True)], chain.first, max(wanted, default=0)
        at = {last * k // (cuts + 1) for k in range(1, cuts + 1)} - {0}
        for k in range(last):
            if k in at:
                forms = [half for form in forms for half in self._halves_of_form(form)]
            after = []
            for form in forms:
                image = step(form)
                if image is None or not set_.contains_all(image[1]):
                    return
                after.append(image[0])
            forms, step = after, chain.later
            if k + 1 in wanted:
                ends = [self._boxes_at_switch(chain, form, set_) for form in forms]
                if ends and all(ends):  # nothing is said of no box
                    yield k + 1, [end for some in ends for end in some or ()]

    def _boxes_at_switch(
        self, chain: Chain, form: tuple[arb, ...], within: _TargetCells
    ) -> list[tuple[float, ...]] | None:
        """The boxes of all states while the last command may act; None if one leaves `within`."""
        n = len(self.group.states)
        if chain.last is None:
            end = _box_of_states(form, n)
            return [end] if within.holds_beyond(end) else None
        image = chain.last(form)
        if image is None or not within.contains_all(image[1]):
            return None
        boxes = image[1]
        return [boxes[k : k + 2 * n] for k in range(0, len(boxes), 2 * n)]

    def leads_in_parts(
        self,
        box: list[tuple[arb, arb]],
        holds: int,
        within: Cells,
        target: Callable[[Sequence[float]], bool],
    ) -> bool:
        """Whether `leads_to` holds with finer tubes, for parts of the box and of later sets.

        If not, it tries each of several windows separately. If the manifest claims older reads than
        the program has, this check uses the program's reads from then on.
        """
        own_delay_ns = self.model.facts.derived.delay

        def all_lead(part: list[tuple[arb, arb]], some: Sequence[Window], cuts: int) -> bool:
            return all(
                self.leads_to(part, holds, within, target, PIECES[1], cuts=cuts, window=w)
                for w in some
            )

        for some in self._window_splits():
            if any(holds_in_parts(box, partial(all_lead, some=some, cuts=c), n) for n, c in LED_IN):
                return True
            if self.delay_ns != own_delay_ns:
                self.delay_ns = own_delay_ns
                self._chains.clear()
                return self.leads_in_parts(box, holds, within, target)
        return False

    def _halves_of_form(self, form: tuple[arb, ...]) -> list[tuple[arb, ...]]:
        """The halves of a form, cut at the beta of the state whose rest is widest in cells."""
        n = len(self.group.states)
        widths = [(e[-1] - e[0]) / (len(e) - 1) for e in self.group.grid.edges]
        count = count_states(len(form), n)
        rest = 2 * count + count + count * n
        axis = max(range(n), key=lambda i: float(form[rest + i]) / widths[i])
        return [half_of_form(form, n, axis, side) for side in (-HALF, HALF)]


def _box_of_states(form: Sequence[arb], n: int) -> tuple[float, ...]:
    bounds: list[float] = []
    for i in range(n):
        bounds += (lower(form[2 * i]), upper(form[2 * i + 1]))
    return tuple(bounds)


def count_states(length: int, n: int) -> int:
    """The number of states and memories in a form: 4 + n numbers each, n more for a memory."""
    return (length + n * n) // (4 + 2 * n)


def half_of_form(form: tuple[arb, ...], n: int, axis: int, side: arb) -> tuple[arb, ...]:
    """The part of a form in which the beta of a state lies on one side of 0.

    beta = side + beta'/2, side = 1/2 or -1/2: centres move by side times their coefficient of beta.
    """
    count = count_states(len(form), n)
    new = list(form)
    centre, symbols = 2 * count, 3 * count
    rest = symbols + count * n
    common = rest + count
    b = form[rest + axis]
    new[centre + axis] += side * b
    new[rest + axis] = b * HALF
    for k in range(count - n):
        new[centre + n + k] += side * b * form[common + k * n + axis]
    radius = new[rest + axis]
    for k in range(n):
        radius += abs(form[symbols + axis * n + k])
    new[2 * axis] = larger(new[centre + axis] - radius, form[2 * axis])
    new[2 * axis + 1] = smaller(new[centre + axis] + radius, form[2 * axis + 1])
    return tuple(new)


def cells_not_led(
    check: ChainCheck,
    witnesses: NDArray[np.uint8],
    within: Cells,
    target: Cells,
    block: Block,
) -> Iterator[Block]:
    """The cells with a witness from which SC does not certainly lead to the target.

    `witnesses`: the number of holds, or 0 for no witness, in the grid's shape.
    """
    grid = check.group.grid

    def attempt(at: Block, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        due = witnesses[block_index(at)]
        shown = np.zeros_like(wanted)
        for holds, ends in check.follow(
            grid.box_of(at), distinct_holds(due, wanted), within, PIECES[0]
        ):
            if all(target.contains(end) for end in ends):
                shown |= wanted & (due == holds)
        return shown

    def leads_to(cell: Block) -> bool:
        holds = int(witnesses[block_index(cell)].flat[0])
        return check.leads_in_parts(grid.box_of(cell), holds, within, target.contains)

    waiting = cells_unshown(witnesses > 0, block, attempt, CELLS_AT_ONCE)
    return (cell for cell in waiting if not leads_to(cell))


def distinct_holds(witnesses: NDArray[np.uint8], wanted: NDArray[np.bool_]) -> list[int]:
    """The hold counts of the wanted cells, in rising order; both arrays have the same shape."""
    return [int(n) for n in np.unique(witnesses[wanted]) if n > 0]


def cells_not_nearer(check: ChainCheck, home: Cells, block: Block) -> Iterator[Block]:
    """Yields the cells of W from which SC may not lead to cells of lower rank."""
    group = check.group
    assert group.rank is not None
    assert group.rank_holds is not None
    grid, every_holds = group.grid, group.rank_holds
    order = group.rank.astype(np.int64)  # wider than a table: UNRANKED has no place in 16 bits
    order[order == 0] = UNRANKED
    order[home.members] = 0
    around = grid.table_continued(order)
    everywhere = Cells(grid, np.ones(grid.shape, dtype=np.bool_))

    def highest_rank(box: Sequence[float]) -> int:
        cells = grid.cells_around(box)
        if cells is None:
            return UNRANKED
        return int(around[block_index(cells)].max())

    todo = (group.rank > 0) & ~home.members

    def attempt(at: Block, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        due, ranks = every_holds[block_index(at)], order[block_index(at)]
        shown = np.zeros_like(wanted)
        for holds, ends in check.follow(
            grid.box_of(at), distinct_holds(due, wanted), everywhere, PIECES[0]
        ):
            top = max(highest_rank(end) for end in ends)
            shown |= wanted & (due == holds) & (ranks > top)
        return shown

    def leads_to(cell: Block) -> bool:
        holds, rank = (int(x[block_index(cell)].flat[0]) for x in (every_holds, order))
        return holds > 0 and check.leads_in_parts(
            grid.box_of(cell), holds, everywhere, lambda end: highest_rank(end) < rank
        )

    waiting = cells_unshown(todo, block, attempt, CELLS_AT_ONCE)
    return (cell for cell in waiting if not leads_to(cell))


# ---------------------------------------------------------------- free phases


class FreeCheck:
    """Checks whether runs from boxes stay in a set for some time, under any commands."""

    def __init__(self, model: CaseModel, group: GroupTables, time_ns: int) -> None:
        self.model, self.group, self.time_ns = model, group, time_ns
        self._phases: dict[int, tuple[Step, ...]] = {}

    def compiled_steps(self, pieces: int) -> tuple[Step, ...]:
        """The steps of the free phase, compiled on first use."""
        if pieces not in self._phases:
            self._phases[pieces] = free_phase_steps(
                self.model, self.group.states, self.time_ns, pieces
            )
        return self._phases[pieces]

    def stays_in(self, box: list[tuple[arb, arb]], within: Cells, pieces: int) -> bool:
        """Whether all runs from a box stay in `within` during [0, time]."""
        maps = self.model.facts.kind == "map"
        form = form_of_box(box, symbols=True)
        start = _box_of_states(form, len(self.group.states))
        set_ = _TargetCells(within, box)
        if not within.contains(start):
            return False
        for step in self.compiled_steps(pieces):
            image = step(form)
            if image is None or not set_.contains_all(image[1]):
                return False
            if maps:
                form = image[0]
        return True

    def stays_in_parts(self, box: list[tuple[arb, arb]], within: Cells, splits: int) -> bool:
        """Whether `stays_in` holds, possibly with finer tubes on parts halved `splits` times."""
        if self.stays_in(box, within, FREE_PIECES[0]):
            return True
        tried = (partial(self.stays_in, within=within, pieces=n) for n in FREE_PIECES[1:])
        return splits > 0 and any(holds_in_parts(box, stays, splits) for stays in tried)


def cells_driven_out(
    check: FreeCheck, claimed: NDArray[np.bool_], within: Cells, block: Block
) -> Iterator[Block]:
    """Yields cells of `claimed` (shaped as the grid) that a command may drive out of `within`."""
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        return check.stays_in_parts(grid.box_of(at), within, SPLITS if cell_count(at) == 1 else 0)

    return cells_uncovered(claimed, block, attempt, 4 * CELLS_AT_ONCE)
