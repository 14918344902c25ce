"""Rates of the states as sums of the effects of commands and disturbances.

Purpose: `rates_taken_apart` splits rates into the effect of each command and disturbance and a
rest, in which disturbances are in the middle of their ranges. `domain_conditions` says where these
are defined.
Non-goals: expressions (`expression_graph.py`), steps (`tube.soter`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.verify.tubes.expression_graph import (
    LARGEST,
    MAY_FAULT,
    PARTIAL,
    NoExpressionError,
    deciding_nodes,
    in_order,
    is_positive,
    reads_kind,
    states_read,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.verify.tubes.expression_graph import Expressions, Node


def domain_conditions(
    make: Expressions, parts: Sequence[Node], slopes: Sequence[Node]
) -> list[Node]:
    """Conditions on states which ensure that terms missing in the `parts` of rates are defined.

    A term of a rate may cancel in its `parts`, or be 0 with a disturbance in its middle, where it
    is NaN, or so steep that a flow has several solutions. `slopes` has derivatives of the effects
    along directions "v" of states. Raises `NoExpressionError` if such a term reads commands or
    disturbances.
    """
    known = {*in_order(parts)}
    partial = [x for x in in_order([*slopes, *make.hidden]) if x.op in PARTIAL and x not in known]
    asked = [x for x in partial if not (x.op == "inverse" and is_positive(x.of[0]))]
    if any(reads_kind(x, kind) for x in asked for kind in "uw"):
        raise NoExpressionError(MAY_FAULT)
    return [make.in_range(x, -LARGEST, LARGEST) for x in asked if not reads_kind(x, "y")]


@dataclass(frozen=True)
class SplitRates:
    """Rates f(x, u, w) as a sum of the effects of commands u and disturbances w.

    `still`: f with every disturbance in which it is affine in the middle of its range. `effects`:
    for each disturbance, then each control, its factor in every rate, 0 for those in `ranged`. A
    factor may read x and `ranged`, and that of a disturbance all controls (a brake that grips more
    or less). `ranged`: the others, which stand in `still`, and are ranges there.
    """

    still: list[Node]
    effects: list[list[Node]]
    ranged: list[Node]


def rates_taken_apart(
    make: Expressions,
    rates: Sequence[Node],
    middles: Mapping[Node, float],
    controls: Sequence[Node],
) -> SplitRates:
    """The rates split by controls and disturbances; `middles` has each disturbance's middle.

    Inputs that a condition reads become `ranged`. Raises `NoExpressionError` if a rate jumps
    without a condition.
    """
    zero, one = make.constant(0.0), make.constant(1.0)
    of_branches = deciding_nodes(rates)
    ranged = {x: None for x in (*middles, *controls) if x in of_branches}
    while True:
        known = {w: make.constant(m) for w, m in middles.items() if w not in ranged}
        still = [make.substituted(e, known) for e in rates]
        effects, more = [], dict(ranged)
        for movers, of in ((list(middles), rates), (controls, still)):
            affine = set(movers) - set(ranged)
            for x in movers:
                row = [make.slope_along(e, {x: one}, {}) for e in of]
                if affine & set(in_order(row)):
                    more[x] = None
                effects.append([zero] * len(row) if x in ranged else row)
        if more == ranged:
            return SplitRates(still, effects, list(ranged))
        ranged = more


def state_that_may_grow_without_end(
    make: Expressions, rates: Sequence[Node], followed: Sequence[int]
) -> int | None:
    """The first state not in `followed` that may become infinite in finite time; None if none may.

    A state cannot if its rate is defined everywhere and affine in the states that are not followed.
    """
    left = set(range(len(rates))) - set(followed)
    for s in sorted(left):
        rate = rates[s]
        partial = any(e.op in PARTIAL for e in in_order([rate]))
        along = [make.input("x", k) for k in states_read([rate]) & left]
        slopes = [make.slope_along(rate, {x: make.constant(1.0)}, {}) for x in along]
        if partial or states_read(slopes) & left:
            return s
    return None
