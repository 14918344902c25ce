"""Which cells meet an obstacle, and whether obstacles are what the mapper may assume: exact.

Purpose: the referee of `examples/exploration/mapper.soter`. Obstacles are convex polygons; doubles
count as what they are, all arithmetic is that of fractions (whole numbers, once denominators are
cleared).
Non-goals: rays, errors of sensors, anything that the mapper computes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import ceil, floor, hypot, lcm
from typing import Any

Point = tuple[float, float]
Whole = tuple[int, int]
Polygon = Sequence[Point]
"""Corners, anticlockwise."""
Cell = tuple[int, int]

ROUNDED = Fraction(1, 10**9)
"""By how much, relative, a double may miss a right angle or a width."""


@dataclass(frozen=True)
class Obstacle:
    """A convex polygon, and for each corner the middle of a disc that lies in it, m."""

    corners: tuple[Point, ...]
    middles: tuple[Point, ...]


@dataclass(frozen=True)
class Grid:
    """Closed squares: (i, j) has its least corner at (x0 + i cell, y0 + j cell), m."""

    x0: float
    y0: float
    cell: float
    count: int

    @classmethod
    def of(cls, constant: Callable[[str], Any]) -> Grid:
        """That of grid.soter: `constant` gives the value of `grid.X0` and so on."""
        x0, y0, cell, count = (constant(f"grid.{name}") for name in ("X0", "Y0", "CELL", "N"))
        return cls(x0, y0, cell, count)

    def corner(self, i: int, j: int) -> tuple[Fraction, Fraction]:
        """The least corner of a cell."""
        return _edge(self.x0, self.cell, i), _edge(self.y0, self.cell, j)


@cache
def _edge(start: float, cell: float, k: int) -> Fraction:
    return Fraction(start) + k * Fraction(cell)


def rectangle(x: float, y: float, long: float, wide: float, c: float, s: float) -> list[Point]:
    """The corners of a wall as `worlds.Wall` has it, rounded to doubles."""
    ends = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return [(x + a * long * c - b * wide * s, y + a * long * s + b * wide * c) for a, b in ends]


def _whole(*polygons: Sequence[tuple[Fraction, Fraction]]) -> list[list[Whole]]:
    scale = lcm(*(x.denominator for polygon in polygons for p in polygon for x in p))
    return [[(int(x * scale), int(y * scale)) for x, y in polygon] for polygon in polygons]


def _separates(a: Sequence[Whole], b: Sequence[Whole]) -> bool:
    """Whether an edge of a has all of a on one side and all of b beyond it."""
    for k, (x, y) in enumerate(a):
        px, py = a[k - 1]
        dx, dy = x - px, y - py
        if all(dx * (qy - py) - dy * (qx - px) < 0 for qx, qy in b):
            return True
    return False


def meet(a: Sequence[tuple[Fraction, Fraction]], b: Sequence[tuple[Fraction, Fraction]]) -> bool:
    """Whether two closed convex polygons have a point in common."""
    one, other = _whole(a, b)
    return not _separates(one, other) and not _separates(other, one)


def exact(polygon: Polygon) -> list[tuple[Fraction, Fraction]]:
    """The doubles of the corners as what they are."""
    return [(Fraction(x), Fraction(y)) for x, y in polygon]


def _span(grid: Grid, values: list[float], start: float) -> range:
    low = floor((min(values) - start) / grid.cell) - 1
    high = ceil((max(values) - start) / grid.cell) + 1
    return range(max(low, 0), min(high, grid.count))


def met_cells(grid: Grid, polygon: Polygon, among: Callable[[Cell], bool]) -> set[Cell]:
    """Of the cells that `among` picks those that a polygon meets, a touch included."""
    corners, met = exact(polygon), set()
    for i in _span(grid, [x for x, _ in polygon], grid.x0):
        for j in _span(grid, [y for _, y in polygon], grid.y0):
            if among((i, j)):
                (x0, y0), (x1, y1) = grid.corner(i, j), grid.corner(i + 1, j + 1)
                if meet(corners, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]):
                    met.add((i, j))
    return met


def reaches(grid: Grid, cell: Cell, middle: Point, radius: float) -> bool:
    """Whether a cell has a point that is `radius` away from `middle`, or farther."""
    i, j = cell
    x, y = grid.x0 + i * grid.cell - middle[0], grid.y0 + j * grid.cell - middle[1]
    if hypot(abs(x) + grid.cell, abs(y) + grid.cell) < 0.999 * radius:
        return False
    if hypot(x, y) > 1.001 * radius:
        return True
    px, py = Fraction(middle[0]), Fraction(middle[1])
    (x0, y0), (x1, y1) = grid.corner(i, j), grid.corner(i + 1, j + 1)
    far = max(abs(x0 - px), abs(x1 - px)) ** 2 + max(abs(y0 - py), abs(y1 - py)) ** 2
    return far >= Fraction(radius) ** 2


def as_declared(obstacle: Obstacle, thick: float) -> bool:
    """Whether every point has, for each r up to `thick`, a disc in the obstacle, sqrt(2) r away.

    Of a corner the largest disc says so for the smaller ones, which lie between both; of any
    other point the middles are mixed as the point is of corners: the polygon is convex.
    """
    corners, middles, [(radius, _)] = _whole(
        exact(obstacle.corners), exact(obstacle.middles), [(Fraction(repr(thick)), Fraction(0))]
    )
    least, most = (radius**2 * (1 - ROUNDED), 2 * radius**2 * (1 + ROUNDED))
    for k, (x, y) in enumerate(corners):
        px, py = corners[k - 1]
        length = (x - px) ** 2 + (y - py) ** 2
        for mx, my in set(middles):
            left = (x - px) * (my - py) - (y - py) * (mx - px)
            if left <= 0 or left**2 < least * length:
                return False
    return len(corners) == len(middles) and all(
        (x - mx) ** 2 + (y - my) ** 2 <= most
        for (x, y), (mx, my) in zip(corners, middles, strict=True)
    )
