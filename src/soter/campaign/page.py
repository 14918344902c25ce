"""Makes the page of a campaign: what was flown and what happened, in tables and histograms.

Purpose: `write_page` turns results into one HTML file without scripts: headline, modules, arms,
faults, measures, assumptions; bars and histograms are SVG.
Non-goals: computing the results (`result.py`), their wording (`tables.py`).
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from soter.campaign import tables
from soter.campaign.statistics import FLIGHTS
from soter.campaign.tables import faults_text, interval_text, quoted_names, rate_unit, verdict_text
from soter.report.html import write_document
from soter.report.templates import PageSection, filled
from soter.report.wording import quantity

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.campaign.result import Campaign, MetricResult, Result


WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 520, 240, 74, 44, 12, 12
SIDE, ROW = 22, 46


@dataclass(frozen=True)
class Histogram:
    """The histogram of a measure: `edges` (n + 1,); `bins` (n + 2,) with those below and above."""

    name: str
    caption: str
    edges: tuple[float, ...]
    bins: tuple[int, ...]
    x_name: str = ""
    counted: str = "looks"
    """The noun for what the bins count."""
    of_ints: bool = False
    """Whether bins count whole numbers: the label, a bin's lower edge, is below its middle."""


@dataclass(frozen=True)
class Bars:
    """Shares as bars: each of `rows` has a name, a share (0..1) and the share as text.

    `kind`: "ac" for time in which AC has control, "bad" for shares that should be 0.
    """

    name: str
    caption: str
    rows: tuple[tuple[str, float, str], ...]
    kind: str = ""


@dataclass(frozen=True)
class CampaignPage:
    """The content of a campaign's page; `verdict` ("good" or "bad") colours the headline."""

    title: str
    headline: str
    verdict: str
    sections: tuple[PageSection, ...]
    histograms: tuple[Histogram, ...]
    charts: tuple[Bars | Histogram, ...] = ()
    """The drawings of what happened in the flights."""


def page_body(page: CampaignPage) -> str:
    """The HTML of the page's body."""
    return filled("campaign/page.html.j2", **vars(page), bars=_bar_chart, histogram=_histogram)


def _bar_chart(chart: Bars) -> Iterator[str]:
    """Yields the SVG of bars; names stand above the bars, as they may be long."""
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
    """Yields the SVG of a histogram; its outer bars count values below and above the range."""
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
        yield f"<title>{_bin_text(h, k)}: {count:,} {escape(h.counted)}</title></rect>"
    bins = len(h.bins) - 2
    for k in range(0, bins + (not h.of_ints), max(1, bins // 10)):
        x = LEFT + (k + 1 + h.of_ints / 2) * step
        yield f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">'
        yield f"{h.edges[k]:.4g}</text>"
    middle = (LEFT + WIDTH - RIGHT) / 2
    at = f'x="{middle:g}" y="{HEIGHT - 4}" text-anchor="middle"'
    yield f'<text class="name" {at}>{escape(h.x_name)}</text></svg>'


def _bin_text(h: Histogram, k: int) -> str:
    if k == 0:
        return f"below {h.edges[0]:g}"
    if k == len(h.bins) - 1:
        return f"above {h.edges[-1]:g}"
    if h.of_ints and h.edges[k] - h.edges[k - 1] == 1:
        return f"{h.edges[k - 1]:g}"
    return f"{h.edges[k - 1]:g} to {h.edges[k] - h.of_ints:g}"


COUNTS_MAX = 40
"""Bars of a histogram of counts."""
SAVE = (
    "A save is a disengagement after which a copy of the state, flown on with only this module's "
    "decision module off and the same draws, violates a property within the horizon; any other is "
    "a precaution. Disengagements of a module within 2 s are one episode, judged at its first."
)
SPREAD = (
    "Intervals are 95 %. Of rates: exact (Garwood) where the counts of the flights pass the "
    "dispersion test of Poisson's distribution or there are none, else by flight (betting, "
    "Waudby-Smith and Ramdas), which takes no distribution for granted. Of shares: Clopper and "
    "Pearson."
)
RESTS_ON = (
    "Virtual time: every step takes none, unless the program or a fault says otherwise.",
    "The plants of the program are the world: what they do not model is not flown.",
    "Whether a module is proved is not asked here: `soter verify` says.",
    "Seeds make independent flights; copies of a flight make no bound closer.",
    SPREAD,
    SAVE,
)


def write_page(campaign: Campaign, program: str, path: Path) -> Path:
    """Writes the page and returns its path. Raises SoterError D006 if it cannot be written."""
    made = make_page(campaign, program)
    return write_document(made.title, page_body(made), path)


def make_page(campaign: Campaign, program: str) -> CampaignPage:
    """The content of a campaign's page."""
    r = campaign.result
    way = "" if r.km is None else f", {r.km:,.0f} km"
    aloft = "" if r.hours_aloft is None else " aloft"
    headline = f"{verdict_text(r)} in {r.rate_hours:,.2f} h{aloft}{way}"
    return CampaignPage(
        title=f"{Path(program).name}: {campaign.system}, {r.flights:,} flights",
        headline=headline,
        verdict="bad" if r.violations else "good" if r.properties else "",
        sections=tuple(_page_sections(campaign, program)),
        charts=tuple(_charts(campaign)),
        histograms=tuple(_measure_histogram(m) for m in r.measures),
    )


def _page_sections(campaign: Campaign, program: str) -> Iterator[PageSection]:
    r = campaign.result
    says = [
        f"{r.hours:,.2f} h in {r.flights:,} flights of {campaign.until_s:g} s.",
        *_bound_texts(r),
    ]
    if campaign.forced:
        says.append(f"Forced, so that nothing protects them: {', '.join(campaign.forced)}.")
    if r.violations and campaign.faults:
        says.append(f"{faults_text(r)}.")
    if campaign.properties:
        says.insert(1, f"A violation is one of {quoted_names(campaign.properties)}.")
    says.append(f"Program {campaign.program_sha256}; digest of all flights {r.digest}.")
    yield PageSection("What was flown", tuple(says), *tables.violations_table(campaign))
    control = []
    if len(r.modules) > 1:
        control.append(f"All modules in AC at once: {r.ac_share:.2%} of the time.")
    if campaign.horizon_s > 0:
        control.append(f"Saves are counted with a horizon of {campaign.horizon_s:g} s.")
    late = (f"Lateness of the arm `paper`: {campaign.lateness}",) if campaign.lateness else ()
    for title, texts, (head, rows) in (
        ("The first violated flights", (), tables.worst_flights_table(campaign)),
        ("Who was in control", tuple(control), tables.modules_table(campaign)),
        ("The same seeds by other rules", late, tables.arms_table(campaign)),
        ("What was declared to go wrong", (), tables.faults_table(campaign)),
    ):
        if rows:
            yield PageSection(title, texts, head, rows)
    yield PageSection("What this rests on", RESTS_ON)
    yield PageSection("Again", tuple(_commands_again(campaign, program)))


def _commands_again(campaign: Campaign, program: str) -> Iterator[str]:
    """Yields the commands that fly the campaign again, with all options that were set."""
    flown = ["--system", campaign.system, "--until", f"{campaign.until_s:.15g}s"]
    flown += ["--seed", f"{campaign.first_seed}"]
    for name, value in campaign.params.items():
        flown += ["--set", f"{name}={value}"]
    asked = ["--flights", f"{campaign.result.flights}"]
    asked += ["--arms", ",".join(campaign.asked_arms)] if campaign.asked_arms else []
    asked += ["--saves", f"{campaign.horizon_s:.15g}s"] if campaign.horizon_s > 0 else []
    yield f"`{shlex.join(['soter', 'campaign', program, *flown, *asked, '--report'])}`"
    looked = shlex.join(["soter", "run", program, *flown, "--flight", "K", "--report"])
    arm = "; of an arm: `--arm NAME`" if campaign.asked_arms else ""
    yield f"Flight K of it, looked at{arm}: `{looked}`"


def _charts(campaign: Campaign) -> Iterator[Bars | Histogram]:
    """Yields the charts: who had control, how often that changed, and the arms in comparison."""
    r, flights = campaign.result, campaign.flights
    several = len(r.modules) > 1
    rows = [(m.name, m.ac_share, f"{m.ac_share:.2%}") for m in r.modules]
    rows += [("all at once", r.ac_share, f"{r.ac_share:.2%}")] if several else []
    if rows:
        yield Bars("AC in control", "share of the time of all flights", tuple(rows), "ac")
    for k, m in enumerate(r.modules):
        counts = [f.disengagements[k] for f in flights]
        if m.disengagements:
            yield _count_bars(f"Takeovers a flight, {m.name}", counts)
    if campaign.arms:
        yield Bars(
            "Flights violated, by arm",
            "share of the same seeds",
            tuple(
                (
                    a.name,
                    a.result.flights_violated / (a.result.flights or 1),
                    f"{a.result.flights_violated:,} of {a.result.flights:,}",
                )
                for a in campaign.arms
            ),
            "bad",
        )


def _count_bars(name: str, counts: Sequence[int]) -> Histogram:
    """The histogram of a count over all flights; a bar covers several counts if needed."""
    wide = max(counts) // COUNTS_MAX + 1
    bins = [0] * (max(counts) // wide + 1)
    for count in counts:
        bins[count // wide] += 1
    caption = f"mean {sum(counts) / len(counts):.4g}, least {min(counts)}, most {max(counts)}"
    caption += f"; share of the {len(counts):,} flights"
    edges = tuple(float(k * wide) for k in range(len(bins) + 1))
    return Histogram(name, caption, edges, (0, *bins, 0), "takeovers", "flights", of_ints=True)


def _bound_texts(r: Result) -> Iterator[str]:
    if r.properties:
        by = " (by flight)" if r.per_hour_basis == FLIGHTS else ""
        low, high = r.per_flight
        yield (
            f"With 95 % confidence {interval_text(*r.per_hour)} violations {rate_unit(r)}{by}, and "
            f"{interval_text(100.0 * low, 100.0 * high)} % of flights violated."
        )
    if r.distinct < r.flights:
        yield f"{r.flights - r.distinct:,} of the flights are copies of others."


def _measure_histogram(m: MetricResult) -> Histogram:
    unit = f" {m.unit}" if m.unit else ""
    caption = f"mean {m.mean:.4g}{unit}, least {m.least:.4g}{unit}, most {m.most:.4g}{unit}"
    caption += f"; share of {sum(m.bins):,} looks"
    outside = m.bins[0] + m.bins[-1]
    if outside:
        caption += f"; {outside:,} looks beyond the range (faint)"
    return Histogram(m.name, caption, m.edges, m.bins, quantity(m.name, m.unit), "looks")
