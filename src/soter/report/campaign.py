"""The page of a campaign: what was flown, what happened, in tables and histograms.

Purpose: one HTML file without scripts; the histograms are SVG.
Non-goals: computing any of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from soter.report.sections import sections_main

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.report.sections import PageSection

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 720, 220, 64, 36, 12, 12
FILL = "#3465a4"


@dataclass(frozen=True)
class Histogram:
    """A measure: `edges` (n + 1,) of the range, `bins` (n + 2,) with below and above it."""

    name: str
    caption: str
    edges: tuple[float, ...]
    bins: tuple[int, ...]


@dataclass(frozen=True)
class CampaignPage:
    """`verdict`: "good" or "bad", how the headline is coloured."""

    title: str
    headline: str
    verdict: str
    sections: tuple[PageSection, ...]
    histograms: tuple[Histogram, ...]


def campaign_main(page: CampaignPage) -> str:
    """The body of the page."""
    parts = list(sections_main(page.title, page.headline, page.verdict, page.sections))
    if page.histograms:
        parts.append('<h2 style="margin-top: 2rem">What was measured</h2>')
    for h in page.histograms:
        parts += [f"<h3>{escape(h.name)}</h3><figure>", *_histogram(h)]
        parts.append(f"<figcaption>{escape(h.caption)}</figcaption></figure>")
    return "\n".join(parts)


def _histogram(h: Histogram) -> Iterator[str]:
    """Bars of the shares of all looks; the outer two, hatched by their labels, lie beyond."""
    total = sum(h.bins) or 1
    most = max(h.bins) / total or 1.0
    step = (WIDTH - LEFT - RIGHT) / len(h.bins)
    depth = HEIGHT - TOP - BOTTOM
    yield f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" font-size="12" fill="currentColor">'
    yield f"<title>{escape(h.name)}: {escape(h.caption)}</title>"
    for k in range(5):
        y = HEIGHT - BOTTOM - depth * k / 4
        yield f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" '
        yield 'stroke="currentColor" stroke-opacity="0.2"/>'
        yield f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{most * k / 4:.2%}</text>'
    for k, count in enumerate(h.bins):
        tall = depth * (count / total) / most
        x = LEFT + k * step
        faint = ' fill-opacity="0.4"' if k in (0, len(h.bins) - 1) else ""
        yield f'<rect x="{x:.2f}" y="{HEIGHT - BOTTOM - tall:.2f}" width="{step * 0.92:.2f}" '
        yield f'height="{tall:.2f}" fill="{FILL}"{faint}>'
        yield f"<title>{_bin(h, k)}: {count}</title></rect>"
    bins = len(h.bins) - 2
    for k in range(0, bins + 1, max(1, bins // 10)):
        x = LEFT + (k + 1) * step
        yield f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">'
        yield f"{h.edges[k]:.3g}</text>"
    yield "</svg>"


def _bin(h: Histogram, k: int) -> str:
    if k == 0:
        return f"below {h.edges[0]:g}"
    if k == len(h.bins) - 1:
        return f"above {h.edges[-1]:g}"
    return f"{h.edges[k - 1]:g} to {h.edges[k]:g}"
