"""The proof report: one page that a safety engineer can file, with the paper's region figure.

Purpose: verdict, properties with their method, times, vacuity figures, what it rests on, hashes; in
the order in which it is questioned. The regions R1 to R5 are an SVG of one path each, cells merged
into rectangles, so that a grid of 100,000 cells is a small, sharp drawing that prints and needs no
script.
Non-goals: verifying; deciding which cell belongs where, or what to show (`verify/`).
"""

from __future__ import annotations

from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from soter.report.html import document, write_text
from soter.report.proof.record import R1, R5
from soter.report.run.result_wording import quantity
from soter.report.templates import filled

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.report.proof.record import ProofPage, RegionFigure, RegionSlice, Trajectory


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
    parts = [_slice(s, k == figure.shown, x, y) for k, s in enumerate(figure.slices)]
    parts = parts or [*_paths(figure.regions, x, y), _border(figure.lets_ac, x, y)]
    parts += _axis_x(x, quantity(figure.x_name, figure.x_unit), height)
    if not flat:
        parts += _axis_y(y, quantity(figure.y_name, figure.y_unit), height)
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


def _slice(part: RegionSlice, shown: bool, x: _Scale, y: _Scale) -> str:
    """One slice of several: all but the one that is shown are there for the slider."""
    hidden = "" if shown else ' display="none"'
    paths = "".join((*_paths(part.regions, x, y), _border(part.lets_ac, x, y)))
    return f'<g class="slice"{hidden}><title>{escape(part.where)}</title>{paths}</g>'


def _paths(regions: NDArray[np.uint8], x: _Scale, y: _Scale) -> list[str]:
    """A path for each region that has cells."""
    return [
        f'<path class="r{code}" d="{path}"/>'
        for code in range(R1, R5 + 1)
        if (path := _region_path(regions == code, x, y))
    ]


def _region_path(inside: NDArray[np.bool_], x: _Scale, y: _Scale) -> str:
    """All cells of one region: a rectangle for each run along x, as high as rows have that run."""
    pieces: list[str] = []
    open_runs: dict[tuple[int, int], int] = {}
    for j in range(inside.shape[1] + 1):
        column = inside[:, j] if j < inside.shape[1] else np.zeros(len(inside), dtype=np.bool_)
        ends = np.flatnonzero(np.diff(np.concatenate(([False], column, [False])).astype(int)))
        row = set(zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True))
        for a, b in [run for run in open_runs if run not in row]:
            bottom, top = y.places[open_runs.pop((a, b))], y.places[j]
            pieces.append(f"M{x.places[a]:g} {bottom:g}H{x.places[b]:g}V{top:g}H{x.places[a]:g}z")
        for run in sorted(row):
            open_runs.setdefault(run, j)
    return "".join(pieces)


def _border(inside: NDArray[np.bool_] | None, x: _Scale, y: _Scale) -> str:
    """The line between cells of a set and others, without the frame."""
    if inside is None:
        return ""
    pieces = [
        f"M{x.places[i + 1]:g} {y.places[j]:g}V{y.places[j + 1]:g}"
        for i, j in np.argwhere(inside[1:] != inside[:-1]).tolist()
    ]
    pieces += [
        f"M{x.places[i]:g} {y.places[j + 1]:g}H{x.places[i + 1]:g}"
        for i, j in np.argwhere(inside[:, 1:] != inside[:, :-1]).tolist()
    ]
    return f'<path class="border" d="{"".join(pieces)}"/>' if pieces else ""


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


SIGNS = {"proved": "✓", "refuted": "✕", "undecided": "?", "assumed": "•"}
SWITCHED = "; the DM has switched to SC"
"""Of R3 without R4, where `ttf` and P3 are proved."""
REGIONS = (
    ("r1", "R1", "outside the constraint C (`safe`)"),
    ("r2", "R2", "inside C, but SC cannot keep it there"),
    ("r3", "R3 \N{SET MINUS} R4", "core K: SC keeps C"),
    (
        "r4",
        "R4 \N{SET MINUS} R5",
        "R(H): AC may act here for H; it keeps control where `ttf` is false",
    ),
    ("r5", "R5", "where `safer` may hold: the DM gives control back to AC"),
)


def write_proof(page: ProofPage, path: str | os.PathLike[str]) -> Path:
    """Write the page to `path`; it needs no script and no network. Raises `ReportError`."""
    return write_text(proof_document(page), path)


def proof_document(page: ProofPage) -> str:
    """The page as one text; only sliders through a third axis have a script."""
    main = proof_body(page)
    return document(page.title, main, "slices" if 'class="slices"' in main else "")


def proof_body(page: ProofPage) -> str:
    """Return the inside of `<main>`."""
    return filled(
        "report/proof/page.html.j2",
        page=page,
        signs=SIGNS,
        regions=REGIONS,
        switched=SWITCHED,
        region_svg=region_svg,
        of_one_region=_of_one_region,
        undrawn=_undrawn,
    )


def _of_one_region(f: RegionFigure) -> int | None:
    """The region that a single axis lies in from end to end: nothing of it need be drawn."""
    if f.y_name or f.slices or f.trajectory is not None:
        return None
    if f.lets_ac is not None and f.lets_ac.any() and not f.lets_ac.all():
        return None
    first = int(f.regions.flat[0])
    return first if (f.regions == first).all() else None


def _undrawn(figures: tuple[RegionFigure, ...]) -> list[tuple[str, str, str]]:
    """Of each region and note: the axes that lie in it from end to end."""
    axes: dict[tuple[int, str], list[str]] = {}
    for f in figures:
        region = _of_one_region(f)
        if region is not None:
            unit = f" {f.x_unit}" if f.x_unit else ""
            ends = f"{f.x_edges[0]:.4g}, {f.x_edges[-1]:.4g}".replace("-", "\N{MINUS SIGN}")
            axes.setdefault((region, f.note), []).append(f"{f.x_name} in [{ends}]{unit}")
    return [(REGIONS[r - 1][1], note, "; ".join(names)) for (r, note), names in axes.items()]
