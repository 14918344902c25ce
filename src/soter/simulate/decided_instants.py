"""Which decision modules decided in which states of a trace.

Purpose: `decided_at`, from the calendar and the faults that move it.
Non-goals: what they decided (`decisions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.semantics.random.faults import by_component, is_released

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.language.model.system import System


def decided_at(system: System, states: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """In which of these states (n,) each module has just decided, (n, modules)."""
    times_ns = states["header"]["ct"]
    periods = np.array([m.period_ns for m in system.modules], dtype=np.int64)
    due: npt.NDArray[np.bool_] = times_ns[:, np.newaxis] % periods == 0
    late = by_component(system, of_time=True)
    for m in system.modules:
        if m.dm in late and len(states):
            dm, seed = system.components[m.dm], int(states["header"]["seed"][0])
            release_flags = [is_released(system, late[m.dm], dm, seed, int(t)) for t in times_ns]
            due[:, m.index] = release_flags
    return due
