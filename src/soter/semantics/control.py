"""Who has control: OE of every controller, from the modes of the modules; and their latches.

Purpose: dm1 and dm2 of the paper's DM-Step, also where a module stands in the place of AC
(docs/semantics.md, Modules above modules): its own controllers then have control only while the
mode of the module above is AC. And what a DM step finds of the operator's acknowledgement, where a
latch wants one, and what a switch makes of it (The latch).
Non-goals: deciding a mode (`rules.py`); where a latch lies
(`elaborate/margin_and_latch_topics.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.semantics.configuration import NEVER, put
from soter.semantics.observer_records import AC, SC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Module, System
    from soter.semantics.configuration import Configuration


WAITS, READY, ACKNOWLEDGED = 0, 1, 2
OPEN, CLOSED = 0, 1


def enabled(
    system: System, oe: Sequence[bool], modes: Sequence[int], module: Module
) -> tuple[bool, ...]:
    """OE after the mode of a module was decided; `modes` by module.

    OE of a DM says whether its module is to have control at all: always, but for one in the place
    of AC.
    """
    flags = list(oe)
    on, m = flags[module.dm], module
    while True:
        flags[m.sc] = on and modes[m.index] == SC
        on = on and modes[m.index] == AC
        if m.over is None:
            break
        m = system.modules[m.over]
        flags[m.dm] = on
    flags[m.ac] = on
    return tuple(flags)


def enabled_at_first(system: System, modes: Sequence[int]) -> tuple[bool, ...]:
    """OE at the start; what is no controller always has it."""
    oe: tuple[bool, ...] = (True,) * len(system.components)
    for module in system.modules:
        oe = enabled(system, oe, modes, module)
    return oe


# ---------------------------------------------------------------- latches


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
