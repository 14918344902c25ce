"""The page of `soter advise`: what Delta and m cost, drawn.

Purpose: one HTML file for all modules: shares of the states left to AC over Delta, a line for each
m, with every number in a table below. Drawn as SVG: it needs no script.
Non-goals: computing any of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 720, 360, 60, 50, 20, 110
COLOURS = ("#2a7f62", "#3465a4", "#b5651d", "#8e44ad", "#555555")


@dataclass(frozen=True)
class Line:
    """One curve: `points` are (Delta in ms, share); `sure` says where everything is proved."""

    name: str
    points: tuple[tuple[float, float], ...]
    sure: tuple[bool, ...]


@dataclass(frozen=True)
class AdvicePage:
    """What is known of one module; `table` is rows of text under `head`."""

    module: str
    summary: str
    lines: tuple[Line, ...]
    head: tuple[str, ...]
    table: tuple[tuple[str, ...], ...]


def advice_main(pages: Sequence[AdvicePage]) -> str:
    """The body of the page."""
    return "\n".join(part for page in pages for part in _module(page))


def _module(page: AdvicePage) -> Iterator[str]:
    yield f"<h1>{escape(page.module)}</h1>"
    yield f"<p>{escape(page.summary)}</p>"
    yield f"<figure>{''.join(_figure(page))}"
    yield (
        "<figcaption>Share of the grid's states over the period Δ of the decision module. "
        "Filled dots: everything is proved there; rings: not.</figcaption></figure>"
    )
    head = "".join(f"<th>{escape(h)}</th>" for h in page.head)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in page.table
    )
    yield f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _figure(page: AdvicePage) -> Iterator[str]:
    longest = max((x for line in page.lines for x, _ in line.points), default=1.0) * 1.05

    def at(x: float, y: float) -> tuple[float, float]:
        across = LEFT + x / longest * (WIDTH - LEFT - RIGHT)
        return across, HEIGHT - BOTTOM - y * (HEIGHT - BOTTOM - TOP)

    yield f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" font-size="12" fill="currentColor">'
    yield f"<title>{escape(page.module)}: shares of the states over Delta</title>"
    for k in range(6):
        x, y = at(0.0, k / 5)
        yield f'<line x1="{x:.1f}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" '
        yield 'stroke="currentColor" stroke-opacity="0.2"/>'
        yield f'<text x="{x - 8:.1f}" y="{y + 4:.1f}" text-anchor="end">{20 * k} %</text>'
    for ms in sorted({x for line in page.lines for x, _ in line.points}):
        x, y = at(ms, 0.0)
        yield f'<text x="{x:.1f}" y="{y + 18:.1f}" text-anchor="middle">{ms:g}</text>'
    yield f'<text x="{(WIDTH - RIGHT + LEFT) / 2:.0f}" y="{HEIGHT - 10}" text-anchor="middle">'
    yield "Δ in ms</text>"
    for line, colour in zip(page.lines, COLOURS, strict=False):
        yield from _line(line, colour, [at(x, y) for x, y in line.points])
    yield "</svg>"


def _line(line: Line, colour: str, points: list[tuple[float, float]]) -> Iterator[str]:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    yield f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'
    for (x, y), sure in zip(points, line.sure, strict=True):
        fill = colour if sure else "none"
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{fill}" stroke="{colour}"/>'
    if points:
        x, y = points[-1]
        yield f'<text x="{x + 10:.1f}" y="{y + 4:.1f}" fill="{colour}">{escape(line.name)}</text>'
