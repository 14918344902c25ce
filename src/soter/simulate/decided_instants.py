"""Which decision modules decided in which states of a trace, and where a shield moved a command.

Purpose: `decided_at`, from the calendar and the faults that move it; `moved_at`, from what AC
proposed and what is published.
Non-goals: what they decided (`decisions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.model.types import ArrayType, RecordType
from soter.semantics.random.faults import by_component, is_released

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.language.model.system import Module, System
    from soter.language.model.types import Type


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


def moved_at(
    system: System, module: Module, states: npt.NDArray[Any]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """In which states (n,) AC, in control, has just published, and where its shield moved that.

    (n,) both; nowhere where the module has no shield `toward sc`.
    """
    published, was_moved = np.zeros((2, len(states)), dtype=np.bool_)
    shield = module.shield
    if shield is None or shield.proposed is None:
        return published, was_moved
    proposals = states["topics"][system.topics[shield.proposed].name]
    in_ac = states["modules"]["mode"][:, module.index] != 0
    at = 0
    for i in module.outputs:
        numbers = numbers_of(system.topics[i].type, states["topics"][system.topics[i].name])
        proposed = proposals[:, at : at + numbers.shape[-1]]
        at += numbers.shape[-1]
        told = in_ac & (states["stamps"][:, i] == states["header"]["ct"])
        published |= told
        was_moved |= told & (numbers != proposed).any(axis=-1)
    return published, was_moved


def numbers_of(t: Type, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """(..., k): the k numbers of every value of a type without lists, in declared order."""
    if isinstance(t, RecordType):
        return np.concatenate([numbers_of(f, values[n]) for n, f in t.fields], axis=-1)
    if isinstance(t, ArrayType):
        parts = numbers_of(t.element, values)
        return parts.reshape(*parts.shape[:-2], -1)
    return values.astype(np.float64)[..., np.newaxis]
