"""What everything that a property reads may be, whatever steps do.

Purpose: a range for every scalar of topics, plants, modes and times: the declared sets and types;
one value where nobody can write another one before the end of the test.
Non-goals: what steps compute: a search answers that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore.trace.allowed_steps import plan_of
from soter.language.evaluate.range_evaluation import anything, constant
from soter.language.evaluate.ranges import ANY_FLOAT, INF, Range
from soter.language.evaluate.topic_ranges import published
from soter.language.model.types import leaf_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.evaluate.range_evaluation import Known, ReadPlace
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type


class Domains:
    """Of a flattened test. `start`: of its start alone, before any step."""

    def __init__(self, system: System, *, start: bool = False) -> None:
        self._system = system
        self._start = start
        self._writable = _writable(system)
        plan = plan_of(system)
        late = max((f.by_ns for f in plan.faults if f.kind == "late"), default=0)
        long = max((f.by_ns for f in plan.faults if f.kind == "overrun"), default=0)
        self._end_s = (plan.horizon_ns + plan.skew_ns + late + long) / 1e9

    def of(self, place: ReadPlace) -> Range:
        """The range of a scalar."""
        if place.kind == "topic":
            return self._topic(place)
        if place.kind == "truth":
            return self._truth(place)
        if place.kind == "mode":
            module = self._system.modules[place.index]
            if module.forced is not None or self._start:
                mode = int(module.forced == "ac")
                return Range(mode, mode)
            return Range(0, 1)
        if self._start:
            return ANY_FLOAT
        return Range(0.0, self._end_s if place.kind == "time" else INF)

    def _topic(self, place: ReadPlace) -> Range:
        topic = self._system.topics[place.index]
        if topic.queue_of is not None:
            return _range(anything(place.type), place.type)
        if self._start or place.index not in self._writable:
            return _at(constant(topic.type, topic.default), place.path, place.type)
        return published(topic, place)

    def _truth(self, place: ReadPlace) -> Range:
        component = self._system.components[place.index]
        plant = component.plant
        assert plant is not None
        state = plant.states[place.path[0]]
        moved = plant.extern or state in plant.der or state in plant.next
        drawn = component.initial_range and component.initial_range[place.path[0]]
        if drawn:
            low, high = drawn
            return (
                _range(anything(place.type), place.type)
                if moved and not self._start
                else (Range(low, high))
            )
        if not (moved and not self._start):
            first = constant(state.type, component.initial[place.path[0]])
            return _at(first, place.path[1:], place.type)
        return _range(anything(place.type), place.type)


def _writable(system: System) -> set[int]:
    """Topics that somebody may write up to the horizon."""
    horizon = plan_of(system).horizon_ns
    topics = {drive.topic for drive in system.inputs}
    for c in system.components:
        if c.phase_ns <= horizon:
            topics |= set(written_by(c))
    return topics


def written_by(c: Component) -> Sequence[int]:
    """The topics that a component publishes or drives."""
    if c.node is not None:
        return [c.scope.topics[t] for t in c.node.publishes]
    if c.plant is not None:
        return [c.scope.topics[t] for t, _ in c.plant.drives]
    return []


def _at(whole: Known, path: tuple[int, ...], of: Type) -> Range:
    for index in path:
        whole = whole[index] if isinstance(whole, tuple) and index < len(whole) else None
    return whole if isinstance(whole, Range) else _range(anything(of), of)


def _range(known: Known, of: Type) -> Range:
    assert isinstance(known, Range), (of, leaf_count(of))
    return known
