"""A shield: the commands of a module are judged before they are published.

Purpose: what the publications of AC or SC leave in the shield's topic, and the step fault of an AC
that would publish what is not permitted (docs/semantics.md, Shields).
Non-goals: what is permitted (`verify/tables/shield_tables.py`), the DM's look at the command that
is held (`rules.py`: it is the module's `ttf`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.semantics.configuration import put

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component, Module
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


def shielded(
    machine: ExecutableSystem,
    c: Configuration,
    component: Component,
    published: Mapping[int, Value],
) -> dict[int, Value]:
    """The shield's topic after a step of AC or SC that publishes this; nothing without a shield.

    StepFault where AC publishes a command that is not permitted, in control or not.
    """
    code = machine.shields.get(component.index)
    if code is None or not published:
        return {}
    dm = machine.system.components[_module(machine, component).dm]
    held = {code.topic: code.held(machine.environment(c, dm))}
    if component.role == "ac":
        values = c.Topics
        for topic, value in (*published.items(), *held.items()):
            values = put(values, topic, value)
        if not code.permits(machine.environment(replace(c, Topics=values), dm)):
            raise StepFault(FaultKind.SHIELD, component.span, "the shield does not permit it")
    return held


def _module(machine: ExecutableSystem, component: Component) -> Module:
    assert component.module is not None, component.name
    return machine.system.modules[component.module]
