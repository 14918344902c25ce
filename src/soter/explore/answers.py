"""The picks of a trace, handed to the reference interpreter one step at a time.

Purpose: whatever a step asks is answered from its own list, stream by stream and in order, with
the alternatives of docs/testing.md; every question and its answer is kept for the reader.
Non-goals: `hold`ing disturbances, which stay drawn by chance.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.explore.trace import Choice
from soter.program.types import BoolType, EnumType, FloatType, IntType
from soter.program.values import to_json
from soter.semantics.random_draws import SeededDraws

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.program.system import Bound, System
    from soter.program.types import Type, Value


class WrongPickError(Exception):
    """A pick that answers nothing that the step asks; the message says why."""


@dataclass
class TraceDraws:
    """Draws (`semantics/random_draws.py`) that a trace answers; `streams` are drawn by chance."""

    seed: int
    streams: frozenset[str]
    asked: list[Choice] = field(default_factory=list)
    """What the step has asked so far, with the values taken."""
    _given: dict[str, list[Choice]] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, seed: int) -> TraceDraws:
        """For the executions of one system."""
        disturbances = (d for c in system.components for d in c.disturbances)
        return cls(seed, frozenset(s for d in disturbances if d.hold_ns for s in d.streams))

    # ------------------------------------------------------------ one step

    def begin(self, choices: Iterable[Choice]) -> None:
        """A step begins, which has these picks."""
        self.asked = []
        self._given = {}
        for choice in choices:
            self._given.setdefault(choice.stream, []).append(choice)

    def end(self) -> tuple[Choice, ...]:
        """The step is over: everything it asked. `WrongPickError` where picks are left over."""
        for stream, left in self._given.items():
            if left:
                raise WrongPickError(f"nothing asks for a choice from `{stream}`")
        return tuple(self.asked)

    def _pick(self, stream: str, count: int) -> int:
        """The next pick of a stream; the first alternative where the trace says nothing."""
        if count < 2:
            return 0
        left = self._given.get(stream)
        if not left:
            return 0
        choice = left.pop(0)
        if choice.of != count:
            message = f"`{stream}` has {count} alternatives here, not {choice.of}"
            raise WrongPickError(message)
        return choice.pick

    def _keep(self, stream: str, pick: int, count: int, value: object) -> None:
        if count > 1:
            self.asked.append(Choice(stream, pick, count, value))

    def tell(self, value: object) -> None:
        """The value, as JSON, that the last answer to `choice` stood for."""
        if self.asked:
            self.asked[-1] = replace(self.asked[-1], value=value)

    # ------------------------------------------------------------ Draws

    def choice(self, stream: str, index: int, count: int) -> int:
        """One of `count` alternatives; their values are not known here."""
        del index
        pick = self._pick(stream, count)
        self._keep(stream, pick, count, None)
        return pick

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]: the middle, low or high."""
        if stream in self.streams:
            return SeededDraws(self.seed).uniform(stream, index, low, high)
        count = 3 if low < high else 1
        pick = self._pick(stream, count)
        middle = 0.0 if low <= 0.0 <= high else low + (high - low) / 2.0
        value = (middle, low, high)[pick]
        self._keep(stream, pick, count, value)
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type within its bound."""
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        low, count = _alternatives(t, bound)
        pick = self._pick(stream, count)
        value = bool(pick) if isinstance(t, BoolType) else low + pick
        self._keep(stream, pick, count, to_json(t, value))
        return value


def _alternatives(t: Type, bound: Bound | None) -> tuple[int, int]:
    """The first value and how many there are."""
    if isinstance(t, BoolType):
        return 0, 2
    if isinstance(t, EnumType):
        return 0, len(t.members)
    assert isinstance(t, IntType), t
    low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
    return low, high - low + 1
