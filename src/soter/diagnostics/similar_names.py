"""Guesses which known name a misspelt one was meant to be.

Purpose: the one comparison behind every "did you mean", so that it is never long.
Non-goals: which names are possible at a place.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

NAME_MAX = 60
"""Longer names are not compared: nobody mistypes one in one letter."""
CANDIDATES_MAX = 30_000
"""How many names are compared at most; of more, nobody expects a suggestion."""


def closest(name: str, candidates: Iterable[str], cutoff: float = 0.6, count: int = 1) -> list[str]:
    """At most `count` candidates that are similar to the name, the most similar first.

    `cutoff` is the least ratio of `difflib`, which is 1 for equal texts.
    """
    if len(name) > NAME_MAX:
        return []
    from difflib import get_close_matches  # noqa: PLC0415 - only where something is wrong

    # where the lengths alone keep the ratio below the cutoff, nothing is compared
    fit = [
        c
        for c in islice(candidates, CANDIDATES_MAX)
        if 2 * min(len(c), len(name)) >= cutoff * (len(c) + len(name))
    ]
    return get_close_matches(name, fit, count, cutoff)


def likely_name(name: str, candidates: Iterable[str]) -> str | None:
    """The most similar candidate, perhaps in another letter case; None if no candidate is."""
    if len(name) > NAME_MAX:
        return None
    most = 1 + len(name) // 3
    near = [
        c
        for c in islice(candidates, CANDIDATES_MAX)
        if abs(len(c) - len(name)) <= most and c != name
    ]
    folded = next((c for c in near if c.casefold() == name.casefold()), None)
    close = [folded] if folded else closest(name, near, 0.7)
    return close[0] if close else None


def did_you_mean(name: str, candidates: Iterable[str]) -> tuple[str, ...]:
    """A help line with the most similar candidate; () if no candidate is similar."""
    near = likely_name(name, candidates)
    return (f"did you mean `{near}`?",) if near else ()


def nearest_or_all(name: str, known: Iterable[str]) -> str:
    """A help line with the known name most like `name`, or else all names; "" without names."""
    names = [" ".join(n.splitlines()) for n in known]  # a help may have several lines, a name not
    if near := closest(name, names):
        return f"did you mean `{near[0]}`?"
    shown = ", ".join(f"`{n}`" for n in names[:8])
    return f"there are {shown}{' ...' if len(names) > 8 else ''}" if names else ""
