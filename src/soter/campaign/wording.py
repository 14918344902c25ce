"""Words of campaigns for people.

Purpose: lists, intervals of rates, the verdict and whose fault it is.
Non-goals: figures (`result.py`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from soter.campaign.statistics import FLIGHTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.campaign.result import Result


def listed(names: Sequence[str]) -> str:
    """`a`, `b`, `c`."""
    return ", ".join(f"`{n}`" for n in names)


def interval(low: float, high: float) -> str:
    """What a rate or a share lies in."""
    if high == inf:
        return "any number"
    if low == 0.0:
        return f"less than {high:.3g}"
    return f"{low:.3g} to {high:.3g}"


def an_hour(r: Result) -> str:
    """Per which hour rates are."""
    return "an hour" if r.hours_aloft is None else "an hour aloft"


def verdict(r: Result) -> str:
    """What was violated; that nothing was judged, where nothing was."""
    if not r.properties and not r.violations:
        return "nothing was judged: the system has no property"
    return f"{r.violations:,} violations"


def bound(r: Result) -> str:
    """What is said of all flights with 95 % confidence; "" where nothing was judged."""
    if not r.properties:
        return ""
    hourly = f"{interval(*r.per_hour)} {an_hour(r)}"
    if r.per_hour_basis == FLIGHTS:
        low, high = r.per_flight
        share = interval(100.0 * low, 100.0 * high)
        return f"{share} % of the flights are violated, {hourly} by flight"
    return hourly


def guilt(r: Result) -> str:
    """Whose fault violated flights are, in a system with faults."""
    out = r.flights_violated - r.violated_inside
    return (
        f"{r.flights_violated:,} flights violated: {out:,} of them are clean when they are flown "
        f"again without the faults that are outside of what proofs assume, {r.violated_inside:,} "
        "met none before or are violated without them, too"
    )
