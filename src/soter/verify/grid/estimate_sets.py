"""Sets of estimates on a grid: levels, the DM's table of them, commands that a shield permits.

Purpose: `find_levels` computes S_0, S_1, ... by eroding R(H) (docs/verification.md, section 3);
`enter_table` takes the DM's table, which all cases share, and enters the states from which AC may
have control by it. `find_permitted_commands` cuts the range of a shield's command into cells: for
each cell of estimates and each command cell it computes in `tops` up to which cell commands may act
together with those of that one, in any order, until SC's first output does (docs/proof-flight.md,
"A gate that looks at commands").
Non-goals: the tables (`verify/deploy/level_tables.py`, `shield_tables.py`). Symbols: `sets.py`.

R_V(H) is R(H) with a box V of commands in the place of U: the same engine, told that the group's
command lies in V. For a map V is one command, so one cell. Groups that several commands move have
no shield: between the first component of SC's output and the last one any command may act, and that
is not counted here. A shield `toward sc` looks for a command by `lasting`; what it finds is judged
by `tops` like any other command.

The DM does not see an axis that no topic shows: S_j holds only what is right anywhere on it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.deploy.level_tables import FULL
from soter.verify.deploy.shield_tables import command_edges
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.inputs import errors_by_state, topics_seen_by_dm

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.layout import Bools
    from soter.verify.claims.results import GroupSets
    from soter.verify.deploy.level_tables import GroupTable
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Problem


def find_permitted_commands(
    case: Case,
    proof: object,
    engine: GridGroup,
    part: GroupSets,
    all_unseen: Callable[[Bools], Bools],
) -> None:
    """Computes a group's `part.tops`; enters a failure of `ttf` if the group can have no shield.

    `all_unseen` removes from a set of the grid's shape every cell that is not in the set at all
    places along the axes that the DM does not see.
    """
    problem = case.problem
    assert problem.module.shield is not None
    n = problem.module.shield.cells
    part.tops = np.zeros((*part.allowed.shape, n), dtype=np.uint8)
    if why := _why_no_shield(problem, engine):
        case.fail("ttf", why[0], proof, why[1])
        return
    part.lasting = np.ones_like(part.tops) if problem.module.symbol.toward_sc else None
    if not engine.c.commands:
        part.tops[part.levels[0]] = n
        return
    part.command = int(engine.c.command[0])
    limits = problem.controls[part.command]
    edges = command_edges(limits.low, limits.high, n)
    core, errors = part.core > 0, errors_by_state(problem)
    horizon = problem.whole_periods(problem.times.horizon_ns)
    for i in range(n):
        permitted = np.ones(part.allowed.shape, dtype=np.bool_)
        for j in range(i, n if problem.kind == "flow" else i + 1):
            box = engine_with_command_in(engine, part.command, edges[i], edges[j + 1])
            permitted &= all_unseen(engine.erode(box.cells_safe_for(horizon, core), errors))
            if not permitted.any():
                break
            part.tops[permitted, i] = j + 1
    part.tops[part.levels[0]] = n  # all of U may act there
    if part.lasting is None:
        return
    longer = problem.whole_periods(problem.times.horizon_ns + problem.lead_ns)
    for i in range(n):
        box = engine_with_command_in(engine, part.command, edges[i], edges[i + 1])
        free = engine.erode(box.cells_safe_for(longer, core), errors)
        part.lasting[..., i] = all_unseen(engine.erode(free, errors))


def _why_no_shield(problem: Problem, engine: GridGroup) -> tuple[str, str] | None:
    """Why a group can have no shield, with advice, both in words; None if it can have one."""
    first_age = {t.symbol: t.max_age_ns for t in reversed(problem.system.topics)}
    ageless = {s.name for s in topics_seen_by_dm(problem).values() if first_age[s] is None}
    if ageless:
        names = ", ".join(sorted(ageless))
        text = f"a shield asks how old an estimate may be, which {names} does not say"
        return text, "give it a `max_age`"
    group, controls = engine.c, problem.quantities.controls
    if group.commands > 1:
        several = " and ".join(controls[group.command[k]].name for k in range(group.commands))
        text = f"a shield asks for groups that one command moves, here {several} do"
        return text, "groups of one command each, or no `shield`"
    return None


def engine_with_command_in(engine: GridGroup, control: int, low: float, high: float) -> GridGroup:
    """An engine for the same group in which one command lies in [low, high]."""
    controls = list(engine.inputs.controls)
    controls[control] = (low, high)
    return GridGroup(
        engine.library,
        replace(engine.inputs, controls=tuple(controls)),
        list(zip(engine.axes, engine.edges, strict=True)),
        threads=engine.threads,
        open_ends=engine.open_ends,
        unbounded=engine.unbounded,
        wraps=engine.wraps,
    )


def find_levels(case: Case, proof: object, engine: GridGroup, part: GroupSets) -> None:
    """Computes the sets S_0 ... S_(m-2); enters failures of `ttf` and `safer` if sets are empty."""
    problem = case.problem
    errors, shown = errors_by_state(problem), topics_seen_by_dm(problem)
    window = problem.whole_periods(problem.times.between_states)
    assert part.free is not None
    blind = tuple(k for k, a in enumerate(engine.axes) if a not in shown)
    part.levels = [_cells_in_set_along_axes(engine.erode(part.free, errors), blind)]
    for _ in range(max(problem.levels, 2) - 2):
        inner = engine.erode(part.levels[-1], errors)
        following = engine.cells_safe_for(window, inner)
        estimates = _cells_in_set_along_axes(engine.erode(following, errors), blind)
        part.levels.append(estimates & part.levels[-1])
    if problem.module.shield is not None:
        find_permitted_commands(
            case, proof, engine, part, lambda cells: _cells_in_set_along_axes(cells, blind)
        )
    names = [problem.quantities.states[engine.axes[k]].name for k in blind]
    hint = problem.advice_where_empty
    if names:
        hint = f"let a plant drive a topic with {', '.join(names)}, or write `ttf` and `safer`"
    empty = next((j for j, s in enumerate(part.levels) if not s.any()), 0)
    for claim, j in (("ttf", 0), ("safer", len(part.levels) - 1)):
        if not part.levels[j].any():
            text = f"S_{empty} is empty: AC would never get control"
            case.fail(claim, text, proof, hint).cells = part.free


def _cells_in_set_along_axes(cells: Bools, axes: tuple[int, ...]) -> Bools:
    """The cells that are in the set at every place along these axes."""
    if not axes:
        return cells
    every: Bools = np.asarray(cells.all(axis=axes, keepdims=True), dtype=np.bool_)
    return np.array(np.broadcast_to(every, cells.shape), dtype=np.bool_)


def enter_table(
    case: Case, proof: object, engine: GridGroup, part: GroupSets, table: GroupTable
) -> None:
    """Computes where the DM's table lets AC have control; enters a failure if it never does."""
    errors = errors_by_state(case.problem)
    outer, inner = part.deployed = _levels_of_table(part, table)
    assert part.free is not None
    part.lets_ac = engine.dilate(outer, errors) & part.free
    part.gives_back = engine.dilate(inner, errors) & part.free
    hint = "fewer values of the parameters: the DM has one table for all of them"
    for claim, j, cells in (("ttf", 0, outer), ("safer", -1, inner)):
        if part.levels[j].any() and not cells.any():
            which = j % len(part.levels)
            text = f"no estimate is in S_{which} of every case: AC would never get control"
            case.fail(claim, text, proof, hint).cells = part.free


def _levels_of_table(part: GroupSets, table: GroupTable) -> tuple[Bools, Bools]:
    """The sets S_0 and S_(m-2) that a table holds, extended over all axes of the group."""
    shape = [len(a.edges) - 1 if a.state in table.states else 1 for a in part.group.axes]
    entries = np.broadcast_to(table.entries.reshape(shape), part.allowed.shape)
    return entries > 0, entries >= FULL


def states_with_control(case: Case, engine: GridGroup, part: GroupSets) -> Bools | None:
    """The states, in the grid's shape, where AC gets control at every estimate; None: no table."""
    if part.deployed is None:
        return None
    return engine.erode(part.deployed[1], errors_by_state(case.problem))
