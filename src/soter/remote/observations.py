"""What a policy reads: values with the time of their measurement.

Purpose: `Reading` of one topic, `Observation` of several at once.
Non-goals: where they come from (`robot.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

SECOND = 1e9


@dataclass(frozen=True)
class Reading:
    """A topic's newest value: `stamp`, ns on CLOCK_MONOTONIC, is when it was measured.

    `age`: how long that was ago as it was read, in s.
    """

    value: Any
    stamp: int
    age: float


class Observation(dict[str, Any]):
    """Topic -> value, with the readings behind them in `readings`."""

    def __init__(self, readings: dict[str, Reading]) -> None:
        super().__init__({name: r.value for name, r in readings.items()})
        self.readings = readings

    @property
    def measured(self) -> int:
        """When the oldest of its values was measured: what an action that rests on it may say."""
        return min(r.stamp for r in self.readings.values())

    @property
    def age(self) -> float:
        """Of the oldest of its values as they were read, in s."""
        return max(r.age for r in self.readings.values())
