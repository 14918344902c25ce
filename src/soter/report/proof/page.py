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
from soter.report.plain_page import data_head
from soter.report.proof.record import R1, R5
from soter.report.run.result_wording import prose, quantity

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.report.proof.record import (
        ModuleProof,
        ProofPage,
        PropertyRow,
        RegionFigure,
        RegionSlice,
        Trajectory,
    )


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
KEEPS = "core K: SC keeps C"
SWITCHED = "; the DM has switched to SC"
"""Of R3 without R4, where `ttf` and P3 are proved."""
REGIONS = (
    ("r1", "R1", "outside the constraint C (`safe`)"),
    ("r2", "R2", "inside C, but SC cannot keep it there"),
    ("r3", "R3 \N{SET MINUS} R4", KEEPS),
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
    sections = [
        _header(page),
        *(_module(m) for m in page.modules),
        _together(page),
        _list("What this rests on", page.assumptions, "grounds"),
        _list("Not covered", page.not_covered, "grounds"),
        _list("What has to be trusted", page.trusted_base, "grounds"),
        _provenance(page),
    ]
    return "\n".join(s for s in sections if s)


def _header(page: ProofPage) -> str:
    return (
        f'<header class="top"><p class="kicker">{escape(page.title)}</p>'
        f"<h1><span>{prose(page.headline)}</span></h1>"
        f'<p class="subtitle">{prose(page.subtitle)}</p></header>'
    )


def _module(m: ModuleProof) -> str:
    sign, kind = SIGNS.get(m.verdict, "?"), "but" if m.but else m.verdict
    but = f'<p class="lead but">Proved, but {prose(m.but)}.</p>' if m.but else ""
    return (
        f'<section class="proof"><h2>{escape(m.name)} '
        f'<span class="badge {escape(kind)}">{sign} {escape(m.verdict)}'
        f"{', but see below' if m.but else ''}</span></h2>{but}"
        f'<p class="note lead">{prose(m.headline)}</p>{_properties(m)}'
        f"{_lines('The run that leaves the safe set', m.counterexample)}"
        f"{''.join(_lines(title, lines) for title, lines in m.open)}{_leaving(m)}"
        f'<div class="pair">{_times(m)}{_shares(m)}</div>{_figures(m)}</section>'
    )


def _together(page: ProofPage) -> str:
    if not page.together:
        return ""
    rows = "".join(
        f'<tr><th scope="row">{prose(t.module)}</th>'
        f"<td{data_head('takes for granted')}>{prose(t.what)}</td><td{data_head('because')}>"
        f"{f'<strong>{prose(t.why)}</strong>' if t.open else prose(t.why)}</td></tr>"
        for t in page.taken
    )
    return (
        '<section class="proof"><h2>All of them together '
        f'<span class="badge {escape(page.together)}">{SIGNS.get(page.together, "?")} '
        f"{escape(page.together)}</span></h2>"
        '<p class="note lead">Theorem 4.1: where each keeps its own <code>safe</code> all are kept '
        "together; who keeps what a module takes for granted"
        f"{_open(sum(t.open for t in page.taken))}</p>"
        '<div class="scroll"><table class="events proof stacked"><thead><tr>'
        '<th scope="col">module</th><th scope="col">takes for granted</th>'
        f'<th scope="col">because</th></tr></thead><tbody>{rows}</tbody></table></div></section>'
    )


def _open(count: int) -> str:
    return f"; {count} of these {'is' if count == 1 else 'are'} assumed" if count else ""


def _properties(m: ModuleProof) -> str:
    rows = "".join(_property(p) for p in m.properties)
    return (
        '<div class="scroll"><table class="events proof stacked"><thead><tr>'
        '<th scope="col">property</th>'
        '<th scope="col">verdict</th><th scope="col">what it says</th><th scope="col">method</th>'
        '<th scope="col" class="number">time / s</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _property(p: PropertyRow) -> str:
    more = p.detail if p.detail != p.meaning else ""
    detail = f'<br><span class="detail">{prose(more)}</span>' if more else ""
    return (
        f'<tr><th scope="row">{prose(p.name)}</th>'
        f'<td><span class="badge {escape(p.verdict)}">{SIGNS.get(p.verdict, "?")} '
        f"{escape(p.verdict)}</span></td><td>{prose(p.meaning)}{detail}</td>"
        f"<td{data_head('method')}>{prose(p.method)}</td>"
        f'<td class="number"{data_head("time / s")}>{p.seconds:.2f}</td></tr>'
    )


def _lines(title: str, lines: tuple[str, ...]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{prose(text)}</li>" for text in lines)
    return f'<h3>{escape(title)}</h3><ul class="lines">{items}</ul>'


def _times(m: ModuleProof) -> str:
    rows = "".join(
        f'<tr><th scope="row">{prose(symbol)}</th><td>{prose(meaning)}</td>'
        f'<td class="number">{escape(value)}</td></tr>'
        for symbol, meaning, value in m.times
    )
    return f"<div><h3>Times</h3><table class='events'><tbody>{rows}</tbody></table></div>"


def _shares(m: ModuleProof) -> str:
    if not m.shares:
        return ""
    rows = "".join(
        f'<tr><td>{prose(what)}</td><td class="number">{escape(share)}</td></tr>'
        for what, share in m.shares
    )
    return (
        "<div><h3>How much the sets hold</h3><table class='events'><tbody>"
        f"{rows}</tbody></table></div>"
    )


def _leaving(m: ModuleProof) -> str:
    """The run of the model that leaves C soonest, drawn."""
    if not m.leaving:
        return ""
    drawn = "".join(_figure(f) for f in m.leaving)
    return (
        "<h3>The run of the model that leaves soonest</h3>"
        f'<p class="note">{prose(m.leaving_text)}</p><ul class="key">'
        '<li><i class="region r1"></i><span>outside the constraint C</span></li>'
        '<li><i class="region r2"></i><span>inside C</span></li></ul>'
        f'<div class="figures">{drawn}</div>'
    )


def _figure(f: RegionFigure) -> str:
    note = f'<p class="note">{prose(f.note)}</p>' if f.note else ""
    return (
        f"<figure><figcaption>{prose(f.title)}</figcaption>{region_svg(f)}{_slider(f)}{note}"
        "</figure>"
    )


def _slider(f: RegionFigure) -> str:
    """Where the figure is cut, and what the script moves that with."""
    if not f.slices:
        return ""
    return (
        f'<p class="slices"><output>{escape(f.slices[f.shown].where)}</output>'
        f'<input type="range" min="0" max="{len(f.slices) - 1}" value="{f.shown}" hidden '
        f'aria-label="{escape(f.across)}"></p>'
    )


def _figures(m: ModuleProof) -> str:
    if not m.figures:
        return ""
    key = "".join(
        f'<li><i class="region {code}"></i><span><strong>{name}</strong> '
        f"{prose(text + (SWITCHED if text == KEEPS and m.switches else ''))}</span></li>"
        for code, name, text in REGIONS
    )
    if any(f.lets_ac is not None for f in m.figures):
        key += (
            '<li><i class="stroke border"></i><span>border of <code>ttf</code>: on the side of R5 '
            "the DM leaves AC in control</span></li>"
        )
    drawn = "".join(_figure(f) for f in m.figures if _of_one_region(f) is None)
    return (
        f'<h3>Regions of operation</h3><ul class="key">{key}</ul><div class="figures">{drawn}</div>'
        f"{_undrawn(m.figures)}"
    )


def _of_one_region(f: RegionFigure) -> int | None:
    """The region that a single axis lies in from end to end: nothing of it need be drawn."""
    if f.y_name or f.slices or f.trajectory is not None:
        return None
    if f.lets_ac is not None and f.lets_ac.any() and not f.lets_ac.all():
        return None
    first = int(f.regions.flat[0])
    return first if (f.regions == first).all() else None


def _undrawn(figures: tuple[RegionFigure, ...]) -> str:
    """The axes that lie in one region, in a sentence for each region and note."""
    axes: dict[tuple[int, str], list[str]] = {}
    for f in figures:
        region = _of_one_region(f)
        if region is not None:
            unit = f" {f.x_unit}" if f.x_unit else ""
            ends = f"{f.x_edges[0]:.4g}, {f.x_edges[-1]:.4g}".replace("-", "\N{MINUS SIGN}")
            axes.setdefault((region, f.note), []).append(f"{f.x_name} in [{ends}]{unit}")
    return "".join(
        f'<p class="note">{REGIONS[region - 1][1]} from end to end, so without a figure'
        f"{f' ({prose(note)})' if note else ''}: {prose('; '.join(names))}.</p>"
        for (region, note), names in axes.items()
    )


def _list(title: str, texts: tuple[str, ...], kind: str) -> str:
    if not texts:
        return ""
    items = "".join(f"<li>{prose(text)}</li>" for text in texts)
    return f'<section class="{kind}"><h2>{escape(title)}</h2><ul>{items}</ul></section>'


def _provenance(page: ProofPage) -> str:
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in page.provenance.items()
    )
    return f'<section class="provenance"><h2>Provenance</h2><dl>{items}</dl></section>'
