"""Whether the scheme that flies is in a proof: one assumption less, or what is known against it.

Purpose: `scheme_of`, once every case is settled.
Non-goals: the error of a scheme (`enclose/scheme_error.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.integration_stability import diverging
from soter.verify.claims.results import PROVED, UNDECIDED
from soter.verify.enclose.scheme_error import STIFF_HINT
from soter.verify.problem.problem import SCHEME

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import ModuleResult


def scheme_of(result: ModuleResult, done: Sequence[Case]) -> None:
    """For linear flows the simulator's scheme is part of the proof: one assumption less.

    Of others it is assumed; not where it diverges, as that is known to be wrong.
    """
    problem = result.problem
    if all(_follows_scheme(c) for c in done):
        problem.assumptions = [a for a in problem.assumptions if a != SCHEME]
    finding = result.findings["P2a"]
    if SCHEME not in problem.assumptions or finding.verdict != PROVED:
        return
    states = zip(problem.quantities.states, problem.states, strict=True)
    within = {(s.owner, s.member, s.path): (r.low, r.high) for s, r in states}
    for c in problem.system.components:
        own = {(name, path): r for (owner, name, path), r in within.items() if owner == c.index}
        for d in diverging(problem.system, c, own):
            finding.verdict = UNDECIDED
            finding.text = f"the scheme of {c.name} makes {', '.join(d.names)} diverge: a step "
            finding.text += f"multiplies by {d.growth:.3g}"
            finding.hint = STIFF_HINT


def _follows_scheme(case: Case) -> bool:
    """Whether the simulator's steps are solutions of every group's model."""
    if len(case.proofs) < len(case.problem.groups):
        return False
    return all(p.covers_scheme for p in case.proofs)
