"""Computes how old a topic may be when a decision module (DM) reads it.

Purpose: the least `max_age` that the periods of a system allow (W034, remedies of `verify`), and
the ages at which a DM sees a topic as fresh.
Non-goals: ages by lateness and by messages that are lost; whether a `max_age` is too small (W028).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System

PUBLICATIONS = 2
"""Greatest age, in periods of its plant, of a value that is neither lost nor late when read."""


def least_age_ns(system: System, topic: int) -> int | None:
    """Gives the least `max_age` that a topic's period allows, in ns; None if no plant drives it."""
    drivers = _plants_that_publish(system, topic)
    return PUBLICATIONS * drivers[0].period_ns if drivers else None


def fresh_ages_ns(
    system: System, module: Module, most_ns: int | None = None
) -> dict[int, int | None]:
    """Gives topic -> the greatest age in ns at which the DM sees it as fresh; None for any age.

    `most_ns`: the greatest age that a proof assumes for topics that plants publish.
    """
    ages: dict[int, int | None] = {}
    for index in module.inputs:
        bounds = [system.topics[index].max_age_ns]
        bounds += [most_ns] if _plants_that_publish(system, index) else []
        ages[index] = min((b for b in bounds if b is not None), default=None)
    return ages


def _plants_that_publish(system: System, topic: int) -> list[Component]:
    return [
        c
        for c in system.components
        if c.plant is not None and any(c.scope.topics[t] == topic for t, _ in c.plant.drives)
    ]


def is_measured(system: System, topic: int) -> bool:
    """Whether a topic with floats is published repeatedly, by a plant or from outside.

    An input, which an operator sets once, is not measured, nor is a topic of plants without floats.
    """
    least = least_age_ns(system, topic)
    moving = [v.type for c in system.components if c.plant for v in c.plant.states]
    kinds = [system.topics[topic].type, *(moving if least is not None else ())]
    outside = any(e.topic == topic for e in system.externals)
    has_fraction = any(isinstance(t, FloatType) for kind in kinds for _, t in leaves(kind))
    return has_fraction and (least is not None or outside)
