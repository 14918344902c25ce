"""Draws of an adversary: floats at the ends of their bounds, in a pattern by the seed.

Purpose: the twin of `native/c/soter_adversary.h`, so that the reference interpreter can repeat a
run that was found natively, draw by draw.
Non-goals: which seeds are worth trying (`verify/refute.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.types import FloatType
from soter.semantics.draws import (
    GOLDEN,
    MASK,
    SeededDraws,
    bits_at,
    float_of_bits,
    fnv1a_64,
    splitmix64,
)

if TYPE_CHECKING:
    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value

CHANCE, CORNER, TURN, HOLDS, TOGETHER, MIXED = range(6)
"""The adversary's patterns, which the top byte of a seed selects."""


def _patterned_uniform(key: int, index: int, low: float, high: float) -> float:
    segment = bits_at(key, index >> (3 + (key & 7)))
    if segment & 3 == 0:
        return low
    if segment & 3 == 1:
        return high
    if segment & 3 == 2:
        return float_of_bits(segment, low, high)
    return float_of_bits(bits_at(key, index), low, high)


def adverse_float(seed: int, stream: str, index: int, low: float, high: float) -> float:
    """Gives the same float of [low, high] as `soter_draw` of `native/c/soter_adversary.h`."""
    seed_key = splitmix64((seed + GOLDEN) & MASK)
    key = splitmix64(seed_key ^ fnv1a_64(stream))
    side = key >> 63
    pattern = seed >> 56
    if pattern == TURN:
        side ^= index >= ((key >> 8) & 0xFFFF) % (1 << (key % 14))
    elif pattern == HOLDS:
        side = bits_at(key, index >> (key % 13)) >> 63
    elif pattern == TOGETHER:
        side ^= bits_at(seed_key, index >> (seed_key % 13)) >> 63
    elif pattern == MIXED:
        return _patterned_uniform(key, index, low, high)
    elif pattern != CORNER:
        return float_of_bits(bits_at(key, index), low, high)
    return high if side else low


@dataclass(frozen=True)
class AdverseDraws:
    """Draws floats at their bounds in a pattern set by the seed, and other values by chance."""

    seed: int

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives a float of [low, high], which follows the pattern of the seed."""
        return adverse_float(self.seed, stream, index, low, high)

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives a value of a scalar type: a float as `uniform` gives it, another type by chance."""
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        return SeededDraws(self.seed).leaf_value(t, bound, stream, index)

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives an index below `count`, drawn by chance."""
        return SeededDraws(self.seed).choice(stream, index, count)
