"""Turns the facts of a step of a session into keys of `info`.

Purpose: the mode, who was followed, why the action did not count, whether a model explains the step
(docs/gym.md lists the keys).
Non-goals: keys that count or quote: margin, violations, cost, actions (`guard.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.gym.environment_choices import CAUSES
from soter.language.evaluate.arithmetic import FaultKind

if TYPE_CHECKING:
    from soter.gym.session import Session


def flag_info(session: Session, before: int, *, has_model: bool) -> dict[str, Any]:
    """The part of `info` that follows from flags; `before` is the mode before the step."""
    seen = session.seen
    mode, stepped, gate_fault = seen.mode, seen.steps > 0, bool(seen.gate_fault)
    counted = bool(seen.taken_by) and not gate_fault and not seen.moved
    return {
        "mode": "AC" if mode else "SC",
        "ttf": bool(seen.ttf),
        "safer": bool(seen.safer),
        "stale": bool(seen.stale),
        "switched": mode != before,
        "taken_by": ("AC" if seen.taken_by else "SC") if stepped else None,
        "gate_fault": gate_fault,
        "intervened": stepped and not counted,
        "cause": CAUSES[seen.cause] or None,
        "off_model": bool(seen.off_model) if has_model else None,
    }


def refusal_cause(session: Session) -> str:
    """The cause of the last refusal: "shield" if the shield forbade the command, else "gate"."""
    if session.module.shield is None:
        return "gate"
    agent = session.record["components"][session.agent.index]
    return "shield" if agent["last_fault"] == FaultKind.SHIELD else "gate"
