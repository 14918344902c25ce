"""Which claims a certificate may make.

Purpose: the names of the properties, and which verdicts count.
Non-goals: showing any of them.
"""

from __future__ import annotations

from soter.recheck.inclusion import RejectedError

CLAIMS = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start")
ELSEWHERE = ("DM",)
"""Said in a certificate, not confirmed here: what was compiled is not our matter."""
SAFETY = ("P1a", "P1b", "P1c", "P2a", "P3", "ttf", "safer", "start")
"""Without one of them there is no theorem (docs/proof.md); P2b is about AC's return only."""
VERDICTS = ("proved", "assumed", "undecided", "refuted")


def missing_of(claims: dict[str, str], confirmed: list[str]) -> list[str]:
    """What safety needs and a certificate does not establish; P1c may be assumed.

    An assumed P1c is H >= H* with delays taken for zero: `recheck/problem.py` compares them.
    """
    held = {*confirmed, *(n for n in ("P1c",) if claims.get(n) == "assumed")}
    return [n for n in SAFETY if n not in held]


def claimed_of(given: object) -> set[str]:
    """The properties that are said to be proved."""
    if not isinstance(given, dict):
        raise RejectedError("`claims` is not as it should be")
    for name, verdict in given.items():
        if name not in (*CLAIMS, *ELSEWHERE) or verdict not in VERDICTS:
            raise RejectedError(f"the claim `{name}: {verdict}` is unknown")
    found = {name for name, verdict in given.items() if verdict == "proved" and name in CLAIMS}
    if not found:
        raise RejectedError("nothing is claimed")
    return found
