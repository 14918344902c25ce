"""The proof method "grid": claims about one group on cells, and its entry in a certificate.

Purpose: `GridProof` computes the sets of one group (C, K, R(H), S_j, Q, W: head of `sets.py`) and
checks the claims about them cell by cell; `new_proof` opens one; `entry` writes the sets into a
certificate as tables, one entry a cell.
Non-goals: computing sets (`sets.py`), P2b (`recovery.py`), levels (`estimate_sets.py`),
figures (`set_figures.py`); checking a certificate (`soter recheck`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.model.types import show_ns
from soter.verify.claims.product_sets import CellsPart, points_to_try, states_elsewhere
from soter.verify.claims.results import GroupSets
from soter.verify.deploy.level_tables import CommandTable, Estimates, GroupTable
from soter.verify.grid import estimate_sets, recovery
from soter.verify.grid.case import certificate_axes_entry
from soter.verify.grid.grid_refinement import cells_around_box, regions_of
from soter.verify.grid.recovery import cells_in_way
from soter.verify.grid.resting import cells_at_rest
from soter.verify.grid.scheme_error import STIFF_HINT
from soter.verify.grid.set_figures import deepest_cell, drawn_edges, figure_of_regions, volume_share
from soter.verify.grid.sets import RESTS, GridGroup
from soter.verify.problem.problem_times import look_ahead_advice

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.certificate.reading.folder import Certificate
    from soter.core.layout import Bools, Floats
    from soter.report.proof_page import RegionFigure
    from soter.verify.claims.results import Region
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Group, Problem

    Arrays = Mapping[str, NDArray[np.generic]]


def certificate_entry(
    problem: Problem, group: GroupSets, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """Gives a group's entry in a certificate and adds the group's tables to `files`.

    A table has one byte per cell for witnesses and one bit per cell for sets.
    """
    group_entry = certificate_axes_entry(problem, group.group, stem, files)
    rank, holds = group.rank, group.rank_holds
    if rank is not None and holds is not None and group.home is not None:
        rank = np.where(group.home > 0, 1, rank)
        holds = np.where(rank > 1, holds, 0)
    tables = {
        "K": _table_bytes(group.core, "<u1"),
        "R": _packed_bits(group.free),
        "Q": _table_bytes(group.home, "<u1"),
        "W": _table_bytes(rank, "<u2"),
        "W_N": _table_bytes(holds, "<u1"),
    }
    if group.finer is not None:
        finer_entry = certificate_axes_entry(problem, group.finer[1], f"{stem}_Q", files)
        group_entry["Q_axes"] = [axis["edges"] for axis in finer_entry["axes"]]
    for key, data in tables.items():
        if data is not None:
            files[f"{stem}_{key}.bin"] = data
            group_entry[key] = f"{stem}_{key}.bin"
    if group.levels:
        group_entry["S"] = []
    for k, level in enumerate(group.levels):
        name = f"{stem}_S{k}.bin"
        files[name] = _packed_bits(level) or b""
        group_entry["S"].append(name)
    return group_entry


def _table_bytes(table: NDArray[Any] | None, kind: str) -> bytes | None:
    return None if table is None else np.ascontiguousarray(table).astype(kind).tobytes()


def _packed_bits(table: NDArray[Any] | None) -> bytes | None:
    if table is None:
        return None
    return np.packbits(np.ascontiguousarray(table).reshape(-1), bitorder="little").tobytes()


HOLDS = 12
"""The most periods of SC computed per declared cell of C, on average, for a nonlinear flow; beyond
them K is given up. Eight such robots with a K needed 3.2 at most, two without one at least 60."""
CROSSED = (
    "; the differential equation keeps {ends}, and that the scheme which integrates it does "
    "was not shown"
)
CROSSED_HINT = "ranges that end a little further out, where the flow points inwards by itself"


@dataclass(eq=False)
class GridProof:
    """The proof of one group on a grid, with the group's engine and the sets found so far.

    The claims that follow from K are examined only if the proof is `fresh` and no K is empty.
    """

    group: Group
    engine: GridGroup
    found: GroupSets
    fresh: bool = True
    """Whether the sets are still to be computed; otherwise an earlier attempt computed them."""

    @property
    def cells(self) -> int:
        """The number of cells of the grid."""
        return self.found.allowed.size

    @property
    def return_ns(self) -> int:
        """The longest time from W to Q, in ns."""
        return self.found.return_ns

    def take_constraint(self, case: Case, part: CellsPart) -> None:
        """Stores C_g, this group's part of C; if it has changed, the proof starts anew."""
        if not self.fresh and not np.array_equal(self.found.allowed, part.cells):
            case.make_fresh(self)
        if self.fresh:
            self.found.allowed = part.cells

    def find_core(self, case: Case) -> bool:
        """Computes K and returns whether it has cells; if not, enters a failure of P2a."""
        if self.engine.stiff:
            case.fail("P2a", self.engine.stiff, self, STIFF_HINT)
        rests = np.zeros(self.engine.shape, dtype=np.bool_)
        if case.problem.stays:
            rests = cells_at_rest(case, self.engine, self.found.allowed)
        holds = case.holds or (0 if self.engine.is_linear or case.vain else HOLDS)
        kept = self.engine.compute_core(
            self.found.allowed, vain=case.vain, holds=holds, resting=rests
        )
        self.found.core = kept.witness
        case.raise_count("rounds", kept.rounds)
        case.raise_count("longest", int(np.where(rests, 0, kept.witness).max()))
        if kept.witness.any():
            return True
        hint = "a wider grid; a stronger SC; smaller errors, delays or disturbances"
        text = "K is empty: no set was found that SC keeps"
        if self.engine.crossed:
            text += CROSSED.format(ends=", ".join(self.engine.crossed))
            hint = CROSSED_HINT
        failure = case.fail("P2a", text, self, hint)
        if case.holds or not kept.spent:
            failure.cells = self.found.allowed
        return False

    def find_free_states(self, case: Case) -> None:
        """Computes R(H), the states that no command in U leads out of K within the horizon H."""
        horizon = case.problem.whole_periods(case.problem.times.horizon_ns)
        self.found.free = self.engine.cells_safe_for(horizon, self.found.core > 0)

    def check_inclusion(self, case: Case, predicate: str) -> None:
        """Enters a failure where a predicate may let AC have control at a state outside R(H)."""
        part = self.found
        if part.possible is None:
            part.possible = self.engine.cells_maybe_true("safe")
        if predicate == "ttf":
            part.lets_ac = lets = self.engine.cells_maybe_false("ttf") & part.possible
        else:
            part.gives_back = lets = self.engine.cells_maybe_true("safer") & part.possible
        assert part.free is not None
        wrong = lets & ~part.free
        if wrong.any():
            says = "may be false" if predicate == "ttf" else "may be true"
            count = int(wrong.sum())
            text = f"`{predicate}` {says} on {count} cells from which AC could leave K within H"
            hint = look_ahead_advice(case.problem.times, predicate)
            case.fail(predicate, text, self, hint).cells = wrong

    def why_not_entered(self, case: Case) -> str:
        """The reason why `enters` may hold outside R(H), in words; "" if it cannot hold there."""
        del case
        assert self.found.free is not None
        wrong = int((self.engine.cells_maybe_true("enters") & ~self.found.free).sum())
        names = ", ".join(a.name for a in self.group.axes)
        return f"it may hold on {wrong:,} cells of {names} outside R(H)" if wrong else ""

    def find_levels(self, case: Case) -> None:
        """Computes S_0, S_1, ...: the sets of estimates by which the DM decides."""
        estimate_sets.find_levels(case, self, self.engine, self.found)

    def without_levels(self) -> GridProof:
        """A copy of this proof that has no sets but C, K and R(H)."""
        f = self.found
        found = GroupSets(f.group, f.allowed, f.core, f.free, f.possible, solver=f.solver)
        return GridProof(self.group, self.engine, found)

    def take_table(self, case: Case, table: GroupTable) -> None:
        """Stores the DM's table and computes the states where the table may give AC control."""
        estimate_sets.enter_table(case, self, self.engine, self.found, table)

    def unshown_start_cells(self, at: tuple[NDArray[np.intp], ...], until_ns: int) -> list[Bools]:
        """The sets of initial cells outside C, outside K, and outside R(h_0), each (cells, ...)."""
        kept, found = self.found.core > 0, []
        for held in (self.found.allowed, kept, self.engine.cells_safe_for(until_ns, kept)):
            found.append(np.zeros_like(kept))
            found[-1][at] = ~held[at]
        return found

    def index_of_start_cells(self, case: Case) -> tuple[NDArray[np.intp], ...] | None:
        """The indices of the initial states' cells, one array per axis; None if one is outside."""
        starts = [case.problem.initial[s] for s in self.engine.axes]
        box = cells_around_box(self.engine.spans, self.engine.turns, starts)
        at = [b for b in box if b is not None]
        return np.ix_(*at) if len(at) == len(box) else None

    def cells_that_give_ac_control(self, case: Case) -> CellsPart | None:
        """Cells where the DM's table gives AC control at every estimate; None without a table."""
        cells = estimate_sets.states_with_control(case, self.engine, self.found)
        return None if cells is None else CellsPart(self.engine, cells)

    def find_recovery(self, case: Case, target: CellsPart) -> None:
        """Computes Q and W for a target set, unless they are already known for this target."""
        before = None if self.fresh else self.found.target
        if before is not None and np.array_equal(before, target.cells):
            return
        recovery.enter_recovery(case, self, self.engine, self.found, target.cells)

    @property
    def stuck_share(self) -> float:
        """The share of the cells of K from which no way to Q was found."""
        core, rank = self.found.core > 0, self.found.rank
        if rank is None:
            return 0.0
        return float((core & ~cells_in_way(self.found)).sum() / max(1, core.sum()))

    @property
    def core_cells(self) -> int:
        """The number of cells of K."""
        return int(np.count_nonzero(self.found.core))

    def restrict_core_to_way(self, case: Case) -> None:
        """Replaces K by W, or, if Q is on smaller cells, by what SC keeps of W's declared cells."""
        part = self.found
        assert part.home is not None
        assert part.rank is not None
        assert part.rank_holds is not None
        if part.finer is not None:
            members = (part.core > 0) & cells_in_way(part)
            part.core = self.engine.compute_core(part.allowed, members=members).witness
        else:
            part.core = np.where(part.rank == 1, part.home, part.rank_holds)
            part.core[part.rank == 0] = 0
        case.raise_count("longest", int(part.core.max()))

    def boxes_around(self, cells: Bools, parameters: Sequence[tuple[str, int]]) -> list[Region]:
        """Boxes that together contain all of `cells`, a set of the grid's shape."""
        names = [a.name for a in self.group.axes]
        return regions_of(cells, names, self.engine.edges, parameters)

    @property
    def covers_scheme(self) -> bool:
        """Whether the simulator's steps are solutions of the engine's model."""
        return self.engine.covers_scheme

    @property
    def simultaneous_controls(self) -> tuple[int, ...]:
        """The commands assumed to act at once: all if several move the group, otherwise none."""
        c = self.engine.c
        moved = tuple(int(c.command[a]) for a in range(c.commands))
        return moved if len(moved) > 1 else ()

    def volume_shares(self, case: Case) -> dict[str, float]:
        """The share of the grid's volume of each known set, by name; `estimates` stands for S_0."""
        del case
        part, edges = self.found, drawn_edges(self.found.group.axes)
        sets = {
            "core": part.core > 0,
            "free": part.free,
            "lets_ac": part.lets_ac,
            "gives_back": part.gives_back,
            "estimates": part.deployed[0] if part.levels and part.deployed is not None else None,
        }
        return {n: volume_share(np.asarray(s), edges) for n, s in sets.items() if s is not None}

    def random_states(self, chance: np.random.Generator, count: int) -> Floats:
        """Random states, uniform on the cells of K, of shape (count, axes)."""
        core, edges = np.argwhere(self.found.core > 0), drawn_edges(self.found.group.axes)
        sizes = np.prod([np.diff(e)[core[:, k]] for k, e in enumerate(edges)], axis=0)
        at = core[chance.choice(len(core), count, p=sizes / sizes.sum())]
        low = np.stack([e[at[:, k]] for k, e in enumerate(edges)], axis=1)
        high = np.stack([e[at[:, k] + 1] for k, e in enumerate(edges)], axis=1)
        return np.asarray(chance.uniform(low, high))

    @property
    def core_share(self) -> float | None:
        """The volume of K as a share of the volume of C; 0 if C is empty."""
        part, edges = self.found, drawn_edges(self.found.group.axes)
        whole = volume_share(part.allowed, edges)
        return volume_share((part.core > 0) & part.allowed, edges) / whole if whole else 0.0

    @property
    def free_share(self) -> float | None:
        """The cells of R(H) as a share of the grid's cells; None if R(H) is not known."""
        return None if self.found.free is None else float(np.mean(self.found.free))

    @property
    def overlap_of_predicates(self) -> tuple[float, bool] | None:
        """The share of K where AC gets and may keep control, and whether any cell is such a one."""
        part, edges = self.found, drawn_edges(self.found.group.axes)
        if part.lets_ac is None or part.gives_back is None:
            return None
        core, lets = part.core > 0, part.lets_ac & part.gives_back
        whole = volume_share(core, edges)
        return volume_share(lets & core, edges) / whole if whole else 1.0, bool(lets.any())

    def never_lets_ac(self, predicate: str) -> bool:
        """Whether a predicate is known to let AC have control at no cell of K."""
        part = self.found
        lets = part.lets_ac if predicate == "ttf" else part.gives_back
        return lets is not None and not (lets & (part.core > 0)).any()

    def share_of_core_with_ac(self, case: Case, predicate: str) -> float | None:
        """The share of K where a predicate or the table lets AC have control; None if unknown."""
        del case
        part, edges = self.found, drawn_edges(self.found.group.axes)
        by_predicate = part.deployed or (part.lets_ac, part.gives_back)
        cells = by_predicate[0 if predicate == "ttf" else 1]
        core = part.core > 0
        return (
            None if cells is None else volume_share(cells & core, edges) / volume_share(core, edges)
        )

    def waits_at_start(self, case: Case) -> bool:
        """Whether AC certainly gets no control at the initial states."""
        at, gives_back = self.index_of_start_cells(case), self.found.gives_back
        return at is not None and gives_back is not None and not gives_back[at].any()

    @property
    def deepest_state(self) -> Mapping[int, float]:
        """The middle of a cell far inside C, as values by the numbers of the states."""
        return deepest_cell(self.found)

    @property
    def estimate_levels(self) -> Estimates | None:
        """S_0, S_(m-2) and the commands that a shield permits; None if no levels are known."""
        part = self.found
        if not part.levels:
            return None
        commands = (
            None
            if part.tops is None
            else CommandTable(part.command, part.tops, lasting=part.lasting)
        )
        return Estimates(part.levels[0], part.levels[-1], commands)

    def certificate_entry(
        self, problem: Problem, stem: str, files: dict[str, bytes]
    ) -> dict[str, object]:
        """Gives the group's entry in a certificate, and adds the group's tables to `files`."""
        return certificate_entry(problem, self.found, stem, files)

    def region_figures(self, note: str) -> list[RegionFigure]:
        """A list of one figure, which shows the regions of the grid."""
        return [figure_of_regions(self.found, note)]


HOW = {
    "P2a": "greatest fixpoint over chains of SC periods",
    "P2b": "ranks over chains of SC periods",
    "ttf": "inclusion on every cell, all errors",
    "safer": "inclusion on every cell, all errors",
    "start": "inclusion of the initial states",
}
"""How each claim is shown, in words."""


def new_proof(case: Case, group: Group) -> GridProof:
    """A new proof of a group with a new engine; may raise `UnboundedError`."""
    library, problem = case.forms.library, case.problem
    engine = GridGroup.for_group(library, problem, group, case.parameter)
    allowed = np.zeros(engine.shape, dtype=np.bool_)
    core = np.zeros(engine.shape, dtype=np.uint8)
    return GridProof(group, engine, GroupSets(group, allowed, core, solver=engine))


def factors_of_predicate(case: Case, predicate: str) -> list[CellsPart] | None:
    """For each group the cells on which a predicate holds while other groups stay at one point.

    None where a group has no such cell. A later check shows that the set is their product.
    """
    engines = [p.engine for p in case.proofs]
    if len(engines) == 1:
        return [CellsPart(engines[0], engines[0].cells_true(predicate))]
    for point in points_to_try(case.problem):
        parts = []
        for engine in engines:
            elsewhere = states_elsewhere(case.problem, engine, point)
            parts.append(CellsPart(engine, engine.cells_true(predicate, ranges=elsewhere)))
        if all(part.cells.any() for part in parts):
            return parts
    return None


def parts_within_core_hint(case: Case, parts: Sequence[CellsPart]) -> list[CellsPart] | None:
    """The cells of `parts` where the program's `core` hint holds, too; None if it never holds."""
    hints = factors_of_predicate(case, "core")
    if hints is None:
        return None
    both = zip(parts, hints, strict=True)
    return [CellsPart(part.engine, part.cells & hint.cells) for part, hint in both]


def proved_in_words(done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
    """The text for a proved claim (P2a, `ttf` or `safer`), and the figures of the text by name."""
    every = [p.found for c in done for p in c.proofs]
    if claim == "P2a":
        cells, of = (sum(int(n) for n in x) for x in _cell_counts(every))
        longest = max(c.counts.get("longest", 0) for c in done)
        rounds = max(c.counts.get("rounds", 0) for c in done)
        span = show_ns(longest * done[0].problem.times.delta_sc)
        rest = sum(int((g.core == RESTS).sum()) for g in every)
        still = f"{rest:,} of them at rest, " if rest else ""
        text = f"{cells:,} of {of:,} cells, {still}chains up to {span}"
        return text, {"cells": cells, "longest": longest, "rounds": rounds}
    parts = [part.lets_ac if claim == "ttf" else part.gives_back for part in every]
    cells = sum(int(p.sum()) for p in parts if p is not None)
    return f"on {cells:,} cells", {"cells": cells}


def arrays_of_levels(every: Estimates) -> dict[str, NDArray[np.generic]]:
    """The levels as arrays to be stored, with eight cells per byte, each of shape (bytes,)."""
    both = (every.outer, every.inner)
    packed: dict[str, NDArray[np.generic]] = {
        str(k): np.packbits(np.asarray(cells)) for k, cells in enumerate(both)
    }
    if every.commands is not None:
        moved = every.commands.control
        packed["command"] = np.array([-1 if moved is None else moved])
        packed["tops"] = every.commands.tops
        if every.commands.lasting is not None:
            packed["lasting"] = every.commands.lasting
    return packed


def levels_from_arrays(group: Group, arrays: Arrays) -> Estimates:
    """Restores the levels from the arrays of `arrays_of_levels`, as sets of the grid's shape.

    Raises `KeyError` or `ValueError` if the arrays have another form.
    """
    shape = tuple(len(a.edges) - 1 for a in group.axes)
    outer, inner = (_unpacked_cells(np.asarray(arrays[k], np.uint8), shape) for k in ("0", "1"))
    if "tops" not in arrays:
        return Estimates(outer, inner)
    moved = int(arrays["command"][0])
    tops = np.asarray(arrays["tops"], np.uint8)
    lasting = np.asarray(arrays["lasting"], np.uint8) if "lasting" in arrays else None
    commands = CommandTable(None if moved < 0 else moved, tops, lasting=lasting)
    return Estimates(outer, inner, commands)


def levels_in_certificate(
    certificate: Certificate, group: Group, entry: Mapping[str, Any]
) -> Estimates | None:
    """The levels of a group in a certificate, without a shield's commands; None without levels.

    Raises `RejectedError` if a file has the wrong size.
    """
    levels = entry.get("S", [])
    if not levels:
        return None
    shape = tuple(len(a.edges) - 1 for a in group.axes)
    outer, inner = (certificate.set_of_cells(levels[k], shape) for k in (0, -1))
    return Estimates(outer, inner)


def _cell_counts(every: Sequence[GroupSets]) -> tuple[list[int], list[int]]:
    """The number of cells of K, and the number of all cells, of each group."""
    return [int((g.core > 0).sum()) for g in every], [g.core.size for g in every]


def _unpacked_cells(bits: NDArray[np.uint8], shape: tuple[int, ...]) -> Bools:
    count = int(np.prod(shape))
    return np.unpackbits(bits, count=count).astype(np.bool_).reshape(shape)
