"""The page of a campaign, from its results.

Purpose: results -> `report/campaign.py`: headline, modules, arms, faults, measures, assumptions.
Non-goals: the page's looks.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.campaign import tables
from soter.campaign.statistics import FLIGHTS
from soter.campaign.wording import an_hour, guilt, interval, verdict
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.report.campaign import CampaignPage, Histogram, campaign_main
from soter.report.errors import ReportError
from soter.report.html import write_document
from soter.report.sections import PageSection

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.campaign.result import MetricResult, Result
    from soter.campaign.tables import CampaignLike

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


def write_page(campaign: CampaignLike, program: str, path: Path) -> Path:
    """Write the page; SoterError D006 where it cannot be written."""
    made = page_of(campaign, program)
    try:
        return write_document(made.title, campaign_main(made), path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


def page_of(campaign: CampaignLike, program: str) -> CampaignPage:
    """The page as data."""
    r = campaign.result
    way = "" if r.km is None else f", {r.km:,.0f} km"
    aloft = "" if r.hours_aloft is None else " aloft"
    headline = f"{verdict(r)} in {r.rate_hours:,.1f} h{aloft}{way}"
    return CampaignPage(
        title=f"{Path(program).name}: {campaign.system}, {r.flights:,} flights",
        headline=headline,
        verdict="bad" if r.violations else "good" if r.properties else "",
        sections=tuple(_sections(campaign, Path(program).name)),
        histograms=tuple(_histogram(m) for m in r.measures),
    )


def _sections(campaign: CampaignLike, program: str) -> Iterator[PageSection]:
    r = campaign.result
    system = (
        f"--system {campaign.system} --until {campaign.until_s:g}s --seed {campaign.first_seed}"
    )
    says = [
        f"{r.hours:,.2f} h in {r.flights:,} flights of {campaign.until_s:g} s.",
        f"Again: soter campaign {program} {system} --flights {r.flights}",
        f"Flight K of it, looked at: soter run {program} {system} --flight K --report"
        + (" (of an arm: --arm NAME)" if campaign.arms else ""),
        *_bounds(r),
    ]
    if campaign.forced:
        says.append(f"Forced, so that nothing protects them: {', '.join(campaign.forced)}.")
    if r.violations and campaign.faults:
        says.append(f"{guilt(r)}.")
    says.append(f"Program {campaign.program_sha256}; digest of all flights {r.digest}.")
    yield PageSection("What was flown", tuple(says), *tables.broken(campaign))
    control = []
    if len(r.modules) > 1:
        control.append(f"All modules in AC at once: {r.ac_share:.2%} of the time.")
    if campaign.horizon_s > 0:
        control.append(f"Saves are counted with a horizon of {campaign.horizon_s:g} s.")
    late = (f"Lateness of the arm `paper`: {campaign.lateness}",) if campaign.lateness else ()
    for title, texts, (head, rows) in (
        ("The first violated flights", (), tables.worst(campaign)),
        ("Who was in control", tuple(control), tables.modules(campaign)),
        ("The same seeds by other rules", late, tables.arms(campaign)),
        ("What was declared to go wrong", (), tables.faults(campaign)),
    ):
        if rows:
            yield PageSection(title, texts, head, rows)
    yield PageSection("What this rests on", RESTS_ON)


def _bounds(r: Result) -> Iterator[str]:
    if r.properties:
        by = " by flight" if r.per_hour_basis == FLIGHTS else ""
        yield (
            f"Violations {an_hour(r)}, 95 %: {interval(*r.per_hour)}{by}; violated flights, "
            f"95 %: {interval(*r.per_flight)}."
        )
    if r.distinct < r.flights:
        yield f"{r.flights - r.distinct:,} of the flights are copies of others."


def _histogram(m: MetricResult) -> Histogram:
    caption = f"mean {m.mean:.4g}, least {m.least:.4g}, most {m.most:.4g}"
    outside = m.bins[0] + m.bins[-1]
    if outside:
        caption += f"; {outside:,} looks beyond the range (faint)"
    return Histogram(m.name, caption, m.edges, m.bins)
