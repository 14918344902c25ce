"""Random draws by counters, keyed by seed, stream and index, and draws that a driver chooses.

Purpose: no draw depends on another, so arms of an experiment and edits of a program do not shift
each other. The arithmetic is that of docs/semantics.md, section Random draws. `AdverseDraws` are
the twin of `native/c/soter_adversary.h`, so that the reference interpreter can repeat a run that
was found natively, draw by draw; `Recorder` notes draws. `AnsweredDraws` are for a driver that
decides itself what a step leaves open (docs/testing.md, Choices).
Non-goals: when something is drawn (`interpreter.py`); which seeds or alternatives are worth trying
(`verify/refute.py`, `explore/`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import count
from typing import TYPE_CHECKING, Protocol

from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Bound, Component, System
    from soter.language.model.types import Type, Value


_MASK = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


def splitmix64(z: int) -> int:
    """The finaliser of SplitMix64 on an unsigned 64-bit number."""
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return z ^ (z >> 31)


def fnv1a_64(text: str) -> int:
    """FNV-1a of the UTF-8 bytes of a text, 64 bits."""
    h = 0xCBF29CE484222325
    for byte in text.encode():
        h = ((h ^ byte) * 0x100000001B3) & _MASK
    return h


@lru_cache(maxsize=4096)
def stream_key(seed: int, stream: str) -> int:
    """The key of one stream under one seed."""
    return splitmix64(splitmix64((seed + GOLDEN) & _MASK) ^ fnv1a_64(stream))


def draw_bits(seed: int, stream: str, index: int) -> int:
    """64 random bits."""
    return splitmix64((stream_key(seed, stream) + (index + 1) * GOLDEN) & _MASK)


def draw_float(seed: int, stream: str, index: int, low: float, high: float) -> float:
    """A uniform float of [low, high]; rounding never leads outside."""
    u = float(draw_bits(seed, stream, index) >> 11) * 2.0**-53
    return min(low + (high - low) * u, high)


class Draws(Protocol):
    """The environment's free choices, made by chance unless said otherwise (`SeededDraws`)."""

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type within its bound."""

    def choice(self, stream: str, index: int, count: int) -> int:
        """The number of one of `count` alternatives, count >= 1."""


CHOICES_A_STEP = 4096
"""Indices of the stream of a component's choices that belong to one release."""


@dataclass(frozen=True)
class SeededDraws:
    """The draws of docs/semantics.md."""

    seed: int

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A uniform float."""
        return draw_float(self.seed, stream, index, low, high)

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A uniform value."""
        return _draw_leaf(t, bound, self.seed, stream, index)

    def choice(self, stream: str, index: int, count: int) -> int:
        """A uniform choice."""
        return draw_bits(self.seed, stream, index) % count


def choice_answerer(draws: Draws, component: Component, ct: int) -> Callable[[int], int]:
    """The function that answers the `choose`s of one step at `ct` from `draws`, in order."""
    stream = f"{component.name}.choose"
    indices = count((ct - component.phase_ns) // component.period_ns * CHOICES_A_STEP)
    return lambda alternatives: draws.choice(stream, next(indices), alternatives)


def chosen_value(
    t: Type, bounds: Sequence[Bound | None], draws: Draws, base: str, index: int
) -> Value:
    """A value whose leaves `draws` chooses, each from a stream of its own.

    `bounds` in the order of `leaves(t)`; a list has no fixed leaves and cannot be drawn.
    """
    drawn = (
        draws.leaf(leaf, bound, leaf_name(base, path), index)
        for (path, leaf), bound in zip(leaves(t), bounds, strict=True)
    )
    return value_of_leaves(t, drawn)


def leaf_name(base: str, path: tuple[str, ...]) -> str:
    """The stream of one leaf: `base.x` for a field, `base.[0]` for an element."""
    return ".".join((base, *path))


def _draw_leaf(t: Type, bound: Bound | None, seed: int, stream: str, index: int) -> Value:
    if isinstance(t, FloatType):
        assert bound is not None, f"{stream} is not bounded"
        return draw_float(seed, stream, index, bound.low, bound.high)
    bits = draw_bits(seed, stream, index)
    if isinstance(t, BoolType):
        return bool(bits >> 63)
    if isinstance(t, EnumType):
        return bits % len(t.members)
    assert isinstance(t, IntType), t
    low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
    return low + bits % (high - low + 1)


def value_of_leaves(t: Type, leaf_values: Iterator[Value]) -> Value:
    """The value of type `t` with these leaves, in the order of `leaves(t)`; no lists."""
    if isinstance(t, RecordType):
        return tuple([value_of_leaves(f, leaf_values) for _, f in t.fields])
    if isinstance(t, ArrayType):
        return tuple([value_of_leaves(t.element, leaf_values) for _ in range(t.size)])
    return next(leaf_values)


Answer = Callable[[str, int], int]
"""(stream, count) -> pick, 0 <= pick < count; called in the order in which steps ask."""

MANY = 2**32 - 1
"""The most alternatives of a question; those beyond are not reached."""


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
        self.answer = answer if callable(answer) else queued_answers(answer)
        self.asked: list[ChoiceQuestion] = []
        self._chance = SeededDraws(seed)
        self._by_chance = frozenset(_streams_of_chance(system))

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
        """The number of one of `count` alternatives."""
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


def queued_answers(picks: Mapping[str, Iterable[int]]) -> Answer:
    """Answers from one queue of picks a stream; the default where it has run out."""
    left = {stream: iter(queue) for stream, queue in picks.items()}
    return lambda stream, _: next(left.get(stream, iter(())), 0)


def _streams_of_chance(system: System) -> Iterable[str]:
    """The streams that chance answers, not the driver."""
    for component in system.components:
        for d in component.disturbances:
            if d.hold_ns > 0 or component.extern:
                yield from d.streams
        if component.extern:
            yield from (m.stream for m in component.measured)
        if component.extern and component.plant is not None:
            yield f"{component.name}.choose"


_GOLDEN = 0x9E3779B97F4A7C15

CHANCE, CORNER, TURN, HOLDS, TOGETHER, MIXED = range(6)
"""The adversary's patterns, which the top byte of a seed selects."""


def _spread_bits(key: int, index: int) -> int:
    return splitmix64((key + (index + 1) * _GOLDEN) & _MASK)


def _float_between(bits: int, low: float, high: float) -> float:
    u = float(bits >> 11) * 2.0**-53
    return min(low + (high - low) * u, high)


def _mix_uniform(key: int, index: int, low: float, high: float) -> float:
    segment = _spread_bits(key, index >> (3 + (key & 7)))
    if segment & 3 == 0:
        return low
    if segment & 3 == 1:
        return high
    if segment & 3 == 2:
        return _float_between(segment, low, high)
    return _float_between(_spread_bits(key, index), low, high)


def adverse_float(seed: int, stream: str, index: int, low: float, high: float) -> float:
    """What `soter_draw` of `native/c/soter_adversary.h` gives."""
    seed_key = splitmix64((seed + _GOLDEN) & _MASK)
    key = splitmix64(seed_key ^ fnv1a_64(stream))
    side = key >> 63
    pattern = seed >> 56
    if pattern == TURN:
        side ^= index >= ((key >> 8) & 0xFFFF) % (1 << (key % 14))
    elif pattern == HOLDS:
        side = _spread_bits(key, index >> (key % 13)) >> 63
    elif pattern == TOGETHER:
        side ^= _spread_bits(seed_key, index >> (seed_key % 13)) >> 63
    elif pattern == MIXED:
        return _mix_uniform(key, index, low, high)
    elif pattern != CORNER:
        return _float_between(_spread_bits(key, index), low, high)
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
        """The number of one of some alternatives."""
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

    def _draw_at(self, stream: str, index: int) -> Value:
        noted = self.choices.get(stream, [])
        at = bisect_right(noted, index, key=lambda entry: entry[0]) - 1
        if at < 0:
            raise ChoiceError(f"no choice is given for `{stream}` at {index}")
        return noted[at][1]

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """The float that was chosen."""
        value = self._draw_at(stream, index)
        if isinstance(value, bool) or not isinstance(value, float) or not low <= value <= high:
            raise ChoiceError(f"`{stream}` at {index}: {value} is not in [{low}, {high}]")
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """The value that was chosen."""
        value = self._draw_at(stream, index)
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
        value = self._draw_at(stream, index)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
            raise ChoiceError(f"`{stream}` at {index}: {value} is none of {count} alternatives")
        return value
