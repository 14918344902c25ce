"""Random draws by counters, so that no draw depends on another.

Purpose: a draw is keyed by seed, stream and index: arms of an experiment and edits do not shift
each other. The arithmetic is that of docs/semantics.md, section Random draws.
Non-goals: when something is drawn (`interpreter.py`); draws that a driver answers
(`answered_draws.py`), that are adverse (`adverse_draws.py`) or written down (`recorded_draws.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
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
    from collections.abc import Callable, Iterator, Sequence

    from soter.language.model.system import Bound, Component
    from soter.language.model.types import Type, Value


MASK = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15
"""The increment of SplitMix64: 2^64 by the golden ratio, an odd number."""


def splitmix64(z: int) -> int:
    """Gives the unsigned 64-bit number that the finaliser of SplitMix64 makes of `z`."""
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def fnv1a_64(text: str) -> int:
    """Gives the FNV-1a hash of the UTF-8 bytes of a text, 64 bits."""
    h = 0xCBF29CE484222325
    for byte in text.encode():
        h = ((h ^ byte) * 0x100000001B3) & MASK
    return h


@lru_cache(maxsize=4096)
def stream_key(seed: int, stream: str) -> int:
    """Gives the key that determines all draws of a stream under this seed."""
    return splitmix64(splitmix64((seed + GOLDEN) & MASK) ^ fnv1a_64(stream))


def draw_bits(seed: int, stream: str, index: int) -> int:
    """Gives the 64 random bits of a stream at an index."""
    return bits_at(stream_key(seed, stream), index)


def bits_at(key: int, index: int) -> int:
    """Gives the 64 random bits at an index of the stream with this key."""
    return splitmix64((key + (index + 1) * GOLDEN) & MASK)


def draw_float(seed: int, stream: str, index: int, low: float, high: float) -> float:
    """Gives a uniform float of [low, high]; rounding cannot push it outside."""
    return float_of_bits(draw_bits(seed, stream, index), low, high)


def float_of_bits(bits: int, low: float, high: float) -> float:
    """Gives the float of [low, high] that the first 53 of 64 random bits select."""
    u = float(bits >> 11) * 2.0**-53
    return min(low + (high - low) * u, high)


class Draws(Protocol):
    """The free choices of the environment; `SeededDraws` makes them by chance."""

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives a float of [low, high]."""

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives a value of a scalar type within its bound."""

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives an index from 0 to `count` - 1, where `count` is at least 1."""


CHOICES_A_STEP = 4096
"""How many indices of a component's stream of choices belong to one release."""


@dataclass(frozen=True)
class SeededDraws:
    """Draws by chance under a seed, as docs/semantics.md defines them."""

    seed: int

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives a uniform float of [low, high]."""
        return draw_float(self.seed, stream, index, low, high)

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives a uniform value of a scalar type within its bound."""
        return _draw_leaf(t, bound, self.seed, stream, index)

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives an index below `count`, drawn uniformly."""
        return draw_bits(self.seed, stream, index) % count


def choice_answerer(draws: Draws, component: Component, ct: int) -> Callable[[int], int]:
    """Gives a function that answers the `choose`s of one step at `ct` in order from `draws`."""
    stream = f"{component.name}.choose"
    indices = count((ct - component.phase_ns) // component.period_ns * CHOICES_A_STEP)
    return lambda alternatives: draws.choice(stream, next(indices), alternatives)


def chosen_value(
    t: Type, bounds: Sequence[Bound | None], draws: Draws, base: str, index: int
) -> Value:
    """Gives a value whose leaves are drawn by `draws`, each from its separate stream.

    `bounds` are in the order of `leaves(t)`. A list has no fixed leaves and cannot be drawn.
    """
    drawn = (
        draws.leaf_value(leaf, bound, stream_of_leaf(base, path), index)
        for (path, leaf), bound in zip(leaves(t), bounds, strict=True)
    )
    return value_of_leaves(t, drawn)


def stream_of_leaf(base: str, path: tuple[str, ...]) -> str:
    """Gives the stream of one leaf: `base.x` for a field, `base.[0]` for an element."""
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
    """Builds a value of type `t` (without lists) from its leaves in the order of `leaves(t)`."""
    if isinstance(t, RecordType):
        return tuple([value_of_leaves(f, leaf_values) for _, f in t.fields])
    if isinstance(t, ArrayType):
        return tuple([value_of_leaves(t.element, leaf_values) for _ in range(t.size)])
    return next(leaf_values)
