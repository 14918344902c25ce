"""The result of a campaign: totals, shares, episodes, bounds, and which faults its flights met.

Purpose: `Result` takes flights to figures with intervals; `Campaign` has it and what was flown.
`FaultAttribution` tells a violation that is a defect from one that is excused: the flight met a
declared fault outside of what proofs assume before it, and without such faults it is clean.
`count_faults` counts each fault. All of it follows from the seeds, so nothing is stored for it.
Non-goals: printing, files; what faults do (`semantics/faults.py`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import fsum, inf, isnan, nan
from typing import TYPE_CHECKING

import numpy as np

from soter.campaign.batch_flights import EPISODE_NS
from soter.campaign.statistics import FLIGHTS, RateInterval, rate_interval, share_interval
from soter.campaign.store import campaign_digest
from soter.language.elaborate.derived_systems import without_faults, without_outside_faults
from soter.language.model.types import FloatType, IntType
from soter.semantics.draws import GOLDEN, fnv1a_64
from soter.semantics.faults import begin_times

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from soter.campaign.store import FlightOutcome
    from soter.core.layout import Words
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.language.model.system import Component, Fault, System


ORDER = "order any"


@dataclass(frozen=True)
class FaultAttribution:
    """The faults outside the assumptions of proofs that may explain a violated flight.

    `met`: the faults, as text, before its first violation. `clean_without`: whether the same flight
    without all of them violates nothing; None if it met none and was not flown again. `needed`:
    each fault without which alone the flight is clean; () if several do the same harm.
    """

    met: tuple[str, ...]
    clean_without: bool | None
    needed: tuple[str, ...] = ()

    @property
    def excused(self) -> bool:
        """Whether the flight is clean without the faults outside the assumptions."""
        return self.clean_without is True


def attributions(
    system: System,
    bad: Sequence[FlightOutcome],
    fly_again: Callable[[System, Sequence[int]], Iterable[FlightOutcome]],
) -> dict[int, FaultAttribution]:
    """The attribution of each flight in `bad`, by number; `fly_again` flies numbers of a system."""
    met = {f.number: tuple(faults_outside(system, f.seed, _first_violation_ns(f))) for f in bad}

    def clean_flights(other: System, numbers: Sequence[int]) -> set[int]:
        return {f.number for f in fly_again(other, numbers) if not f.violations}

    suspects = [n for n, texts in met.items() if texts]
    excused = clean_flights(without_outside_faults(system), suspects) if suspects else set()
    needed: dict[int, list[str]] = {n: list(met[n]) for n in excused if len(met[n]) == 1}
    several = excused - needed.keys()
    for text in sorted({t for n in several for t in met[n]}):
        shuffled = system.shuffled and text != ORDER
        numbers = sorted(n for n in several if text in met[n])
        for n in clean_flights(without_faults(system, (text,), shuffled=shuffled), numbers):
            needed.setdefault(n, []).append(text)
    return {
        n: FaultAttribution(texts, n in excused if texts else None, tuple(needed.get(n, ())))
        for n, texts in met.items()
    }


def _first_violation_ns(f: FlightOutcome) -> int:
    return round((f.seconds if f.first_s is None else f.first_s) * 1e9)


def faults_outside(system: System, seed: int, until_ns: int) -> list[str]:
    """The texts of faults outside the proofs' assumptions that occurred until `until_ns`."""
    fault_texts = {ORDER: None} if system.shuffled else {}
    for f in system.faults:
        if (
            f.inside is None
            and f.text not in fault_texts
            and _has_occurred(system, f, seed, until_ns)
        ):
            fault_texts[f.text] = None
    return list(fault_texts)


def _has_occurred(system: System, f: Fault, seed: int, until_ns: int) -> bool:
    always = f.kind == "late" and f.slot_ns == 0
    return always or bool(begin_times(f, system.components[f.component], seed, until_ns))


# ---------------------------------------------------------------- how often

DRAWS = 1 << 20
"""How many draws are made at once."""


def count_faults(system: System, seeds: Sequence[int], until_ns: int) -> dict[str, int | None]:
    """How often each fault occurred in the flights of these seeds, by the text of the fault.

    It counts the time slots (docs/semantics.md, Faults) that a release met; a fault that hits a
    group at once counts once. None means always, such as a lateness of every release.
    """
    streams_by_fault: dict[str, dict[str, int] | None] = {ORDER: None} if system.shuffled else {}
    for f in system.faults:
        if f.on is not None:
            continue
        if f.kind == "late" and f.slot_ns == 0:
            streams_by_fault[f.text] = None
            continue
        streams = streams_by_fault.setdefault(f.text, {})
        if streams is not None:
            # outputs of one component share a stream, and so do all of a group
            times = _occurrence_count(f, system.components[f.component], seeds, until_ns)
            streams[f.stream] = max(times, streams.get(f.stream, 0))
    return {text: None if s is None else sum(s.values()) for text, s in streams_by_fault.items()}


def _occurrence_count(f: Fault, c: Component, seeds: Sequence[int], until_ns: int) -> int:
    """The number of slots in all these flights in which a fault occurs, as `begin_times` rules."""
    step = max(f.slot_ns, c.period_ns)
    slots = until_ns // step + 2
    rows, total = max(1, DRAWS // slots), 0
    for k in range(0, len(seeds), rows):
        some = seeds[k : k + rows]
        offsets = np.zeros(len(some), dtype=np.int64)
        if f.slot_ns:
            begin = _draw_bits(some, f"{f.stream}.at", np.zeros((len(some), 1), dtype=np.int64))
            offsets = (begin[:, 0] % np.uint64(f.slot_ns)).astype(np.int64)
        first = -offsets if f.slot_ns > c.period_ns else np.full(len(some), c.phase_ns)
        times = first[:, None] + np.arange(slots, dtype=np.int64) * step
        seen = times <= until_ns
        times = np.maximum(times, 0)
        at = (times + offsets[:, None]) // f.slot_ns if f.slot_ns else times // c.period_ns
        begins = _hits(f, some, at)
        if f.apart:
            begins &= ~_hits(f, some, at - 1)
        total += int((begins & seen).sum())
    return total


def _hits(f: Fault, seeds: Sequence[int], slots: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """For each slot, whether the fault is drawn in it, as an array (flights, slots)."""
    share = (_draw_bits(seeds, f.stream, slots) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    mask: npt.NDArray[np.bool_] = share < f.probability
    return mask


def _draw_bits(seeds: Sequence[int], stream: str, index: npt.NDArray[np.int64]) -> Words:
    """The random bits of `draw_bits` for each index, (flights, n); each row has its seed."""
    golden = np.uint64(GOLDEN)
    keys = _mixed_arrays(
        _mixed_arrays(np.array(seeds, dtype=np.uint64) + golden) ^ np.uint64(fnv1a_64(stream))
    )
    return _mixed_arrays((index + 1).astype(np.uint64) * golden + keys[:, None])


def _mixed_arrays(z: Words) -> Words:
    """The numbers of an array after mixing each with `splitmix64`; the shape stays."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    words: Words = z ^ (z >> np.uint64(31))
    return words


SPEED = "speed"
"""The name of the measure whose mean, in m/s, gives the kilometres."""
ALOFT = "aloft"
"""The name of the measure whose mean is the share of time that counts as aloft."""


@dataclass(frozen=True)
class ModuleStatistics:
    """The statistics of a module over all flights; `per_hour`: the 95 % interval of episodes.

    `basis`: the assumption behind the interval (`statistics.RateInterval`).
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
    """A measure over all flights: mean, least and greatest sample, and histogram, in `unit`.

    `edges`: (bins + 1,) of the range; `bins`: (bins + 2,) counts, with those outside the range.
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
    """The statistics of all flights; `per_hour`: the 95 % interval of the violation rate.

    Rates are per hour aloft if the system measures that, else per hour. `distinct`: the number of
    different flights. `properties`: the number of properties that judged each flight; if it is 0,
    nothing is known of the rate.
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
    """The attribution of each of the worst."""
    digest: str
    violated_inside: int = 0
    """How many violated flights met no fault outside of the assumptions before, or are violated
    without them, too."""
    excused: tuple[tuple[str, int, int], ...] = ()
    """(fault outside, flights that are clean without it alone, flights that met it and are clean
    without all faults outside)."""
    measures: tuple[MetricResult, ...] = ()
    hours_aloft: float | None = None
    """Hours in which the measure `aloft` is 1.0, not 0.0; None without such a measure."""
    km: float | None = None
    """Mean of the measure `speed`, in m/s, over all hours; None where it has no number."""

    @property
    def outside(self) -> tuple[tuple[str, ...], ...]:
        """The faults outside assumptions that each worst flight met before its violation."""
        return tuple(b.met for b in self.blames)

    @property
    def rate_hours(self) -> float:
        """The hours to which all rates refer."""
        return self.hours if self.hours_aloft is None else self.hours_aloft


@dataclass(frozen=True)
class FlownArm:
    """An arm flown on the seeds of a campaign; `folder` has all of its flights."""

    name: str
    text: str
    system: System
    folder: Path
    flights: tuple[FlightOutcome, ...]
    result: Result
    flown: int
    wall_s: float


@dataclass(frozen=True)
class Campaign:
    """A flown campaign. `folder` has every flight; `wall_s` is the time of this call alone.

    `flown`: number of flights in this call; the folder already had the others. `arms`: the same
    seeds under other rules, first the campaign itself; `lateness`: the lateness measured for them,
    as text. `horizon_s`: how long AC flew on after it lost control; 0 if saves were not counted.
    """

    system: str
    until_s: float
    first_seed: int
    folder: Path
    flights: tuple[FlightOutcome, ...]
    result: Result
    flown: int
    wall_s: float
    workers: int
    arms: tuple[FlownArm, ...] = ()
    lateness: str = ""
    horizon_s: float = 0.0
    program_sha256: str = ""
    params: Mapping[str, str] = field(default_factory=dict)
    """Parameter that is not at its default -> its value as a program writes it."""
    asked_arms: tuple[str, ...] = ()
    """The arms that were asked for; `swept` stands for several of `arms`."""
    forced: tuple[str, ...] = ()
    """Modules whose mode the system forces, as text with who is in control."""
    faults: tuple[tuple[str, str], ...] = ()
    """Each fault as it was written, and the assumption that it keeps; "": none."""
    occurred: Mapping[str, int | None] = field(default_factory=dict)
    """Fault -> how often it occurred in all flights; None: always."""
    diagnostics: tuple[Diagnostic, ...] = ()
    """Warnings about claims for which these flights are no evidence."""
    properties: tuple[str, ...] = ()
    """The properties that judged each flight, as the program writes them."""


def make_result(
    flights: Sequence[FlightOutcome], system: System, blames: Mapping[int, FaultAttribution]
) -> Result:
    """The statistics of these flights; without flights, zeros and intervals that exclude nothing.

    `blames`: the attribution of each violated flight, by its number.
    """
    hours = sum(f.seconds for f in flights) / 3600.0
    counts_by_violation = Counter(violation for f in flights for violation in f.broken)
    bad = [f for f in flights if f.violations]
    blames_of_bad = [blames[f.number] for f in bad]
    kinds = [f.trajectory for f in flights]
    aloft = _hours_aloft(flights, system)
    exposed = [f.seconds / 3600.0 for f in flights] if aloft is None else aloft
    measures = _metric_results(flights, system)
    counts = [f.violations for f in flights]
    rate, per_flight = RateInterval(0.0, inf, FLIGHTS), (0.0, 1.0)
    if system.properties:
        rate = rate_interval(counts, exposed, most=_most_violations(flights, system), kinds=kinds)
        per_flight = share_interval(list(map(bool, counts)), kinds)
    return Result(
        flights=len(flights),
        distinct=len(set(kinds)),
        properties=len(system.properties),
        hours=hours,
        violations=sum(counts),
        per_hour=(rate.low, rate.high),
        per_hour_basis=rate.basis,
        flights_violated=len(bad),
        per_flight=per_flight,
        ac_share=sum(f.all_ac_s for f in flights) / max(3600.0 * hours, 1e-9),
        modules=tuple(_module_statistics(flights, system, exposed, kinds)),
        broken=tuple(counts_by_violation.most_common()),
        worst=tuple(bad[:10]),
        blames=tuple(blames_of_bad[:10]),
        digest=campaign_digest(flights),
        violated_inside=sum(not b.excused for b in blames_of_bad),
        excused=_excused_rows(blames_of_bad),
        measures=measures,
        hours_aloft=None if aloft is None else fsum(aloft),
        km=_kilometres(measures, hours),
    )


def _kilometres(measures: Sequence[MetricResult], hours: float) -> float | None:
    """The kilometres of all flights; None if the measure `speed` is missing or has no number."""
    speed = next((m.mean for m in measures if m.name == SPEED), None)
    return None if speed is None or isnan(speed) else speed * 3.6 * hours


def _module_statistics(
    flights: Sequence[FlightOutcome], system: System, hours: Sequence[float], kinds: Sequence[str]
) -> Iterator[ModuleStatistics]:
    """Yields statistics of each module; `hours` and `kinds`, (flights,): see `rate_interval`."""
    seconds = max(sum(f.seconds for f in flights), 1e-9)
    most = max((int(f.seconds * 1e9) // EPISODE_NS + 1 for f in flights), default=0)
    for k, m in enumerate(system.modules):
        episodes = [f.episodes[k] for f in flights]
        interval = rate_interval(episodes, hours, most=most, kinds=kinds)
        saves, precautions = _saves_of_module(flights, k)
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


def _hours_aloft(flights: Sequence[FlightOutcome], system: System) -> list[float] | None:
    """The hours aloft of each flight, 0 without a number; None without a measure `aloft`."""
    k = next((k for k, m in enumerate(system.measures) if m.name == ALOFT), None)
    if k is None:
        return None
    looks = [f.looks[k] for f in flights]
    shares = [min(max(x.sum / x.count, 0.0), 1.0) if x.count else 0.0 for x in looks]
    return [s * f.seconds / 3600.0 for s, f in zip(shares, flights, strict=True)]


def _most_violations(flights: Sequence[FlightOutcome], system: System) -> int:
    """The most violations possible in a flight: each begins after an instant without violation.

    A release makes at most two instants: the release, and the publication of held outputs.
    """
    until_ns = max((round(f.seconds * 1e9) for f in flights), default=0)
    instants = sum(2 * (until_ns // c.period_ns + 2) for c in system.components)
    instants += sum(until_ns // i.every_ns + 2 for i in system.inputs)
    return len(system.properties) * (instants // 2 + 1) + len(system.components)


def _excused_rows(blames: Sequence[FaultAttribution]) -> tuple[tuple[str, int, int], ...]:
    met = Counter(text for b in blames if b.excused for text in b.met)
    needed = Counter(text for b in blames for text in b.needed)
    return tuple((text, needed[text], n) for text, n in met.most_common())


def _saves_of_module(flights: Sequence[FlightOutcome], k: int) -> tuple[int | None, int | None]:
    if not flights or not flights[0].saves:
        return None, None
    return sum(f.saves[k] for f in flights), sum(f.precautions[k] for f in flights)


def _metric_results(flights: Sequence[FlightOutcome], system: System) -> tuple[MetricResult, ...]:
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
