"""Whether a corridor is what the motion primitive asks for: exact, from the city's file alone.

Purpose: the referee of `examples/drone/boxes.soter`. All numbers are fractions: those of the city
and the margins as they are written, those of plans and boxes as the doubles that they are.
Non-goals: finding a corridor, speed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    Exact = tuple[Fraction, Fraction, Fraction]
    Point = Sequence[float] | NDArray[np.float64]
    Boxes = Sequence[Sequence[float]] | NDArray[np.float64]

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Room:
    """What is free: between `low` and `high`, outside of every building; grown by the radius."""

    low: Exact
    high: Exact
    buildings: tuple[tuple[Exact, Exact], ...]


@dataclass(frozen=True)
class Block:
    """A box of a corridor, and the aim in it."""

    low: Exact
    high: Exact
    aim: Exact


def exact(p: Point) -> Exact:
    """The doubles of a point as what they are; the text of each as what it says."""
    return (Fraction(p[0]), Fraction(p[1]), Fraction(p[2]))


def written(x: float) -> Fraction:
    """The shortest decimal that is read as this double: what stands in the program."""
    return Fraction(repr(x))


def room(radius: float, ceiling: float, path: Path = DRONE / "utopia.json") -> Room:
    """The free space of a city for a sphere's centre; the grown buildings have sharp corners."""
    city: Any = json.loads(path.read_text(encoding="utf-8"), parse_float=Fraction)
    r = written(radius)

    def corner(v: Any, more: Fraction) -> Exact:
        x, y, z = (Fraction(v[a]) + more for a in AXES)
        return (x, y, z)

    size = city["size"]
    return Room(
        low=(r, r, r),
        high=(Fraction(size["x"]) - r, Fraction(size["y"]) - r, written(ceiling) - r),
        buildings=tuple((corner(b["low"], -r), corner(b["high"], r)) for b in city["boxes"]),
    )


def _box_fault(room: Room, block: Block) -> str:
    for a in range(3):
        if not room.low[a] < block.low[a] < block.high[a] < room.high[a]:
            return "outside the map"
    for low, high in room.buildings:
        if all(block.high[a] >= low[a] and block.low[a] <= high[a] for a in range(3)):
            return "touches a building"
    return ""


def _room_for(block: Block, aim: Exact, margin: Exact) -> bool:
    return all(block.low[a] + margin[a] <= aim[a] <= block.high[a] - margin[a] for a in range(3))


def _contains(block: Block, p: Exact) -> bool:
    return all(block.low[a] <= p[a] <= block.high[a] for a in range(3))


def _exit(block: Block, p: Exact, q: Exact, since: Fraction) -> Fraction | None:
    """Up to which share of a segment it stays in the box, from `since` on; None: it is outside."""
    low, high = Fraction(0), Fraction(1)
    for a in range(3):
        way = q[a] - p[a]
        if way == 0:
            if not block.low[a] <= p[a] <= block.high[a]:
                return None
        else:
            ends = sorted(((block.low[a] - p[a]) / way, (block.high[a] - p[a]) / way))
            low, high = max(low, ends[0]), min(high, ends[1])
    return high if low <= since <= high else None


def uncovered(plan: Sequence[Exact], blocks: Sequence[Block]) -> str:
    """Where the path of the plan leaves the boxes, taken in their order; empty: nowhere."""
    segment, share = 0, Fraction(0)
    for block in blocks:
        while segment < len(plan) - 1:
            end = _exit(block, plan[segment], plan[segment + 1], share)
            if end is None:
                break
            if end < 1:
                share = end
                break
            segment, share = segment + 1, Fraction(0)
        if segment == len(plan) - 1:
            return ""
    return f"segment {segment} is not covered beyond {float(share)}"


def fault_of(room: Room, margin: Exact, plan: Sequence[Point], boxes: Boxes) -> str:
    """What is wrong with the corridor of a plan; empty: nothing. Boxes: low, high, aim, (n, 9)."""
    blocks = [Block(exact(b[0:3]), exact(b[3:6]), exact(b[6:9])) for b in boxes]
    path = [exact(p) for p in plan]
    if not blocks or not path:
        return "no boxes, or no plan"
    for i, block in enumerate(blocks):
        fault = _box_fault(room, block)
        if fault:
            return f"box {i}: {fault}"
        if any(block.high[a] - block.low[a] < 2 * margin[a] for a in range(3)):
            return f"box {i} is too narrow"
        if not _room_for(block, block.aim, margin):
            return f"the aim of box {i} is too near to its wall"
    for i, (a, b) in enumerate(pairwise(blocks)):
        if not _room_for(b, a.aim, margin):
            return f"the aim of box {i} is too near to a wall of the next"
        shared = (min(a.high[k], b.high[k]) - max(a.low[k], b.low[k]) for k in range(3))
        if any(s < 2 * m for s, m in zip(shared, margin, strict=True)):
            return f"boxes {i} and {i + 1} overlap too little"
    if not _contains(blocks[0], path[0]):
        return "the start is not in the first box"
    if not _contains(blocks[-1], path[-1]):
        return "the goal is not in the last box"
    return uncovered(path, blocks)
