"""Weak duality: what linear functions are at most on a polytope, by given multipliers.

Purpose: for lambda >= 0 and every x of {low <= x <= high, F x <= f}

    r x  <=  lambda f + max over the box of (r - lambda F) x,

in balls. Multipliers are hints of the certificate: wrong ones give a useless bound, never a false
one.
Non-goals: finding multipliers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.format.errors import RejectedError
from soter.certificate.terms.arb_balls import HALF, ZERO, exact

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    from soter.certificate.polytope.certificate_tables import HalfSpaces, Triples
    from soter.certificate.polytope.half_space_images import Rows


class BoundedPolytope:
    """A polytope in balls."""

    def __init__(self, p: HalfSpaces) -> None:
        self.rows = [[exact(x) for x in row] for row in p.rows]
        self.limits = [exact(x) for x in p.bounds]
        ends = [(exact(low), exact(high)) for low, high in zip(p.low, p.high, strict=True)]
        self.centre = [(low + high) * HALF for low, high in ends]
        self.radius = [(high - low) * HALF for low, high in ends]

    def bound(self, row: Sequence[arb], weights: Sequence[tuple[int, float]]) -> arb:
        """A number that the row does not exceed on the polytope."""
        rest, total = list(row), ZERO
        for face, value in weights:
            weight = exact(value)
            total += weight * self.limits[face]
            rest = [x - weight * y for x, y in zip(rest, self.rows[face], strict=True)]
        for x, centre, radius in zip(rest, self.centre, self.radius, strict=True):
            total += x * centre + abs(x) * radius
        return total

    def require(
        self, what: str, rows: Rows, limits: Sequence[arb], weights: Triples | None
    ) -> None:
        """Rows x <= limits everywhere on the polytope; `RejectedError` where it is not certain."""
        if weights is None:
            weights = [[] for _ in rows]
        if len(weights) != len(rows):
            raise RejectedError(f"{what}: the multipliers are not one list for each row")
        for row, limit, own in zip(rows, limits, weights, strict=True):
            if any(face >= len(self.rows) for face, _ in own):
                raise RejectedError(f"{what}: a multiplier belongs to no half-space")
            if not self.bound(row, own) <= limit:
                raise RejectedError(f"{what}: not confirmed by its multipliers")


def in_balls(rows: Sequence[Sequence[float]]) -> list[list[arb]]:
    """Rows of doubles."""
    return [[exact(x) for x in row] for row in rows]


def within(limits: Sequence[float], losses: Sequence[arb]) -> list[arb]:
    """What is left of limits after losses."""
    return [exact(a) - b for a, b in zip(limits, losses, strict=True)]
