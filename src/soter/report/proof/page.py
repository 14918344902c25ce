"""The proof report: one page that a safety engineer can file.

Purpose: verdict, properties with their method, times, vacuity figures, the region figure, what it
rests on, hashes; in the order in which it is questioned.
Non-goals: verifying; deciding what to show.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from soter.report.html import document, write_text
from soter.report.plain_page import data_head
from soter.report.proof.regions import region_svg
from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from soter.report.proof.record import ModuleProof, ProofPage, PropertyRow, RegionFigure

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
