"""Angles that turn: states that a module reads only modulo a full turn.

Purpose: `turning_states` finds them; `reads_modulo_turns` says whether expressions stay the same
when a state changes by whole turns; `with_rounding_of_turns` adds to expressions the rounding of
angles many turns away ("An angle that turns" in docs/proof-flight.md).
Non-goals: claims about them (`rest_claims.py`), grids (`problem/axes.py`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import Node, in_order, states_read

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from soter.verify.tubes.expression_graph import Expressions


A_TURN = Interval(-3.1416, 3.1416)
"""A little more than a full turn, so that the ends overlap."""
FARTHEST_TURN = 2.0**14
"""The assumed largest distance of such an angle from 0, in rad."""
TURNS_MAX, SUMS_MAX = 4, 7
"""So many such states, and sums with one of them in an angle, may be off by half of `FAR_TURNS`
(`forms.soter`): 4 (7 + 1) roundings of up to 2^-53 (2^14 + 4), sensors among them."""
COMPUTED = frozenset({"sin", "cos", "tan", "wrap_angle"})
OF_A_TURN = COMPUTED | {"real_sin", "real_cos"}


def reads_modulo_turns(roots: Sequence[Node], state: int) -> bool:
    """Whether `roots` read a state only as an angle, plus or minus, of periodic functions."""
    times: dict[Node, float] = {}
    """The turns by which each node grows if the state grows by one turn; inf: no multiple."""
    for e in in_order(roots):
        times[e] = _multiple_of_state(e, [times[x] for x in e.of if isinstance(x, Node)], state)
        if e.op in OF_A_TURN and times[e.of[0]]:
            angle = in_order([e.of[0]])
            if sum(x.op in ("add", "sub") and times[x] != 0 for x in angle) > SUMS_MAX:
                return False
    return not any(times[e] for e in roots)


def turning_states(
    asked: Sequence[Node], rates: Sequence[Node], drifts: Collection[int]
) -> list[int]:
    """The states that need not come back, because all expressions read them modulo a full turn.

    A state with a declared set is not among them: its set is a part of C, which counts the turns.
    """
    read = states_read(asked) - {*drifts}
    found = [s for s in sorted(read) if reads_modulo_turns([*asked, *rates], s)]
    return found if len(found) <= TURNS_MAX else []


def _multiple_of_state(e: Node, of: Sequence[float], state: int) -> float:
    """The multiple of the state in `e`, `of` being those in its operands; inf: not a multiple."""
    if e.op == "input":
        return float(e.of[0] in "xy" and e.of[1] == state)
    if not any(of) or (e.op in OF_A_TURN and abs(of[0]) == 1.0):
        return 0.0
    if e.op == "neg":
        return -of[0]
    if e.op in ("add", "sub"):
        times = of[0] + of[1] if e.op == "add" else of[0] - of[1]
        return times or inf  # where it cancels, what was rounded many turns further is left
    return inf


def with_rounding_of_turns(
    make: Expressions, roots: Sequence[Node], turning: Sequence[int]
) -> list[Node]:
    """The expressions with the rounding error of many turns added to angles."""
    known: dict[Node, Node] = {}
    for e in in_order(roots):
        if e.op in COMPUTED and states_read([e]) & {*turning}:
            angle = make.function_node("any_turn", make.substituted(e.of[0], known))
            known[e] = make.function_node(e.op, angle)
    return [make.substituted(e, known) for e in roots]
