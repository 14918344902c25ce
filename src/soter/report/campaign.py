"""The page of a campaign: what was flown, what happened, in tables and histograms.

Purpose: one HTML file without scripts; bars and histograms are SVG.
Non-goals: computing any of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from soter.report.templates import filled

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.report.plain_page import PageSection

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 520, 240, 74, 44, 12, 12
SIDE, ROW = 22, 46


@dataclass(frozen=True)
class Histogram:
    """A measure: `edges` (n + 1,) of the range, `bins` (n + 2,) with below and above it."""

    name: str
    caption: str
    edges: tuple[float, ...]
    bins: tuple[int, ...]
    x_name: str = ""
    of: str = "looks"
    """What is counted."""
    whole: bool = False
    """Each bin is of whole numbers from its lower edge on, which stands below its middle."""


@dataclass(frozen=True)
class Bars:
    """Shares side by side: each of `rows` has a name, a share (0..1) and that as a text.

    `kind`: "ac" for time in which AC has control, "bad" for what is to be none.
    """

    name: str
    caption: str
    rows: tuple[tuple[str, float, str], ...]
    kind: str = ""


@dataclass(frozen=True)
class CampaignPage:
    """`verdict`: "good" or "bad", how the headline is coloured."""

    title: str
    headline: str
    verdict: str
    sections: tuple[PageSection, ...]
    histograms: tuple[Histogram, ...]
    charts: tuple[Bars | Histogram, ...] = ()
    """What happened; `histograms`: what was measured."""


def campaign_main(page: CampaignPage) -> str:
    """The body of the page."""
    return filled("report/campaign.html.j2", **vars(page), bars=_bars, histogram=_histogram)


def _bars(chart: Bars) -> Iterator[str]:
    """A bar a row, its name above it: names are as long as they are."""
    height = ROW * len(chart.rows) + BOTTOM
    depth = WIDTH - 2 * SIDE
    yield f'<svg class="chart {chart.kind}" viewBox="0 0 {WIDTH} {height}" role="img">'
    yield f"<title>{escape(chart.name)}: {escape(chart.caption)}</title>"
    for k in range(5):
        x = SIDE + depth * k / 4
        yield f'<path class="grid" d="M{x:g} 0V{height - BOTTOM}"/>'
        yield f'<text x="{x:g}" y="{height - 10}" text-anchor="middle">{k / 4:.0%}</text>'
    for k, (name, share, text) in enumerate(chart.rows):
        y = k * ROW
        yield f'<text x="{SIDE}" y="{y + 18}">{escape(name)}</text>'
        yield f'<text x="{WIDTH - SIDE}" y="{y + 18}" text-anchor="end">{escape(text)}</text>'
        yield f'<rect x="{SIDE}" y="{y + 26}" width="{depth * share:.2f}" height="14"/>'
    yield "</svg>"


def _histogram(h: Histogram) -> Iterator[str]:
    """Bars of the shares of all looks; the outer two, hatched by their labels, lie beyond."""
    total = sum(h.bins) or 1
    most = max(h.bins) / total or 1.0
    step = (WIDTH - LEFT - RIGHT) / len(h.bins)
    depth = HEIGHT - TOP - BOTTOM
    yield f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">'
    yield f"<title>{escape(h.name)}: {escape(h.caption)}</title>"
    for k in range(5):
        y = HEIGHT - BOTTOM - depth * k / 4
        yield f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>'
        yield f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{most * k * 25:.3g} %</text>'
    for k, count in enumerate(h.bins):
        tall = depth * (count / total) / most
        x = LEFT + k * step
        faint = ' fill-opacity="0.4"' if k in (0, len(h.bins) - 1) else ""
        yield f'<rect x="{x:.2f}" y="{HEIGHT - BOTTOM - tall:.2f}" width="{step * 0.92:.2f}" '
        yield f'height="{tall:.2f}"{faint}>'
        yield f"<title>{_bin(h, k)}: {count:,} {escape(h.of)}</title></rect>"
    bins = len(h.bins) - 2
    for k in range(0, bins + (not h.whole), max(1, bins // 10)):
        x = LEFT + (k + 1 + h.whole / 2) * step
        yield f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">'
        yield f"{h.edges[k]:.4g}</text>"
    middle = (LEFT + WIDTH - RIGHT) / 2
    at = f'x="{middle:g}" y="{HEIGHT - 4}" text-anchor="middle"'
    yield f'<text class="name" {at}>{escape(h.x_name)}</text></svg>'


def _bin(h: Histogram, k: int) -> str:
    if k == 0:
        return f"below {h.edges[0]:g}"
    if k == len(h.bins) - 1:
        return f"above {h.edges[-1]:g}"
    if h.whole and h.edges[k] - h.edges[k - 1] == 1:
        return f"{h.edges[k - 1]:g}"
    return f"{h.edges[k - 1]:g} to {h.edges[k] - h.whole:g}"
