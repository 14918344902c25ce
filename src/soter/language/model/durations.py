"""Durations as people read and write them.

Purpose: `10 ms` in a sentence, `10ms` in code; lengths of time that people give.
Non-goals: those of a program (`language/syntax/tokens.py`).
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

from soter.language.syntax.tokens import UNIT_NS

DURATION_NS_MAX = 2**62
"""About 146 years: the sum of a time and a period still fits 64 bits."""

TEXT_MAX = 100
"""No number needs more characters."""

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?)\s*([a-z]+)")

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


class WrongTextError(Exception):
    """A text or number that is no value of what is asked for; the message says what is."""


def duration_ns(given: float | str) -> int:
    """A length of time in ns: text with its unit (`"30s"`, `"1.5 min"`), or a number of seconds.

    Exact: `"0.1s"` is 100,000,000 ns. Raises `WrongTextError`.
    """
    if isinstance(given, str):
        ns = _duration_of_text(given.strip())
    elif isinstance(given, bool) or not hasattr(given, "__float__"):
        raise WrongTextError(f"expected a text such as '30s', or seconds, found {given!r}")
    else:
        seconds = float(given)
        if not math.isfinite(seconds):
            raise WrongTextError(f"{seconds} is no length of time")
        ns = round(Fraction(repr(seconds)) * 10**9)
    if abs(ns) > DURATION_NS_MAX:
        raise WrongTextError("longer than 146 years")
    return ns


def _duration_of_text(text: str) -> int:
    match = _DURATION.fullmatch(text) if len(text) <= TEXT_MAX else None
    if match is None or match[2] not in UNIT_NS:
        units = ", ".join(UNIT_NS)
        raise WrongTextError(f"write a number with its unit ({units}), such as 30s or 1.5min")
    ns = Fraction(match[1]) * UNIT_NS[match[2]]
    if ns.denominator != 1:
        raise WrongTextError("that is no whole number of nanoseconds")
    return int(ns)
