"""Draws that somebody chooses: at the bounds, to do harm, or one alternative at a time.

Purpose: the adversary is the twin of `native/c/soter_adversary.h`, so that the reference
interpreter can repeat a run that was found natively, draw by draw; `Recorded` has draws that are
written down. Answered draws are for a driver that decides itself what a step leaves open
(docs/testing.md, Choices), such as one that enumerates or replays executions.
Non-goals: which seeds or alternatives are worth trying (`verify/attack/refute.py`, `explore/`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from soter.semantics.random_draws import SeededDraws, fnv, mix

if TYPE_CHECKING:
    from soter.language.model.system import Bound, System
    from soter.language.model.types import Type, Value
    from soter.semantics.random_draws import Draws


Answer = Callable[[str, int], int]
"""(stream, count) -> pick, 0 <= pick < count; called in the order in which steps ask."""

MANY = 2**32 - 1
"""No question has more alternatives; those beyond are not reached."""


@dataclass(frozen=True, slots=True)
class ChoiceQuestion:
    """One question with more than one alternative, and its answer."""

    stream: str
    count: int
    pick: int
    value: Value


class AnsweredDraws:
    """Choices by `answer`: a function, or per stream the picks to come (then 0, the default).

    A question with one alternative is not asked. Disturbances that hold, and what extern plants
    draw, are drawn by chance under `seed`. `asked` says what was asked, in order; empty it between
    steps at will.
    """

    def __init__(
        self, system: System, answer: Answer | Mapping[str, Iterable[int]], seed: int = 0
    ) -> None:
        self.answer = answer if callable(answer) else queued(answer)
        self.asked: list[ChoiceQuestion] = []
        self._chance = SeededDraws(seed)
        self._by_chance = frozenset(_drawn_by_chance(system))

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """The middle (0 where that is inside), low or high."""
        if stream in self._by_chance:
            return self._chance.uniform(stream, index, low, high)
        middle = 0.0 if low <= 0.0 <= high else low + (high - low) / 2.0
        values = (middle, low, high)
        value: float = self._ask(stream, 3 if low < high else 1, lambda pick: values[pick])
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A float as `uniform` has it; any bool, any enum member, any int of the bound."""
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            return self._ask(stream, 2, bool)
        if isinstance(t, EnumType):
            return self._ask(stream, len(t.members), int)
        assert isinstance(t, IntType), t
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        return self._ask(stream, min(high - low + 1, MANY), lambda pick: low + pick)

    def choice(self, stream: str, index: int, count: int) -> int:
        """One of `count` alternatives."""
        if stream in self._by_chance:
            return self._chance.choice(stream, index, count)
        pick: int = self._ask(stream, count, int)
        return pick

    def _ask(self, stream: str, count: int, value: Callable[[int], Value]) -> Value:
        if count == 1:
            return value(0)
        pick = self.answer(stream, count)
        assert 0 <= pick < count, f"{stream}: {pick} is none of {count} alternatives"
        outcome = value(pick)
        self.asked.append(ChoiceQuestion(stream, count, pick, outcome))
        return outcome


def queued(picks: Mapping[str, Iterable[int]]) -> Answer:
    """Answers from one queue of picks a stream; the default where it has run out."""
    left = {stream: iter(queue) for stream, queue in picks.items()}
    return lambda stream, _: next(left.get(stream, iter(())), 0)


def _drawn_by_chance(system: System) -> Iterable[str]:
    """Streams that no driver answers."""
    for component in system.components:
        for d in component.disturbances:
            if d.hold_ns > 0 or component.extern:
                yield from d.streams
        if component.extern:
            yield from (m.stream for m in component.measured)
        if component.extern and component.plant is not None:
            yield f"{component.name}.choose"


_MASK = 2**64 - 1
_GOLDEN = 0x9E3779B97F4A7C15

CHANCE, CORNER, TURN, HOLDS, TOGETHER, MIXED = range(6)
"""The patterns: the top byte of a seed."""


def _spread(key: int, index: int) -> int:
    return mix((key + (index + 1) * _GOLDEN) & _MASK)


def _between(bits: int, low: float, high: float) -> float:
    u = float(bits >> 11) * 2.0**-53
    return min(low + (high - low) * u, high)


def _mixed(key: int, index: int, low: float, high: float) -> float:
    segment = _spread(key, index >> (3 + (key & 7)))
    if segment & 3 == 0:
        return low
    if segment & 3 == 1:
        return high
    if segment & 3 == 2:
        return _between(segment, low, high)
    return _between(_spread(key, index), low, high)


def adverse_float(seed: int, stream: str, index: int, low: float, high: float) -> float:
    """What `soter_draw` of `native/c/soter_adversary.h` gives."""
    seed_key = mix((seed + _GOLDEN) & _MASK)
    key = mix(seed_key ^ fnv(stream))
    side = key >> 63
    pattern = seed >> 56
    if pattern == TURN:
        side ^= index >= ((key >> 8) & 0xFFFF) % (1 << (key % 14))
    elif pattern == HOLDS:
        side = _spread(key, index >> (key % 13)) >> 63
    elif pattern == TOGETHER:
        side ^= _spread(seed_key, index >> (seed_key % 13)) >> 63
    elif pattern == MIXED:
        return _mixed(key, index, low, high)
    elif pattern != CORNER:
        return _between(_spread(key, index), low, high)
    return high if side else low


@dataclass(frozen=True)
class AdverseDraws:
    """Floats at their bounds in the pattern of the seed; bools, ints and enums by chance."""

    seed: int

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""
        return adverse_float(self.seed, stream, index, low, high)

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type."""
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        return SeededDraws(self.seed).leaf(t, bound, stream, index)

    def choice(self, stream: str, index: int, count: int) -> int:
        """An alternative, by chance."""
        return SeededDraws(self.seed).choice(stream, index, count)


# ---------------------------------------------------------------- written down


Choices = dict[str, list[tuple[int, "Value"]]]
"""By stream: (index, value), ascending; a value holds until the next index that is given."""


@dataclass(frozen=True)
class Recorder:
    """Writes down what other draws choose, in the order of a run: indices never fall."""

    draws: Draws
    choices: Choices = field(default_factory=dict)

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""
        value = self.draws.uniform(stream, index, low, high)
        self._note(stream, index, value)
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type."""
        value = self.draws.leaf(t, bound, stream, index)
        self._note(stream, index, value)
        return value

    def choice(self, stream: str, index: int, count: int) -> int:
        """Which of some alternatives."""
        pick = self.draws.choice(stream, index, count)
        self._note(stream, index, pick)
        return pick

    def _note(self, stream: str, index: int, value: Value) -> None:
        noted = self.choices.setdefault(stream, [])
        if not noted or noted[-1][1] != value:
            noted.append((index, value))


class ChoiceError(Exception):
    """A written choice that is missing, or that the program does not allow."""


@dataclass(frozen=True)
class RecordedDraws:
    """Choices that were written down. A choice outside its declared set is a `ChoiceError`."""

    choices: Mapping[str, list[tuple[int, Value]]]

    def _at(self, stream: str, index: int) -> Value:
        noted = self.choices.get(stream, [])
        at = bisect_right(noted, index, key=lambda entry: entry[0]) - 1
        if at < 0:
            raise ChoiceError(f"no choice is given for `{stream}` at {index}")
        return noted[at][1]

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """The float that was chosen."""
        value = self._at(stream, index)
        if isinstance(value, bool) or not isinstance(value, float) or not low <= value <= high:
            raise ChoiceError(f"`{stream}` at {index}: {value} is not in [{low}, {high}]")
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """The value that was chosen."""
        value = self._at(stream, index)
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            allowed = isinstance(value, bool)
        else:
            allowed = isinstance(value, int) and not isinstance(value, bool)
            if allowed and isinstance(t, EnumType):
                allowed = 0 <= value < len(t.members)
            elif allowed and isinstance(t, IntType):
                low, high = (t.low, t.high) if bound is None else (bound.low, bound.high)
                allowed = low <= value <= high
        if not allowed:
            raise ChoiceError(f"`{stream}` at {index}: {value} is no value of its set")
        return value

    def choice(self, stream: str, index: int, count: int) -> int:
        """The alternative that was chosen."""
        value = self._at(stream, index)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
            raise ChoiceError(f"`{stream}` at {index}: {value} is none of {count} alternatives")
        return value
