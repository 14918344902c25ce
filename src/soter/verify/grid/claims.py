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
from soter.verify.grid.case import axes_entry
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
    """A group's entry in a certificate.

    Its tables are added to `files`: witnesses as bytes, sets as bits.
    """
    group_entry = axes_entry(problem, group.group, stem, files)
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
        own = axes_entry(problem, group.finer[1], f"{stem}_Q", files)
        group_entry["Q_axes"] = [axis["edges"] for axis in own["axes"]]
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
"""The limit of periods per declared cell of C, on average, for a flow that is not linear: beyond it
K is given up. Of eight such robots with a K the most was 3.2, of two without one the least 60."""
CROSSED = (
    "; the differential equation keeps {ends}, and that the scheme which integrates it does "
    "was not shown"
)
CROSSED_HINT = "ranges that end a little further out, where the flow points inwards by itself"


@dataclass(eq=False)
class GridProof:
    """The proof of one group on a grid: its engine, and the sets that were found.

    Claims between K and the start are asked only if it is `fresh` and every group has a K.
    """

    group: Group
    engine: GridGroup
    found: GroupSets
    fresh: bool = True
    """Whether its sets are still to be computed; else they are those of an earlier attempt."""

    @property
    def cells(self) -> int:
        """How many cells the grid has."""
        return self.found.allowed.size

    @property
    def return_ns(self) -> int:
        """The longest time from W to Q, in ns."""
        return self.found.return_ns

    def take_constraint(self, case: Case, part: CellsPart) -> None:
        """Takes C_g, this group's part of C; a proof that had another one starts anew."""
        if not self.fresh and not np.array_equal(self.found.allowed, part.cells):
            case.make_fresh(self)
        if self.fresh:
            self.found.allowed = part.cells

    def find_core(self, case: Case) -> bool:
        """Computes K, a greatest fixpoint; False, and a failure of P2a, if K is empty."""
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
        """Computes R(H), the states from which no command in U leads out of K within H."""
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
        """Why `enters`, after which `safe` is not known, may hold outside R(H); or ""."""
        del case
        assert self.found.free is not None
        wrong = int((self.engine.cells_maybe_true("enters") & ~self.found.free).sum())
        names = ", ".join(a.name for a in self.group.axes)
        return f"it may hold on {wrong:,} cells of {names} outside R(H)" if wrong else ""

    def find_levels(self, case: Case) -> None:
        """Computes S_0, S_1, ..., the sets of estimates by which the DM decides."""
        estimate_sets.find_levels(case, self, self.engine, self.found)

    def without_levels(self) -> GridProof:
        """A copy of this proof with C, K and R(H) only."""
        f = self.found
        found = GroupSets(f.group, f.allowed, f.core, f.free, f.possible, solver=f.solver)
        return GridProof(self.group, self.engine, found)

    def take_table(self, case: Case, table: GroupTable) -> None:
        """Takes the DM's table and computes the states from which AC may have control by it."""
        estimate_sets.enter_table(case, self, self.engine, self.found, table)

    def wrong_at_start(self, at: tuple[NDArray[np.intp], ...], until_ns: int) -> list[Bools]:
        """The initial cells that are not in C, in K, in R(h_0): three sets (cells, ...)."""
        kept, found = self.found.core > 0, []
        for held in (self.found.allowed, kept, self.engine.cells_safe_for(until_ns, kept)):
            found.append(np.zeros_like(kept))
            found[-1][at] = ~held[at]
        return found

    def at_start(self, case: Case) -> tuple[NDArray[np.intp], ...] | None:
        """The cells of the initial states, one index an axis; None if the grid lacks some."""
        starts = [case.problem.initial[s] for s in self.engine.axes]
        box = cells_around_box(self.engine.spans, self.engine.turns, starts)
        at = [b for b in box if b is not None]
        return np.ix_(*at) if len(at) == len(box) else None

    def states_given_back(self, case: Case) -> CellsPart | None:
        """The states at which the DM's table gives AC control on any estimate."""
        cells = estimate_sets.states_with_control(case, self.engine, self.found)
        return None if cells is None else CellsPart(self.engine, cells)

    def find_recovery(self, case: Case, target: CellsPart) -> None:
        """Computes Q and W for a target, unless they are known for the same target."""
        before = None if self.fresh else self.found.target
        if before is not None and np.array_equal(before, target.cells):
            return
        recovery.enter_recovery(case, self, self.engine, self.found, target.cells)

    @property
    def stuck(self) -> float:
        """The share of K's cells from which no way to Q was found."""
        core, rank = self.found.core > 0, self.found.rank
        if rank is None:
            return 0.0
        return float((core & ~cells_in_way(self.found)).sum() / max(1, core.sum()))

    @property
    def core_cells(self) -> int:
        """How many cells K has."""
        return int(np.count_nonzero(self.found.core))

    def keep_way_only(self, case: Case) -> None:
        """Makes W the new K; if Q has smaller cells, only what SC keeps of W's declared cells."""
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
        """Gives boxes that together contain all of `cells`, a set of the grid's shape."""
        names = [a.name for a in self.group.axes]
        return regions_of(cells, names, self.engine.edges, parameters)

    @property
    def covers_scheme(self) -> bool:
        """Whether the simulator's steps are solutions of the engine's model."""
        return self.engine.covers_scheme

    @property
    def simultaneous_controls(self) -> tuple[int, ...]:
        """The commands that a chain takes to act at one instant: all, if several move the group."""
        c = self.engine.c
        moved = tuple(int(c.command[a]) for a in range(c.commands))
        return moved if len(moved) > 1 else ()

    def shares(self, case: Case) -> dict[str, float]:
        """The share of the grid's volume of each set; `estimates`: S_0, if it is computed."""
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
        """The share of C's volume that K has; 0 where C is empty."""
        part, edges = self.found, drawn_edges(self.found.group.axes)
        whole = volume_share(part.allowed, edges)
        return volume_share((part.core > 0) & part.allowed, edges) / whole if whole else 0.0

    @property
    def free_share(self) -> float | None:
        """The share of the grid's cells that R(H) has; None before it is known."""
        return None if self.found.free is None else float(np.mean(self.found.free))

    @property
    def overlap_of_predicates(self) -> tuple[float, bool] | None:
        """The share of K where AC gets and may keep control; whether there is any such state."""
        part, edges = self.found, drawn_edges(self.found.group.axes)
        if part.lets_ac is None or part.gives_back is None:
            return None
        core, lets = part.core > 0, part.lets_ac & part.gives_back
        whole = volume_share(core, edges)
        return volume_share(lets & core, edges) / whole if whole else 1.0, bool(lets.any())

    def excludes(self, predicate: str) -> bool:
        """Whether a predicate, as known so far, lets AC have control at no cell of K."""
        part = self.found
        lets = part.lets_ac if predicate == "ttf" else part.gives_back
        return lets is not None and not (lets & (part.core > 0)).any()

    def lets_share(self, case: Case, predicate: str) -> float | None:
        """The share of K where a predicate, or the DM's table, lets AC have control."""
        del case
        part, edges = self.found, drawn_edges(self.found.group.axes)
        by_predicate = part.deployed or (part.lets_ac, part.gives_back)
        cells = by_predicate[0 if predicate == "ttf" else 1]
        core = part.core > 0
        return (
            None if cells is None else volume_share(cells & core, edges) / volume_share(core, edges)
        )

    def waits_at_start(self, case: Case) -> bool:
        """Whether AC surely gets no control at the initial states."""
        at, gives_back = self.at_start(case), self.found.gives_back
        return at is not None and gives_back is not None and not gives_back[at].any()

    @property
    def deepest(self) -> Mapping[int, float]:
        """The middle of a cell far inside C: a number by state."""
        return deepest_cell(self.found)

    @property
    def pair(self) -> Estimates | None:
        """S_0 and S_(m-2) in the grid's shape, and what a shield permits; None without levels."""
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
        """The group's entry in a certificate; its tables are added to `files`."""
        return certificate_entry(problem, self.found, stem, files)

    def figures(self, note: str) -> list[RegionFigure]:
        """The figure of the grid's regions, as the only one."""
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
    """A new proof of a group, with an engine of its own.

    `UnboundedError` where the dynamics have no enclosure.
    """
    library, problem = case.forms.library, case.problem
    engine = GridGroup.of(library, problem, group, case.parameter)
    allowed = np.zeros(engine.shape, dtype=np.bool_)
    core = np.zeros(engine.shape, dtype=np.uint8)
    return GridProof(group, engine, GroupSets(group, allowed, core, solver=engine))


def set_factors(case: Case, predicate: str) -> list[CellsPart] | None:
    """For each group the cells on which a predicate holds, with other groups at one point.

    None where there are no such cells. That C is the product of these is checked later.
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


def cut_to_hint(case: Case, parts: Sequence[CellsPart]) -> list[CellsPart] | None:
    """The cells of `parts` on which the program's `core e;` holds, too; None: it holds nowhere."""
    hints = set_factors(case, "core")
    if hints is None:
        return None
    both = zip(parts, hints, strict=True)
    return [CellsPart(part.engine, part.cells & hint.cells) for part, hint in both]


def proved_in_words(done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
    """The text of a proved P2a, `ttf` or `safer`, with its counts of cells."""
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


def pack(every: Estimates) -> dict[str, NDArray[np.generic]]:
    """The levels as arrays to store: sets as bits, eight cells a byte, of shape (bytes,)."""
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


def unpack(group: Group, arrays: Arrays) -> Estimates:
    """The levels that `pack` stored: two sets of the grid's shape, and the shield's part.

    `KeyError` or `ValueError` where these are other arrays.
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


def pair_in_certificate(
    certificate: Certificate, group: Group, entry: Mapping[str, Any]
) -> Estimates | None:
    """The levels that a certificate has of a group, without what a shield permits.

    `RejectedError` where its files do not have the size that they should.
    """
    levels = entry.get("S", [])
    if not levels:
        return None
    shape = tuple(len(a.edges) - 1 for a in group.axes)
    outer, inner = (certificate.set_of_cells(levels[k], shape) for k in (0, -1))
    return Estimates(outer, inner)


def _cell_counts(every: Sequence[GroupSets]) -> tuple[list[int], list[int]]:
    """The numbers of cells of K, and those of the grids, a number per group."""
    return [int((g.core > 0).sum()) for g in every], [g.core.size for g in every]


def _unpacked_cells(bits: NDArray[np.uint8], shape: tuple[int, ...]) -> Bools:
    count = int(np.prod(shape))
    return np.unpackbits(bits, count=count).astype(np.bool_).reshape(shape)
