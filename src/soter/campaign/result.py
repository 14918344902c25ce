"""What a campaign says: totals, shares, episodes, bounds.

Purpose: `Result`, from flights to figures, with intervals of the hours that are told.
Non-goals: printing, files.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import fsum, inf, isnan, nan
from typing import TYPE_CHECKING

from soter.campaign.batch_flights import EPISODE_NS
from soter.campaign.statistics import FLIGHTS, RateInterval, interval_of, share_of
from soter.campaign.store import digest_of
from soter.language.model.types import FloatType, IntType

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.campaign.fault_attribution import FaultAttribution
    from soter.campaign.flight_outcome import FlightOutcome
    from soter.language.model.system import System

SPEED = "speed"
"""The measure whose mean, in m/s, makes kilometres."""
ALOFT = "aloft"
"""The measure whose mean is the share of time that counts as aloft."""


@dataclass(frozen=True)
class ModuleStatistics:
    """One module over all flights. Rates per hour, with 95 % intervals.

    `basis`: what the interval rests on (`statistics.Interval`).
    """

    name: str
    ac_share: float
    disengagements: int
    episodes: int
    per_hour: tuple[float, float]
    basis: str
    gate_faults: int
    saves: int | None = None
    precautions: int | None = None


@dataclass(frozen=True)
class MetricResult:
    """A measure over all flights: its mean over looks, its ends, its histogram, all in `unit`.

    `edges`: (bins + 1,) of the range; `bins`: (bins + 2,) counts, below and above the range, too.
    """

    name: str
    mean: float
    least: float
    most: float
    edges: tuple[float, ...]
    bins: tuple[int, ...]
    unit: str = ""


@dataclass(frozen=True)
class Result:
    """All flights together. `per_hour`: what the rate of violations lies in; 95 %.

    Rates are per hour aloft where the system measures that, else per hour. `distinct`: flights
    that are no copies of others. `properties`: how many judged each flight; where it is 0, nothing
    is said of the rate.
    """

    flights: int
    distinct: int
    properties: int
    hours: float
    violations: int
    per_hour: tuple[float, float]
    per_hour_basis: str
    flights_violated: int
    per_flight: tuple[float, float]
    ac_share: float
    modules: tuple[ModuleStatistics, ...]
    broken: tuple[tuple[str, int], ...]
    worst: tuple[FlightOutcome, ...]
    blames: tuple[FaultAttribution, ...]
    """Of each of the worst: whose fault it is."""
    digest: str
    violated_inside: int = 0
    """Violated flights that met no fault outside of the assumptions before, or are violated without
    them, too."""
    excused: tuple[tuple[str, int, int], ...] = ()
    """Each fault outside with how many violated flights are clean without it alone, and how many
    met it that are clean without all faults outside."""
    measures: tuple[MetricResult, ...] = ()
    hours_aloft: float | None = None
    """Those for which the measure `aloft` (1.0 or 0.0) says so; None without such a measure."""
    km: float | None = None
    """Mean of the measure `speed`, in m/s, over all hours; None where it has no number."""

    @property
    def outside(self) -> tuple[tuple[str, ...], ...]:
        """Of each of the worst: the faults outside of the assumptions that it met before."""
        return tuple(b.met for b in self.blames)

    @property
    def rate_hours(self) -> float:
        """The hours that all rates are about."""
        return self.hours if self.hours_aloft is None else self.hours_aloft


def result_of(
    flights: Sequence[FlightOutcome], system: System, blames: Mapping[int, FaultAttribution]
) -> Result:
    """The figures of these flights. Of none: zeros, and intervals that say nothing.

    `blames`: of each violated flight, by its number.
    """
    hours = sum(f.seconds for f in flights) / 3600.0
    told = Counter(what for f in flights for what in f.broken)
    bad = [f for f in flights if f.violations]
    kinds = [f.trajectory for f in flights]
    aloft = _aloft(flights, system)
    exposed = [f.seconds / 3600.0 for f in flights] if aloft is None else aloft
    measures = _measured(flights, system)
    speed = next((m.mean for m in measures if m.name == SPEED), None)
    counts = [f.violations for f in flights]
    rate = interval_of(counts, exposed, most=_onsets_most(flights, system), kinds=kinds)
    if not system.properties:
        rate = RateInterval(0.0, inf, FLIGHTS)
    return Result(
        flights=len(flights),
        distinct=len(set(kinds)),
        properties=len(system.properties),
        hours=hours,
        violations=sum(counts),
        per_hour=(rate.low, rate.high),
        per_hour_basis=rate.basis,
        flights_violated=len(bad),
        per_flight=share_of([c > 0 for c in counts], kinds) if system.properties else (0.0, 1.0),
        ac_share=sum(f.all_ac_s for f in flights) / max(3600.0 * hours, 1e-9),
        modules=tuple(_modules(flights, system, exposed, kinds)),
        broken=tuple(told.most_common()),
        worst=tuple(bad[:10]),
        blames=tuple(blames[f.number] for f in bad[:10]),
        digest=digest_of(flights),
        violated_inside=sum(not blames[f.number].excused for f in bad),
        excused=_excused([blames[f.number] for f in bad]),
        measures=measures,
        hours_aloft=None if aloft is None else fsum(aloft),
        km=None if speed is None or isnan(speed) else speed * 3.6 * hours,
    )


def _modules(
    flights: Sequence[FlightOutcome], system: System, hours: Sequence[float], kinds: Sequence[str]
) -> Iterator[ModuleStatistics]:
    """Each module; `hours` and `kinds` (flights,), as of `interval_of`."""
    seconds = max(sum(f.seconds for f in flights), 1e-9)
    most = max((int(f.seconds * 1e9) // EPISODE_NS + 1 for f in flights), default=0)
    for k, m in enumerate(system.modules):
        episodes = [f.episodes[k] for f in flights]
        interval = interval_of(episodes, hours, most=most, kinds=kinds)
        saves, precautions = _saved(flights, k)
        yield ModuleStatistics(
            name=m.name,
            ac_share=sum(f.ac_s[k] for f in flights) / seconds,
            disengagements=sum(f.disengagements[k] for f in flights),
            episodes=sum(episodes),
            per_hour=(interval.low, interval.high),
            basis=interval.basis,
            gate_faults=sum(f.gate_faults[k] for f in flights),
            saves=saves,
            precautions=precautions,
        )


def _aloft(flights: Sequence[FlightOutcome], system: System) -> list[float] | None:
    """Hours aloft of each flight; of one in which the measure had no number, none."""
    k = next((k for k, m in enumerate(system.measures) if m.name == ALOFT), None)
    if k is None:
        return None
    looks = [f.looks[k] for f in flights]
    shares = [min(max(x.sum / x.count, 0.0), 1.0) if x.count else 0.0 for x in looks]
    return [s * f.seconds / 3600.0 for s, f in zip(shares, flights, strict=True)]


def _onsets_most(flights: Sequence[FlightOutcome], system: System) -> int:
    """How many violations one flight can have at most: each begins in an instant after one without.

    A release makes two instants at most: its own, and that in which what it held is published.
    """
    until_ns = max((round(f.seconds * 1e9) for f in flights), default=0)
    instants = sum(2 * (until_ns // c.period_ns + 2) for c in system.components)
    instants += sum(until_ns // i.every_ns + 2 for i in system.inputs)
    return len(system.properties) * (instants // 2 + 1) + len(system.components)


def _excused(blames: Sequence[FaultAttribution]) -> tuple[tuple[str, int, int], ...]:
    """Each fault that excused flights met: how many are clean without it alone, of how many."""
    met = Counter(text for b in blames if b.excused for text in b.met)
    needed = Counter(text for b in blames for text in b.needed)
    return tuple((text, needed[text], n) for text, n in met.most_common())


def _saved(flights: Sequence[FlightOutcome], k: int) -> tuple[int | None, int | None]:
    if not flights or not flights[0].saves:
        return None, None
    return sum(f.saves[k] for f in flights), sum(f.precautions[k] for f in flights)


def _measured(flights: Sequence[FlightOutcome], system: System) -> tuple[MetricResult, ...]:
    measures = []
    for k, m in enumerate(system.measures):
        looks = [f.looks[k] for f in flights if f.looks[k].count]
        count = sum(x.count for x in looks)
        edges = tuple(m.low + (m.high - m.low) * i / m.bins for i in range(m.bins + 1))
        bins = [0] * (m.bins + 2)
        for x in looks:
            bins = [a + b for a, b in zip(bins, x.bins, strict=True)]
        measures.append(
            MetricResult(
                name=m.name,
                mean=fsum(x.sum for x in looks) / count if count else nan,
                least=min((x.least for x in looks), default=nan),
                most=max((x.most for x in looks), default=nan),
                edges=edges,
                bins=tuple(bins),
                unit=m.value.type.unit if isinstance(m.value.type, (FloatType, IntType)) else "",
            )
        )
    return tuple(measures)
