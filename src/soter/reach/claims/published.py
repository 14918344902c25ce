"""Whether states that a proof keeps can be published at all.

Purpose: a topic with a declared set takes no value outside of it, and a plant that has one stops.
Where an estimate of a state of K may lie outside, nothing is proved of what the plant does then.
Non-goals: topics that are more than a state: that they stay in their sets is an assumption.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from soter.program.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.reach.problem.problem import Axis, Problem

    Bools = NDArray[np.bool_]


def unpublished(problem: Problem, axes: Sequence[Axis], cells: Bools) -> tuple[str, str]:
    """Why an estimate of these cells may lie outside of its topic's set, and what helps.

    `cells`: one axis each, as `axes`. ("", "") where every estimate of every cell lies inside.
    """
    for (topic, leaf), state in problem.state_of_leaf.items():
        bound = problem.system.topics[topic].bounds[leaf]
        k = next((i for i, a in enumerate(axes) if a.state == state), None)
        if bound is None or k is None:
            continue
        others = tuple(j for j in range(cells.ndim) if j != k)
        held = np.flatnonzero(cells.any(axis=others))
        if not len(held):
            continue
        edges, error = axes[k].edges, _error(problem, topic, leaf)
        low = Fraction(edges[held[0]]) - error
        high = Fraction(edges[held[-1] + 1]) + error
        if low < bound.low or high > bound.high:
            name = problem.quantities.states[state].name
            owner = problem.system.topics[topic].name
            text = f"K has estimates of {name} in [{float(low):.6g}, {float(high):.6g}], and "
            text += f"`{owner}` takes only [{bound.low:.6g}, {bound.high:.6g}]: the plant stops"
            return text, f"a wider set of `{owner}`, or a `safe` that keeps {name} inside of it"
    return "", ""


def _error(problem: Problem, topic: int, leaf: int) -> Fraction:
    """By how much an estimate may differ, exactly: rounding it to a float passes no float."""
    path = list(leaves(problem.system.topics[topic].type))[leaf][0]
    pairs = zip(problem.quantities.errors, problem.errors, strict=True)
    ends = [max(-b.low, b.high) for e, b in pairs if (e.owner, e.path) == (topic, path)]
    return Fraction(max(ends, default=0.0))
