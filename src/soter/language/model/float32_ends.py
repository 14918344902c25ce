"""What a float32 makes of the ends of a set (docs/decisions.md, 257).

Purpose: how far beyond an end what comes from outside is still that end.
Non-goals: who asks: the gate of both engines, channels.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.language.model.system import Bound


def singles(bound: Bound) -> tuple[float, float]:
    """For each end the float32 that is nearest to it, where that lies outside; else the end."""
    return min(bound.low, _single(bound.low)), max(bound.high, _single(bound.high))


def _single(number: float) -> float:
    """The nearest float32; of what is too large for one, the number itself."""
    try:
        nearest: float = struct.unpack("<f", struct.pack("<f", number))[0]
    except OverflowError:
        return number
    return nearest
