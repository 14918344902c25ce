"""The results of a campaign in words and tables, for terminals and pages.

Purpose: head and rows of each table, without rows where there is nothing to say; lists, intervals
of rates, the verdict, and which faults explain violations.
Non-goals: figures (`result.py`), layout.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from soter.campaign.statistics import FLIGHTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.campaign.result import Campaign, ModuleStatistics, Result

    Row = tuple[str, ...]
    Table = tuple[Row, tuple[Row, ...]]


def quoted_names(names: Sequence[str]) -> str:
    """The names in backquotes, with commas between them."""
    return ", ".join(f"`{n}`" for n in names)


def interval_text(low: float, high: float) -> str:
    """The interval of a rate or share, as text."""
    if high == inf:
        return "any number"
    if low == 0.0:
        return f"less than {high:.3g}"
    return f"{low:.3g} to {high:.3g}"


def rate_unit(r: Result) -> str:
    """The unit of the rates: an hour, or an hour aloft."""
    return "an hour" if r.hours_aloft is None else "an hour aloft"


def verdict_text(r: Result) -> str:
    """The number of violations as text, or a note that nothing was judged."""
    if not r.properties and not r.violations:
        return "nothing was judged: the system has no property"
    return f"{r.violations:,} violations"


def bound_text(r: Result) -> str:
    """The bound on the violation rate with 95 % confidence, as text; "" if nothing was judged."""
    if not r.properties:
        return ""
    hourly = f"{interval_text(*r.per_hour)} {rate_unit(r)}"
    if r.per_hour_basis == FLIGHTS:
        low, high = r.per_flight
        share = interval_text(100.0 * low, 100.0 * high)
        return f"{share} % of the flights are violated, {hourly} by flight"
    return hourly


def faults_text(r: Result) -> str:
    """A sentence on how many violated flights are clean without faults outside the assumptions."""
    out = r.flights_violated - r.violated_inside
    return (
        f"{r.flights_violated:,} flights violated: {out:,} of them are clean when they are flown "
        f"again without the faults that are outside of what proofs assume, {r.violated_inside:,} "
        "met none before or are violated without them, too"
    )


def violations_table(campaign: Campaign) -> Table:
    """The table of violated properties with their numbers of violations."""
    return ("times", "violated"), tuple((f"{n:,}", text) for text, n in campaign.result.broken)


def worst_flights_table(campaign: Campaign) -> Table:
    """The table of the first violated flights."""
    rows = tuple(
        (
            f"{f.number}",
            f"{f.seed}",
            f"{f.first_s or 0.0:.3f}",
            "; ".join(f.broken),
            "; ".join(blame.met),
            {None: "not flown", True: "clean", False: "violated"}[blame.clean_without],
        )
        for f, blame in zip(campaign.result.worst, campaign.result.blames, strict=True)
    )
    head = ("flight", "seed", "at s", "what", "faults outside before", "without them")
    return head, rows


def modules_table(campaign: Campaign) -> Table:
    """The table of modules, with how long AC had control and how often it lost control."""
    saves = campaign.horizon_s > 0
    hourly = f"episodes {rate_unit(campaign.result)}, 95 %"
    head = ("module", "AC share", "takeovers", "episodes", hourly, "gate faults")
    more = ("saves", "precautions") if saves else ()
    return (*head, *more), tuple(_module_row(m, saves=saves) for m in campaign.result.modules)


def _module_row(m: ModuleStatistics, *, saves: bool) -> Row:
    row = (m.name, f"{m.ac_share:.2%}", f"{m.disengagements:,}", f"{m.episodes:,}")
    more = (f"{m.saves:,}", f"{m.precautions:,}") if saves else ()
    often = interval_text(*m.per_hour) + (" by flight" if m.basis == FLIGHTS else "")
    return (*row, often, f"{m.gate_faults:,}", *more)


def measures_table(campaign: Campaign) -> Table:
    """The table of measures."""
    rows = tuple(
        (m.name, f"{m.mean:.4g}", f"{m.least:.4g}", f"{m.most:.4g}")
        for m in campaign.result.measures
    )
    return ("measure", "mean", "least", "most"), rows


def arms_table(campaign: Campaign) -> Table:
    """The table of arms, which are the same seeds under other rules."""
    rows = tuple(
        (
            a.name,
            f"{a.result.flights_violated:,}",
            f"{a.result.violations:,}",
            f"{a.result.ac_share:.2%}",
            a.text,
        )
        for a in campaign.arms
    )
    return ("arm", "flights violated", "violations", "all in AC", "what is different"), rows


def faults_table(campaign: Campaign) -> Table:
    """The table of declared faults, with the number of violated flights that each excuses."""
    excused = {text: f"{n:,} of {met:,} that met it" for text, n, met in campaign.result.excused}
    rows = tuple(
        (_times(campaign.occurred[t]), t, f"inside: {w}" if w else "outside", excused.get(t, ""))
        for t, w in campaign.faults
    )
    head = ("times", "fault", "of what proofs assume", "violated flights, clean without it alone")
    return (head, rows) if excused else (head[:3], tuple(row[:3] for row in rows))


def _times(count: int | None) -> str:
    return "always" if count is None else f"{count:,}"
