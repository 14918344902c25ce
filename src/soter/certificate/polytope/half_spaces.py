"""Half-spaces, and what linear functions are at most on them: weak duality by given multipliers.

Purpose: for lambda >= 0 and every x of {low <= x <= high, F x <= f}

    r x  <=  lambda f + max over the box of (r - lambda F) x,

in balls. Multipliers are hints of the certificate: wrong ones give a useless bound, never a false
one.
Non-goals: finding multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from soter.certificate.format.errors import RejectedError
from soter.certificate.terms.arb_balls import HALF, ZERO, exact

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    Rows = Sequence[Sequence[arb]]
    Weights = Sequence[tuple[int, float]]
    """Half-spaces of `rows` with their multipliers, where that is not zero."""


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """{x : low <= x <= high, rows x <= bounds}."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]
    bounds: tuple[float, ...]

    @property
    def faces(self) -> tuple[list[tuple[float, ...]], list[float]]:
        """Every half-space: those of the box last, upper ends before lower ones."""
        n = len(self.low)
        units = [tuple(float(i == j) for j in range(n)) for i in range(n)]
        below = [tuple(-x for x in row) for row in units]
        return [*self.rows, *units, *below], [*self.bounds, *self.high, *(-x for x in self.low)]

    @cached_property
    def in_balls(self) -> tuple[list[list[arb]], list[arb]]:
        """`faces` in balls."""
        faces, ends = self.faces
        return [[exact(x) for x in row] for row in faces], [exact(x) for x in ends]

    @cached_property
    def own(self) -> tuple[list[list[arb]], list[arb]]:
        """The same of `rows` alone."""
        faces, ends = self.in_balls
        return faces[: len(self.rows)], ends[: len(self.rows)]

    def boxed_in(self, other: HalfSpaces) -> bool:
        """Whether its box is part of another one."""
        return all(a >= b for a, b in zip(self.low, other.low, strict=True)) and all(
            a <= b for a, b in zip(self.high, other.high, strict=True)
        )

    def bound(self, row: Sequence[arb], weights: Weights) -> arb:
        """A number that the row does not exceed here."""
        rows, limits = self.own
        rest, total = list(row), ZERO
        for face, value in weights:
            weight = exact(value)
            total += weight * limits[face]
            rest = [x - weight * y for x, y in zip(rest, rows[face], strict=True)]
        for x, low, high in zip(rest, map(exact, self.low), map(exact, self.high), strict=True):
            total += (x * (low + high) + abs(x) * (high - low)) * HALF
        return total

    def require(
        self, what: str, rows: Rows, limits: Sequence[arb], weights: Sequence[Weights] | None
    ) -> None:
        """Rows x <= limits everywhere here; `RejectedError` where it is not certain."""
        if weights is None:
            weights = [[] for _ in rows]
        if len(weights) != len(rows):
            raise RejectedError(f"{what}: the multipliers are not one list for each row")
        for row, limit, own in zip(rows, limits, weights, strict=True):
            if any(face >= len(self.rows) for face, _ in own):
                raise RejectedError(f"{what}: a multiplier belongs to no half-space")
            if not self.bound(row, own) <= limit:
                raise RejectedError(f"{what}: not confirmed by its multipliers")


def less(limits: Sequence[arb], losses: Sequence[arb]) -> list[arb]:
    """What is left of limits after losses."""
    return [a - b for a, b in zip(limits, losses, strict=True)]
