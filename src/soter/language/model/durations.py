"""Durations as people read and write them.

Purpose: `10 ms` in a sentence, `10ms` in code.
Non-goals: reading them (`language/syntax/tokens.py`).
"""

from __future__ import annotations

HOUR = 3600 * 10**9
UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))


def _parts(ns: int) -> tuple[str, str]:
    """Number and unit: the largest unit that is not larger than the duration, exactly."""
    if ns and ns % HOUR == 0:
        return f"{ns // HOUR}", "h"
    for unit, size in UNITS:
        if abs(ns) >= size:
            whole, rest = divmod(abs(ns), size)
            digits = f"{rest:0{len(str(size)) - 1}d}".rstrip("0") if rest else ""
            return ("-" if ns < 0 else "") + f"{whole}" + (f".{digits}" if digits else ""), unit
    return "0", "s"


def show_ns(ns: int) -> str:
    """A duration in a sentence: `10 ms`, `1.5 us`, `0 s`."""
    return " ".join(_parts(ns))


def write_ns(ns: int) -> str:
    """A duration as Soter source: `10ms`, `1.5us`."""
    return "".join(_parts(ns))
