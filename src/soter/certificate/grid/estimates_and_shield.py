"""The sets S of computed predicates, and the table of a shield: inclusions about estimates.

Purpose: for `GridCheck.levels` and `home`. `eroded`: the cells of states all of whose estimates lie
in a set; `levels_hold`, `driven_estimates`: the states behind the estimates of a cell lie, or
stay, in a set. `to_show`: commands that a shield permits on an estimate lead from no state behind
it out of K before SC's first output acts (docs/proof-flight.md, A gate that looks at commands).
Non-goals: free phases (`group_claims.py`), which claims there are, the table's bytes
(`grid_group.py`); that the DM reads its table as it should.

The set of a command is cut into n cells at low + (high - low) (k / n). Where commands of the cells
i to j may act, so may those of some of these: for every cell of estimates and every i the greatest
j is shown.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cell_sets import Cells, uncovered, volume
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.grid.group_claims import CELLS_AT_ONCE, SPLITS, FreeCheck
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import number_of
from soter.certificate.reading.problem import error_of
from soter.certificate.reading.symbolic_operations import FAR_TURNS
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import (
    TINIEST,
    UNIT_ROUNDOFF,
    above,
    below,
    exact,
    magnitude,
)
from soter.language.model.tree_walk import topic_reads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Block
    from soter.certificate.grid.group_claims import GroupTables
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Component
    from soter.language.model.typed import TopicSymbol

    Show = Callable[[Block], Iterator[Block]]


def around(model: CaseModel, group: GroupTables, box: list[tuple[arb, arb]]) -> tuple[float, ...]:
    """The box of all estimates of states in a box, and of all states behind estimates in it.

    Of a state that no topic shows nothing is known: it is anywhere on its axis.
    """
    bounds: list[float] = []
    for state, (low, high) in zip(group.states, box, strict=True):
        bounds += _estimates_of(model, state, low, high)
    return tuple(bounds)


def _estimates_of(model: CaseModel, state: int, low: arb, high: arb) -> tuple[float, float]:
    """The range of all estimates of one state that is in [low, high]."""
    if state not in model.facts.leaves:
        return model.extents[state]
    error = exact(error_of(model.facts, state))
    if state in model.facts.turning:  # the DM brings it back to the grid
        error += FAR_TURNS
    if not error.is_zero():
        error += (magnitude(low).max(magnitude(high)) + error) * (2 * UNIT_ROUNDOFF) + TINIEST
    return below(low - error), above(high + error)


def eroded(model: CaseModel, group: GroupTables, level: Cells) -> Cells:
    """Cells of states all of whose estimates lie in a level; and of estimates of such states.

    An error is as large on either side, so that the same set answers both.
    """
    grid = group.grid
    ends = [
        [_estimates_of(model, state, low, high) for low, high in pairwise(map(exact, edges))]
        for state, edges in zip(group.states, grid.edges, strict=True)
    ]
    members = np.zeros(grid.shape, dtype=np.bool_)
    for cell in map(tuple, np.argwhere(level.members)):
        box = [end for i, axis in zip(cell, ends, strict=True) for end in axis[i]]
        members[cell] = level.contains(box)
    return Cells(grid, members)


def levels_hold(
    model: CaseModel, group: GroupTables, claimed: NDArray[np.bool_], inside: Cells, block: Block
) -> Iterator[Block]:
    """The `claimed` cells of estimates (shaped as the grid) behind which a state may be outside."""

    def attempt(at: Block) -> bool:
        return inside.contains(around(model, group, group.grid.box(at)))

    return uncovered(claimed, block, attempt, 1 << 20)


def driven_estimates(
    check: FreeCheck, claimed: NDArray[np.bool_], within: Cells, block: Block
) -> Iterator[Block]:
    """The `claimed` cells of estimates from behind which a state may be driven out of `within`.

    `claimed`: shaped as the grid. Any command acts, for the time of `check`.
    """
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        ends = around(check.model, check.group, grid.box(at))
        box = [(exact(a), exact(b)) for a, b in zip(ends[::2], ends[1::2], strict=True)]
        return check.keeps(box, within, SPLITS if volume(at) == 1 else 0)

    return uncovered(claimed, block, attempt, 4 * CELLS_AT_ONCE)


def cells_of(facts: Facts) -> int:
    """The number of cells into which a shield's table cuts each number of a command.

    NotRecheckedError where no proof of a shield is known here, RejectedError where none can be.
    """
    assert facts.symbol.shield is not None
    if facts.view or any(e.clocks for e in facts.setting.effects) or not _passes_on(facts):
        raise NotRecheckedError("a shield of a view, or with nodes behind the module")
    if facts.kind == "map" and not _steps_with_plants(facts):
        raise NotRecheckedError("a shield of an AC that runs between the steps of its plant")
    if {r.name for r in facts.setting.by_sc} - {r.name for r in facts.setting.by_dm}:
        raise NotRecheckedError("a shield of an SC that reads what the DM does not")
    topics = {topic for topic, _ in facts.leaves.values()}
    if any(facts.system.topics[i].max_age_ns is None for i in topics):
        raise RejectedError("a shield reads a topic without a `max_age`")
    return int(number_of(facts, facts.symbol.shield))


def _steps_with_plants(facts: Facts) -> bool:
    """Whether AC steps only when the plants, which move in steps, do."""
    step = facts.plants[0].period_ns
    ac = facts.system.components[facts.module.ac]
    return ac.period_ns % step == 0 and ac.phase_ns % step == 0


def _passes_on(facts: Facts) -> bool:
    """Whether every node behind SC in its instant runs in its thread, and reads commands alone.

    What reads sensors, too, or has a memory has to show what it says to the plants of the proof.
    """
    system, names = facts.flying, {n for kind, n in facts.ways.notes if kind == "in step"}
    nodes = [c for c in system.components if c.node is not None and c.name in names]
    shown = topic_reads(*(link.value for link in facts.symbol.verify.abstracts))
    told = set(facts.flying_module.outputs)
    for c in nodes:
        assert c.node is not None
        told |= {*c.writes}
    return all(c.in_thread and (_reads_only(c, told) or _is_shown(c, shown)) for c in nodes)


def _reads_only(c: Component, told: set[int]) -> bool:
    assert c.node is not None
    return {*c.reads} <= told and not c.node.locals


def _is_shown(c: Component, shown: Iterable[TopicSymbol]) -> bool:
    assert c.node is not None
    return set(c.node.publishes) <= set(shown)


def to_show(model: CaseModel, group: GroupTables, core: Cells) -> Iterator[tuple[str, Show]]:
    """(failure in words, function of a block) for each inclusion of a shield's table.

    RejectedError where the table is not there, or is of another command.
    """
    n, tops = cells_of(model.facts), group.tops
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
    edges = [control.low, *(cut(control.low, control.high, k, n) for k in range(1, n))]
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
            what = f"{control.name} in {ends}, which the shield permits, may lead out of K from"
            yield what, partial(driven_estimates, check, claimed, core)


def cut(low: float, high: float, k: int, n: int) -> float:
    """The number at which cell k of n begins."""
    return low + (high - low) * (k / n)


def tops_of(data: bytes, group: GroupTables, n: int) -> NDArray[np.uint8]:
    """`GroupTables.tops` of a file, (*cells, n): in C order, a byte for each command cell.

    RejectedError where it has another size, or names cells that there are not.
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
