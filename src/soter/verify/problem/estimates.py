"""Estimates: how far they are from states, and where the DM sees them.

Purpose: errors of topic leaves that are states, and the topics that show a state to the DM.
Non-goals: sets of estimates (`levels.py`, `verify/polytope/proofs.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import leaves
from soter.verify.problem.left_out_states import FAR_TURNS

if TYPE_CHECKING:
    from soter.language.model.typed import TopicSymbol
    from soter.verify.problem.problem import Problem


def errors_of(problem: Problem) -> dict[int, float]:
    """State -> largest |estimate - state| of the topic leaf that is that state.

    An estimate is the sum of state and error, rounded once; that is included. On an axis that wraps
    around it is brought back by whole turns, which rounds once more.
    """
    error_by_state: dict[int, float] = {}
    for state, (topic, leaf) in problem.topic_leaf_of_state.items():
        path = list(leaves(problem.system.topics[topic].type))[leaf][0]
        for e, bounds in zip(problem.quantities.errors, problem.errors, strict=True):
            error = max(-bounds.low, bounds.high)
            if (e.owner, e.path) == (topic, path) and error > 0.0:
                extent = problem.states[state]
                largest = max(abs(extent.low), abs(extent.high)) + error
                error_by_state[state] = max(
                    error_by_state.get(state, 0.0), error + (error + largest) * 2.0**-50
                )
        if state in problem.quantities.turning:
            error_by_state[state] = error_by_state.get(state, 0.0) + FAR_TURNS
    return error_by_state


def seen(problem: Problem) -> dict[int, TopicSymbol]:
    """State -> the topic in which the DM sees it: one of those whose age is inside A."""
    symbol = problem.module.symbol
    declared = {a.topic for g in symbol.verify.groups for a in g.axes if a.topic is not None}
    sc = problem.system.components[problem.module.sc]
    scope = {**sc.scope.topics, **problem.module.scope.topics}
    names = {index: s for s, index in scope.items() if not declared or s in declared}
    at = problem.topic_leaf_of_state
    return {s: names[topic] for s, (topic, _) in at.items() if topic in names}
