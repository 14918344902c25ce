"""Predicates that read a scaled observation as if it were the state.

Purpose: where `safe` holds on the whole grid, what it reads that a plant drives otherwise than as a
state, as in `drives seen = x / 10.0;`, with the place where that is written.
Non-goals: verdicts; which unit is meant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import FLOAT, leaves
from soter.verify.claims.results import Cause

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import GroupSets
    from soter.verify.problem.problem import Problem


def scaled(case: Case, part: GroupSets) -> Iterator[Cause]:
    """A cause where `safe` has no end on the grid and reads something that is no state."""
    if not part.allowed.all():
        return
    driven_topics = list(_driven_otherwise(case.problem))
    if not driven_topics:
        return
    how = "; ".join(f"`{topic}`, driven as `{value}`" for topic, value in driven_topics)
    text = f"`safe` holds on the whole grid: it reads {how}, and may count in other units"
    hint = (
        "drive the states as they are, in the units of `safe`, and divide in the controller that "
    )
    hint += "wants scaled numbers; or write the predicates in the units of the topic"
    yield Cause("scaled", text, hint, ())


def _driven_otherwise(problem: Problem) -> Iterator[tuple[str, str]]:
    """Topics that `safe` reads and a plant drives, in part, by more than a state; how."""
    symbol, scope = problem.module.symbol, problem.module.scope
    read = {scope.topics[t] for t in topic_reads(symbol.safe) if t in scope.topics}
    for c in problem.system.components:
        for topic, value in c.plant.drives if c.plant is not None else ():
            index = c.scope.topics[topic]
            numbers = [i for i, (_, t) in enumerate(leaves(topic.type)) if t == FLOAT]
            if index in read and any((index, i) not in problem.state_of_leaf for i in numbers):
                yield topic.name, " ".join(value.span.text.split())
