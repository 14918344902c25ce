"""A proof by induction in a certificate (docs/verification.md, section 4).

Purpose: what `soter recheck` needs of it: how far the induction goes, and about whom.
Non-goals: checking it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.verify.claims.results import PROVED, UNCLAIMED

if TYPE_CHECKING:
    from soter.verify.induction.verify import InductionResult


def entry(
    result: InductionResult, system: str, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """The module in a manifest; it has no files."""
    del stem, files
    problem, induction = result.problem, result.induction
    claims = {n: f.verdict for n, f in result.findings.items() if n not in UNCLAIMED}
    claims.pop("failsafe", None)  # of plants, and nothing is proved of it here
    returns = induction.returns if claims.get("P2b") == PROVED else 0
    declared = problem.recover_ns is not None and returns
    return {
        "system": system,
        "module": problem.name,
        "claims": claims,
        "recover_ns": induction.returns_ns if declared else None,
        "induction": {
            "k": induction.k,
            "returns": returns,
            "hyperperiod_ns": induction.hyperperiod_ns,
            "lemmas": list(problem.lemma_texts),
            "progress": list(problem.progress_texts),
            "latching": bool(induction.latching),
            "clocks": {
                problem.system.components[c.component].name: [
                    c.period,
                    c.phase,
                    c.late,
                    c.response,
                ]
                for c in problem.declared
            },
        },
    }
