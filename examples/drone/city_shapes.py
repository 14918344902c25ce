"""Shapes of a scene: outlines from above, solids for the 3-D view, the window that is shown.

Purpose: turn boxes and tubes into polygons and triangles.
Non-goals: collision checks; what is drawn here decides nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from city_scene import Scene, Tube
    from numpy.typing import NDArray

    from soter.report.run.record import Flight

HEIGHT_LEVELS = 5
"""Shades of the buildings, from the lowest to the highest."""
MARGIN_M = 2.5
SPAN_MIN_M = 8.0


@dataclass(frozen=True)
class Window:
    """The part of the ground plane that is shown, in m."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @property
    def width(self) -> float:
        """Extent along x in m."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Extent along y in m."""
        return self.y_max - self.y_min


def window(scene: Scene, flights: Sequence[Flight]) -> Window:
    """Return a window that holds every flight, goal and tube with a margin, and no more.

    It is no narrower than two thirds of its height and no wider than two times it, so that a
    flight along one street still shows the street.
    """
    points = [np.asarray([position], dtype=np.float64)[:, :2] for _, position in scene.goals]
    points += [flight.position[:, :2] for flight in flights]
    points += [tube_outline(tube, tube.half_width_m) for tube in scene.tubes]
    if not points:
        points = [np.asarray([scene.lo, scene.hi], dtype=np.float64)[:, :2]]
    everything = np.concatenate(points)
    everything = everything[np.isfinite(everything).all(axis=1)]
    low = everything.min(axis=0) - MARGIN_M
    high = everything.max(axis=0) + MARGIN_M
    centre = (low + high) / 2
    span = np.maximum(high - low, SPAN_MIN_M)
    span = np.maximum(span, [span[1] * 2 / 3, span[0] / 2])
    low, high = centre - span / 2, centre + span / 2
    return Window(float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def height_levels(boxes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the shade, 0 to `HEIGHT_LEVELS`-1, of each box (n, 2, 3) by its height: (n,)."""
    tops = boxes[:, 1, 2]
    if len(tops) == 0:
        return np.empty(0, dtype=np.intp)
    spread = float(tops.max() - tops.min())
    share = (tops - tops.min()) / spread if spread > 0 else np.ones_like(tops)
    levels: NDArray[np.intp] = np.round(share * (HEIGHT_LEVELS - 1)).astype(np.intp)
    return levels


def box_outline(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the closed outline from above (5, 2) of a box (2, 3), counter-clockwise."""
    (x0, y0, _), (x1, y1, _) = box.tolist()
    return np.asarray([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], dtype=np.float64)


def tube_outline(tube: Tube, half_width_m: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the closed outline from above (k, 2) of one region of a tube.

    Every outline turns the same way, so overlapping tubes fill as their union. A segment that
    rises straight up is a square.
    """
    centres, widths, along, _ = _stations(tube, half_width_m)
    across = np.asarray([-along[1], along[0]])
    if float(np.hypot(*across)) < 1e-9:
        width = float(widths.max())
        x, y = float(centres[0, 0]), float(centres[0, 1])
        square = [[x - width, y - width, 0.0], [x + width, y + width, 0.0]]
        return box_outline(np.asarray(square))[::-1]
    across = across / np.hypot(*across)
    left = centres[:, :2] + widths[:, None] * across
    right = centres[:, :2] - widths[:, None] * across
    return np.concatenate([left, right[::-1], left[:1]])


def box_rings(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a box (2, 3) as a loft of its floor and its roof: (2, 4, 3)."""
    outline = box_outline(box)[:4]
    rings = np.empty((2, 4, 3))
    rings[:, :, :2] = outline
    rings[0, :, 2], rings[1, :, 2] = box[0, 2], box[1, 2]
    return rings


def tube_rings(tube: Tube, half_width_m: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one region of a tube as a loft of squares along its segment: (stations, 4, 3)."""
    centres, widths, along, _ = _stations(tube, half_width_m)
    helper = np.asarray([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.asarray([1.0, 0.0, 0.0])
    side = np.cross(helper, along)
    side = side / np.linalg.norm(side)
    up = np.cross(along, side)
    corners = np.asarray([side + up, -side + up, -side - up, side - up])
    rings: NDArray[np.float64] = centres[:, None, :] + widths[:, None, None] * corners[None, :, :]
    return rings


def loft_mesh(
    lofts: Iterable[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return vertices (v, 3) and triangles (t, 3) of closed lofts of four-cornered rings."""
    vertices: list[NDArray[np.float64]] = []
    triangles: list[tuple[int, int, int]] = []
    base = 0
    for rings in lofts:
        count = len(rings)
        vertices.append(rings.reshape(-1, 3))
        for ring in range(count - 1):
            for corner in range(4):
                a = base + 4 * ring + corner
                b = base + 4 * ring + (corner + 1) % 4
                triangles += [(a, b, a + 4), (b, b + 4, a + 4)]
        last = base + 4 * (count - 1)
        triangles += [(base, base + 2, base + 1), (base, base + 3, base + 2)]
        triangles += [(last, last + 1, last + 2), (last, last + 2, last + 3)]
        base += 4 * count
    if not vertices:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.intp)
    return np.concatenate(vertices), np.asarray(triangles, dtype=np.intp)


def loft_edges(lofts: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the edges of lofts as polylines parted by rows of NaN: (m, 3)."""
    gap = np.full((1, 3), np.nan)
    parts: list[NDArray[np.float64]] = []
    for rings in lofts:
        for ring in (rings[0], rings[-1]):
            parts += [ring, ring[:1], gap]
        for corner in range(4):
            parts += [rings[:, corner, :], gap]
    return np.concatenate(parts) if parts else np.empty((0, 3))


def join(outlines: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join polylines (k, d) into one array, parted by rows of NaN."""
    parts: list[NDArray[np.float64]] = []
    for outline in outlines:
        parts += [outline, np.full((1, outline.shape[1]), np.nan)]
    return np.concatenate(parts[:-1]) if parts else np.empty((0, 2))


def _stations(
    tube: Tube, half_width_m: float | NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Return centres (m, 3), half widths (m,), unit direction (3,) and length of a region.

    The first and last station lie half a width beyond the segment: C is a box in the tube
    frame, |across| <= r and -r <= along <= L + r.
    """
    start = np.asarray(tube.start, dtype=np.float64)
    end = np.asarray(tube.end, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0 else np.asarray([1.0, 0.0, 0.0])
    widths = np.atleast_1d(np.asarray(half_width_m, dtype=np.float64))
    inner = np.linspace(0.0, length, len(widths)) if len(widths) > 1 else np.asarray([0.0])
    stations = np.concatenate([[-widths[0]], inner, [length + widths[-1]]])
    widths = np.concatenate([widths[:1], widths, widths[-1:]])
    return start + stations[:, None] * along, widths, along, length
