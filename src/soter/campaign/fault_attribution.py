"""Which faults a flight met: inside of what proofs assume, or outside; how often each was there.

Purpose: whether a violation is a defect, or had an excuse that was declared before the flight: a
fault outside that it met before, without which the same flight is clean. All of it follows from the
seeds, so nothing is kept for it.
Non-goals: what faults do (`semantics/random/faults.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.language.elaborate.derived_systems import only_inside, without_faults
from soter.semantics.random.faults import begins
from soter.semantics.random.random_draws import GOLDEN, fnv

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import numpy.typing as npt

    from soter.campaign.flight_outcome import FlightOutcome
    from soter.language.model.system import Component, Fault, System

    Words = npt.NDArray[np.uint64]

ORDER = "order any"


@dataclass(frozen=True)
class FaultAttribution:
    """Whose fault a violated flight is.

    `met`: faults outside of what proofs assume, as they were written, that were there before its
    first violation; `clean_without`: whether the same flight without any fault outside violates
    nothing; None: it met none, and was not flown again. `needed`: of those that it met each without
    which alone it is clean; none, where several of them do the same harm.
    """

    met: tuple[str, ...]
    clean_without: bool | None
    needed: tuple[str, ...] = ()

    @property
    def excused(self) -> bool:
        """Whether what it met made the violation."""
        return self.clean_without is True


def blames(
    system: System,
    bad: Sequence[FlightOutcome],
    again: Callable[[System, Sequence[int]], Iterable[FlightOutcome]],
) -> dict[int, FaultAttribution]:
    """Of each violated flight, by its number. `again` flies numbers of another system."""
    met = {f.number: tuple(outside(system, f.seed, _first_ns(f))) for f in bad}

    def clean(other: System, numbers: Sequence[int]) -> set[int]:
        return {f.number for f in again(other, numbers) if not f.violations} if numbers else set()

    excused = clean(only_inside(system), [n for n, texts in met.items() if texts])
    needed: dict[int, list[str]] = {n: list(met[n]) for n in excused if len(met[n]) == 1}
    for text in sorted({t for n in excused - needed.keys() for t in met[n]}):
        shuffled = system.shuffled and text != ORDER
        numbers = sorted(n for n in excused if len(met[n]) > 1 and text in met[n])
        for n in clean(without_faults(system, (text,), shuffled=shuffled), numbers):
            needed.setdefault(n, []).append(text)
    return {
        n: FaultAttribution(texts, n in excused if texts else None, tuple(needed.get(n, ())))
        for n, texts in met.items()
    }


def _first_ns(f: FlightOutcome) -> int:
    return round((f.seconds if f.first_s is None else f.first_s) * 1e9)


def outside(system: System, seed: int, until_ns: int) -> list[str]:
    """Faults outside of the assumptions that were there up to a time, as they were written."""
    fault_texts = {ORDER: None} if system.shuffled else {}
    for f in system.faults:
        if f.inside is None and f.text not in fault_texts and _was_there(system, f, seed, until_ns):
            fault_texts[f.text] = None
    return list(fault_texts)


def _was_there(system: System, f: Fault, seed: int, until_ns: int) -> bool:
    always = f.kind == "late" and f.slot_ns == 0
    return always or bool(begins(f, system.components[f.component], seed, until_ns))


# ---------------------------------------------------------------- how often

DRAWS = 1 << 20
"""So many at once."""


def occurred(system: System, seeds: Sequence[int], until_ns: int) -> dict[str, int | None]:
    """How often each fault was there in the flights of these seeds, by what was written.

    In how many slots of time (docs/semantics.md, Faults), as far as a release met them; what hits
    a group at once counts once. None: always, as a lateness of every release.
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
            times = _times(f, system.components[f.component], seeds, until_ns)
            streams[f.stream] = max(times, streams.get(f.stream, 0))
    return {text: None if s is None else sum(s.values()) for text, s in streams_by_fault.items()}


def _times(f: Fault, c: Component, seeds: Sequence[int], until_ns: int) -> int:
    """As `begins`, of many flights at once."""
    step = max(f.slot_ns, c.period_ns)
    slots = until_ns // step + 2
    rows, total = max(1, DRAWS // slots), 0
    for k in range(0, len(seeds), rows):
        some = seeds[k : k + rows]
        offsets = np.zeros(len(some), dtype=np.int64)
        if f.slot_ns:
            begin = _bits(some, f"{f.stream}.at", np.zeros((len(some), 1), dtype=np.int64))
            offsets = (begin[:, 0] % np.uint64(f.slot_ns)).astype(np.int64)
        first = -offsets if f.slot_ns > c.period_ns else np.full(len(some), c.phase_ns)
        times = first[:, None] + np.arange(slots, dtype=np.int64) * step
        seen = times <= until_ns
        times = np.maximum(times, 0)
        at = (times + offsets[:, None]) // f.slot_ns if f.slot_ns else times // c.period_ns
        there = _drawn(f, some, at)
        if f.apart:
            there &= ~_drawn(f, some, at - 1)
        total += int((there & seen).sum())
    return total


def _drawn(f: Fault, seeds: Sequence[int], slots: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which slots (flights, slots) are drawn."""
    share = (_bits(seeds, f.stream, slots) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    mask: npt.NDArray[np.bool_] = share < f.probability
    return mask


def _bits(seeds: Sequence[int], stream: str, index: npt.NDArray[np.int64]) -> Words:
    """`draw_bits` of each index (flights, n), under the seed of its row."""
    golden = np.uint64(GOLDEN)
    keys = _mixed(_mixed(np.array(seeds, dtype=np.uint64) + golden) ^ np.uint64(fnv(stream)))
    return _mixed((index + 1).astype(np.uint64) * golden + keys[:, None])


def _mixed(z: Words) -> Words:
    """`mix` of each, any shape."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    words: Words = z ^ (z >> np.uint64(31))
    return words
