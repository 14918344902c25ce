"""Words of campaigns for people.

Purpose: lists, intervals of rates.
Non-goals: figures (`result.py`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def listed(names: Sequence[str]) -> str:
    """`a`, `b`, `c`."""
    return ", ".join(f"`{n}`" for n in names)


def interval(low: float, high: float) -> str:
    """What a rate or a share lies in."""
    if high == inf:
        return "any number"
    if low == 0.0:
        return f"less than {high:.3g}"
    return f"{low:.3g} to {high:.3g}"
