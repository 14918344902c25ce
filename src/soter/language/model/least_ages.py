"""How small the `max_age` of a topic can be.

Purpose: the least that the periods of a system allow, for the warning W034 and for remedies that
`verify` tries; and which topics are measured.
Non-goals: lateness and messages that are lost; whether a `max_age` is too small (W028).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.language.model.system import System

PUBLICATIONS = 2
"""So many periods of its plant old is a read at most that is neither lost nor late."""


def least_age_ns(system: System, topic: int) -> int | None:
    """The smallest `max_age` that the periods of the system allow of a topic that a plant drives.

    None of a topic that no plant drives.
    """
    drivers = [
        c.period_ns
        for c in system.components
        if c.plant is not None and any(c.scope.topics[t] == topic for t, _ in c.plant.drives)
    ]
    return PUBLICATIONS * drivers[0] if drivers else None


def is_measured(system: System, topic: int) -> bool:
    """Whether a topic is said again and again: what moves, or numbers with a fraction from outside.

    No input, which an operator sets once, nor what is driven by plants of whole numbers alone.
    """
    least = least_age_ns(system, topic)
    moving = [v.type for c in system.components if c.plant for v in c.plant.states]
    kinds = [system.topics[topic].type, *(moving if least is not None else ())]
    outside = any(e.topic == topic for e in system.externals)
    has_fraction = any(isinstance(t, FloatType) for kind in kinds for _, t in leaves(kind))
    return has_fraction and (least is not None or outside)
