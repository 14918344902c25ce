"""The method of grids: a group's tables of cells, and its claims as inclusions, cell by cell.

Purpose: `GridGroup` reads the tables of one group (K, R, Q, W, S: `certificate/__init__.py`).
`GridCheck` turns each claim, as `case_check.py` asks for it, into tasks about blocks of cells
(docs/verification.md, section 3).
Non-goals: the inclusions themselves (`group_claims.py`), estimates and the table of a DM with
computed predicates (`estimates_and_shield.py`).
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.cell_predicates import AdmitCheck, cells_wrongly_admitted
from soter.certificate.cell_sets import Cells, Grid, cell_count, cut_block
from soter.certificate.extras import extras
from soter.certificate.grid.group_claims import (
    FREE_PIECES,
    PIECES,
    RESTS,
    ChainCheck,
    FreeCheck,
    GroupTables,
    cells_driven_out,
    cells_not_led,
    cells_not_nearer,
)
from soter.certificate.grid.sc_chains import is_grid_never_left
from soter.certificate.reading.linear_flows import has_linear_rates
from soter.certificate.report import GETS, KEEPS, NotRecheckedError, RejectedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Axes, Block
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.folder import Certificate
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import RecheckedModule
    from soter.language.model import typed

    Entry = dict[str, Any]
    """A part of a manifest."""
    Task = tuple[Callable[[], str], float]
    """A function that shows a part of a claim, and gives "", or what went wrong; and what that is
    likely to cost, in holds of one cell, for the progress alone."""

LOOK = 0.05
"""The cost of looking at a cell, where following it for one hold costs 1."""
BLOCKS = 24
"""Into how many blocks a grid is dealt out to the processors, at least."""
BLOCK = 1_000
"""About so many cells has a block of a larger grid: progress is told block by block."""
SMALL = 4_000
"""A grid with no more cells is not dealt out: it is not worth it."""


class GridGroup:
    """A group of states, for which a certificate has tables of cells.

    Raises RejectedError or NotRecheckedError if the tables are wrong.
    """

    required, optional = ("kind", "axes", "K"), ("R", "Q", "Q_axes", "W", "W_N", "S")

    def __init__(self, tables: GroupTables) -> None:
        self.tables, self.states = tables, tables.states

    @classmethod
    def read(cls, certificate: Certificate, facts: Facts, entry: Entry, axes: Axes) -> GridGroup:
        """Reads the tables of a group; raises RejectedError if a size differs from the grid's."""
        shape = shape_of_way = axes.grid.shape
        certificate.count_cells(shape)
        core = certificate.number_table(entry["K"], shape, "<u1")
        facts.at_rest |= bool((core == RESTS).any())
        tables = GroupTables(axes.states, axes.grid, core)
        if "R" in entry:
            tables.free = certificate.set_of_cells(entry["R"], shape)
        if "Q_axes" in entry:
            of_q = extras.estimates_and_shield.read_grid_of_q
            tables.finer = of_q(certificate, axes.grid, entry["Q_axes"])
            shape_of_way = tables.finer.shape
        if "Q" in entry:
            tables.home = certificate.number_table(entry["Q"], shape_of_way, "<u1")
        if "W" in entry:
            tables.rank = certificate.number_table(entry["W"], shape_of_way, "<u2")
            tables.rank_holds = certificate.number_table(entry.get("W_N"), shape_of_way, "<u1")
        tables.levels = [certificate.set_of_cells(path, shape) for path in entry.get("S", [])]
        return cls(tables)

    def make_check(self, model: CaseModel, lawful: Cells | None) -> GridCheck:
        """Makes the check that shows the claims of this group cell by cell."""
        return GridCheck(model, self.tables, lawful)

    def cells_kept_by_law(self, law: Sequence[GridGroup]) -> Cells:
        """The cells that the law keeps; raises RejectedError if its group has another grid."""
        tables = self.tables
        for other in (g.tables for g in law):
            if other.states == tables.states and other.grid.edges == tables.grid.edges:
                return Cells(tables.grid, other.core > 0)
        raise RejectedError("the law is looked at on other cells than SC")

    def add_size_to(self, report: RecheckedModule) -> None:
        """Adds the number of cells of the grid to a report."""
        report.cells += int(np.prod(self.tables.grid.shape))

    @property
    def why_never_ac(self) -> str:
        """Why the DM's table never gives AC control, or never lets AC keep control; else ""."""
        given_back, levels = self.tables.given_back, self.tables.levels
        if given_back is not None and not given_back.any():
            return f"{GETS} (the table gives it back on no estimate)"
        if levels and not levels[0].any():
            return f"{KEEPS} (the table leaves it in control on no estimate)"
        return ""

    def random_points(self, chance: np.random.Generator) -> Iterator[list[float]]:
        """Yields random points of K: each point is random within a random cell of K."""
        inside = np.argwhere(self.tables.core > 0)
        while len(inside):
            cell = inside[chance.integers(len(inside))]
            ends = [(e[i], e[i + 1]) for e, i in zip(self.tables.grid.edges, cell, strict=True)]
            yield [chance.uniform(*pair) for pair in ends]


class GridCheck:
    """Checks the claims about a group in a case, in the order in which they are asked.

    Raises RejectedError or NotRecheckedError if a claim does not hold. Tasks do the long
    computations, and may run in other processes.
    """

    def __init__(self, model: CaseModel, tables: GroupTables, lawful: Cells | None) -> None:
        self.model, self.tables, self.grid = model, tables, tables.grid
        self.lawful = lawful
        self.kernel = Cells(tables.grid, tables.core > 0)
        self.allowed = np.ones(tables.grid.shape, dtype=np.bool_)
        """Cells on which `safe` is certain, and all that is published in its set."""
        self.kept = is_grid_never_left(model, tables.states)
        """Whether no run leaves the grid, whatever is commanded."""
        self.chain_checks: list[ChainCheck] = []
        """The checks of chains that were made, those of finer cells among them."""

    @property
    def shows_rates_defined(self) -> bool:
        """Whether chains follow a nonlinear flow and therefore need defined rates."""
        return not self.kept and not has_linear_rates(self.model, self.tables.states)

    @cached_property
    def chains(self) -> ChainCheck:
        """The chains of SC; compiles the first ones now, before processes are forked."""
        check = ChainCheck(self.model, self.tables)
        check.compiled_chain(PIECES[0])
        self.chain_checks.append(check)
        return check

    def are_never_left(self, *sets: Cells) -> bool:
        """Whether each set is the whole grid, and no run leaves this grid."""
        return self.kept and all(s.members.all() for s in sets)

    def note_safe_cells(self, cells: Cells) -> None:
        """Notes the cells on which `safe` is certain. Raises RejectedError if K is empty."""
        if self.kernel.size == 0:
            raise RejectedError("K is empty")
        self.allowed &= cells.members

    def keep_in_topic_set(self, topic: int, cells: Cells) -> None:
        """Demands that SC keeps the state in `cells`, because a publishing plant stops elsewhere.

        Raises RejectedError if K has other cells.
        """
        if (self.kernel.members & ~cells.members).any():
            name = self.model.facts.system.topics[topic].name
            raise RejectedError(
                f"K holds states of which it was not shown that what a plant publishes on "
                f"`{name}` lies in its declared set: elsewhere it stops"
            )
        self.allowed &= cells.members

    def core_tasks(self) -> Iterable[Task]:
        """Tasks that show that SC leads each cell of K back to K, after the cell's number of holds.

        Raises RejectedError if `safe` is not certain on a cell of K.
        """
        text = "`safe`"
        if self.lawful is not None:
            text = f"{text}, or what the law keeps,"
            self.allowed &= self.lawful.members
        if (self.kernel.members & ~self.allowed).any():
            raise RejectedError(f"K holds cells on which {text} is not certain")
        if self.are_never_left(self.kernel):
            return ()
        within, tasks, at_rest = (
            Cells(self.grid, self.allowed),
            [],
            np.asarray(self.tables.core == RESTS),
        )
        if at_rest.any():
            still = extras.resting.resting_cells_unshown(self.model, self.tables, at_rest, within)
            tasks = [*block_tasks("SC does not certainly stand still from", self.grid, still)]
        holds = np.where(at_rest, 0, self.tables.core)
        show = partial(cells_not_led, self.chains, holds, within, self.kernel)
        text = "SC does not certainly lead back to K from"
        return [*tasks, *block_tasks(text, self.grid, show, holds)]

    def free_tasks(self, horizon_ns: int) -> Iterable[Task]:
        """Tasks that show that no command leads from R out of K. Raises RejectedError without R."""
        if self.tables.free is None:
            raise RejectedError("a claim needs R, which is not there")
        if self.are_never_left(self.kernel):
            return ()
        check = FreeCheck(self.model, self.tables, horizon_ns)
        check.compiled_steps(FREE_PIECES[0])
        show = partial(cells_driven_out, check, self.tables.free, self.kernel)
        return block_tasks("some command leads out of K within H from", self.grid, show)

    def predicate_tasks(self, name: str, expr: typed.TypedExpr, *, admits: bool) -> Iterable[Task]:
        """Tasks that show that a predicate leaves AC in control on no cell outside of R."""
        assert self.tables.free is not None
        if self.tables.free.all():
            return ()
        check = AdmitCheck(self.model, self.tables, expr, admits=admits)
        show = partial(cells_wrongly_admitted, check, self.tables.free)
        return block_tasks(f"`{name}` may leave AC in control outside R(H) in", self.grid, show)

    def tasks_for_levels(self, ns_between_verdicts: int) -> Iterator[Task]:
        """Tasks that show the sets S if predicates are computed."""
        yield from extras.estimates_and_shield.level_tasks(self, ns_between_verdicts)

    @property
    def holds_to_return(self) -> int:
        """The sum, in holds, of each rank's longest chain; raises RejectedError without ranks."""
        rank, holds = self.tables.rank, self.tables.rank_holds
        if rank is None or holds is None:
            raise RejectedError("a claim needs Q and W, which are not there")
        of_rank = np.zeros(int(rank.max()) + 1, dtype=np.int64)
        np.maximum.at(of_rank, rank.reshape(-1), holds.reshape(-1))
        return int(of_rank[1:].sum())

    def return_tasks(self, calm: Cells | None) -> Iterator[Task]:
        """Tasks that show that SC stays in Q, and leads all other cells of W to lower ranks.

        Raises RejectedError if Q, W or the DM's table is missing or if they do not fit, and
        NotRecheckedError if K has cells from which SC comes to rest.
        """
        tables = self.tables
        if np.any(tables.core == RESTS):
            raise NotRecheckedError("P2b: K has cells at rest, from which SC leads nowhere")
        if tables.finer is not None:
            if tables.given_back is None:
                raise RejectedError("Q has cells of its own, and the DM has no table")
            finer = extras.estimates_and_shield.tables_on_finer_cells(tables)
            check = GridCheck(self.model, finer, self.lawful)
            check.chain_checks = self.chain_checks
            yield from check.return_tasks(None)
            return
        if calm is None:
            if tables.given_back is None:
                raise RejectedError("a claim needs the table of the DM, which is not there")
            calm = extras.estimates_and_shield.eroded_cells(
                self.model, tables, Cells(self.grid, tables.given_back)
            )
        if tables.home is None or tables.rank is None or tables.rank_holds is None:
            raise RejectedError("a claim needs Q and W, which are not there")
        home = Cells(self.grid, tables.home > 0)
        if (home.members & ~calm.members).any():
            raise RejectedError("Q holds cells on which `safer` is not certain")
        if (self.kernel.members & ~home.members & (tables.rank == 0)).any():
            raise RejectedError("W does not hold all of K")
        if (home.members & (tables.rank != 1)).any():
            raise RejectedError("W does not begin with Q")
        if ((tables.rank <= 1) & (tables.rank_holds > 0)).any():
            raise RejectedError("W says how long it takes where there is nowhere to go")
        if self.are_never_left(home):
            return
        kept = partial(cells_not_led, self.chains, tables.home, calm, home)
        text = "SC does not certainly stay where `safer` holds from"
        yield from block_tasks(text, self.grid, kept, tables.home)
        nearer = partial(cells_not_nearer, self.chains, home)
        text = "SC does not certainly come nearer to Q from"
        yield from block_tasks(text, self.grid, nearer, tables.rank_holds)

    def start_tasks(self, until_ns: int) -> Iterable[Task]:
        """Shows at once that initial states stay in K until SC acts, or raises RejectedError."""
        states = [self.model.facts.states[i] for i in self.tables.states]
        box = Grid(tuple(self.grid.move_onto_axis(k, s.low, s.high) for k, s in enumerate(states)))
        inside = self.grid.cells_around([end for edges in box.edges for end in edges]) is not None
        if not (inside and self.are_never_left(self.kernel)):
            check = FreeCheck(self.model, self.tables, until_ns)
            if not check.stays_in(box.box_of(box.all_cells), self.kernel, FREE_PIECES[-1]):
                raise RejectedError("an initial state may leave K before SC acts")
        return ()


def block_tasks(
    text: str,
    grid: Grid,
    show: Callable[[Block], Iterator[Block]],
    holds: NDArray[Any] | None = None,
) -> Iterator[Task]:
    """Tasks for a claim about all cells of a grid, in blocks; `show` yields the failing cells.

    `holds`, of the grid's shape: for how many holds to follow each cell; None for less than one.
    """
    cells = int(np.prod(grid.shape))
    for block in cut_block(grid.all_cells, max(BLOCKS, cells // BLOCK) if cells > SMALL else 1):
        work = LOOK * cell_count(block)
        if holds is not None:
            work += float(holds[tuple(slice(a, b) for a, b in block)].sum(dtype=np.float64))
        yield partial(_failure_in_block, text, grid, show, block), work


def _failure_in_block(
    text: str, grid: Grid, show: Callable[[Block], Iterator[Block]], block: Block
) -> str:
    failed = next(show(block), None)
    return "" if failed is None else f"{text} {grid.block_in_words(failed)}"
