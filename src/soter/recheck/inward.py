"""Groups that no run leaves, whatever is commanded: the flow points inwards at both ends.

Purpose: the argument of docs/proof.md ("Products of groups") for groups of one axis, from the
linear flow that this room reads off the program.
Non-goals: flows that are not linear, groups that a command moves: chains show those (`chains.py`).

With x' = a x + c + w, |w| <= size, and everything that other groups do part of w: where
a high + c + size <= 0 and a low + c - size >= 0, the solution with its own state projected onto
[low, high] stays in it, and solutions of a linear equation are unique.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.recheck.balls import ZERO, exact
from soter.recheck.flows import linear_flow

if TYPE_CHECKING:
    from soter.recheck.inclusion import GroupTables
    from soter.recheck.model import Model


def points_inwards(model: Model, group: GroupTables) -> bool:
    """Whether no run leaves the grid of the group; False where it is not certain."""
    if model.facts.kind != "flow" or len(group.states) != 1:
        return False
    flow = linear_flow(model, group.states)
    if any(not x.is_zero() for x in flow.b[0]):
        return False
    rate, constant = flow.a[0][0], flow.constant[0]
    size = sum((abs(x) for x in flow.noise[0]), ZERO)
    (edges,) = group.grid.edges
    low, high = exact(edges[0]), exact(edges[-1])
    return bool(rate * high + constant + size <= 0 and rate * low + constant - size >= 0)
