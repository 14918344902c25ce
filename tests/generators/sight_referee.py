"""How far somebody is from a rover, and whether a scan may have been as it is: exact.

Purpose: the referee of `examples/exploration/sight.soter`. People are discs, the rover a box,
rays segments; doubles count as what they are, all arithmetic is that of fractions.
Non-goals: scenes (`sight_scenes.py`), anything that the node computes.
"""

from __future__ import annotations

from fractions import Fraction

Point = tuple[float, float]

ROUNDED = Fraction(1, 10**9)
"""By how much, relative, a double may miss where a ray touches a disc."""


def is_nearer(middle: Point, radius: float, box: tuple[float, float, float], gap: float) -> bool:
    """Whether a disc is nearer to a box than `gap`, or overlaps it; m.

    box: where its middle lies along x (y is 0), half its length, half its width.
    """
    at, long, wide = map(Fraction, box)
    ex = max(abs(Fraction(middle[0]) - at) - long, Fraction(0))
    ey = max(abs(Fraction(middle[1])) - wide, Fraction(0))
    return Fraction(gap) > 0 and ex**2 + ey**2 < (Fraction(gap) + Fraction(radius)) ** 2


def passes(origin: Point, along: Point, length: float, middle: Point, radius: float) -> bool:
    """Whether a segment stays out of a disc; `along`: its direction, of length about 1."""
    ux, uy = map(Fraction, along)
    qx, qy = (Fraction(m) - Fraction(o) for m, o in zip(middle, origin, strict=True))
    norm = ux**2 + uy**2
    t = min(max((qx * ux + qy * uy) / norm, Fraction(0)), Fraction(max(length, 0.0)))
    return (qx - t * ux) ** 2 + (qy - t * uy) ** 2 >= Fraction(radius) ** 2 * (1 - ROUNDED)
