"""The places of a diagram's boxes: in layers from top to bottom, arrows downwards if possible.

Purpose: a layered drawing after Sugiyama, small and repeatable. Arrows that would close a circle
are turned round (Eades, Lin and Smyth); layers follow the longest path and are then drawn together;
sweeps order each layer by the mean place of its neighbours; x comes from isotonic regression (pool
adjacent violators, exact for one layer). Arrows with one source share their path where they can.
Non-goals: shapes, text (`svg.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

GAP_PX = 22.0
"""The gap between two boxes of a layer."""
BEND_PX = 12.0
"""The width that an arrow takes where it passes a layer."""
UPWARDS_PX = 14.0
"""The distance on a box between the places of downward and of upward arrows."""
SWEEPS = 24
SHIFTS = 30
STRAIGHT = 6.0
"""How much more a straight arrow counts than a box right below another."""


@dataclass(eq=False)
class Spot:
    """A box, or a point where an arrow passes a layer (`box` is None, and `width` small)."""

    width: float
    height: float
    box: int | None = None
    layer: int = 0
    x: float = 0.0
    """Left edge."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A line from the lower edge of a spot to the upper edge of a spot in the next layer.

    `up`: the arrow leads upwards. `ends`: whether its head is here. x is from a spot's left edge.
    """

    above: Spot
    above_x: float
    below: Spot
    below_x: float
    up: bool
    ends: bool
    source: str
    target: str


@dataclass(frozen=True)
class Link:
    """An arrow between boxes (by index), with the points on them where it begins and ends."""

    source: int
    source_x: float
    target: int
    target_x: float
    names: tuple[str, str]


@dataclass(eq=False)
class GraphLayout:
    """The layers from top to bottom, each from left to right, and the pieces of all arrows."""

    layers: list[list[Spot]]
    pieces: list[Piece] = field(default_factory=list)


def lay_out(
    sizes: Sequence[tuple[float, float]], links: Sequence[Link], first: frozenset[int]
) -> GraphLayout:
    """Places boxes of these sizes (px), `first` on top if possible; omits loops at one box."""
    links = [link for link in links if link.source != link.target]
    order = _box_sequence(len(sizes), links, first)
    layer = _box_layers(len(sizes), links, order, first)
    spots = [Spot(w, h, i, layer[i]) for i, (w, h) in enumerate(sizes)]
    layout = GraphLayout([[] for _ in range(max(layer, default=0) + 1)])
    for i in sorted(range(len(spots)), key=lambda i: order[i]):
        layout.layers[layer[i]].append(spots[i])
    _connect_boxes(layout, spots, links)
    _sort_layers(layout)
    _place_spots(layout)
    return layout


# ---------------------------------------------------------------- layers


def _box_sequence(count: int, links: Sequence[Link], first: frozenset[int]) -> list[int]:
    """By box: its position in an order that few arrows oppose; boxes in `first` come first."""
    left = dict.fromkeys(i for i in range(count) if i not in first)
    head, tail = sorted(first), list[int]()
    while left:
        within = [k for k in links if k.source in left and k.target in left]
        sinks = sorted(left.keys() - {k.source for k in within})
        sources = sorted(left.keys() - {k.target for k in within})
        if sinks:
            tail[:0] = sinks
            removed = sinks
        elif sources:
            head += sources
            removed = sources
        else:
            removed = [max(left, key=lambda i: (_outgoing_surplus(i, left, links), -i))]
            head += removed
        for i in removed:
            del left[i]
    position = {i: k for k, i in enumerate((*head, *tail))}
    return [position[i] for i in range(count)]


def _outgoing_surplus(i: int, left: dict[int, None], links: Sequence[Link]) -> int:
    out = sum(k.source == i and k.target in left for k in links)
    return out - sum(k.target == i and k.source in left for k in links)


def _box_layers(
    count: int, links: Sequence[Link], order: Sequence[int], first: frozenset[int]
) -> list[int]:
    """By box: its layer, by its longest path, then moved closer to its neighbours."""
    above, below = _joined_boxes(count, links, order)
    downward = sorted(range(count), key=lambda i: order[i])
    layer = [0] * count
    for i in downward:
        layer[i] = max((layer[a] + 1 for a in above[i]), default=0)
    movable = [i for i in reversed(downward) if i not in first and len(below[i]) != len(above[i])]
    for _ in range(count):
        before = list(layer)
        for i in movable:
            low = max((layer[a] + 1 for a in above[i]), default=0)
            high = min((layer[b] - 1 for b in below[i]), default=low)
            layer[i] = high if len(below[i]) > len(above[i]) else low
        if layer == before:
            break
    least = min(layer, default=0)
    return [n - least for n in layer]


def _joined_boxes(
    count: int, links: Sequence[Link], order: Sequence[int]
) -> tuple[list[list[int]], list[list[int]]]:
    """By box: the boxes before it that an arrow joins to it, and such boxes after it."""
    above: list[list[int]] = [[] for _ in range(count)]
    below: list[list[int]] = [[] for _ in range(count)]
    ends = {(k.source, k.target) for k in links}
    for a, b in sorted({(a, b) if order[a] < order[b] else (b, a) for a, b in ends}):
        above[b].append(a)
        below[a].append(b)
    return above, below


def _connect_boxes(layout: GraphLayout, spots: Sequence[Spot], links: Sequence[Link]) -> None:
    """Makes the pieces of all arrows, and the spots where arrows pass through a layer."""
    passing: dict[tuple[int, float, bool, int], Spot] = {}
    drawn: set[tuple[int, int, float, float]] = set()
    for k in links:
        up = spots[k.source].layer > spots[k.target].layer
        start, end = spots[k.source].layer, spots[k.target].layer
        step = -1 if up else 1
        at, at_x = spots[k.source], _meeting_x(spots[k.source], k.source_x, up=up)
        end_x = _meeting_x(spots[k.target], k.target_x, up=up)
        for n in range(start + step, end, step):
            key = (k.source, k.source_x, up, n)
            if key not in passing:
                passing[key] = Spot(BEND_PX, 0.0, None, n)
                layout.layers[n].append(passing[key])
            _add_piece(layout, drawn, (at, at_x, passing[key], BEND_PX / 2), k, up=up, ends=False)
            at, at_x = passing[key], BEND_PX / 2
        _add_piece(layout, drawn, (at, at_x, spots[k.target], end_x), k, up=up, ends=True)


def _meeting_x(spot: Spot, x: float, *, up: bool) -> float:
    """The x on a spot where an arrow meets it; an upward arrow is beside the downward ones."""
    return min(x + UPWARDS_PX, spot.width - BEND_PX / 2) if up else x


def _add_piece(
    layout: GraphLayout,
    drawn: set[tuple[int, int, float, float]],
    way: tuple[Spot, float, Spot, float],
    link: Link,
    *,
    up: bool,
    ends: bool,
) -> None:
    """Adds a piece, unless it was added for another arrow."""
    source, source_x, target, target_x = way
    key = (id(source), id(target), source_x, target_x)
    if key in drawn:
        return
    drawn.add(key)
    ordered = (target, target_x, source, source_x) if up else way
    layout.pieces.append(
        Piece(*ordered, up=up, ends=ends, source=link.names[0], target=link.names[1])
    )


# ---------------------------------------------------------------- order


def _sort_layers(layout: GraphLayout) -> None:
    """Orders the spots of each layer so that few pieces cross."""
    best, least = [list(layer) for layer in layout.layers], _crossing_count(layout)
    for sweep in range(SWEEPS):
        downwards = sweep % 2 == 0
        count = len(layout.layers)
        for n in range(1, count) if downwards else range(count - 2, -1, -1):
            _sort_by_means(layout, n, downwards=downwards)
        _swap_neighbours(layout)
        now = _crossing_count(layout)
        if now < least:
            best, least = [list(layer) for layer in layout.layers], now
        if not least:
            break
    layout.layers = best


def _spot_positions(layer: Sequence[Spot]) -> dict[Spot, float]:
    return {spot: float(i) for i, spot in enumerate(layer)}


def _share(spot: Spot, x: float) -> float:
    """The position x on a spot as a share of the spot's width: from 0 to less than 1."""
    return 0.98 * x / max(spot.width, 1e-9)


def _sort_by_means(layout: GraphLayout, n: int, *, downwards: bool) -> None:
    other = _spot_positions(layout.layers[n - 1 if downwards else n + 1])
    met: dict[Spot, list[float]] = {}
    for p in layout.pieces:
        if downwards:
            mine, its, x = p.below, p.above, p.above_x
        else:
            mine, its, x = p.above, p.below, p.below_x
        if mine.layer == n:
            met.setdefault(mine, []).append(other[its] + _share(its, x))
    wish = _spot_positions(layout.layers[n]) | {spot: sum(xs) / len(xs) for spot, xs in met.items()}
    layout.layers[n].sort(key=lambda spot: wish[spot])


def _swap_neighbours(layout: GraphLayout) -> None:
    """Swaps two neighbours in a layer wherever fewer pieces cross afterwards."""
    for n, layer in enumerate(layout.layers):
        for i in range(len(layer) - 1):
            before = _crossings_around(layout, n)
            layer[i], layer[i + 1] = layer[i + 1], layer[i]
            if _crossings_around(layout, n) >= before:
                layer[i], layer[i + 1] = layer[i + 1], layer[i]


def _crossings_around(layout: GraphLayout, n: int) -> int:
    above = _crossings_between(layout, n - 1) if n else 0
    return above + (_crossings_between(layout, n) if n + 1 < len(layout.layers) else 0)


def _crossing_count(layout: GraphLayout) -> int:
    return sum(_crossings_between(layout, n) for n in range(len(layout.layers) - 1))


def _crossings_between(layout: GraphLayout, n: int) -> int:
    """How many pairs of pieces between the layers n and n + 1 cross."""
    upper, lower = _spot_positions(layout.layers[n]), _spot_positions(layout.layers[n + 1])
    lines = sorted(
        (upper[p.above] + _share(p.above, p.above_x), lower[p.below] + _share(p.below, p.below_x))
        for p in layout.pieces
        if p.above in upper and p.below in lower
    )
    return sum(a[0] < b[0] and a[1] > b[1] for i, a in enumerate(lines) for b in lines[i + 1 :])


# ---------------------------------------------------------------- places


def _place_spots(layout: GraphLayout) -> None:
    """Gives every spot an x, as near to the x that its neighbours want as the widths permit."""
    for layer in layout.layers:
        x = 0.0
        for spot in layer:
            spot.x = x
            x += spot.width + GAP_PX
    joined: dict[Spot, list[tuple[float, Spot, float]]] = {}
    for p in layout.pieces:
        joined.setdefault(p.above, []).append((p.above_x, p.below, p.below_x))
        joined.setdefault(p.below, []).append((p.below_x, p.above, p.above_x))
    for turn in range(SHIFTS):
        for layer in layout.layers if turn % 2 == 0 else reversed(layout.layers):
            wishes = [_wanted_x(spot, joined.get(spot, [])) for spot in layer]
            for spot, x in zip(layer, _nearest_places(layer, wishes), strict=True):
                spot.x = x
    least = min((spot.x for layer in layout.layers for spot in layer), default=0.0)
    for layer in layout.layers:
        for spot in layer:
            spot.x -= least


def _wanted_x(spot: Spot, joined: Sequence[tuple[float, Spot, float]]) -> tuple[float, float]:
    """The x that a spot's neighbours want for it, and the weight of their wish."""
    total = weight = 0.0
    for own_x, other, other_x in joined:
        w = STRAIGHT if spot.box is None and other.box is None else 1.0
        total += w * (other.x + other_x - own_x)
        weight += w
    return (total / weight, weight) if weight else (spot.x, 0.1)


def _nearest_places(layer: Sequence[Spot], wishes: Sequence[tuple[float, float]]) -> list[float]:
    """The x nearest to the wanted ones, by weighted least squares, with order and gaps kept."""
    starts = [0.0]
    for spot, other in pairwise(layer):
        gap = GAP_PX if spot.box is not None and other.box is not None else BEND_PX
        starts.append(starts[-1] + spot.width + gap)
    pools: list[tuple[float, float, int]] = []
    for (x, w), start in zip(wishes, starts, strict=True):
        mean, weight, count = x - start, w, 1
        while pools and pools[-1][0] > mean:
            m, v, c = pools.pop()
            mean, weight, count = (m * v + mean * weight) / (v + weight), v + weight, c + count
        pools.append((mean, weight, count))
    means = [mean for mean, _, count in pools for _ in range(count)]
    return [mean + start for mean, start in zip(means, starts, strict=True)]
