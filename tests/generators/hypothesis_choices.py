"""Choices of a random program, made through Hypothesis.

Purpose: few, cheap kinds of choice (a number, one of several, a chance), so that a whole program
fits into what Hypothesis draws for one example.
Non-goals: knowing what is chosen.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, TypeVar

from hypothesis import strategies as st

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hypothesis.strategies import DrawFn, SearchStrategy

T = TypeVar("T")


@cache
def _up_to(top: int) -> SearchStrategy[int]:
    return st.integers(min_value=0, max_value=top)


class Chooser:
    """Chooses with Hypothesis' `draw`; 0, the first option and False are the simplest choices."""

    def __init__(self, draw: DrawFn) -> None:
        self._draw = draw

    def below(self, n: int) -> int:
        """0, ..., n - 1."""
        return 0 if n <= 1 else self._draw(_up_to(n - 1))

    def count(self, low: int, high: int) -> int:
        """low, ..., high."""
        return low + self.below(high - low + 1)

    def chance(self, percent: int) -> bool:
        """True in so many of 100 cases."""
        if percent <= 0:
            return False
        return percent >= 100 or self.below(100) >= 100 - percent

    def pick(self, options: Sequence[T]) -> T:
        """One of them."""
        return options[self.below(len(options))]

    def weighted(self, options: Sequence[tuple[int, T]]) -> T:
        """One of them, each as often as its weight says."""
        at = self.below(sum(weight for weight, _ in options))
        for weight, option in options:
            if at < weight:
                return option
            at -= weight
        raise AssertionError

    def some(self, options: Sequence[T], low: int, high: int) -> list[T]:
        """From `low` to `high` different ones of them, as far as there are so many."""
        left = list(options)
        wanted = min(self.count(low, high), len(left))
        return [left.pop(self.below(len(left))) for _ in range(wanted)]

    def shuffled(self, options: Sequence[T]) -> list[T]:
        """All of them in any order."""
        return self.some(options, len(options), len(options))
