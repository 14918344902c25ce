"""Numbers and times in hints, which are rounded outward to few digits.

Purpose: `rounded_outward` rounds ends and bounds, `duration_text` writes a time.
Non-goals: numbers for people (`report/`).
"""

from __future__ import annotations

from math import ceil, floor, isfinite, log10

from soter.language.model.types import write_ns


def rounded_outward(value: float, *, up: bool) -> float:
    """The number `value`, rounded up or down to two digits."""
    if value == 0.0 or not isfinite(value):
        return float(value)
    unit = 10.0 ** (floor(log10(abs(value))) - 1)
    count = value / unit
    return float(f"{(ceil(count - 1e-9) if up else floor(count + 1e-9)) * unit:.12g}")


def duration_text(seconds: float) -> str:
    """The text of a time, rounded up to whole seconds, or to ms or us if it is short."""
    part_ns = 10**9 if seconds >= 10.0 else 10**6 if seconds >= 0.01 else 10**3
    return write_ns(ceil(seconds * 1e9 / part_ns) * part_ns)
