"""The parts of a trace that somebody wants to keep.

Purpose: from names (topics, `<plant>.truth`, modules) to a smaller record, and states copied to it.
Non-goals: reading a trace (`result.py`), keeping it (`run_observer.py`).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import group_field
from soter.diagnostics.similar_names import nearest_or_all
from soter.simulate.run_settings import usage_error

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.language.model.system import System

    Kept = bool | str | Collection[str]
    """All of a trace, nothing of it, or the named parts."""


def names_of(keep: Kept) -> tuple[str, ...] | None:
    """The parts that are named, perhaps none; None where all or nothing is kept."""
    if isinstance(keep, str):
        return (keep,)
    return tuple(dict.fromkeys(keep)) if isinstance(keep, Collection) else None


def wanted(keep: Kept) -> bool:
    """Whether anything is kept, and be it only the times."""
    return names_of(keep) is not None or bool(keep)


class TraceParts:
    """Some parts of the states of a system: `header`, and what is named."""

    def __init__(
        self, system: System, layout: StateLayout, dtype: np.dtype[Any], names: tuple[str, ...]
    ) -> None:
        topics = {t.name for t in system.topics}
        truths = {
            f"{system.components[g.owner].name}.truth": group_field(g)
            for g in layout.groups
            if g.owner >= 0 and system.components[g.owner].plant is not None
        }
        modules = {m.name for m in system.modules}
        for name in names:
            if name not in topics and name not in truths and name not in modules:
                known = nearest_or_all(name, [*topics, *truths, *modules])
                message = f"the run has no topic, truth or module `{name}` to record"
                raise usage_error("U001", message, known)
        self._topics = [n for n in names if n in topics]
        self._whole = ["header"]
        if modules.intersection(names):
            self._whole.append("modules")
        self._whole += [truths[n] for n in names if n in truths]
        fields = [(part, dtype[part]) for part in self._whole]
        if self._topics:
            fields.append(("topics", np.dtype([(n, dtype["topics"][n]) for n in self._topics])))
        self.dtype: np.dtype[Any] = np.dtype(fields)

    def of(self, states: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Copies of these parts, (n,), of states, (n,)."""
        copies = np.empty(len(states), dtype=self.dtype)
        for part in self._whole:
            copies[part] = states[part]
        for name in self._topics:
            copies["topics"][name] = states["topics"][name]
        return copies
