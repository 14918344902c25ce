"""Rates and sizes as people write them.

Purpose: three digits and a unit.
Non-goals: times (`language/model/durations.py`).
"""

from __future__ import annotations


def rounded(x: float) -> str:
    """A rate: `1.4 M`, `23 k`, `840`."""
    for unit, factor in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if x >= 0.9995 * factor:
            return f"{x / factor:.3g} {unit}"
    return f"{x:.0f}"


def size(count: int) -> str:
    """A size: `9.6 MB`."""
    for unit, factor in (("GB", 2**30), ("MB", 2**20), ("kB", 2**10)):
        if count >= 0.9995 * factor:
            return f"{count / factor:.{3 if count < 999.5 * factor else 4}g} {unit}"
    return f"{count} bytes"


def decimal(count: int) -> str:
    """A size on a disk, in units of 1000: `481 MB`."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= 0.9995 * factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count} bytes"
