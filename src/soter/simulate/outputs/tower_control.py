"""Who has control in a tower: modules that stand in the place of each other's AC.

Purpose: `levels_of`: of every state of a trace the controller that has control; `told`: how long
each had it, in words.
Non-goals: what each DM decides: a module below one that is in SC goes on deciding, without effect.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.system import modules_above, tower_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.language.model.system import Module, System
    from soter.simulate.result import Run

TIMES = "\N{MULTIPLICATION SIGN}"


def towers(system: System) -> list[tuple[Module, ...]]:
    """Every tower of a system, its topmost module first."""
    return [
        tower_of(system, m.index)
        for m in system.modules
        if m.over is not None and not modules_above(system, m.index)
    ]


def controllers(system: System, tower: tuple[Module, ...]) -> list[str]:
    """Who may have control, the SC of the topmost module first, the AC of the lowest last."""
    return [system.components[i].name for i in (*(m.sc for m in tower), tower[-1].ac)]


def levels_of(tower: tuple[Module, ...], trace: npt.NDArray[np.void]) -> npt.NDArray[np.intp]:
    """Of each state, (states,), the number of the one in `controllers` that has control."""
    modes = trace["modules"]["mode"][:, [m.index for m in tower]] == 1
    held: npt.NDArray[np.intp] = np.cumprod(modes, axis=1).sum(axis=1)
    return held


def told(run: Run) -> list[str]:
    """A line for each tower: shares of the time, and how often each took or was given control."""
    trace = run.require_trace()
    time_ns = trace["header"]["ct"].astype(np.float64)
    lasts = np.diff(time_ns, append=run.reached_s * 1e9)
    lines = []
    for tower in towers(run.system):
        held = levels_of(tower, trace)
        begins = np.flatnonzero(np.diff(held, prepend=-1))
        parts = [
            f"{name} {lasts[held == k].sum() / max(lasts.sum(), 1.0):.1%} of the time, "
            f"{int((held[begins] == k).sum())} {TIMES}"
            for k, name in enumerate(controllers(run.system, tower))
        ]
        lines.append(f"Who had control in {tower[0].name}: {'; '.join(parts)}.")
    return lines
