"""What the world gives a module that was proved by induction.

Purpose: what comes from outside may be anything; what is assumed of the loop.
Non-goals: which proofs are carried (`deploy/proof_transfer.py`).

A proof by induction asks nothing of what comes from outside: to it a topic that no node of the
relation publishes is any value of its set, of any age, at every read; and whatever is published
lies in that set, or is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.deployment.deployed_systems import allowed_lateness, from_outside

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import System
    from soter.verify.induction.problem import InductionProblem


def covers(
    here: System, there: System, problem: InductionProblem, diagnostics: Diagnostics
) -> tuple[list[str], list[str]]:
    """What is covered, and what is assumed of the loop besides, in words."""
    del there, diagnostics
    said = [here.topics[e.topic].name for e in from_outside(here)]
    free = [f"{n}: any value of its set, of any age" for n in said if n in problem.any_value]
    judged = {here.components[i].name for i in allowed_lateness(here)}
    nodes = [c.name for c in problem.system.components if c.role == "node"]
    untold = ", ".join(n for n in nodes if n not in judged)
    return free, [f"{untold}: in time, which SOTER_LATE does not tell"] if untold else []
