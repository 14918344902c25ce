"""Shields: the commands of a module are judged before they are published.

Purpose: a shield moves commands of AC toward SC's, or makes a step fault of them
(docs/semantics.md, Shields).
Non-goals: which commands are permitted (`verify/deploy/shield_tables.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.types import numbers_in, value_of_numbers
from soter.semantics.configuration import with_value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component, Module
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem, ShieldCode


@dataclass(frozen=True, slots=True)
class Shielded:
    """The topic values after a step of AC or SC has passed its shield.

    Each field maps topics to values. `published`: the values that the step publishes. `held`: the
    shield's topic, stored with them. `proposed`: the topic of proposals, stored in any case.
    """

    published: dict[int, Value]
    held: dict[int, Value] = field(default_factory=dict)
    proposed: dict[int, Value] = field(default_factory=dict)


def apply_shield(
    machine: ExecutableSystem, c: Configuration, component: Component, published: dict[int, Value]
) -> Shielded:
    """Gives what a step of AC or SC publishes after the shield of its module, if it has a shield.

    Raises StepFault if AC, in control or not, publishes a command that is not permitted. In a
    forced module the shield refuses and moves nothing.
    """
    code = machine.shields.get(component.index)
    if code is None or not published:
        return Shielded(published)
    dm = machine.system.components[_shielding_module(machine, component).dm]
    held = {code.topic: code.held(machine.environment(c, dm))}
    proposed = _updated_proposals(machine, c, component, code, published)
    if component.role != "ac" or _shielding_module(machine, component).forced:
        return Shielded(published, held, proposed)
    found: object = 1.0
    if code.moved is not None:
        seen = _with_topics(c, {**held, **proposed})
        *numbers, found = code.moved(machine.environment(seen, dm))
        published = _publications_with_numbers(machine, component, published, numbers)
    if found != 1.0 or not code.permits(
        machine.environment(_with_topics(c, {**published, **held}), dm)
    ):
        raise StepFault(FaultKind.SHIELD, component.span, "the shield does not permit it")
    return Shielded(published, held, proposed)


def _updated_proposals(
    machine: ExecutableSystem,
    c: Configuration,
    component: Component,
    code: ShieldCode,
    published: Mapping[int, Value],
) -> dict[int, Value]:
    """Gives the topic of proposals with this step's numbers put in: first AC's, then SC's."""
    if code.proposed is None:
        return {}
    numbers = list(c.Topics[code.proposed])
    at = 0 if component.role == "ac" else len(numbers) // 2
    for topic in _shielding_module(machine, component).outputs:
        count = len(list(numbers_in(c.Topics[topic])))
        if topic in published:
            numbers[at : at + count] = numbers_in(published[topic])
        at += count
    return {code.proposed: tuple(numbers)}


def _publications_with_numbers(
    machine: ExecutableSystem,
    component: Component,
    published: Mapping[int, Value],
    numbers: list[Value],
) -> dict[int, Value]:
    """Gives the publications with their numbers replaced by `numbers`, which cover all outputs."""
    new, rest = dict(published), iter(numbers)
    for topic in _shielding_module(machine, component).outputs:
        value = value_of_numbers(machine.system.topics[topic].type, rest)
        if topic in published:
            new[topic] = value
    return new


def _with_topics(c: Configuration, values: Mapping[int, Value]) -> Configuration:
    topics = c.Topics
    for topic, value in values.items():
        topics = with_value(topics, topic, value)
    return replace(c, Topics=topics)


def _shielding_module(machine: ExecutableSystem, component: Component) -> Module:
    assert component.module is not None
    return machine.system.modules[component.module]
