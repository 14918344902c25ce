"""The diagram of a system as SVG: one file that needs nothing else, in light and dark.

Purpose: `picture` gives in one call what `soter show`, reports, the docs and editors show: sizes of
boxes from their texts, the layout, and lines, arrow heads, legend and style. Elements that a page
may light up have `data-component`, `data-module` or `data-topics`.
Non-goals: what stands where (`layered_layout.py`), what there is (`system_graph.py`). Lengths are
pixels.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from soter.diagram.layered_layout import GraphLayout, Link, Piece, Spot, lay_out
from soter.diagram.system_graph import DiagramBox, DiagramGraph, ModuleFrame, Part, graph_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import System


LINE_PX, CAPTION_PX, PAD_X, PAD_Y = 17.0, 14.0, 11.0, 7.0
FRAME_PAD, TITLE_PX, INSIDE_GAP = 10.0, 20.0, 10.0
BETWEEN_PX = 44.0
"""The distance between layers."""
MARGIN_PX = 14.0
LEGEND_WIDTH_PX = 400.0
"""The least width of the legend, about that of a phone."""
NARROW, WIDE = set("iljtfrI.,:;'|()[] "), set("mwMW@")
LEGEND = (
    ("plant", "plant"),
    ("node", "node"),
    ("ac", "advanced controller"),
    ("sc", "safe controller"),
    ("dm", "decision module"),
    ("topic", "topic"),
    ("input", "input from outside"),
)
UPWARDS = ("up", "leads upwards")
"""The entry of the legend for upward arrows, where there are any."""
STYLE = """
.sd { --ink: #1a1f24; --muted: #5b646d; --paper: #fcfcfa; --panel: #ffffff;
  --rule: #9aa3ab; --line: #6d767e;
  --ac: #ad5500; --sc: #0a6ebd; --plant: #e6e2d6; --topic: #eceff1;
  --frame: #f3f6f8; --back: #8a5a9e;
  font-family: system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", Arial, sans-serif; }
@media (prefers-color-scheme: dark) {
  .sd { --ink: #eceef0; --muted: #a3acb4; --paper: #14171a; --panel: #1f2429;
    --rule: #5d666e; --line: #8a939b;
    --ac: #f28e2b; --sc: #5aaeee; --plant: #3a372e; --topic: #2a3036;
    --frame: #1a1f24; --back: #b98acb; } }
.sd text { font-size: 13px; fill: var(--ink); text-anchor: middle; }
.sd .caption { font-size: 11px; fill: var(--muted); }
.sd .frame-title { font-weight: 600; text-anchor: start; }
.sd rect, .sd path.shape { fill: var(--panel); stroke: var(--rule); stroke-width: 1.2; }
.sd .back { fill: var(--paper); stroke: none; }
.sd .frame > rect { fill: var(--frame); stroke: var(--muted); }
.sd .plant > rect { fill: var(--plant); stroke-width: 2; }
.sd .ac > rect { stroke: var(--ac); stroke-width: 2; }
.sd .sc > rect { stroke: var(--sc); stroke-width: 2; stroke-dasharray: 7 3; }
.sd .dm > path { stroke: var(--ink); }
.sd .topic > rect, .sd .input > rect { fill: var(--topic); stroke: none; }
.sd .input > rect { stroke: var(--muted); stroke-dasharray: 2 3; }
.sd .wire { fill: none; stroke: var(--line); stroke-width: 1.2; }
.sd .wire.up { stroke: var(--back); }
.sd .head { fill: var(--line); stroke: none; }
.sd .head.up { fill: var(--back); }
.sd .on > rect { fill: var(--ac); } .sd .sc.on > rect { fill: var(--sc); }
.sd .on > text { fill: var(--paper); }
"""


def draw_graph(graph: DiagramGraph) -> str:
    """The SVG of a graph; the same graph always gives the same text."""
    sizes = [_part_size(part) for part in graph.parts]
    at = {key: (i, x) for i, part in enumerate(graph.parts) for key, x in _anchors_x(part).items()}
    links = [
        Link(*at[a.source], *at[a.target], names=(a.source, a.target))
        for a in graph.arrows
        if a.source in at and a.target in at
    ]
    layout = lay_out(sizes, links, frozenset(at[key][0] for key in graph.first))
    tops = _layer_tops(layout)
    upwards = any(piece.up for piece in layout.pieces)
    ends = (s.x + s.width for layer in layout.layers for s in layer)
    inner = max(LEGEND_WIDTH_PX, *ends)
    legend = _legend(inner, upwards=upwards)
    width = inner + 2 * MARGIN_PX
    height = tops[-1] + legend[1] + MARGIN_PX
    inside = [
        f'<rect class="back" width="{width:.0f}" height="{height:.0f}"/>',
        f'<g transform="translate({MARGIN_PX:g} {MARGIN_PX:g})">',
        *_arrow_lines(layout, tops),
        *(line for layer in layout.layers for spot in layer for line in _spot(graph, spot, tops)),
        f'<g class="legend" transform="translate(0 {tops[-1]:.1f})">{legend[0]}</g>',
        "</g>",
    ]
    name = escape(graph.title)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="sd" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}" role="img" aria-label="{name}">\n'
        f"<title>{name}</title>\n<style>{STYLE}</style>\n" + "\n".join(inside) + "\n</svg>\n"
    )


# ---------------------------------------------------------------- sizes


def text_width(text: str, size: float = 13.0) -> float:
    """An estimate of a text's width in px, rather too large, in sans-serif of `size` px."""
    ems = sum(
        0.33 if c in NARROW else 0.92 if c in WIDE else 0.7 if c.isupper() else 0.6 for c in text
    )
    return ems * size


def _part_size(part: Part) -> tuple[float, float]:
    if isinstance(part, ModuleFrame):
        inner = [_part_size(p) for p in part.inside]
        wide = sum(w for w, _ in inner) + INSIDE_GAP * (len(inner) - 1) + 2 * FRAME_PAD
        high = max(h for _, h in inner) + TITLE_PX + 2 * FRAME_PAD
        return max(wide, text_width(part.title) + 2 * FRAME_PAD), high
    widest = max(*(text_width(line) for line in part.lines), text_width(part.caption, 11.0))
    high = LINE_PX * len(part.lines) + (CAPTION_PX if part.caption else 0.0) + 2 * PAD_Y
    return max(widest + 2 * PAD_X, 46.0), high


def _anchors_x(part: Part, left: float = 0.0) -> dict[str, float]:
    """By key: the x where arrows meet a part or one inside it, from the outermost left edge."""
    width, _ = _part_size(part)
    x_by_key = {part.key: left + width / 2}
    if isinstance(part, ModuleFrame):
        x = left + FRAME_PAD
        for inner in part.inside:
            x_by_key |= _anchors_x(inner, x)
            x += _part_size(inner)[0] + INSIDE_GAP
    return x_by_key


def _layer_tops(layout: GraphLayout) -> list[float]:
    """The y of the top of each layer, and the y where the space below the last layer ends."""
    tops = [0.0]
    for layer in layout.layers:
        high = max((spot.height for spot in layer), default=0.0)
        tops.append(tops[-1] + high + BETWEEN_PX)
    tops[-1] -= BETWEEN_PX / 2
    return tops


# ---------------------------------------------------------------- boxes


def _spot(graph: DiagramGraph, spot: Spot, tops: Sequence[float]) -> Iterator[str]:
    """Yields the SVG of the part at a spot; the part's top is at the top of its layer."""
    if spot.box is not None:
        yield from _part_lines(graph.parts[spot.box], spot.x, tops[spot.layer])


def _part_lines(part: Part, x: float, y: float) -> Iterator[str]:
    width, height = _part_size(part)
    if isinstance(part, DiagramBox):
        yield _box_element(part, (x, y, width, height))
        return
    name = escape(part.key.removeprefix("m:"), quote=True)
    yield (
        f'<g class="frame" data-module="{name}"><rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" '
        f'height="{height:.1f}" rx="8"/><text class="frame-title" x="{x + FRAME_PAD:.1f}" '
        f'y="{y + 19:.1f}">{escape(part.title)}</text>'
    )
    left = x + FRAME_PAD
    for inner in part.inside:
        high = _part_size(inner)[1]
        lowest = y + TITLE_PX + FRAME_PAD + max(_part_size(p)[1] for p in part.inside) - high
        yield from _part_lines(inner, left, lowest)
        left += _part_size(inner)[0] + INSIDE_GAP
    yield "</g>"


def _box_element(cell: DiagramBox, place: tuple[float, float, float, float]) -> str:
    x, y, width, _ = place
    kind = "topics" if cell.kind in {"topic", "input"} else "component"
    names = escape(" ".join(cell.names), quote=True)
    middle, base, texts = x + width / 2, y + PAD_Y + 12.5, []
    for i, line in enumerate(cell.lines):
        texts.append(f'<text x="{middle:.1f}" y="{base:.1f}">{escape(line)}</text>')
        if cell.caption and i + 1 == len(cell.lines):
            base += CAPTION_PX + 1
            place_of = f'x="{middle:.1f}" y="{base:.1f}"'
            texts.append(f'<text class="caption" {place_of}>{escape(cell.caption)}</text>')
        base += LINE_PX
    return (
        f'<g class="{cell.kind}" data-{kind}="{names}">{_outline(cell.kind, place)}'
        f"{''.join(texts)}</g>"
    )


def _outline(kind: str, place: tuple[float, float, float, float]) -> str:
    """The outline of a box; each kind has its own shape as well as its own colour."""
    x, y, width, height = place
    if kind == "dm":
        c = min(10.0, height / 3)
        return (
            f'<path class="shape" d="M{x + c:.1f} {y:.1f}H{x + width - c:.1f}L{x + width:.1f} '
            f"{y + height / 2:.1f}L{x + width - c:.1f} {y + height:.1f}H{x + c:.1f}L{x:.1f} "
            f'{y + height / 2:.1f}Z"/>'
        )
    radius = {"topic": 12.0, "input": 12.0, "plant": 0.0}.get(kind, 5.0)
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
        f'rx="{min(radius, height / 2):g}"/>'
    )


def _legend(width: float, *, upwards: bool) -> tuple[str, float]:
    """The legend of shapes and colours, in rows of at most this width, and its height in px."""
    parts, x, y = [], 0.0, 18.0
    for kind, text in (*LEGEND, *((UPWARDS,) if upwards else ())):
        wide = 34 + text_width(text, 11.0) + 16
        if x and x + wide > width:
            x, y = 0.0, y + 22
        shape = _up_arrow(x + 13, y) if kind == "up" else _outline(kind, (x + 1, y - 8, 24, 14))
        parts.append(
            f'<g class="{kind}">{shape}<text class="caption" style="text-anchor:start" '
            f'x="{x + 32:.1f}" y="{y + 3:.1f}">{escape(text)}</text></g>'
        )
        x += wide
    return "".join(parts), y + 20


def _up_arrow(x: float, y: float) -> str:
    """The SVG of the upward arrow in the legend."""
    return (
        f'<path class="wire up" d="M{x:.1f} {y + 8:.1f}V{y - 2:.1f}"/>'
        f'<path class="head up" d="M{x:.1f} {y - 9:.1f}L{x - 4:.1f} {y - 1.5:.1f}H{x + 4:.1f}Z"/>'
    )


# ---------------------------------------------------------------- arrows


def _arrow_lines(layout: GraphLayout, tops: Sequence[float]) -> Iterator[str]:
    """Yields the SVG of the lines of arrows and of their heads."""
    yield from (
        _passing_line(spot, layout, tops)
        for layer in layout.layers
        for spot in layer
        if spot.box is None
    )
    for piece in layout.pieces:
        yield from _piece_lines(piece, tops)


def _passing_line(spot: Spot, layout: GraphLayout, tops: Sequence[float]) -> str:
    """The line, straight down, of an arrow that passes the boxes of a layer."""
    up = any(p.up for p in layout.pieces if spot in (p.above, p.below))
    x = spot.x + spot.width / 2
    end = tops[spot.layer] + max((s.height for s in layout.layers[spot.layer]), default=0.0)
    return f'<path class="wire{" up" * up}" d="M{x:.1f} {tops[spot.layer]:.1f}V{end:.1f}"/>'


def _piece_lines(p: Piece, tops: Sequence[float]) -> Iterator[str]:
    x0, x1 = p.above.x + p.above_x, p.below.x + p.below_x
    y1 = tops[p.below.layer]
    bottom = tops[p.below.layer] - BETWEEN_PX
    y0 = tops[p.above.layer] + p.above.height if p.above.box is not None else bottom
    up = " up" * p.up
    head = 7.0 if p.ends else 0.0
    start, end = (y0 + head, y1) if p.up else (y0, y1 - head)
    half = max((y1 - bottom) / 2, 8.0)
    names = f'data-from="{escape(p.source, quote=True)}" data-to="{escape(p.target, quote=True)}"'
    yield (
        f'<path class="wire{up}" {names} d="M{x0:.1f} {start:.1f}V{max(bottom, start):.1f}'
        f"C{x0:.1f} {bottom + half:.1f} {x1:.1f} {y1 - half:.1f} {x1:.1f} {end:.1f}" + '"/>'
    )
    if p.ends:
        x, y, back = (x0, y0, 7.5) if p.up else (x1, y1, -7.5)
        yield (
            f'<path class="head{up}" d="M{x:.1f} {y:.1f}L{x - 4:.1f} {y + back:.1f}H{x + 4:.1f}Z"/>'
        )


def picture(system: System) -> str:
    """The SVG of a flat system as a whole file, for light and dark."""
    return draw_graph(graph_of(system))
