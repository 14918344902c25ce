"""Judges which properties a configuration violates, by the true states.

Purpose: `always` and `never` at the end of an instant; `assumes` and `guarantees` of a node as it
steps. A fault while one is judged violates it.
Non-goals: onsets and counts (`run_record.py`), temporal properties of tests (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault

if TYPE_CHECKING:
    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Component
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


def violated_properties(machine: ExecutableSystem, c: Configuration) -> list[bool]:
    """Gives for each property if it is violated now, also by a fault; False for contracts."""
    env = machine.environment(c)
    return [
        p.component is None and _is_violated(machine, p.index, env)
        for p in machine.system.properties
    ]


def violated_contracts(
    machine: ExecutableSystem, c: Configuration, component: Component, kind: str
) -> dict[int, bool]:
    """Maps each contract of a kind (by property index) to whether the node violates it now."""
    indices = [i for k, i in machine.contracts.get(component.index, ()) if k == kind]
    if not indices:
        return {}
    env = machine.environment(c, component)
    return {i: _is_violated(machine, i, env) for i in indices}


def judging_fault(
    machine: ExecutableSystem, c: Configuration, index: int, component: Component | None = None
) -> StepFault | None:
    """Gives the fault that judging a property or a node's contract raises; None without fault."""
    condition, _ = machine.properties[index]
    try:
        condition(machine.environment(c, component))
    except StepFault as fault:
        return fault
    return None


def _is_violated(machine: ExecutableSystem, index: int, env: Environment) -> bool:
    condition, wanted = machine.properties[index]
    try:
        return bool(condition(env)) != wanted
    except StepFault:
        return True
