"""The latch of a decision module: `returns after topic;` and `returns never;`.

Purpose: what a DM step finds of the operator's acknowledgement, and what a switch makes of it.
Non-goals: who asks (`rules.py`); where it lies (`language/elaborate/decision_topics.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.semantics.configuration import NEVER, put
from soter.semantics.observer_records import AC, SC

if TYPE_CHECKING:
    from soter.language.model.system import Module, System
    from soter.semantics.configuration import Configuration

WAITS, READY, ACKNOWLEDGED = 0, 1, 2
OPEN, CLOSED = 0, 1


def latch_seen(
    system: System, c: Configuration, module: Module, mode: int
) -> tuple[Configuration, bool]:
    """What the DM remembers after a look, and whether the latch lets AC have control.

    An acknowledgement is a press after a release, both published after the takeover; it counts
    while it is not older than the `max_age` of its topic. One that is older as it is seen is spent.
    """
    if module.latch is None or mode != SC:
        return c, True
    if module.acknowledgement is None:
        return c, c.Topics[module.latch] == OPEN
    max_age = system.topics[module.acknowledgement].max_age_ns
    assert max_age is not None, "M027"
    held, since = c.Topics[module.latch], c.stamps[module.latch]
    pressed, stamp = c.Topics[module.acknowledgement], c.stamps[module.acknowledgement]
    if since == NEVER:  # the first look of this start: only what comes after it counts
        since = c.ct
    if held == ACKNOWLEDGED and c.ct - since > max_age:
        held = WAITS
    if stamp > since and held == WAITS and not pressed:
        held, since = READY, stamp
    elif stamp > since and held == READY and pressed:
        held, since = ACKNOWLEDGED if c.ct - stamp <= max_age else WAITS, stamp
    return _remembered(c, module.latch, held, since), held == ACKNOWLEDGED


def latch_switched(c: Configuration, module: Module, after: int) -> Configuration:
    """A takeover latches; what gave control back is used up."""
    if module.latch is None:
        return c
    if module.acknowledgement is None:
        return _remembered(c, module.latch, CLOSED, NEVER)
    return _remembered(c, module.latch, WAITS, NEVER if after == AC else c.ct)


def _remembered(c: Configuration, latch: int, held: int, since: int) -> Configuration:
    topics = put(c.Topics, latch, held)
    return replace(c, Topics=topics, stamps=put(c.stamps, latch, since))
