"""The paper's region figure R1 to R5 as an SVG drawing.

Purpose: one path a region, cells of a row merged into runs, so that a grid of 100,000 cells is a
small, sharp drawing that prints and needs no script.
Non-goals: deciding which cell belongs where (`verify/`).
"""

from __future__ import annotations

from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from soter.report.proof.record import R1, R5

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.report.proof.record import RegionFigure, Trajectory

WIDTH, HEIGHT = 520.0, 340.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 14.0, 10.0, 46.0
STRIP = 70.0
"""Height of the drawing of a group with one axis."""
TICKS = 6


def region_svg(figure: RegionFigure) -> str:
    """Draw one figure."""
    flat = not figure.y_name
    height = STRIP + TOP + BOTTOM if flat else HEIGHT
    x = _Scale(figure.x_edges, LEFT, WIDTH - RIGHT)
    y = _Scale(figure.y_edges, height - BOTTOM, TOP)
    parts = [
        f'<path class="r{code}" d="{path}"/>'
        for code in range(R1, R5 + 1)
        if (path := _region_path(figure, code, x, y))
    ]
    parts += _axis_x(x, figure.x_name, height)
    if not flat:
        parts += _axis_y(y, figure.y_name, height)
    if figure.trajectory is not None:
        parts.append(_trajectory(figure.trajectory, x, y))
    frame = (
        f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" '
        f'height="{height - TOP - BOTTOM}"/>'
    )
    return (
        f'<svg class="regions" viewBox="0 0 {WIDTH:g} {height:g}" role="img" '
        f'aria-label="{escape(figure.title)}: regions R1 to R5">{"".join(parts)}{frame}</svg>'
    )


class _Scale:
    """Maps values of an axis to places on the drawing."""

    def __init__(self, edges: NDArray[np.float64], at_low: float, at_high: float) -> None:
        self.low, self.high = float(edges[0]), float(edges[-1])
        self.at_low, self.per_unit = at_low, (at_high - at_low) / (self.high - self.low)
        self.places = np.round(at_low + (edges - self.low) * self.per_unit, 2)

    def at(self, value: float) -> float:
        """Place of one value, px."""
        return self.at_low + (value - self.low) * self.per_unit

    def ticks(self) -> list[float]:
        """Round values inside the axis."""
        raw = (self.high - self.low) / TICKS
        power = 10.0 ** np.floor(np.log10(raw))
        step = next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= raw)
        first = np.ceil(self.low / step - 1e-9)
        count = int(np.floor(self.high / step + 1e-9) - first) + 1
        return [float((first + k) * step) for k in range(count)]


def _region_path(figure: RegionFigure, code: int, x: _Scale, y: _Scale) -> str:
    """All cells of one region: a rectangle for each run along x."""
    pieces: list[str] = []
    inside = figure.regions == code
    for j in range(inside.shape[1]):
        row = np.flatnonzero(np.diff(np.concatenate(([False], inside[:, j], [False])).astype(int)))
        top, bottom = y.places[j + 1], y.places[j]
        pieces += [
            f"M{x.places[a]:g} {bottom:g}H{x.places[b]:g}V{top:g}H{x.places[a]:g}z"
            for a, b in zip(row[::2], row[1::2], strict=True)
        ]
    return "".join(pieces)


def _number(value: float) -> str:
    """A tick's text."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _axis_x(x: _Scale, name: str, height: float) -> list[str]:
    """Ticks and name below."""
    base = height - BOTTOM
    elements = [
        f'<text x="{x.at(t):.1f}" y="{base + 17:g}" text-anchor="middle">{_number(t)}</text>'
        f'<path class="tick" d="M{x.at(t):.1f} {base:g}v4"/>'
        for t in x.ticks()
    ]
    middle = (LEFT + WIDTH - RIGHT) / 2
    elements.append(
        f'<text class="name" x="{middle:g}" y="{base + 37:g}" text-anchor="middle">'
        f"{escape(name)}</text>"
    )
    return elements


def _axis_y(y: _Scale, name: str, height: float) -> list[str]:
    """Ticks and name on the left."""
    elements = [
        f'<text x="{LEFT - 8:g}" y="{y.at(t) + 4:.1f}" text-anchor="end">{_number(t)}</text>'
        f'<path class="tick" d="M{LEFT:g} {y.at(t):.1f}h-4"/>'
        for t in y.ticks()
    ]
    middle = (TOP + height - BOTTOM) / 2
    elements.append(
        f'<text class="name" transform="translate(14 {middle:g}) rotate(-90)" '
        f'text-anchor="middle">{escape(name)}</text>'
    )
    return elements


def _trajectory(run: Trajectory, x: _Scale, y: _Scale) -> str:
    """A run in the colours of who was in control, and dots where that changed."""
    px = np.round([x.at(float(v)) for v in run.x], 1)
    py = np.round([y.at(float(v)) for v in run.y], 1)
    changes = np.flatnonzero(np.diff(run.in_control.astype(int))) + 1
    bounds = [0, *changes.tolist(), len(px) - 1]
    parts: list[str] = []
    for a, b in pairwise(bounds):
        kind = "ac" if run.in_control[a] else "sc"
        points = " ".join(f"{px[k]:g},{py[k]:g}" for k in range(a, b + 1))
        parts.append(f'<polyline class="run {kind}" points="{points}"/>')
    parts += [
        f'<circle class="{"back" if run.in_control[k] else "over"}" cx="{px[k]:g}" '
        f'cy="{py[k]:g}" r="4"/>'
        for k in changes
    ]
    if run.leaves:
        parts.append(f'<circle class="begin" cx="{px[0]:g}" cy="{py[0]:g}" r="4.5"/>')
        parts.append(f'<path class="left" d="M{px[-1] - 5:g} {py[-1] - 5:g}l10 10m-10 0l10 -10"/>')
    return "".join(parts)
