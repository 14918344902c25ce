"""Names of C things.

Purpose: source names survive, made legal and unique.
Non-goals: knowing what is named.
"""

from __future__ import annotations

import re

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Bool _Complex _Imaginary
bool true false NULL NAN INFINITY assert isnan isinf signbit isfinite sqrt floor fabs fmin fmax sin
cos tan exp log pow main errno stdin stdout stderr memcpy memset y0 y1 yn j0 j1 jn gamma index
s m h a state flags published answer fault status first began
"""
C_RESERVED = frozenset(_WORDS.split())
"""Words of C, macros of its headers, and the names every generated function uses itself."""


def legal(text: str) -> str:
    """A C identifier made from any text."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    if not name or name[0].isdigit():
        name = "n" + name
    return name


def local(text: str) -> str:
    """The C name of a temporary: unique source names stay unique."""
    name = legal(text)
    if name in C_RESERVED or name.startswith(
        ("soter_", "SOTER_", "out_", "has_", "INT", "UINT", "_")
    ):
        return "v_" + name
    return name


class Unique:
    """Hands out names of one name space."""

    def __init__(self, taken: frozenset[str] = frozenset()) -> None:
        self._taken = set(taken)

    def __call__(self, text: str) -> str:
        """A legal name nobody has yet."""
        base = legal(text)
        name, n = base, 2
        while name in self._taken or name in C_RESERVED:
            name = f"{base}_{n}"
            n += 1
        self._taken.add(name)
        return name
