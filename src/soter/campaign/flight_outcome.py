"""What one flight of a campaign was like.

Purpose: `FlightOutcome` and `MetricSample`, plain data.
Non-goals: where they come from (`batch_flights.py`), where they are kept (`store.py`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MetricSample:
    """One measure over one flight: looks that gave a number, their sum, ends and histogram.

    `bins`: (bins + 2,) counts; the first is below the range, the last above.
    """

    count: int
    sum: float
    least: float
    most: float
    bins: tuple[int, ...]


@dataclass(frozen=True)
class FlightOutcome:
    """One run. Shares and times by module, in the order of the system's modules.

    `seed` re-flies it (`soter run --seed`); `digest`: SHA-256 over its events and its last state.
    `all_ac_s`: how long all modules were in AC at once. `violations`: onsets by property,
    `latched`: components, both by name with how many; `first_s`: the first of them. `saves` and
    `precautions`: of its episodes, where AC would have done harm and where not; none where they are
    not counted. `looks`: one for each measure of the system. `trajectory`: SHA-256 of what
    happened, without the seed: flights that have the same one are copies of each other.
    """

    number: int
    seed: int
    seconds: float
    ac_s: tuple[float, ...]
    all_ac_s: float
    disengagements: tuple[int, ...]
    episodes: tuple[int, ...]
    gate_faults: tuple[int, ...]
    violations: int
    first_s: float | None
    broken: tuple[str, ...]
    digest: str
    trajectory: str
    saves: tuple[int, ...] = ()
    precautions: tuple[int, ...] = ()
    looks: tuple[MetricSample, ...] = ()
