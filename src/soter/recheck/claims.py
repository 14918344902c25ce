"""Which claims a certificate may make.

Purpose: the names of the properties, and which verdicts count.
Non-goals: showing any of them.
"""

from __future__ import annotations

from soter.recheck.inclusion import RejectedError

CLAIMS = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start")
ELSEWHERE = ("DM",)
"""Said in a certificate, not confirmed here: what was compiled is not our matter."""
VERDICTS = ("proved", "assumed", "undecided", "refuted")


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
