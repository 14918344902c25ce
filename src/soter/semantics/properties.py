"""Properties: what has to hold at the end of every instant.

Purpose: whether an `always` or `never` is violated in a configuration, judged on the truth.
Non-goals: onsets and counts (`record.py`), temporal properties of tests (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program.arith import StepFault

if TYPE_CHECKING:
    from soter.semantics.configuration import Configuration
    from soter.semantics.machine import Machine


def violated(machine: Machine, c: Configuration) -> list[bool]:
    """Per property of the system: whether it is violated now; one that faults is."""
    env = machine.environment(c)
    found = []
    for condition, wanted in machine.properties:
        try:
            found.append(bool(condition(env)) != wanted)
        except StepFault:
            found.append(True)
    return found
