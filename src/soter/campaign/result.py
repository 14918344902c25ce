"""What a campaign says: totals, shares, episodes, bounds.

Purpose: `Result`, from flights to figures, with exact intervals.
Non-goals: printing, files.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.campaign.statistics import rate, share
from soter.campaign.store import digest_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.campaign.fleet import Flight


@dataclass(frozen=True)
class Module:
    """One module over all flights. Rates per hour, with 95 % intervals."""

    name: str
    ac_share: float
    disengagements: int
    episodes: int
    per_hour: tuple[float, float]
    gate_faults: int


@dataclass(frozen=True)
class Result:
    """All flights together. `per_hour`: what the rate of violations lies in; 95 %."""

    flights: int
    hours: float
    violations: int
    per_hour: tuple[float, float]
    flights_violated: int
    per_flight: tuple[float, float]
    ac_share: float
    modules: tuple[Module, ...]
    broken: tuple[tuple[str, int], ...]
    worst: tuple[Flight, ...]
    digest: str


def result_of(flights: Sequence[Flight], modules: Sequence[str]) -> Result:
    """The figures of these flights. Of none: zeros, and intervals that say nothing."""
    hours = sum(f.seconds for f in flights) / 3600.0
    seconds = max(3600.0 * hours, 1e-9)
    told = Counter(what for f in flights for what in f.broken)
    bad = [f for f in flights if f.violations]
    violations = sum(f.violations for f in flights)
    each = []
    for k, name in enumerate(modules):
        episodes = sum(f.episodes[k] for f in flights)
        each.append(
            Module(
                name,
                sum(f.ac_s[k] for f in flights) / seconds,
                sum(f.disengagements[k] for f in flights),
                episodes,
                rate(episodes, hours),
                sum(f.gate_faults[k] for f in flights),
            )
        )
    return Result(
        flights=len(flights),
        hours=hours,
        violations=violations,
        per_hour=rate(violations, hours),
        flights_violated=len(bad),
        per_flight=share(len(bad), len(flights)),
        ac_share=sum(f.all_ac_s for f in flights) / seconds,
        modules=tuple(each),
        broken=tuple(told.most_common()),
        worst=tuple(bad[:10]),
        digest=digest_of(flights),
    )
