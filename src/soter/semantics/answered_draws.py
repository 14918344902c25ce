"""Draws that a driver decides itself: it is asked for each choice that a step leaves open.

Purpose: `AnsweredDraws` asks for the number of an alternative (docs/testing.md, Choices).
Non-goals: which alternatives are worth trying (`explore/`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from soter.semantics.draws import SeededDraws

if TYPE_CHECKING:
    from soter.language.model.system import Bound, System
    from soter.language.model.types import Type, Value

Answer = Callable[[str, int], int]
"""(stream, count) -> pick, 0 <= pick < count; called in the order in which steps ask."""
MANY = 2**32 - 1
"""The most alternatives of a question; later ones are never picked."""


@dataclass(frozen=True, slots=True)
class ChoiceQuestion:
    """A question that had more than one possible answer, with the answer."""

    stream: str
    count: int
    pick: int
    value: Value


class AnsweredDraws:
    """Draws that follow `answer`: a function, or queues of picks by stream (0 once they are empty).

    A question with one alternative is not asked. Held disturbances and the draws of extern plants
    come by chance from `seed`. `questions` records what was asked, in order; a caller may empty it
    between steps.
    """

    def __init__(
        self, system: System, answer: Answer | Mapping[str, Iterable[int]], seed: int = 0
    ) -> None:
        self.answer = answer if callable(answer) else queued_answers(answer)
        self.questions: list[ChoiceQuestion] = []
        self._chance = SeededDraws(seed)
        self._by_chance = frozenset(_streams_of_chance(system))

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives one of three values, as the answer picks: 0 (or the middle), `low` or `high`."""
        if stream in self._by_chance:
            return self._chance.uniform(stream, index, low, high)
        middle = 0.0 if low <= 0.0 <= high else low + (high - low) / 2.0
        values = (middle, low, high)
        value: float = self._value_asked(stream, 3 if low < high else 1, lambda pick: values[pick])
        return value

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives a float as `uniform` does; any bool, any enum member, or any int of the bound."""
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            return self._value_asked(stream, 2, bool)
        if isinstance(t, EnumType):
            return self._value_asked(stream, len(t.members), int)
        assert isinstance(t, IntType), t
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        return self._value_asked(stream, min(high - low + 1, MANY), lambda pick: low + pick)

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives the number of the alternative that the answer picks."""
        if stream in self._by_chance:
            return self._chance.choice(stream, index, count)
        pick: int = self._value_asked(stream, count, int)
        return pick

    def _value_asked(self, stream: str, count: int, value: Callable[[int], Value]) -> Value:
        if count == 1:
            return value(0)
        pick = self.answer(stream, count)
        assert 0 <= pick < count, f"{stream}: {pick} is none of {count} alternatives"
        outcome = value(pick)
        self.questions.append(ChoiceQuestion(stream, count, pick, outcome))
        return outcome


def queued_answers(picks: Mapping[str, Iterable[int]]) -> Answer:
    """Gives an `Answer` that takes its picks from a queue for each stream; 0 for an empty queue."""
    left = {stream: iter(queue) for stream, queue in picks.items()}
    return lambda stream, _: next(left.get(stream, iter(())), 0)


def _streams_of_chance(system: System) -> Iterable[str]:
    """Gives the streams that are drawn by chance, without a question to the driver."""
    for component in system.components:
        for d in component.disturbances:
            if d.hold_ns > 0 or component.extern:
                yield from d.streams
        if component.extern:
            yield from (m.stream for m in component.measured)
        if component.extern and component.plant is not None:
            yield f"{component.name}.choose"
