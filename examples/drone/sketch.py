"""Plane drawings as SVG: a map with buildings, or a signal over time.

Purpose: the paper's figures as small still pictures in the report's style, beside a text; colours
are those of its style sheet. Below, the parts that several figures share.
Non-goals: pointing and turning (the report's own figures do that).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from soter.report.run.figure_parts import givebacks, mode_stretches, takeovers

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flights import City
    from numpy.typing import NDArray

    from soter.report.run.record import Decision

EDGE = 44.0
"""Room for an axis and its name, px."""
TICKS = 5
AC, SC = "stroke:var(--ac);stroke-width:2.2", "stroke:var(--sc);stroke-width:2.6"
GREEN, RED = "stroke:var(--good);stroke-width:1.3", "stroke:var(--bad);stroke-width:1.3"
BLUE, THIN = "stroke:var(--sc);stroke-width:1.2", "stroke:var(--ink);stroke-width:1"
DOTTED = "stroke:var(--ink);stroke-width:1.1;stroke-dasharray:2 3"
SOLID = "fill:var(--box-2);stroke:var(--box-line)"
DANGER = "fill:color-mix(in srgb, var(--bad) 24%, var(--paper));stroke:var(--bad)"
TOOK = "fill:var(--takeover);stroke:var(--paper);stroke-width:1.2"
GAVE = "fill:var(--paper);stroke:var(--giveback);stroke-width:2.4"


class Panel:
    """A frame with two axes; places are in its own units, y upwards.

    `x`, `y`: least and greatest; `height_px` None: as high as true scale asks for.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        *,
        width_px: float = 520.0,
        height_px: float | None = None,
        names: tuple[str, str] = ("x / m", "y / m"),
    ) -> None:
        self.x, self.y = x, y
        self.width = width_px
        self.scale_x = (width_px - EDGE - 10.0) / (x[1] - x[0])
        inner = self.scale_x * (y[1] - y[0]) if height_px is None else height_px - EDGE - 10.0
        self.scale_y = inner / (y[1] - y[0])
        self.height = inner + EDGE + 10.0
        self.names = names
        self.parts: list[str] = []

    def place(self, x: float, y: float) -> tuple[float, float]:
        """A point in px from the upper left."""
        left = EDGE + (x - self.x[0]) * self.scale_x
        return left, 10.0 + (self.y[1] - y) * self.scale_y

    def box(self, low: Sequence[float], high: Sequence[float], style: str) -> None:
        """A rectangle."""
        outline = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        self.area(np.array(outline), style)

    def area(self, points: NDArray[np.float64], style: str) -> None:
        """A filled outline (k, 2)."""
        self.union([points], style)

    def union(self, outlines: Iterable[NDArray[np.float64]], style: str) -> None:
        """Filled outlines (k, 2) as one area: where they overlap it is no darker."""
        d = "".join(f"{self._path(points)}Z" for points in outlines)
        self.parts.append(f'<path d="{d}" style="{style}"/>')

    def line(self, points: NDArray[np.float64], style: str) -> None:
        """A polyline (k, 2)."""
        self.lines([points], style)

    def lines(self, polylines: Iterable[NDArray[np.float64]], style: str) -> None:
        """Polylines (k, 2) as one mark."""
        d = "".join(self._path(points) for points in polylines if len(points) > 1)
        if d:
            self.parts.append(f'<path d="{d}" style="fill:none;{style}"/>')

    def dot(self, at: Sequence[float], style: str, radius: float = 4.5) -> None:
        """A round mark."""
        x, y = self.place(at[0], at[1])
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" style="{style}"/>')

    def cross(self, at: Sequence[float], style: str, arm: float = 5.0) -> None:
        """A mark of two strokes."""
        x, y = self.place(at[0], at[1])
        d = f"M{x - arm:.1f} {y - arm:.1f}l{2 * arm} {2 * arm}m0 {-2 * arm}l{-2 * arm} {2 * arm}"
        self.parts.append(f'<path d="{d}" style="fill:none;stroke-width:2.4;{style}"/>')

    def text(
        self, at: Sequence[float], words: str, *, anchor: str = "middle", up: float = 8
    ) -> None:
        """Words at a point, `up` px above it, with the ground's colour around them."""
        x, y = self.place(at[0], at[1])
        self.parts.append(
            f'<text x="{x:.1f}" y="{y - up:.1f}" text-anchor="{anchor}" '
            f'style="{WORDS}paint-order:stroke;stroke:var(--paper);stroke-width:3px">'
            f"{escape(words)}</text>"
        )

    def svg(self, label: str) -> str:
        """The whole drawing; what it shows, for those who cannot see it, is `label`."""
        bounds = f"0 0 {self.width:.0f} {self.height:.0f}"
        inner = f'x="{EDGE}" y="10" width="{self.width - EDGE - 10:.1f}"'
        inner += f' height="{self.height - EDGE - 10:.1f}"'
        clip = f"clip-{crc32(''.join(self.parts).encode()):08x}"
        return (
            f'<svg viewBox="{bounds}" role="img" aria-label="{escape(label)}" '
            f'style="width:100%;display:block"><clipPath id="{clip}"><rect {inner}/></clipPath>'
            f'<rect {inner} style="fill:var(--panel);stroke:var(--rule)"/>'
            f'<g clip-path="url(#{clip})">{"".join(self.parts)}</g>{"".join(self._axes())}</svg>'
        )

    def _path(self, points: NDArray[np.float64]) -> str:
        spots = [self.place(x, y) for x, y in points[:, :2].tolist()]
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in spots)

    def _axes(self) -> list[str]:
        bottom = self.height - EDGE
        labels = []
        for value in ticks(*self.x):
            x, _ = self.place(value, self.y[0])
            labels.append(_words(x, bottom + 16, f"{value:g}", "middle"))
        for value in ticks(*self.y):
            _, y = self.place(self.x[0], value)
            labels.append(_words(EDGE - 6, y + 4, f"{value:g}", "end"))
        labels.append(_words(self.width - 10, bottom + 34, self.names[0], "end"))
        labels.append(_words(EDGE + 8, 26, self.names[1], "start"))
        return labels


WORDS = "font:12px var(--font);fill:var(--ink);"


def _words(x: float, y: float, text: str, anchor: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" '
        f'style="{WORDS}fill:var(--muted)">{escape(text)}</text>'
    )


def ticks(low: float, high: float) -> list[float]:
    """Round numbers between the ends of an axis."""
    rough = (high - low) / TICKS
    unit = 10.0 ** np.floor(np.log10(rough))
    step = min((m * unit for m in (1, 2, 5, 10)), key=lambda s: abs(s - rough))
    first = np.ceil(low / step)
    return [float(round(k * step, 9)) for k in np.arange(first, high / step + 1e-9)]


# ---------------------------------------------------------------- parts of drawings


def walled(
    city: City,
    x: tuple[float, float],
    y: tuple[float, float],
    style: str,
    *,
    width_px: float = 520.0,
) -> Panel:
    """A map of a part of the city."""
    panel = Panel(x, y, width_px=width_px)
    buildings(panel, city, style)
    return panel


def buildings(panel: Panel, city: City, style: str) -> None:
    """The city's boxes, the highest last."""
    for low, high in city.boxes[np.argsort(city.boxes[:, 1, 2])]:
        panel.box(low, high, style)


def goals(panel: Panel, city: City) -> None:
    """g1 to g4."""
    for i, goal in enumerate(city.goals):
        panel.dot(goal, "fill:var(--ink)", 3.5)
        panel.text(goal, f"g{i + 1}", up=10)


def two_tone(panel: Panel, position: NDArray[np.float64], ac: NDArray[np.bool_]) -> None:
    """A trajectory (n, 2 or 3) in the colours of whoever is in control, (n,)."""
    stretches = mode_stretches(ac)
    for style, mode in ((AC, True), (SC, False)):
        panel.lines([position[a : b + 1] for a, b, is_ac in stretches if is_ac is mode], style)


def shaded(panel: Panel, time_s: NDArray[np.float64], ac: NDArray[np.bool_]) -> None:
    """The ground of the times at which SC is in control; both (n,)."""
    low, high = panel.y
    stretches = [
        np.array([[start, low], [end, low], [end, high], [start, high]])
        for start, end in (
            (time_s[a], time_s[b]) for a, b, is_ac in mode_stretches(ac) if not is_ac
        )
    ]
    panel.union(stretches, "fill:var(--sc-shade)")


def where(
    time_s: NDArray[np.float64], position: NDArray[np.float64], at_s: float
) -> NDArray[np.float64]:
    """Where it was at a time, (3,); `time_s` (n,), `position` (n, 3)."""
    point: NDArray[np.float64] = position[
        min(int(np.searchsorted(time_s, at_s)), len(position) - 1)
    ]
    return point


def decided(
    panel: Panel,
    decisions: tuple[Decision, ...],
    time_s: NDArray[np.float64],
    position: NDArray[np.float64],
) -> None:
    """The paper's red and green dots; `time_s` (n,), `position` (n, 3)."""
    for chosen, style in ((givebacks(decisions), GAVE), (takeovers(decisions), TOOK)):
        for d in chosen:
            panel.dot(where(time_s, position, d.time_s).tolist(), style)
