"""The latch and the plan of a module, which its DM keeps in hidden topics between its steps.

Purpose: the latch by which AC gets control back only after an acknowledgement (docs/semantics.md),
and the plan that SC follows.
Non-goals: deciding a mode (`rules.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.semantics.configuration import AC, NEVER, SC, with_value

if TYPE_CHECKING:
    from soter.language.model.system import Module, System
    from soter.semantics.configuration import Configuration

WAITS, READY, ACKNOWLEDGED = 0, 1, 2
OPEN, CLOSED = 0, 1


def read_latch(
    system: System, c: Configuration, module: Module, mode: int
) -> tuple[Configuration, bool]:
    """Gives the configuration after a DM has read its latch, and whether AC may have control.

    An acknowledgement is a press of a button after a release, both published after the takeover. A
    press older than the `max_age` of its topic when the DM reads it does not count, now or later.
    """
    if module.latch is None or mode != SC:
        return c, True
    if module.acknowledgement is None:
        return c, c.Topics[module.latch] == OPEN
    max_age = system.topics[module.acknowledgement].max_age_ns
    assert max_age is not None, "M028"
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
    return _with_latch(c, module.latch, held, since), held == ACKNOWLEDGED


def with_latch_after_change(c: Configuration, module: Module, after: int) -> Configuration:
    """Gives the configuration after a change of mode, which sets the module's latch anew."""
    if module.latch is None:
        return c
    if module.acknowledgement is None:
        return _with_latch(c, module.latch, CLOSED, NEVER)
    return _with_latch(c, module.latch, WAITS, NEVER if after == AC else c.ct)


def with_plan(c: Configuration, module: Module, after: int, plan: int | None) -> Configuration:
    """Gives the configuration with the good plan stored for SC to follow, if the mode is AC."""
    if after != AC or plan is None or module.plan is None or module.forced is not None:
        return c
    return replace(c, Topics=with_value(c.Topics, module.plan, plan))


def _with_latch(c: Configuration, latch: int, held: int, since: int) -> Configuration:
    topics = with_value(c.Topics, latch, held)
    return replace(c, Topics=topics, stamps=with_value(c.stamps, latch, since))
