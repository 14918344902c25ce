"""The numbers of a configuration that a page draws.

Purpose: every number of every topic and every true state as a signal with unit, panel and limits.
Non-goals: drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.types import ArrayType, BoolType, FloatType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import System
    from soter.language.model.types import Type
    from soter.semantics.configuration import Configuration

SIGNALS_MAX = 16
ELEMENTS_MAX = 4


@dataclass(frozen=True)
class Signal:
    """A number: of topic `index`, or with `plant` of the state of component `index`."""

    name: str
    unit: str
    plant: bool
    index: int
    path: tuple[int, ...]

    def of(self, c: Configuration) -> float:
        """Its value."""
        value = c.L[self.index] if self.plant else c.Topics[self.index]
        for i in self.path:
            value = value[i]
        return float(value)

    def about(self) -> dict[str, object]:
        """As the page wants it."""
        return {"name": self.name, "unit": self.unit}


def signals_of(system: System) -> list[Signal]:
    """True states first, then topics; at most `SIGNALS_MAX`."""
    signals: list[Signal] = []
    for c in system.components:
        if c.plant is not None:
            for i, v in enumerate(c.plant.states):
                for name, unit, path in _numbers(f"{c.name}.{v.name}", v.type):
                    signals.append(Signal(name, unit, plant=True, index=c.index, path=(i, *path)))
    for t in system.topics:
        if t.queue_of is None and not t.held:
            for name, unit, path in _numbers(t.name, t.type):
                signals.append(Signal(name, unit, plant=False, index=t.index, path=path))
    return signals[:SIGNALS_MAX]


def _numbers(
    name: str, t: Type, path: tuple[int, ...] = ()
) -> Iterator[tuple[str, str, tuple[int, ...]]]:
    """Names, units and places of the numbers of a type; long arrays and lists are left out."""
    if isinstance(t, (FloatType, IntType)):
        yield name, t.unit, path
    elif isinstance(t, BoolType):
        yield name, "", path
    elif isinstance(t, RecordType):
        for i, (n, f) in enumerate(t.fields):
            yield from _numbers(f"{name}.{n}", f, (*path, i))
    elif isinstance(t, ArrayType) and t.size <= ELEMENTS_MAX:
        for i in range(t.size):
            yield from _numbers(f"{name}[{i}]", t.element, (*path, i))
