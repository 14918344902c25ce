"""What moves the states in a step: rates as sums of what commands and disturbances do.

Purpose: `take_rates_apart` takes rates apart into what is left with disturbances in the middle of
their ranges and the effect of each command and disturbance; `domain_conditions` says where that is
defined.
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
    """Conditions of states under which rates are defined whose parts do not say so.

    A term of a rate may cancel in its `parts`, or be 0 with a disturbance in its middle, where it
    is NaN, or so steep that a flow has several solutions. `slopes`: derivatives of the effects
    along directions "v" of states. `NoExpressionError` where such a term reads commands or
    disturbances.
    """
    known = {*in_order(parts)}
    partial = [x for x in in_order([*slopes, *make.hidden]) if x.op in PARTIAL and x not in known]
    asked = [x for x in partial if not (x.op == "inverse" and is_positive(x.of[0]))]
    if any(reads_kind(x, kind) for x in asked for kind in "uw"):
        raise NoExpressionError(MAY_FAULT)
    return [make.inside(x, -LARGEST, LARGEST) for x in asked if not reads_kind(x, "y")]


@dataclass(frozen=True)
class Moved:
    """Rates f(x, u, w) as a sum of the effects of commands u and disturbances w.

    `still`: f with every disturbance in which it is affine in the middle of its range. `effects`:
    for each disturbance, then each control, its factor in every rate, 0 for those in `ranged`. A
    factor may read x and `ranged`, and that of a disturbance all controls (a brake that grips more
    or less). `ranged`: the others, which stand in `still`, and are ranges there.
    """

    still: list[Node]
    effects: list[list[Node]]
    ranged: list[Node]


def take_rates_apart(
    make: Expressions,
    rates: Sequence[Node],
    middles: Mapping[Node, float],
    controls: Sequence[Node],
) -> Moved:
    """These rates, taken apart by controls and by disturbances, whose `middles` are passed.

    Inputs that a condition reads are ranged. `NoExpressionError` where a rate jumps without a
    condition.
    """
    zero, one = make.number(0.0), make.number(1.0)
    of_branches = deciding_nodes(rates)
    ranged = {x: None for x in (*middles, *controls) if x in of_branches}
    while True:
        known = {w: make.number(m) for w, m in middles.items() if w not in ranged}
        still = [make.replaced(e, known) for e in rates]
        effects, more = [], dict(ranged)
        for movers, of in ((list(middles), rates), (controls, still)):
            affine = set(movers) - set(ranged)
            for x in movers:
                row = [make.along(e, {x: one}, {}) for e in of]
                if affine & set(in_order(row)):
                    more[x] = None
                effects.append([zero] * len(row) if x in ranged else row)
        if more == ranged:
            return Moved(still, effects, list(ranged))
        ranged = more


def state_that_may_end(
    make: Expressions, rates: Sequence[Node], followed: Sequence[int]
) -> int | None:
    """A state that is not followed and may grow without end in finite time; or None.

    It cannot where its rate is defined everywhere and affine in the states that are left out.
    """
    left = set(range(len(rates))) - set(followed)
    for s in sorted(left):
        rate = rates[s]
        partial = any(e.op in PARTIAL for e in in_order([rate]))
        along = [make.input("x", k) for k in states_read([rate]) & left]
        slopes = [make.along(rate, {x: make.number(1.0)}, {}) for x in along]
        if partial or states_read(slopes) & left:
            return s
    return None
