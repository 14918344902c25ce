"""Properties: what has to hold at the end of every instant, and contracts: as a node steps.

Purpose: whether an `always` or `never` is violated in a configuration, judged on the truth, and
whether `assumes` and `guarantees` of a node are.
Non-goals: onsets and counts (`configuration.py`), temporal properties of tests (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault

if TYPE_CHECKING:
    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Component
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


def violated(machine: ExecutableSystem, c: Configuration) -> list[bool]:
    """Per property of the system: whether it is violated now; one that faults is.

    Contracts are not judged at an instant: False.
    """
    env = machine.environment(c)
    return [
        p.component is None and _is_violated(machine, p.index, env)
        for p in machine.system.properties
    ]


def judged(
    machine: ExecutableSystem, c: Configuration, component: Component, kind: str
) -> dict[int, bool]:
    """The contracts of a node of one kind, by property index: whether each is violated."""
    own = [i for k, i in machine.contracts.get(component.index, ()) if k == kind]
    if not own:
        return {}
    env = machine.environment(c, component)
    return {i: _is_violated(machine, i, env) for i in own}


def fault_of(
    machine: ExecutableSystem, c: Configuration, index: int, component: Component | None = None
) -> StepFault | None:
    """What goes wrong as a property, or a contract of a node, is judged; None: nothing."""
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
