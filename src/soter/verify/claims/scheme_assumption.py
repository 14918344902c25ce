"""Whether the scheme that flies is in a proof, or what is known against it.

Purpose: `shown_scheme`, `solutions` and `scheme_diverges`, once every case is settled.
Non-goals: the error of a scheme (`enclose/scheme_error.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.integration_stability import diverging
from soter.verify.grid.sets import RESTS
from soter.verify.problem.assumption import EVERY_SOLUTION, SCHEME

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.case import Case
    from soter.verify.problem.assumption import Assumption
    from soter.verify.problem.problem import Problem

IN_PROOF = (
    "the simulator's scheme is in the proof, as all flows are linear; `soter recheck` assumes it"
)


def shown_scheme(problem: Problem, done: Sequence[Case]) -> frozenset[str]:
    """For linear flows the simulator's scheme is part of the proof: one assumption is shown."""
    assumed = SCHEME in problem.assumptions
    return frozenset((SCHEME.key,)) if assumed and all(map(_follows_scheme, done)) else frozenset()


def solutions(problem: Problem, done: Sequence[Case]) -> list[Assumption]:
    """What stands in the place of SCHEME where SC comes to rest: there a rate may jump."""
    groups = [g for c in done for g in c.sets.groups]
    rests = SCHEME in problem.assumptions and any((g.core == RESTS).any() for g in groups)
    return [EVERY_SOLUTION] * rests


def scheme_diverges(problem: Problem) -> str:
    """What is known against the scheme where it is assumed; "": nothing is."""
    states = zip(problem.quantities.states, problem.states, strict=True)
    within = {(s.owner, s.member, s.path): (r.low, r.high) for s, r in states}
    for c in problem.system.components:
        own = {(name, path): r for (owner, name, path), r in within.items() if owner == c.index}
        for d in diverging(problem.system, c, own):
            names = ", ".join(d.names)
            return (
                f"the scheme of {c.name} makes {names} diverge: a step multiplies by {d.growth:.3g}"
            )
    return ""


def _follows_scheme(case: Case) -> bool:
    """Whether the simulator's steps are solutions of every group's model."""
    if len(case.proofs) < len(case.problem.groups):
        return False
    return all(p.covers_scheme for p in case.proofs)
