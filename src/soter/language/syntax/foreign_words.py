"""Words of other languages: what one word was meant to be, by what it stands for and by body.

Purpose: types with a range, quantities with a unit and rates, which need more than a look into the
tables of `words.toml`. Parser and checker ask where a word is unknown, never before.
Non-goals: whole phrases (`foreign_phrases.py`), words of Soter in a wrong place
(`clause_words.py`), words that are nearly right (`diagnostics/similar_names.py`).
"""

from __future__ import annotations

import re

from soter.language.syntax.word_tables import meaning

_SIZED = re.compile(r"(u?)(?:int|i)(8|16|32)(?:_t)?|u(8|16|32)")

LIBRARIES = frozenset(
    ["math", "np", "numpy", "cmath", "std", "Math", "torch", "jnp", "jax", "scipy", "tf", "libm"]
)
"""What the prelude stands in for."""


def type_meant(word: str) -> str | None:
    """The type of Soter for a type of another language: `int in [0, 255]` for `uint8_t`."""
    small = word.lower()
    match = _SIZED.fullmatch(small)
    if match is None:
        return meaning("type", small)
    bits = int(match[2] or match[3])
    unsigned = bool(match[1]) or match[3] is not None
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return f"int in [{low}, {high}]"


def type_advice(word: str) -> str | None:
    """What to do without a type that Soter has nothing for."""
    return meaning("no_text", word.lower()) or meaning("no_type", word)


def in_si(number: str, unit: str) -> str | None:
    """A quantity with a unit as the bare number of SI that it stands for."""
    scale = meaning("unit", unit)
    if scale is None or scale == "1.0":
        return scale and number
    return repr(float(f"{float(number.replace('_', '')) * float(scale):.12g}"))


def period_of(rate: str) -> str | None:
    """The period of a rate in Hz where it is a whole number of nanoseconds: `20ms` for `50`."""
    value = float(rate.replace("_", ""))
    if not 1e-3 < value <= 1e9:
        return None
    period_ns = round(1e9 / value)
    if abs(period_ns * value - 1e9) > 1e-3:
        return None
    for unit, size in (("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)):
        if period_ns % size == 0:
            return f"{period_ns // size}{unit}"
    return f"{period_ns}ns"
