"""Writes the proof report, which a safety engineer can file, and the page of `soter advise`.

Purpose: turns plain records, which the caller fills, into HTML. The report has verdict, properties
with their method, times, vacuity figures, what it rests on and hashes, in the order in which it is
questioned. The regions R1 to R5 are an SVG of one path each, cells merged into rectangles, so that
a grid of 100,000 cells is a small, sharp drawing that prints. The page of advice shows what Delta
and m cost: shares of the states left to AC over Delta, a line for each m, with every number in a
table below. Both need no script; only sliders through a third axis have one.
Non-goals: computing verdicts, numbers, which cell belongs where, and what to show (`verify/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from soter.report.html import document, write_text
from soter.report.templates import filled
from soter.report.wording import quantity

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray


R1, R2, R3, R4, R5 = 1, 2, 3, 4, 5
"""The paper's regions, outermost first: unsafe; safe, not in K; K; R(H); where AC may return."""


@dataclass(frozen=True)
class PropertyRow:
    """A table row for one property; `verdict` is proved, refuted, undecided or assumed."""

    name: str
    meaning: str
    verdict: str
    method: str
    seconds: float
    detail: str = ""


@dataclass(frozen=True)
class Trajectory:
    """A run drawn over the regions: n points on both axes, and whether AC controlled each point."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    in_control: NDArray[np.bool_]
    title: str = ""
    leaves: bool = False
    """Whether the run leaves C, the candidate set, at its last point; both ends are marked."""


@dataclass(frozen=True)
class RegionSlice:
    """A slice of a region figure at place `where` of the third axis, shaped as `RegionFigure`."""

    where: str
    regions: NDArray[np.uint8]
    lets_ac: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class RegionFigure:
    """The region figure of the paper for one group of states, or a slice of it.

    `regions[i, j]` is 1 to 5 for the cell between `x_edges[i:i+2]` and `y_edges[j:j+2]`. A group of
    one axis has a single row and an empty `y_name`. A group of three axes has `slices` through the
    third axis `across`, from its lowest value on; the figure shows the slice with index `shown`.
    """

    title: str
    x_name: str
    y_name: str
    x_edges: NDArray[np.float64]
    y_edges: NDArray[np.float64]
    regions: NDArray[np.uint8]
    note: str = ""
    trajectory: Trajectory | None = None
    x_unit: str = ""
    y_unit: str = ""
    across: str = ""
    slices: tuple[RegionSlice, ...] = ()
    shown: int = 0
    lets_ac: NDArray[np.bool_] | None = None
    """The cells where `ttf` may be false, in the form of `regions`; their border is drawn."""


@dataclass(frozen=True)
class ModuleProof:
    """One module: its properties, the times used, and the sizes of its sets."""

    name: str
    verdict: str
    headline: str
    properties: tuple[PropertyRow, ...]
    times: tuple[tuple[str, str, str], ...]
    """Rows (symbol, meaning, value with unit)."""
    shares: tuple[tuple[str, str], ...]
    """Vacuity figures as rows (what, share)."""
    figures: tuple[RegionFigure, ...] = ()
    counterexample: tuple[str, ...] = ()
    """Lines about a refuting run: from where, by what, when."""
    open: tuple[tuple[str, tuple[str, ...]], ...] = ()
    """For every property that is not shown: a heading, and lines where, why, tried, helps."""
    switches: bool = True
    """Whether `ttf` and P3 hold, so that the DM has switched where AC must not act."""
    but: str = ""
    """Why a proof says little: AC never, or hardly ever, has control; else ""."""
    leaving: tuple[RegionFigure, ...] = ()
    """Figures of the model's run that leaves C soonest."""
    leaving_text: str = ""


@dataclass(frozen=True)
class TakenRow:
    """A statement that a module assumes about others, and its reason; `open` if not proved."""

    module: str
    what: str
    why: str
    open: bool


@dataclass(frozen=True)
class ProofPage:
    """The content of the page that reports a proof."""

    title: str
    headline: str
    subtitle: str
    modules: tuple[ModuleProof, ...]
    assumptions: tuple[str, ...]
    trusted_base: tuple[str, ...]
    provenance: dict[str, str] = field(default_factory=dict)
    """Hashes, versions, commands."""
    together: str = ""
    """For several modules the verdict on all of them together, else ""."""
    taken: tuple[TakenRow, ...] = ()
    not_covered: tuple[str, ...] = ()
    """Sentences on what the verdict does not cover."""


WIDTH, HEIGHT = 520.0, 340.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 14.0, 10.0, 46.0
STRIP = 70.0
"""The height, in px, of the drawing of a group with one axis."""
TICKS = 6


def region_svg(figure: RegionFigure) -> str:
    """Draws one region figure as SVG."""
    flat = not figure.y_name
    height = STRIP + TOP + BOTTOM if flat else HEIGHT
    x = _Scale(figure.x_edges, LEFT, WIDTH - RIGHT)
    y = _Scale(figure.y_edges, height - BOTTOM, TOP)
    parts = [_svg_of_slice(s, k == figure.shown, x, y) for k, s in enumerate(figure.slices)]
    parts = parts or [*_region_paths(figure.regions, x, y), _border_path(figure.lets_ac, x, y)]
    parts += _axis_x(x, quantity(figure.x_name, figure.x_unit), height)
    if not flat:
        parts += _axis_y(y, quantity(figure.y_name, figure.y_unit), height)
    if figure.trajectory is not None:
        parts.append(_trajectory_svg(figure.trajectory, x, y))
    frame = (
        f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" '
        f'height="{height - TOP - BOTTOM}"/>'
    )
    return (
        f'<svg class="regions" viewBox="0 0 {WIDTH:g} {height:g}" role="img" '
        f'aria-label="{escape(figure.title)}: regions R1 to R5">{"".join(parts)}{frame}</svg>'
    )


class _Scale:
    """Maps values of an axis to pixels on the drawing."""

    def __init__(self, edges: NDArray[np.float64], at_low: float, at_high: float) -> None:
        self.low, self.high = float(edges[0]), float(edges[-1])
        self.at_low, self.per_unit = at_low, (at_high - at_low) / (self.high - self.low)
        self.places = np.round(at_low + (edges - self.low) * self.per_unit, 2)

    def px_of(self, value: float) -> float:
        """The pixel coordinate of a value on the drawing."""
        return self.at_low + (value - self.low) * self.per_unit

    def ticks(self) -> list[float]:
        """Round values on the axis, at which its ticks are drawn."""
        raw = (self.high - self.low) / TICKS
        power = 10.0 ** np.floor(np.log10(raw))
        step = next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= raw)
        first = np.ceil(self.low / step - 1e-9)
        count = int(np.floor(self.high / step + 1e-9) - first) + 1
        return [float((first + k) * step) for k in range(count)]


def _svg_of_slice(part: RegionSlice, shown: bool, x: _Scale, y: _Scale) -> str:
    """Draws a slice as SVG; it is hidden until the slider selects it, unless it is `shown`."""
    hidden = "" if shown else ' display="none"'
    paths = "".join((*_region_paths(part.regions, x, y), _border_path(part.lets_ac, x, y)))
    return f'<g class="slice"{hidden}><title>{escape(part.where)}</title>{paths}</g>'


def _region_paths(regions: NDArray[np.uint8], x: _Scale, y: _Scale) -> list[str]:
    """An SVG path for each region that has cells."""
    return [
        f'<path class="r{code}" d="{path}"/>'
        for code in range(R1, R5 + 1)
        if (path := _region_path(regions == code, x, y))
    ]


def _region_path(inside: NDArray[np.bool_], x: _Scale, y: _Scale) -> str:
    """The SVG path of one region, made of rectangles; equal rows of cells share a rectangle."""
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


def _border_path(inside: NDArray[np.bool_] | None, x: _Scale, y: _Scale) -> str:
    """The SVG path of the border between cells inside and outside a set, without the frame."""
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


def _tick_text(value: float) -> str:
    """A value as the label of an axis tick."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _axis_x(x: _Scale, name: str, height: float) -> list[str]:
    """The SVG elements of the ticks and the name below the figure."""
    base, middle = height - BOTTOM, (LEFT + WIDTH - RIGHT) / 2
    ticks = [
        f'<text x="{x.px_of(t):.1f}" y="{base + 17:g}" text-anchor="middle">{_tick_text(t)}</text>'
        f'<path class="tick" d="M{x.px_of(t):.1f} {base:g}v4"/>'
        for t in x.ticks()
    ]
    at = f'x="{middle:g}" y="{base + 37:g}" text-anchor="middle"'
    return [*ticks, f'<text class="name" {at}>{escape(name)}</text>']


def _axis_y(y: _Scale, name: str, height: float) -> list[str]:
    """The SVG elements of the ticks and the name to the left of the figure."""
    ticks = [
        f'<text x="{LEFT - 8:g}" y="{y.px_of(t) + 4:.1f}" text-anchor="end">{_tick_text(t)}</text>'
        f'<path class="tick" d="M{LEFT:g} {y.px_of(t):.1f}h-4"/>'
        for t in y.ticks()
    ]
    at = f'transform="translate(14 {(TOP + height - BOTTOM) / 2:g}) rotate(-90)"'
    return [*ticks, f'<text class="name" {at} text-anchor="middle">{escape(name)}</text>']


def _trajectory_svg(run: Trajectory, x: _Scale, y: _Scale) -> str:
    """Draws a run as SVG in the colour of the controller in control, with a dot at each change."""
    px = np.round([x.px_of(float(v)) for v in run.x], 1)
    py = np.round([y.px_of(float(v)) for v in run.y], 1)
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
"""Added to the legend of R3 without R4, if `ttf` and P3 are proved."""
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
    """Writes the page to `path`; it needs no script and no network. `SoterError` D006."""
    return write_text(proof_document(page), path)


def proof_document(page: ProofPage) -> str:
    """The HTML document of the page; it has a script only if a figure has a slider."""
    main = proof_body(page)
    return document(page.title, main, "slices" if 'class="slices"' in main else "")


def proof_body(page: ProofPage) -> str:
    """The HTML inside `<main>` of the report."""
    return filled(
        "report/proof_page.html.j2",
        page=page,
        signs=SIGNS,
        regions=REGIONS,
        switched=SWITCHED,
        region_svg=region_svg,
        of_one_region=_only_region,
        undrawn=_axes_in_one_region,
    )


def _only_region(f: RegionFigure) -> int | None:
    """The region that fills a one-axis figure, which then needs no drawing; None otherwise."""
    if f.y_name or f.slices or f.trajectory is not None:
        return None
    if f.lets_ac is not None and f.lets_ac.any() and not f.lets_ac.all():
        return None
    first = int(f.regions.flat[0])
    return first if (f.regions == first).all() else None


def _axes_in_one_region(figures: tuple[RegionFigure, ...]) -> list[tuple[str, str, str]]:
    """For each region and note: the axes along which the region spans the whole axis."""
    axes: dict[tuple[int, str], list[str]] = {}
    for f in figures:
        if (region := _only_region(f)) is not None:
            unit = f" {f.x_unit}" if f.x_unit else ""
            ends = f"{f.x_edges[0]:.4g}, {f.x_edges[-1]:.4g}".replace("-", "\N{MINUS SIGN}")
            axes.setdefault((region, f.note), []).append(f"{f.x_name} in [{ends}]{unit}")
    return [(REGIONS[r - 1][1], note, "; ".join(names)) for (r, note), names in axes.items()]


CURVES_MAX = 5
APART_PX = 22.0
"""The least distance between labels of neighbouring periods."""


@dataclass(frozen=True)
class Line:
    """A curve of points (Delta in ms, share); `sure` says for each point if it is all proved."""

    name: str
    points: tuple[tuple[float, float], ...]
    sure: tuple[bool, ...]


@dataclass(frozen=True)
class AdvicePage:
    """The part of the page on one module of `program`; `table` holds rows of text below `head`.

    `says` explains names and marks. `best_ms` is the longest Delta that verifies, if any does.
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
    """The HTML inside `<main>` of the page of advice."""
    return filled("report/advice.html.j2", pages=pages, svg=_advice_svg)


def _advice_svg(page: AdvicePage) -> Iterator[str]:
    width, height, left, bottom, top, right = 530, 320, 64, 46, 22, 100
    longest = max((x for line in page.lines for x, _ in line.points), default=1.0) * 1.05

    def place_on_drawing(x: float, y: float) -> tuple[float, float]:
        across = left + x / longest * (width - left - right)
        return across, height - bottom - y * (height - bottom - top)

    yield f'<svg class="chart advice" viewBox="0 0 {width} {height}" role="img">'
    yield f"<title>{escape(page.module)}: shares of the states over Delta</title>"
    for k in range(6):
        x, y = place_on_drawing(0.0, k / 5)
        yield f'<path class="grid" d="M{x:.1f} {y:.1f}H{width - right}"/>'
        yield f'<text x="{x - 8:.1f}" y="{y + 4:.1f}" text-anchor="end">{20 * k} %</text>'
    last = -APART_PX
    for ms in sorted({x for line in page.lines for x, _ in line.points}):
        x, y = place_on_drawing(ms, 0.0)
        if x - last >= APART_PX:
            yield f'<text x="{x:.1f}" y="{y + 18:.1f}" text-anchor="middle">{ms:g}</text>'
            last = x
    middle = f'x="{(width - right + left) / 2:.0f}" y="{height - 8}" text-anchor="middle"'
    yield f'<text class="name" {middle}>Δ / ms</text>'
    if page.best_ms is not None:
        x, y = place_on_drawing(page.best_ms, 0.0)
        yield f'<path class="best" d="M{x:.1f} {y:.1f}V{top}"/><text class="name" x="{x:.1f}" '
        yield f'y="{top - 8}" text-anchor="middle">longest that verifies</text>'
    for k, line in enumerate(page.lines[:CURVES_MAX]):
        yield from _line_svg(line, f"curve-{k}", [place_on_drawing(x, y) for x, y in line.points])
    yield "</svg>"


def _line_svg(line: Line, kind: str, points: list[tuple[float, float]]) -> Iterator[str]:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    yield f'<g class="{kind}"><polyline points="{path}"/>'
    for (x, y), sure in zip(points, line.sure, strict=True):
        yield f'<circle{"" if sure else " class=ring"} cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
    if points:
        x, y = points[-1]
        yield f'<text x="{x + 10:.1f}" y="{y + 4:.1f}">{escape(line.name)}</text>'
    yield "</g>"
