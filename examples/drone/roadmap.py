"""Write roadmap.json: nodes, edges and next hops of the ways that the safe planner knows.

    python examples/drone/roadmap.py

Purpose: a graph in the inner room of boxes.soter such that from every point of it some node is in
plain sight, and every node leads to every other in its piece of the room. The same city and
margins give the same file.
Non-goals: proof: roadmap.soter checks every edge and every next hop anew, when the program is
compiled, and `tests/correct/test_drone_roadmap.py` that a node is in sight from everywhere.
"""

from __future__ import annotations

import heapq
import json
import math
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import soter

HERE = Path(__file__).resolve().parent
OUT = HERE / "roadmap.json"
COMMENT = "Written by roadmap.py from utopia.json and the margins of boxes.soter: do not edit."
SPARE = (
    0.005  # m that nodes and edges keep from the walls of the inner room, rounding to cm included
)
SIGHT = 3  # nodes that every place sees, where there are so many
DETOUR = 1.05  # an edge is left out where others are no longer than this, times its length

Point = tuple[float, float, float]
Span = tuple[Point, Point]


def _point(p: Any) -> Point:  # noqa: ANN401 - a value of the program
    return (float(p[0]), float(p[1]), float(p[2]))


def _span(s: Any) -> Span:  # noqa: ANN401 - the same
    return (_point(s.low), _point(s.high))


@dataclass(frozen=True)
class Room:
    """The inner room: where an aim may be."""

    inner: Span
    walls: tuple[Span, ...]

    def holds(self, p: Point) -> bool:
        """Whether p keeps from all walls."""
        low, high = self.inner
        outer = all(low[k] + SPARE <= p[k] <= high[k] - SPARE for k in range(3))
        return outer and self.sees(p, p)

    def sees(self, p: Point, q: Point) -> bool:
        """Whether the box that p and q span has no wall in it: one box covers the segment."""
        return self.shares_a_box((p, p), q, SPARE)

    def shares_a_box(self, cell: Span, p: Point, spare: float = 0.0) -> bool:
        """Whether the box around the cell and p has no wall in it: then all of the cell sees p."""
        return not any(
            all(
                max(cell[1][k], p[k]) > low[k] - spare and min(cell[0][k], p[k]) < high[k] + spare
                for k in range(3)
            )
            for low, high in self.walls
        )


def inner_room() -> Room:
    """As boxes.soter has it."""
    program = soter.load(HERE / "boxes.soter")
    program.check()
    inner = program.constant("INNER")
    walls = program.constant("THICK")
    return Room(_span(inner), tuple(map(_span, walls)))


def cells_of(room: Room) -> list[Span]:
    """The free boxes between the planes of all walls."""
    planes: list[list[float]] = []
    for k in range(3):
        low, high = room.inner[0][k], room.inner[1][k]
        inside = {x for wall in room.walls for x in (wall[0][k], wall[1][k]) if low < x < high}
        planes.append(sorted({low, high, *inside}))
    spans = [list(pairwise(p)) for p in planes]
    cells = [((x[0], y[0], z[0]), (x[1], y[1], z[1])) for x, y, z in product(*spans)]
    return [c for c in cells if not any(_inside(c, wall) for wall in room.walls)]


def _inside(cell: Span, wall: Span) -> bool:
    middle = [(a + b) / 2 for a, b in zip(*cell, strict=True)]
    return all(wall[0][k] < middle[k] < wall[1][k] for k in range(3))


def candidates_of(room: Room, cells: list[Span]) -> list[Point]:
    """The middles of the cells, to the centimetre, where they keep from the walls."""
    middles = (
        _point([round((a + b) / 2, 2) for a, b in zip(low, high, strict=True)])
        for low, high in cells
    )
    return [p for p in middles if room.holds(p)]


def chosen(room: Room, cells: list[Span], candidates: list[Point]) -> list[Point]:
    """Candidates such that every cell sees SIGHT of them: greedily, by the volume they add."""
    volume = [math.prod(b - a for a, b in zip(*c, strict=True)) for c in cells]
    sight = [{i for i, c in enumerate(cells) if room.shares_a_box(c, p)} for p in candidates]
    wanted = [SIGHT] * len(cells)
    nodes: list[int] = []
    while True:
        gain = [
            sum(volume[i] for i in seen if wanted[i]) if n not in nodes else 0.0
            for n, seen in enumerate(sight)
        ]
        best = max(range(len(candidates)), key=lambda n: (gain[n], -n))
        if gain[best] == 0.0:
            return [candidates[n] for n in nodes]
        nodes.append(best)
        for i in sight[best]:
            wanted[i] = max(wanted[i] - 1, 0)


def pieces_of(room: Room, points: list[Point]) -> list[int]:
    """A number for each point: equal where a chain of them in sight of each other joins two."""
    piece = list(range(len(points)))

    def root(i: int) -> int:
        while piece[i] != i:
            i = piece[i]
        return i

    for i, p in enumerate(points):
        for j in range(i):
            if root(i) != root(j) and room.sees(p, points[j]):
                piece[root(i)] = root(j)
    return [root(i) for i in range(len(points))]


def joined(room: Room, nodes: list[Point], candidates: list[Point]) -> list[Point]:
    """The nodes, and candidates that join those of them that can be joined."""
    whole = pieces_of(room, candidates)
    of = dict(zip(candidates, whole, strict=True))
    while True:
        piece = pieces_of(room, nodes)
        apart = {(of[p], n) for p, n in zip(nodes, piece, strict=True)}
        if len(apart) == len({of[p] for p in nodes}):
            return nodes

        def joins(c: Point, nodes: list[Point] = nodes, piece: list[int] = piece) -> int:
            return len({n for p, n in zip(nodes, piece, strict=True) if room.sees(p, c)})

        nodes = [*nodes, max((c for c in candidates if c not in nodes), key=joins)]


def edges_of(room: Room, nodes: list[Point]) -> list[tuple[int, int]]:
    """Pairs in sight of each other, without those that two others replace."""
    n = len(nodes)
    seen = {
        (i, j): math.dist(nodes[i], nodes[j])
        for i in range(n)
        for j in range(n)
        if i != j and room.sees(nodes[i], nodes[j])
    }
    kept = dict(seen)
    for (i, j), length in sorted(seen.items(), key=lambda x: (-x[1], x[0])):
        if i < j and any(
            kept.get((i, k), math.inf) + kept.get((k, j), math.inf) <= DETOUR * length
            for k in range(n)
        ):
            del kept[i, j], kept[j, i]
    return sorted((i, j) for i, j in kept if i < j)


Table = list[list[int]]


def ways(
    nodes: list[Point], edges: list[tuple[int, int]]
) -> tuple[Table, Table, list[list[float]]]:
    """From i to j: the next node (-1: there is no way), how many hops, how many metres."""
    beside: list[list[tuple[float, int]]] = [[] for _ in nodes]
    for i, j in edges:
        length = math.dist(nodes[i], nodes[j])
        beside[i].append((length, j))
        beside[j].append((length, i))
    n = len(nodes)
    hop, hops, metres = ([[x] * n for _ in nodes] for x in (-1, 0, 0.0))
    for goal in range(n):
        heap = [(0.0, -1, goal, goal)]
        while heap:
            length, count, i, towards = heapq.heappop(heap)
            if hop[i][goal] < 0:
                hop[i][goal], hops[i][goal], metres[i][goal] = towards, count + 1, round(length, 2)
                for more, j in beside[i]:
                    heapq.heappush(heap, (length + more, count + 1, j, i))
    return hop, hops, metres


def main() -> None:
    """Make the roadmap and write it."""
    room = inner_room()
    cells = cells_of(room)
    candidates = candidates_of(room, cells)
    nodes = joined(room, chosen(room, cells, candidates), candidates)
    edges = edges_of(room, nodes)
    hop, hops, metres = ways(nodes, edges)
    document = {
        "$comment": COMMENT,
        "nodes": [dict(zip("xyz", p, strict=True)) for p in nodes],
        "edges": [{"a": i, "b": j} for i, j in edges],
        "hop": hop,
        "hops": hops,
        "metres": metres,
    }
    lines = ",\n".join(f'  "{key}": {_laid_out(value)}' for key, value in document.items())
    OUT.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    print(f"{len(cells)} cells, {len(nodes)} nodes, {len(edges)} edges,", end=" ")
    print(f"{len(set(pieces_of(room, nodes)))} pieces, {max(map(max, hops))} hops at most")


def _laid_out(value: Any) -> str:  # noqa: ANN401 - JSON
    if isinstance(value, str):
        return json.dumps(value)
    rows = ",\n".join(f"    {json.dumps(row)}" for row in value)
    return f"[\n{rows}\n  ]"


if __name__ == "__main__":
    main()
