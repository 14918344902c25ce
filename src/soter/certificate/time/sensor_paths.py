"""How plants and module are connected, in the system that runs.

Purpose: `Ways`: the sensors of what DM and SC read, and how what SC publishes comes to the plant.
Non-goals: what follows from them (`derived_times.py`); nodes in between (`node_paths.py`, which
answers where there is one that reads an output or publishes what is read).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.derived_times import Clock, Effect, TopicPath

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Component, Module, System


@dataclass
class Ways:
    """The ways of a module; all of these go straight from a plant, or to it."""

    system: System
    module: Module
    notes: dict[tuple[str, str], None] = field(default_factory=dict, kw_only=True)
    """What has to be assumed of nodes on them, by kind and name."""
    undeclared: dict[str, None] = field(default_factory=dict, kw_only=True)
    """Nodes on them whose times are not declared."""

    def to(self, index: int) -> tuple[TopicPath, ...]:
        """All ways from a sensor to a topic; `NotRecheckedError` where there is none."""
        paths = [straight(c) for c in self.system.components if index in published(c)]
        if not paths:
            name = self.system.topics[index].name
            raise NotRecheckedError(f"no plant stands behind `{name}` in `{self.system.name}`")
        return tuple(dict.fromkeys(paths))

    def effects(self, least: int, most: int) -> tuple[Effect, ...]:
        """All ways from an output to the plants; NotRecheckedError where one has none."""
        felt = {i for c in self.system.components if c.plant is not None for i in read(c)}
        for index in self.module.outputs:
            if index not in felt:
                name = self.system.topics[index].name
                raise NotRecheckedError(f"no plant feels `{name}` in `{self.system.name}`")
        return (Effect(least, most),)


def straight(c: Component) -> TopicPath:
    """What a plant publishes itself."""
    return TopicPath(Clock(c.name, c.period_ns, c.phase_ns))


def published(c: Component) -> set[int]:
    """The topics that a plant drives, or a node publishes."""
    topics = [t for t, _ in c.plant.drives] if c.plant else c.node.publishes if c.node else ()
    return {c.scope.topics[t] for t in topics}


def read(c: Component) -> set[int]:
    """The topics that a plant reads, or a node subscribes to."""
    topics = c.plant.reads if c.plant else [s.topic for s in c.node.subscribes] if c.node else ()
    return {c.scope.topics[t] for t in topics}


def nodes_between(system: System, module: Module, topics: Iterable[int]) -> bool:
    """Whether a node publishes one of these topics, or reads what the module publishes.

    What a queue shows a node may be that, too.
    """
    felt = {*module.outputs, *(t.index for t in system.topics if t.queue_of is not None)}
    for c in system.components:
        queues = c.node is not None and any(s.queue is not None for s in c.node.subscribes)
        if c.role == "node" and (queues or read(c) & felt):
            return True
        if c.plant is None and published(c) & {*topics}:
            return True
    return False
