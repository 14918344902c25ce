"""JSON in a page: long lists of rounded numbers, in as few letters as they need.

Purpose: `script_json` for a script element; `numbers` rounds; `packed`: a list as differences of
whole numbers, `{"e": digits, "d": [...]}`; the page (`assets/packed.js`) adds them up and divides
by 10^e: the same doubles.
Non-goals: compression that a browser might not know.
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

LONG = 50
"""Shorter lists stay as they are."""
DIGITS_MAX = 12
EXACT_MAX = 2**53
"""Up to here a double holds every whole number, so one division gives the nearest double."""


def script_json(value: object) -> str:
    """Return JSON of which no text can end the script element that it stands in; no NaN."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    return text


def numbers(values: NDArray[np.float64], digits: int = 3) -> list[float | None]:
    """Return (N,) values for JSON, rounded; what is not finite becomes null, a gap in a line."""
    rounded = np.round(values.astype(np.float64), digits) + 0.0
    return [value if np.isfinite(value) else None for value in rounded.tolist()]


def packed(value: object) -> object:
    """A list of more than `LONG` numbers and gaps (None), packed; everything else as it is.

    A list in which a number has more than 12 digits behind the point, or is no number, stays.
    """
    if not isinstance(value, list) or len(value) <= LONG:
        return value
    if not all(v is None or (type(v) in (int, float) and math.isfinite(v)) for v in value):
        return value
    digits = max((_digits(v) for v in value if v is not None), default=0)
    if digits > DIGITS_MAX:
        return value
    deltas: list[int | None] = []
    before = 0
    for v in value:
        if v is None:
            deltas.append(None)
            continue
        whole = round(v * 10**digits)
        if abs(whole) > EXACT_MAX or whole / 10**digits != v:
            return value
        deltas.append(whole - before)
        before = whole
    return {"e": digits, "d": deltas}


def _digits(value: float) -> int:
    """Digits behind the point of the shortest decimal that is this double."""
    text = repr(float(value))
    mantissa, _, exponent = text.partition("e")
    behind = len(mantissa.partition(".")[2].rstrip("0"))
    return max(behind - int(exponent or 0), 0)
