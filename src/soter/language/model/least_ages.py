"""How old what a DM reads can be.

Purpose: the least `max_age` that the periods of a system allow, for the warning W034 and for
remedies that `verify` tries; ages at which a DM may see a topic that is fresh; which topics are
measured.
Non-goals: lateness and messages that are lost; whether a `max_age` is too small (W028).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System

PUBLICATIONS = 2
"""So many periods of its plant old is a read at most that is neither lost nor late."""


def least_age_ns(system: System, topic: int) -> int | None:
    """The smallest `max_age` that the periods of the system allow of a topic that a plant drives.

    None of a topic that no plant drives.
    """
    drivers = _drivers(system, topic)
    return PUBLICATIONS * drivers[0].period_ns if drivers else None


def fresh_ages_ns(
    system: System, module: Module, most_ns: int | None = None
) -> dict[int, int | None]:
    """Topic -> the greatest age at which the DM may see it, where it is not stale; None: any.

    `most_ns`: what a proof takes for the age of what plants publish.
    """
    ages: dict[int, int | None] = {}
    for index in module.inputs:
        bounds = [system.topics[index].max_age_ns]
        bounds += [most_ns] if _drivers(system, index) else []
        ages[index] = min((b for b in bounds if b is not None), default=None)
    return ages


def _drivers(system: System, topic: int) -> list[Component]:
    """The plants that publish a topic."""
    return [
        c
        for c in system.components
        if c.plant is not None and any(c.scope.topics[t] == topic for t, _ in c.plant.drives)
    ]


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
