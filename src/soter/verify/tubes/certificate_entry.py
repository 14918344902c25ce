"""A module that is followed by tubes, in a certificate.

Purpose: what was claimed of it, and of what rest.
Non-goals: checking it: that is *not re-checked* yet (`certificate/tubes/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.verify.claims.results import UNCLAIMED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.verify.problem.problem import Interval
    from soter.verify.tubes.verify import TubeResult


def entry(result: TubeResult, system: str, stem: str, files: dict[str, bytes]) -> dict[str, object]:
    """The module in a manifest; it has no files."""
    del stem, files
    problem, claims = result.problem, result.claims
    said = {n: f.verdict for n, f in result.findings.items() if n not in UNCLAIMED}
    said.pop("failsafe", None)  # none is declared: there is nothing to be claimed
    names = [s.name for s in problem.quantities.states]
    return {
        "system": system,
        "module": problem.name,
        "claims": said,
        "recover_ns": None,
        "rest": {
            "within_ns": problem.within_ns,
            "box": _ends(names, claims.box),
            "ways": _ends(names, claims.ways),
        },
    }


def _ends(names: list[str], ranges: Mapping[int, Interval]) -> dict[str, list[str]]:
    return {names[s]: [r.low.hex(), r.high.hex()] for s, r in ranges.items()}
