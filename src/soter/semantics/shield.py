"""A shield: the commands of a module are judged before they are published.

Purpose: what the publications of AC or SC leave in the shield's topics, what AC's become where they
are moved toward SC's, and the step fault of an AC that would publish what is not permitted
(docs/semantics.md, Shields).
Non-goals: what is permitted, and where to a command is moved (`verify/tables/shield_tables.py`),
the DM's look at the command that is held (`rules.py`: it is the module's `ttf`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.types import made_of, numbers_in
from soter.semantics.configuration import put

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component, Module
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem, ShieldCode


@dataclass(frozen=True, slots=True)
class Shielded:
    """A step of AC or SC as its shield has it.

    `published`: what it publishes; `held`: the shield's topic, which is stored with that (n1);
    `proposed`: its topic of proposals, which is stored whether or not the outputs are enabled.
    """

    published: dict[int, Value]
    held: dict[int, Value] = field(default_factory=dict)
    proposed: dict[int, Value] = field(default_factory=dict)


def shielded(
    machine: ExecutableSystem,
    c: Configuration,
    component: Component,
    published: dict[int, Value],
) -> Shielded:
    """What becomes of a step of AC or SC that would publish this; the same without a shield.

    StepFault where AC publishes a command that is not permitted, in control or not.
    """
    code = machine.shields.get(component.index)
    if code is None or not published:
        return Shielded(published)
    dm = machine.system.components[_module(machine, component).dm]
    held = {code.topic: code.held(machine.environment(c, dm))}
    proposed = _proposed(machine, c, component, code, published)
    if component.role != "ac":
        return Shielded(published, held, proposed)
    if proposed:
        seen = _with(c, {**held, **proposed})
        env = machine.environment(seen, dm)
        published = _moved(machine, component, published, [move(env) for move in code.moved])
    if not code.permits(machine.environment(_with(c, {**published, **held}), dm)):
        raise StepFault(FaultKind.SHIELD, component.span, "the shield does not permit it")
    return Shielded(published, held, proposed)


def _proposed(
    machine: ExecutableSystem,
    c: Configuration,
    component: Component,
    code: ShieldCode,
    published: Mapping[int, Value],
) -> dict[int, Value]:
    """The topic of proposals with what this step would publish; AC's numbers first, then SC's."""
    if code.proposed is None:
        return {}
    numbers = list(c.Topics[code.proposed])
    at = 0 if component.role == "ac" else len(numbers) // 2
    for topic in _module(machine, component).outputs:
        count = len(list(numbers_in(c.Topics[topic])))
        if topic in published:
            numbers[at : at + count] = numbers_in(published[topic])
        at += count
    return {code.proposed: tuple(numbers)}


def _moved(
    machine: ExecutableSystem,
    component: Component,
    published: Mapping[int, Value],
    numbers: list[Value],
) -> dict[int, Value]:
    """What is published, made of these numbers of all outputs."""
    new, rest = dict(published), iter(numbers)
    for topic in _module(machine, component).outputs:
        value = made_of(machine.system.topics[topic].type, rest)
        if topic in published:
            new[topic] = value
    return new


def _with(c: Configuration, values: Mapping[int, Value]) -> Configuration:
    topics = c.Topics
    for topic, value in values.items():
        topics = put(topics, topic, value)
    return replace(c, Topics=topics)


def _module(machine: ExecutableSystem, component: Component) -> Module:
    assert component.module is not None
    return machine.system.modules[component.module]
