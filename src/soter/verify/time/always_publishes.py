"""Whether a node publishes a topic at every step.

Purpose: what is said of ages and waits on a way through a node takes that for granted.
Non-goals: faults (a node that faults is latched; that none does is an assumption).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Component


class UnfollowedError(Exception):
    """A way that cannot be followed: the component that it ends at, and why."""

    def __init__(self, node: Component, why: str) -> None:
        super().__init__(why)
        self.node = node


def publishes_always(statements: Sequence[typed.TypedStmt], topic: typed.TopicSymbol) -> bool:
    """Whether every path through the statements publishes the topic; loops count as empty."""
    for s in statements:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf) and s.otherwise:
            parts = [body for _, body in s.arms] + [s.otherwise]
            if all(publishes_always(body, topic) for body in parts):
                return True
    return False


def must_publish(node: Component, index: int) -> None:
    """`UnfollowedError` where a step of the node may leave out the topic of that index."""
    assert node.node is not None
    if node.node.extern:
        return  # named, like everything that an extern does
    symbols = [t for t in node.node.publishes if node.scope.topics[t] == index]
    if not all(publishes_always(node.node.step, t) for t in symbols):
        raise UnfollowedError(node, "some of its steps publish nothing")
