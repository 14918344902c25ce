"""The page of a campaign, from its results.

Purpose: results -> `report/campaign.py`: headline, modules, arms, faults, measures, assumptions.
Non-goals: the page's looks.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.campaign import tables
from soter.campaign.words import interval
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.report.campaign import CampaignPage, Histogram, Section, campaign_main
from soter.report.errors import ReportError
from soter.report.html import write_document

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.campaign.result import Measured
    from soter.campaign.tables import CampaignLike

SAVE = (
    "A save is a disengagement after which a copy of the state, flown on with only this module's "
    "decision module off and the same draws, violates a property within the horizon; any other is "
    "a precaution. Disengagements of a module within 2 s are one episode, judged at its first."
)
RESTS_ON = (
    "Virtual time: every step takes none, unless the program or a fault says otherwise.",
    "The plants of the program are the world: what they do not model is not flown.",
    "Whether a module is proved is not asked here: `soter verify` says.",
    "Rates are of independent flights; intervals are exact (Poisson, binomial), 95 %.",
    SAVE,
)


def write_page(found: CampaignLike, program: str, path: Path) -> Path:
    """Write the page; SoterError D006 where it cannot be written."""
    made = page_of(found, program)
    try:
        return write_document(made.title, campaign_main(made), path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


def page_of(found: CampaignLike, program: str) -> CampaignPage:
    """The page as data."""
    r = found.result
    hours = r.hours if r.hours_aloft is None else r.hours_aloft
    way = "" if r.km is None else f", {r.km:,.0f} km"
    headline = f"{r.violations} violations in {hours:,.1f} h{way}"
    return CampaignPage(
        title=f"{Path(program).name}: {found.system}, {r.flights:,} flights",
        headline=headline,
        verdict="bad" if r.violations else "good",
        sections=tuple(_sections(found, Path(program).name)),
        histograms=tuple(_histogram(m) for m in r.measures),
    )


def _sections(found: CampaignLike, program: str) -> Iterator[Section]:
    r = found.result
    rates = f"Violations an hour, 95 %: {interval(*r.per_hour)}"
    system = f"--system {found.system} --until {found.until_s:g}s --seed {found.first_seed}"
    says = [
        f"{r.hours:,.2f} h in {r.flights:,} flights of {found.until_s:g} s.",
        f"Again: soter campaign {program} {system} --flights {r.flights}",
        f"Flight K of it, looked at: soter run {program} {system} --flight K --report"
        + (" (of an arm: --arm NAME)" if found.arms else ""),
        f"{rates}; violated flights, 95 %: {interval(*r.per_flight)}.",
    ]
    if found.forced:
        says.append(f"Forced, so that nothing protects them: {', '.join(found.forced)}.")
    if r.violations and found.faults:
        says.append(f"Violated and met no fault outside before: {r.violated_inside} flights.")
    says.append(f"Program {found.program_sha256}; digest of all flights {r.digest}.")
    yield Section("What was flown", tuple(says), *tables.broken(found))
    control = []
    if len(r.modules) > 1:
        control.append(f"All modules in AC at once: {r.ac_share:.2%} of the time.")
    if found.horizon_s > 0:
        control.append(f"Saves are counted with a horizon of {found.horizon_s:g} s.")
    late = (f"Lateness of the arm `paper`: {found.lateness}",) if found.lateness else ()
    for title, texts, (head, rows) in (
        ("The first violated flights", (), tables.worst(found)),
        ("Who was in control", tuple(control), tables.modules(found)),
        ("The same seeds by other rules", late, tables.arms(found)),
        ("What was declared to go wrong", (), tables.faults(found)),
    ):
        if rows:
            yield Section(title, texts, head, rows)
    yield Section("What this rests on", RESTS_ON)


def _histogram(m: Measured) -> Histogram:
    caption = f"mean {m.mean:.4g}, least {m.least:.4g}, most {m.most:.4g}"
    outside = m.bins[0] + m.bins[-1]
    if outside:
        caption += f"; {outside:,} looks beyond the range (faint)"
    return Histogram(m.name, caption, m.edges, m.bins)
