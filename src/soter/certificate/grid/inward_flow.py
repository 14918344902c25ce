"""Checked again: ends of a grid at which the flow points inwards, whatever is commanded.

Purpose: which ends of the axes of a group no run crosses (`uncrossed_ends`), and groups that no
command moves and no run leaves (`points_inwards`).
Non-goals: ends that only SC keeps: chains show those (`sc_chains.py`).

Let x_i' >= 0 wherever x_i is at the lower end of its axis, all other states in their grids, for
every command, disturbance and influence of other groups (at the upper end: x_i' <= 0). Replace x in
f by its projection p(x) onto the grid in the axes with such ends. A solution of x' = f(p(x), u, w)
that begins in the grid stays above that end for as long as its other states are in their grids:
before it were below at some t, it was at the end at some t_0 < t and below from then on, where x_i'
= f_i(p(x), u, w) >= 0, so that x_i(t) >= x_i(t_0). There p does nothing: it solves x' = f(x, u, w),
too, and solutions are unique (a linear flow is Lipschitz; for others a printed assumption). So a
box that encloses the states of one step may be cut off at such an end, if what is left of it lies
in a set of cells: whoever uses such a box checks that. Where all ends are of this kind the same
holds of the whole grid, with no condition.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.cells.cell_sets import finer
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.reading.linear_flows import is_linear, linear_flow
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.straight_line import NotCertainError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flint import arb

    from soter.certificate.reading.case_model import CaseModel

    Kept = list[tuple[bool, bool]]
    Side = list[tuple[float, float]]
    Test = Callable[[Side, int, int], bool]

SPLITS = 8
"""How often a side of the grid is halved along each axis where the flow is not linear."""


def points_inwards(model: CaseModel, states: Sequence[int]) -> bool:
    """Whether no run leaves the grid of a group that no command moves; False where uncertain."""
    if model.facts.kind != "flow" or LocalFlow(model, states).moves:
        return False
    return all(low and high for low, high in uncrossed_ends(model, states))


def uncrossed_ends(model: CaseModel, members: Sequence[int]) -> Kept:
    """For each state whether its lower and its upper end are never crossed; False: uncertain.

    An open end is taken not to be. Where K has cells at rest there are none: solutions may be
    several, and one of them may cross an end at which another one stays.
    """
    if model.facts.kind != "flow" or model.facts.at_rest:
        return [(False, False)] * len(members)
    inwards = (_linear if is_linear(model, members) else _local)(model, members)
    ends = []
    for i in range(len(members)):
        sides = [[model.extents[k] for k in members] for _ in range(2)]
        if members[i] in model.facts.unbounded | model.facts.turning:
            ends.append((False, False))
            continue
        low, high = model.extents[members[i]]
        sides[0][i], sides[1][i] = (low, low), (high, high)
        is_open = members[i] in model.facts.open_ends  # nobody gets there: an assumption
        ends.append((inwards(sides[0], i, 1), is_open or inwards(sides[1], i, -1)))
    return ends


def _linear(model: CaseModel, members: Sequence[int]) -> Test:
    """A linear form over a box is least at a corner; what else acts on it is noise."""
    flow = linear_flow(model, members)

    def inwards(side: Side, i: int, sign: int) -> bool:
        low = sign * flow.constant[i]
        for x in flow.noise[i]:
            low -= abs(x)
        ranges = [*((exact(a), exact(b)) for a, b in side), *flow.ranges]
        for factor, (a, b) in zip((*flow.a[i], *flow.b[i]), ranges, strict=True):
            low += (sign * factor * a).min(sign * factor * b)
        return bool(low >= 0)

    return inwards


def _local(model: CaseModel, members: Sequence[int]) -> Test:
    """Over parts of the side, halved where it is not certain."""
    flow = LocalFlow(model, members)

    def inwards(side: Side, i: int, sign: int) -> bool:
        fixed = exact(side[i][0]), exact(side[i][1])

        def holds(others: list[tuple[arb, arb]]) -> bool:
            try:
                lines = flow.lines([*others[:i], fixed, *others[i:]], flow.ranges)
            except NotCertainError:
                return False
            low, high = flow.rates(lines)[i]
            return bool(low >= 0 if sign > 0 else high <= 0)

        others = [(exact(a), exact(b)) for k, (a, b) in enumerate(side) if k != i]
        return finer(others, holds, SPLITS * len(others)) if others else holds([])

    return inwards
