"""What a campaign says: totals, shares, episodes, bounds.

Purpose: `Result`, from flights to figures, with exact intervals.
Non-goals: printing, files.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import fsum, nan
from typing import TYPE_CHECKING

from soter.campaign.statistics import rate, share
from soter.campaign.store import digest_of
from soter.campaign.troubles import outside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.campaign.flight import Flight
    from soter.program.model.system import System

SPEED = "speed"
"""The measure whose mean, in m/s, makes kilometres."""
ALOFT = "aloft"
"""The measure whose mean is the share of time that counts as aloft."""


@dataclass(frozen=True)
class Module:
    """One module over all flights. Rates per hour, with 95 % intervals."""

    name: str
    ac_share: float
    disengagements: int
    episodes: int
    per_hour: tuple[float, float]
    gate_faults: int
    saves: int | None = None
    precautions: int | None = None


@dataclass(frozen=True)
class Measured:
    """A measure over all flights: its mean over looks, its ends, its histogram.

    `edges`: (bins + 1,) of the range; `bins`: (bins + 2,) counts, below and above the range, too.
    """

    name: str
    mean: float
    least: float
    most: float
    edges: tuple[float, ...]
    bins: tuple[int, ...]


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
    outside: tuple[tuple[str, ...], ...]
    """Of each of the worst: the faults outside of the assumptions that it met before."""
    digest: str
    violated_inside: int = 0
    """Violated flights that met no fault outside of the assumptions before."""
    measures: tuple[Measured, ...] = ()
    hours_aloft: float | None = None
    """Mean of the measure `aloft` (1.0 or 0.0) over all hours; None without such a measure."""
    km: float | None = None
    """Mean of the measure `speed`, in m/s, over all hours; None without such a measure."""


def result_of(flights: Sequence[Flight], system: System) -> Result:
    """The figures of these flights. Of none: zeros, and intervals that say nothing."""
    modules = [m.name for m in system.modules]
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
                *_saved(flights, k),
            )
        )
    measures = _measured(flights, system)
    speed, aloft = (next((m.mean for m in measures if m.name == n), None) for n in (SPEED, ALOFT))
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
        outside=tuple(tuple(_met(system, f)) for f in bad[:10]),
        digest=digest_of(flights),
        violated_inside=sum(not _met(system, f) for f in bad),
        measures=measures,
        hours_aloft=None if aloft is None else aloft * hours,
        km=None if speed is None else speed * 3.6 * hours,
    )


def _saved(flights: Sequence[Flight], k: int) -> tuple[int | None, int | None]:
    if not flights or not flights[0].saves:
        return None, None
    return sum(f.saves[k] for f in flights), sum(f.precautions[k] for f in flights)


def _met(system: System, f: Flight) -> list[str]:
    """Faults outside of the assumptions before the first violation."""
    until_ns = round((f.seconds if f.first_s is None else f.first_s) * 1e9)
    return outside(system, f.seed, until_ns)


def _measured(flights: Sequence[Flight], system: System) -> tuple[Measured, ...]:
    found = []
    for k, m in enumerate(system.measures):
        looks = [f.looks[k] for f in flights if f.looks[k].count]
        count = sum(x.count for x in looks)
        edges = tuple(m.low + (m.high - m.low) * i / m.bins for i in range(m.bins + 1))
        bins = [0] * (m.bins + 2)
        for x in looks:
            bins = [a + b for a, b in zip(bins, x.bins, strict=True)]
        found.append(
            Measured(
                name=m.name,
                mean=fsum(x.sum for x in looks) / count if count else nan,
                least=min((x.least for x in looks), default=nan),
                most=max((x.most for x in looks), default=nan),
                edges=edges,
                bins=tuple(bins),
            )
        )
    return tuple(found)
