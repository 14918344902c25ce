"""Choices of a random program, made by a generator with a seed.

Purpose: what `hypothesis_choices.py` does, where one example is a package that is compiled.
Non-goals: making a failing example smaller.
"""

from __future__ import annotations

import random

from generators.hypothesis_choices import Chooser


class Seeded(Chooser):
    """Chooses with a generator of its own."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - types and values, not secrets

    def below(self, n: int) -> int:
        """0, ..., n - 1."""
        return self._random.randrange(n)
