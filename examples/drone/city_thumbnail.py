"""A small map of one flight, in the text of the page.

Purpose: the arms side by side at a glance, without the drawing library, sharp on paper.
Non-goals: pointing and zooming; that is the map's work.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
from city_shapes import box_outline, height_levels, tube_outline, window

from soter.report.run.figure_parts import (
    event_place,
    flight_indices,
    givebacks,
    mode_stretches,
    takeovers,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from city_scene import Scene
    from city_shapes import Window
    from numpy.typing import NDArray

    from soter.report.run.record import Flight, Vec3

POINTS_MAX = 600


def flight_thumbnail(scene: Scene, flight: Flight, flights: Sequence[Flight]) -> str:
    """Return an SVG of one flight from above, in the window that holds all `flights`."""
    shown = window(scene, flights)
    label = escape(f"{flight.title}: the flight from above")
    view = f"0 0 {shown.width:.2f} {shown.height:.2f}"
    parts = [f'<svg class="thumb" viewBox="{view}" role="img" aria-label="{label}">']
    for box, level in zip(scene.boxes, height_levels(scene.boxes).tolist(), strict=True):
        parts.append(f'<path class="box box-{level}" d="{_path(shown, box_outline(box))}Z"/>')
    outlines = [tube_outline(tube, tube.half_width_m) for tube in scene.tubes]
    if outlines:
        union = "".join(f"{_path(shown, outline)}Z" for outline in outlines)
        parts.append(f'<path class="tube" d="{union}"/>')
    parts += _lines(shown, flight)
    parts += _events(shown, flight)
    for name, (x, y, _) in scene.goals:
        px, py = _pixel(shown, x, y)
        size = shown.width * 0.043
        parts.append(
            f'<text x="{px:.2f}" y="{py - 0.35 * size:.2f}" font-size="{size:.2f}">'
            f"{escape(name)}</text>"
        )
    return "".join([*parts, "</svg>"])


def _lines(shown: Window, flight: Flight) -> list[str]:
    """Draw the trajectory in the colours of whoever is in control."""
    chosen = flight_indices(flight, POINTS_MAX)
    points = flight.position[chosen, :2]
    parts: list[str] = []
    for first, last, is_ac in mode_stretches(flight.in_control[chosen]):
        if last > first:
            controller = "ac" if is_ac else "sc"
            path = _path(shown, points[first : last + 1])
            parts.append(f'<path class="line {controller}" d="{path}"/>')
    return parts


def _events(shown: Window, flight: Flight) -> list[str]:
    """Draw red dots, green dots and crosses."""
    radius = shown.width * 0.0095
    parts = [
        f'<circle class="{kind}" cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}"/>'
        for kind, decisions in (
            ("giveback", givebacks(flight.decisions)),
            ("takeover", takeovers(flight.decisions)),
        )
        for x, y in [
            _spot(shown, event_place(flight, decision.time_s, decision.position))
            for decision in decisions
        ]
    ]
    arm = radius * 1.25
    for violation in flight.violations:
        x, y = _spot(shown, event_place(flight, violation.time_s, violation.position))
        parts.append(
            f'<path class="cross" d="M{x - arm:.2f} {y - arm:.2f}L{x + arm:.2f} {y + arm:.2f}'
            f'M{x - arm:.2f} {y + arm:.2f}L{x + arm:.2f} {y - arm:.2f}"/>'
        )
    return parts


def _spot(shown: Window, position: Vec3) -> tuple[float, float]:
    """Place a point of the world in the drawing."""
    return _pixel(shown, position[0], position[1])


def _pixel(shown: Window, x: float, y: float) -> tuple[float, float]:
    """Place ground coordinates in the drawing, y downwards."""
    return x - shown.x_min, shown.y_max - y


def _path(shown: Window, points: NDArray[np.float64]) -> str:
    """Return the path data of a polyline (k, 2); points that are not finite are left out."""
    finite = points[np.isfinite(points).all(axis=1)]
    spots = [_pixel(shown, x, y) for x, y in finite.tolist()]
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in spots) if spots else ""
