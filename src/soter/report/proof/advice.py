"""The page of `soter advise`: what Delta and m cost, drawn.

Purpose: one HTML file for all modules: shares of the states left to AC over Delta, a line for each
m, with every number in a table below. Drawn as SVG: it needs no script.
Non-goals: computing any of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from soter.report.templates import filled

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 530, 320, 64, 46, 22, 100
CURVES_MAX = 5
APART_PX = 22.0
"""Between labels of neighbouring periods, at least."""


@dataclass(frozen=True)
class Line:
    """One curve: `points` are (Delta in ms, share); `sure` says where everything is proved."""

    name: str
    points: tuple[tuple[float, float], ...]
    sure: tuple[bool, ...]


@dataclass(frozen=True)
class AdvicePage:
    """What is known of one module of `program`; `table` is rows of text under `head`.

    `says`: what the names and marks mean; `best_ms`: the longest Delta that verifies, if one does.
    """

    module: str
    summary: str
    lines: tuple[Line, ...]
    head: tuple[str, ...]
    table: tuple[tuple[str, ...], ...]
    says: tuple[str, ...] = ()
    best_ms: float | None = None
    program: str = ""


def advice_main(pages: Sequence[AdvicePage]) -> str:
    """The body of the page."""
    return filled("report/proof/advice.html.j2", pages=pages, svg=_figure)


def _figure(page: AdvicePage) -> Iterator[str]:
    longest = max((x for line in page.lines for x, _ in line.points), default=1.0) * 1.05

    def at(x: float, y: float) -> tuple[float, float]:
        across = LEFT + x / longest * (WIDTH - LEFT - RIGHT)
        return across, HEIGHT - BOTTOM - y * (HEIGHT - BOTTOM - TOP)

    yield f'<svg class="chart advice" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">'
    yield f"<title>{escape(page.module)}: shares of the states over Delta</title>"
    for k in range(6):
        x, y = at(0.0, k / 5)
        yield f'<path class="grid" d="M{x:.1f} {y:.1f}H{WIDTH - RIGHT}"/>'
        yield f'<text x="{x - 8:.1f}" y="{y + 4:.1f}" text-anchor="end">{20 * k} %</text>'
    last = -APART_PX
    for ms in sorted({x for line in page.lines for x, _ in line.points}):
        x, y = at(ms, 0.0)
        if x - last >= APART_PX:
            yield f'<text x="{x:.1f}" y="{y + 18:.1f}" text-anchor="middle">{ms:g}</text>'
            last = x
    middle = f'x="{(WIDTH - RIGHT + LEFT) / 2:.0f}" y="{HEIGHT - 8}" text-anchor="middle"'
    yield f'<text class="name" {middle}>Δ / ms</text>'
    if page.best_ms is not None:
        x, y = at(page.best_ms, 0.0)
        yield f'<path class="best" d="M{x:.1f} {y:.1f}V{TOP}"/><text class="name" x="{x:.1f}" '
        yield f'y="{TOP - 8}" text-anchor="middle">longest that verifies</text>'
    for k, line in enumerate(page.lines[:CURVES_MAX]):
        yield from _line(line, f"curve-{k}", [at(x, y) for x, y in line.points])
    yield "</svg>"


def _line(line: Line, kind: str, points: list[tuple[float, float]]) -> Iterator[str]:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    yield f'<g class="{kind}"><polyline points="{path}"/>'
    for (x, y), sure in zip(points, line.sure, strict=True):
        yield f'<circle{"" if sure else " class=ring"} cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
    if points:
        x, y = points[-1]
        yield f'<text x="{x + 10:.1f}" y="{y + 4:.1f}">{escape(line.name)}</text>'
    yield "</g>"
