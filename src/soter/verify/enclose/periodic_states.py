"""States of which nothing reads how many full turns they have made: axes that wrap around.

Purpose: `wrapping`, of the axes that are a full turn long those whose state is read in functions of
a full turn alone; of the others who reads them otherwise.
Non-goals: sets that wrap around (`verify/engine/soter_reach_grid.c`), the DM's table
(`verify/tables/grid_tables.py`).

Such a function takes sums in which the state stands as it is. What a sum may be off where the state
is many turns further is `SOTER_FAR_TURNS` of `verify/engine/soter_form_math.h`; it holds up to
`FARTHEST` of every such state, which is assumed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.model.system import tower_of
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.enclose.compiled_enclosures import hint_of
from soter.verify.enclose.enclosure_code import generate_enclosures
from soter.verify.problem.assumption import Assumption
from soter.verify.problem.left_out_states import MOVING, in_words
from soter.verify.problem.problem import Interval

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.core.core import CoreSystem
    from soter.verify.problem.problem import Axis, Group, Problem
    from soter.verify.problem.quantities import Quantities
    from soter.verify.problem.verification_system import VerificationSystem

TURN = 2.0 * math.pi
NEAR = 2.0**-44
"""Ends may be rounded by so much."""
FARTHEST = 2.0**14
"""2,607 turns: beyond, an estimate is in no table."""
FAR_TURNS = 2.0**-33
"""As `SOTER_FAR_TURNS`; an estimate that is brought back by whole turns is off by less, too."""
APART = frozenset({"drives", MOVING})
"""What these say is in others."""


def wrapping(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, groups: tuple[Group, ...]
) -> tuple[frozenset[int], dict[str, str]]:
    """The states whose axis wraps around; of others by name who reads them otherwise.

    Of flows that one module alone commands, with the SC and the predicates that it declares.
    """
    symbol = at.module.symbol
    settled = not (
        at.module.view
        or symbol.verify.enters is not None
        or symbol.shield is not None
        or len(tower_of(at.flat, at.home.index)) > 1
    )
    axes = [a for g in groups for a in g.axes if g.representation == "grid" and _is_turn(a)]
    found: set[int] = set()
    readers: dict[str, str] = {}
    for axis in axes if settled else ():
        try:
            read = _readers(at, core, quantities, axis.state)
        except EnclosureError:
            continue  # said where all of it is enclosed
        if read:
            readers[axis.name] = in_words(read, quantities)
        else:
            found.add(axis.state)
    return frozenset(found), readers


def _is_turn(axis: Axis) -> bool:
    low, high = axis.edges[0], axis.edges[-1]
    long = abs(high - low - TURN) <= NEAR and max(-low, high) <= 1.5 * TURN
    return long and not (axis.open or axis.unbounded)


def _readers(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, state: int
) -> frozenset[str]:
    """The functions of a proof that hang on how many turns a state has made."""
    hint, functions = hint_of(at.system, at.module)
    turning = replace(quantities, turning=frozenset({state}))
    unit = generate_enclosures(
        at.system, core, at.module, turning, core_hint=hint, hint_functions=functions, apart=True
    )
    return frozenset(name for name in unit.of_turns if name not in APART)


def turned(groups: tuple[Group, ...], states: frozenset[int]) -> tuple[Group, ...]:
    """The groups with the axes of these states as ones that wrap around."""
    return tuple(
        replace(g, axes=tuple(replace(a, wraps=a.state in states) for a in g.axes)) for g in groups
    )


def starts_on(groups: tuple[Group, ...], starts: Sequence[Interval]) -> tuple[Interval, ...]:
    """The ranges of starts, those of states whose axis wraps around brought back to it.

    By whole turns, so that they begin on the axis; they may go on beyond its upper end.
    """
    near = list(starts)
    for axis in (a for g in groups for a in g.axes if a.wraps):
        (first, last), start = (axis.edges[0], axis.edges[-1]), near[axis.state]
        far = max(-start.low, start.high) > FARTHEST  # more than what is assumed of such a state
        if far or first <= start.low <= start.high <= last:
            continue
        if start.high - start.low >= TURN:
            near[axis.state] = Interval(first, last)
            continue
        back = TURN * math.floor((start.low - first) / TURN)
        near[axis.state] = Interval(start.low - back - FAR_TURNS, start.high - back + FAR_TURNS)
    return tuple(near)


def turning_as(law: Problem, states: frozenset[int]) -> Problem:
    """The problem of a fail-safe law, with no other axes that wrap around than its module has."""
    kept = law.quantities.turning & states
    quantities = replace(law.quantities, turning=kept)
    return replace(law, quantities=quantities, groups=turned(law.groups, kept))


def far_turns(groups: tuple[Group, ...]) -> list[Assumption]:
    """What is assumed of states whose axis wraps around."""
    names = [a.name for g in groups for a in g.axes if a.wraps]
    if not names:
        return []
    said = ", ".join(f"`{n}`" for n in names)
    text = (
        f"{said} stays within {FARTHEST:,.0f} rad of 0 ({FARTHEST / TURN:,.0f} turns): it is read "
        "modulo a full turn, and its axis wraps around"
    )
    return [Assumption("turns", text)]
