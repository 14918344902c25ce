"""What a DM with computed predicates has in its tables: the sets S, and commands of a shield.

Purpose: `compare_tables` compares the bytes of the DM's tables with the sets S of all cases;
`level_tasks` shows these sets: `eroded_cells` gives the cells of states all of whose estimates lie
in a set; `estimates_of_states_outside`, `estimates_driven_out` yield the cells of estimates behind
which a state may lie, or may be driven, outside of one. `shield_inclusions`: commands that a shield
permits on an estimate lead from no state behind it out of K before SC's first output acts
(docs/proof-flight.md, A gate that looks at commands). `read_grid_of_q`, `tables_on_finer_cells`: a
Q with smaller cells, which needs such a table.
Non-goals: free phases (`group_claims.py`), which claims there are (`grid_group.py`); that the DM
reads its table as it should.

The set of a command is cut into n cells at low + (high - low) (k / n). Where commands of the cells
i to j may act, so may those of some of these: for every cell of estimates and every i the greatest
j is shown.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.cell_sets import Cells, Grid, cell_count, cells_uncovered
from soter.certificate.extras.left_out_states import reached_breakpoints
from soter.certificate.extras.prelude_functions import FAR_TURNS
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.grid.grid_group import block_tasks
from soter.certificate.grid.group_claims import CELLS_AT_ONCE, SPLITS, FreeCheck, GroupTables
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import const_value
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import (
    TINIEST,
    UNIT_ROUNDOFF,
    exact,
    lower,
    magnitude,
    upper,
)
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Block
    from soter.certificate.grid.grid_group import Entry, GridCheck, GridGroup, Task
    from soter.certificate.reading.folder import Certificate
    from soter.certificate.reading.module_facts import Facts

    Show = Callable[[Block], Iterator[Block]]


BITS = 2
"""Bits of a cell's level in the DM's table.

0: `ttf` holds; 1: the cell is in S_0 of every case, so AC keeps control; 2: it is in S_(m-2) of
every case, so AC gets control.
"""
FULL = 2
"""The greatest level."""
CELLS_IN_A_BYTE = 4


def estimate_error(facts: Facts, state: int) -> float:
    """The error bound of a state's estimate, in the topic leaf that is its axis.

    NotRecheckedError where no topic has the state as its axis.
    """
    if state not in facts.leaves:
        raise NotRecheckedError(f"no topic carries `{facts.states[state].name}` as its axis")
    topic, path = facts.leaves[state]
    leaf = [at for at, _ in leaves(facts.system.topics[topic].type)].index(path)
    measured = [m for c in facts.plants for m in c.measured]
    return max((m.bound for m in measured if (m.topic, m.leaf) == (topic, leaf)), default=0.0)


def estimates_around(
    model: CaseModel, group: GroupTables, box: list[tuple[arb, arb]]
) -> tuple[float, ...]:
    """The box (low, high, ...) of all estimates of states in a box, and of all states behind them.

    A state that no topic shows is anywhere on its axis.
    """
    bounds: list[float] = []
    for state, (low, high) in zip(group.states, box, strict=True):
        bounds += _estimate_range(model, state, low, high)
    return tuple(bounds)


def _estimate_range(model: CaseModel, state: int, low: arb, high: arb) -> tuple[float, float]:
    if state not in model.facts.leaves:
        return model.extents[state]
    error = exact(estimate_error(model.facts, state))
    if state in model.facts.turning:  # the DM brings it back to the grid
        error += FAR_TURNS
    if not error.is_zero():
        error += (magnitude(low).max(magnitude(high)) + error) * (2 * UNIT_ROUNDOFF) + TINIEST
    return lower(low - error), upper(high + error)


def eroded_cells(model: CaseModel, group: GroupTables, level: Cells) -> Cells:
    """The cells whose states have all their estimates in a level, and the reverse.

    One set answers both questions, as an error is equally large in both directions.
    """
    grid = group.grid
    ends = [
        [_estimate_range(model, state, low, high) for low, high in pairwise(map(exact, edges))]
        for state, edges in zip(group.states, grid.edges, strict=True)
    ]
    members = np.zeros(grid.shape, dtype=np.bool_)
    for cell in map(tuple, np.argwhere(level.members)):
        box = [end for i, axis in zip(cell, ends, strict=True) for end in axis[i]]
        members[cell] = level.contains(box)
    return Cells(grid, members)


def estimates_of_states_outside(
    model: CaseModel, group: GroupTables, claimed: NDArray[np.bool_], inside: Cells, block: Block
) -> Iterator[Block]:
    """The `claimed` cells (shaped as the grid) whose estimates may be of states not `inside`."""

    def attempt(at: Block) -> bool:
        return inside.contains(estimates_around(model, group, group.grid.box_of(at)))

    return cells_uncovered(claimed, block, attempt, 1 << 20)


def estimates_driven_out(
    check: FreeCheck, claimed: NDArray[np.bool_], within: Cells, block: Block
) -> Iterator[Block]:
    """The `claimed` cells of estimates behind which commands may drive a state out of `within`.

    `claimed`: shaped as the grid. Any command acts, for the time of `check`.
    """
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        ends = estimates_around(check.model, check.group, grid.box_of(at))
        box = [(exact(a), exact(b)) for a, b in zip(ends[::2], ends[1::2], strict=True)]
        return check.stays_in_parts(box, within, SPLITS if cell_count(at) == 1 else 0)

    return cells_uncovered(claimed, block, attempt, 4 * CELLS_AT_ONCE)


def level_tasks(check: GridCheck, ns_between_verdicts: int) -> Iterator[Task]:
    """Tasks that show S_0 from R, each S_k from S_(k-1), and the commands that a shield permits.

    Raises RejectedError if a set S is missing, or is no subset of the set before it.
    """
    tables, grid, model = check.tables, check.grid, check.model
    facts = model.facts
    assert tables.free is not None
    if len(tables.levels) != facts.levels - 1:
        raise RejectedError("the tables S are not as many as the levels ask for")
    levels = tables.levels
    inside = Cells(grid, tables.free)
    show: Any = partial(estimates_of_states_outside, model, tables, levels[0], inside)
    yield from block_tasks("an estimate in S_0 may be of a state outside R(H), in", grid, show)
    if facts.symbol.shield is not None:
        for failure, of_commands in shield_inclusions(model, tables, check.kernel):
            yield from block_tasks(failure, grid, of_commands)
    free = FreeCheck(model, tables, ns_between_verdicts)
    for k in range(1, len(levels)):
        if (levels[k] & ~levels[k - 1]).any():
            raise RejectedError(f"S_{k} is no part of S_{k - 1}")
        calm = eroded_cells(model, tables, Cells(grid, levels[k - 1]))
        if not check.are_never_left(calm):
            show = partial(estimates_driven_out, free, levels[k], calm)
            failure = f"S_{k} may be left for outside S_{k - 1} at once, from"
            yield from block_tasks(failure, grid, show)


def command_cells(facts: Facts) -> int:
    """The number of cells into which a shield's table divides each number of a command.

    Raises NotRecheckedError if no proof of this shield is known here.
    """
    assert facts.symbol.shield is not None
    if (
        facts.view
        or any(e.clocks for e in facts.setting.effects)
        or not _do_nodes_pass_commands_on(facts)
    ):
        raise NotRecheckedError("a shield of a view, or with nodes behind the module")
    if facts.kind == "map" and not _ac_steps_with_plants(facts):
        raise NotRecheckedError("a shield of an AC that runs between the steps of its plant")
    if {r.name for r in facts.setting.by_sc} - {r.name for r in facts.setting.by_dm}:
        raise NotRecheckedError("a shield of an SC that reads what the DM does not")
    topics = {topic for topic, _ in facts.leaves.values()}
    assert all(facts.system.topics[i].max_age_ns is not None for i in topics)  # `_timing_setting`
    return int(const_value(facts, facts.symbol.shield))


def _ac_steps_with_plants(facts: Facts) -> bool:
    """Whether AC steps only at instants at which the plants step, too."""
    step = facts.plants[0].period_ns
    ac = facts.system.components[facts.module.ac]
    return ac.period_ns % step == 0 and ac.phase_ns % step == 0


def _do_nodes_pass_commands_on(facts: Facts) -> bool:
    """Whether nodes behind SC in its instant run in its thread, and read commands alone.

    A node that reads sensors, too, or keeps locals must show its outputs to the proof's plants.
    """
    system, names = facts.flying, {n for kind, n in facts.ways.notes if kind == "in step"}
    nodes = [(c, c.node) for c in system.components if c.node is not None and c.name in names]
    shown = {*topic_reads(*(link.value for link in facts.symbol.verify.abstracts))}
    passed_on = {*facts.flying_module.outputs}.union(*(c.writes for c, _ in nodes))
    return all(
        (c.inline or not c.extern)
        and (({*c.reads} <= passed_on and not node.locals) or {*node.publishes} <= shown)
        for c, node in nodes
    )


def shield_inclusions(
    model: CaseModel, group: GroupTables, core: Cells
) -> Iterator[tuple[str, Show]]:
    """A failure text and a function of a block, for each inclusion that a shield's table needs.

    Raises RejectedError if the table is missing or is for another command.
    """
    n, tops = command_cells(model.facts), group.tops
    if tops is None:
        raise RejectedError("the table of the shield is not there")
    moving = LocalFlow(model, group.states).moves
    beyond = ~group.levels[0]
    if moving != ([] if group.command is None else [group.command]):
        raise RejectedError("a shield is of a group that one command moves, and says which")
    if group.command is None:
        if tops[beyond].any():
            raise RejectedError("the shield permits commands where no command keeps K")
        return
    control = model.facts.controls[group.command]
    edges = [control.low, *(command_edge(control.low, control.high, k, n) for k in range(1, n))]
    edges.append(control.high)
    horizon = model.facts.times["H_ns"]
    for i in range(n):
        for j in range(i, n):
            claimed = beyond & (tops[..., i] == j + 1)
            if not claimed.any():
                continue
            facts = copy(model.facts)
            facts.controls = list(facts.controls)
            facts.controls[group.command] = replace(control, low=edges[i], high=edges[j + 1])
            between = CaseModel(facts, model.parameter, model.extents)
            check = FreeCheck(between, group, horizon)
            ends = f"[{edges[i]:g}, {edges[j + 1]:g}]"
            failure = f"{control.name} in {ends}, which the shield permits, may lead out of K from"
            yield failure, partial(estimates_driven_out, check, claimed, core)


def command_edge(low: float, high: float, k: int, n: int) -> float:
    """The number at which cell k of n of a command begins."""
    return low + (high - low) * (k / n)


def read_shield_table(data: bytes, group: GroupTables, n: int) -> NDArray[np.uint8]:
    """Reads `GroupTables.tops` from a file, (*cells, n): in C order, a byte for each command cell.

    Raises RejectedError if the size is wrong or a cell does not exist.
    """
    shape = (*group.grid.shape, n)
    if len(data) != int(np.prod(shape)):
        raise RejectedError("the table of the shield has another size")
    tops = np.frombuffer(data, dtype=np.uint8).reshape(shape)
    if (tops > n).any():
        raise RejectedError("the table of the shield names cells that there are not")
    if ((tops > 0) & (tops <= np.arange(n))).any():
        raise RejectedError("the table of the shield names a greatest cell below the least one")
    return tops


# ---------------------------------------------------------------- the DM's table


def compare_tables(
    certificate: Certificate, facts: Facts, cases: list[list[GridGroup]], entries: list[Entry]
) -> None:
    """Raises RejectedError if a group's table in the DM differs from the sets S of all cases."""
    if len(entries) != len(cases[0]):
        raise RejectedError("the tables of the DM are not one for each group")
    if any(len(case) != len(cases[0]) for case in cases):
        raise RejectedError("the cases have other groups, and the DM has one table for all")
    for same, entry in zip(zip(*cases, strict=True), entries, strict=True):
        compare_table(certificate, facts, [g.tables for g in same], entry)


def compare_table(
    certificate: Certificate, facts: Facts, tables: Sequence[GroupTables], entry: Entry
) -> None:
    """Raises RejectedError if the DM's table of a group differs from the sets S of all cases."""
    group = tables[0]
    shield = {"command", "commands"} if facts.symbol.shield is not None else set()
    if entry.keys() != {"axes", "levels", *shield}:
        raise RejectedError("a table of the DM is not as it should be")
    if any(g.states != group.states or g.grid.edges != group.grid.edges for g in tables):
        raise RejectedError("the cases have other grids, and the DM has one table for all")
    names = [facts.states[i].name for i in group.states]
    require_same_axes(certificate, group, names, axes_seen_by_dm(facts, group), entry["axes"])
    total = least_levels(tables)
    if certificate.table_bytes(entry["levels"]) != packed_levels(total):
        raise RejectedError(f"the table of the DM over {', '.join(names)} is not that of S")
    for g in tables:
        g.given_back = total == FULL
        if shield:
            read_shield(certificate, facts, g, entry)


def require_same_axes(
    certificate: Certificate,
    group: GroupTables,
    names: Sequence[str],
    looked_at: Sequence[int],
    axes: Sequence[Entry],
) -> None:
    """Raises RejectedError if the axes of the DM's table are not those that it sees of the group.

    `names`: of the group's states; `looked_at`: from `axes_seen_by_dm`; `axes`: from the manifest.
    """
    if [a["state"] for a in axes] != [names[k] for k in looked_at]:
        raise RejectedError("a table of the DM has other axes than its group")
    for axis, place in zip(axes, looked_at, strict=True):
        edges = reached_breakpoints(group.grid, place)
        if axis.keys() != {"state", "edges"} or certificate.breakpoints(axis["edges"]) != edges:
            raise RejectedError(f"the DM cuts {axis['state']} elsewhere than its group")


def axes_seen_by_dm(facts: Facts, group: GroupTables) -> list[int]:
    """The axes of a group that the DM can see.

    A state that no topic of the DM shows may be anywhere on its axis (`estimates_around`), whatever
    the other estimates are. Raises NotRecheckedError if its axis has several cells.
    """
    axes = []
    for k, (state, cells) in enumerate(zip(group.states, group.grid.shape, strict=True)):
        if state in facts.leaves:
            axes.append(k)
        elif cells != 1:
            name = facts.states[state].name
            raise NotRecheckedError(
                f"no topic shows `{name}` to the DM, and its axis has cells: write `/ 1` in its "
                "`grid`, or a topic of the plant that shows it and that SC or a predicate reads"
            )
    return axes


def least_levels(cases: Sequence[GroupTables]) -> NDArray[np.uint8]:
    """The least level of each cell over all cases of a group, in the grid's shape.

    Raises RejectedError if a case has no tables S.
    """
    total = np.full(cases[0].grid.shape, FULL, dtype=np.uint8)
    for group in cases:
        if not group.levels:
            raise RejectedError("the tables S are not there")
        outer, inner = group.levels[0], group.levels[-1]
        total = np.minimum(total, np.where(outer, np.where(inner, FULL, 1), 0).astype(np.uint8))
    return total


def packed_levels(levels: NDArray[np.uint8]) -> bytes:
    """The bytes of the DM's table: two bits for each cell, the first cell in the lowest bits.

    `levels`: 0, 1 or 2 (`BITS`), in the grid's shape.
    """
    cells = levels.reshape(-1).tolist()
    data = bytearray(-(-len(cells) // CELLS_IN_A_BYTE))
    for k, level in enumerate(cells):
        data[k // CELLS_IN_A_BYTE] |= level << (BITS * (k % CELLS_IN_A_BYTE))
    return bytes(data)


def command_memory_ns(facts: Facts) -> int:
    """W, in ns: how long a replaced command may still act on a state that the DM reads.

    The state is at most A old. A command acts up to L after the next one is published. Of that time
    only its release is known, so a period of SC and the latest end of a step of SC are added.
    """
    setting = facts.setting
    out = max(setting.latest_start(t) + setting.sc.response - t for t in setting.settled_releases())
    return facts.derived.age + max(e.most for e in setting.effects) + setting.sc.period + out


def read_shield(certificate: Certificate, facts: Facts, group: GroupTables, entry: Entry) -> None:
    """Reads which commands the DM's shield permits. Raises RejectedError for an unknown command."""
    names = [c.name for c in facts.controls]
    if entry["command"] is not None and entry["command"] not in names:
        raise RejectedError("a table of the DM is about a command that there is not")
    group.command = None if entry["command"] is None else names.index(entry["command"])
    group.tops = read_shield_table(
        certificate.table_bytes(entry["commands"]), group, command_cells(facts)
    )


def read_grid_of_q(certificate: Certificate, grid: Grid, paths: Sequence[str]) -> Grid:
    """Reads the grid of Q; raises RejectedError unless each cell lies in one cell of `grid`."""
    edges = tuple(map(certificate.breakpoints, paths))
    same = len(edges) == len(grid.edges) and all(
        set(coarse) <= set(cut) and (coarse[0], coarse[-1]) == (cut[0], cut[-1])
        for coarse, cut in zip(grid.edges, edges, strict=False)
    )
    if not same:
        raise RejectedError("the cells of Q are no parts of those of its group")
    finer = replace(grid, edges=edges)
    certificate.count_cells(finer.shape)
    return finer


def tables_on_finer_cells(tables: GroupTables) -> GroupTables:
    """A copy of the tables of a group for the smaller cells of Q."""
    grid = tables.finer
    assert grid is not None
    places = zip(tables.grid.edges, grid.edges, strict=True)
    at = np.ix_(*(np.searchsorted(e, f[:-1], side="right") - 1 for e, f in places))
    given_back = None if tables.given_back is None else tables.given_back[at]
    made = GroupTables(tables.states, grid, tables.core[at], given_back=given_back)
    made.home, made.rank, made.rank_holds = tables.home, tables.rank, tables.rank_holds
    return made
