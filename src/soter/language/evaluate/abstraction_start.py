"""Where an abstraction starts: the map of `abstracts`, of the initial state of what flies.

Purpose: `start_behind`, for whoever shows that a run starts among the states that are proved.
Non-goals: initial states that are drawn: of them nothing is said here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from soter.language.model.system import Module, System
    from soter.language.model.types import Value


def start_behind(
    flat: System, module: Module, link: typed.AbstractionLink
) -> tuple[Value, ...] | None:
    """The states of the plant of the proof, one by one, at the start of the flying system.

    Topics have their defaults then. None where there is no map, where a state of what flies is
    drawn, and where the map reads what is not there yet: ages, times, modes.
    """
    name = ".".join((*module.name.split(".")[:-1], link.instance))
    plants = [c for c in flat.components if c.name == name and c.plant is not None]
    if link.value is None or not plants or plants[0].extern:
        return None
    (c,) = plants
    late = (typed.AgeRead, typed.TimeRead, typed.ModeRead, typed.MarginRead)
    if any(r is not None for r in c.initial_range) or any(
        isinstance(n, late) for n in nodes([link.value])
    ):
        return None
    topics: dict[typed.TopicSymbol, int] = {}
    for other in flat.components:
        topics.update(other.scope.topics)
    topics.update(module.scope.topics)
    evaluator = Evaluator(module.scope.params, topics=topics, plants={link.instance: c.index})
    defaults = [t.default for t in flat.topics]
    env = Environment(topics=defaults, truth=lambda _: c.initial)
    try:
        value = evaluator.expression(link.value)(env)
    except StepFault:
        return None
    assert isinstance(value, tuple)
    return value
