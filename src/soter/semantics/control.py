"""Who has control: OE of every controller, from the modes of the modules.

Purpose: dm1 and dm2 of the paper's DM-Step, also where a module stands in the place of AC
(docs/semantics.md, Modules above modules): its own controllers then have control only while the
mode of the module above is AC.
Non-goals: deciding a mode (`rules.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.semantics.observer_records import AC, SC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Module, System


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
