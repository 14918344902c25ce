"""Prepare sampled signals for drawing: thin them, split them by who is in control.

Purpose: few points on the page, yet nothing a reader looks for is lost: every change of mode,
every decision, every violation and every dip of the clearance stays.
Non-goals: filtering or smoothing; every point drawn is a point of the trace.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from soter.report.run.record import Decision, Flight, Series, Vec3

DENSE_STEPS = 300
"""More of them touch each other in a drawing."""
POINTS_MAX = 2500
"""Points of one trajectory on the page; four screens' worth of pixels."""


def runs(in_control: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """Split (N,) modes into stretches `(first, last, is_ac)` of equal mode.

    A mode holds until the next sample, so `last` is the first sample of the next stretch (N-1
    for the last one): lines drawn from `first` to `last` inclusive join without gaps.
    """
    changes = np.flatnonzero(np.diff(in_control.astype(np.int8))) + 1
    firsts = [0, *changes.tolist()]
    lasts = [*changes.tolist(), len(in_control) - 1]
    return [
        (first, last, bool(in_control[first])) for first, last in zip(firsts, lasts, strict=True)
    ]


def dense(series: Series) -> bool:
    """Whether its steps are so many that they would cover their panel."""
    return series.held and int(np.count_nonzero(np.diff(series.values))) > DENSE_STEPS


def by_controller(
    rows: NDArray[np.float64], in_control: NDArray[np.bool_], *, ac: bool
) -> NDArray[np.float64]:
    """Return the rows (N, k) flown by AC (or SC), stretches parted by a row of NaN: (M, k)."""
    gap = np.full((1, rows.shape[1]), np.nan)
    parts: list[NDArray[np.float64]] = []
    for first, last, is_ac in runs(in_control):
        if is_ac is ac and last > first:
            parts += [rows[first : last + 1], gap]
    return np.concatenate(parts[:-1]) if parts else np.empty((0, rows.shape[1]))


def thin(
    count: int,
    keep: Iterable[int],
    dips: NDArray[np.float64] | None = None,
    points_max: int = POINTS_MAX,
) -> NDArray[np.intp]:
    """Choose at most `points_max` of `count` samples: sorted indices (M,).

    Both ends and every index in `keep` are chosen, even beyond `points_max`. What is left goes
    half to an even stride and half to the least value of `dips` (N,) in each stretch of equal
    length, so that no close approach disappears between two points.
    """
    chosen = {0, count - 1, *(index for index in keep if 0 <= index < count)}
    if count <= points_max:
        return np.arange(count)
    budget = max(points_max - len(chosen), 0)
    if dips is None:
        even = np.linspace(0, count - 1, budget).round().astype(np.intp)
        return np.union1d(np.fromiter(chosen, dtype=np.intp), even)
    even = np.linspace(0, count - 1, budget // 2).round().astype(np.intp)
    values = np.where(np.isnan(dips), np.inf, dips)
    bins = np.linspace(0, count, budget // 2 + 1).astype(np.intp)
    lows = [
        first + int(np.argmin(values[first:last]))
        for first, last in zip(bins[:-1].tolist(), bins[1:].tolist(), strict=True)
        if last > first
    ]
    indices = np.union1d(even, np.asarray(lows, dtype=np.intp))
    return np.union1d(np.fromiter(chosen, dtype=np.intp), indices)


def mode_edges(in_control: NDArray[np.bool_]) -> list[int]:
    """Return the indices on both sides of every change of mode; (N,) samples."""
    changes = np.flatnonzero(np.diff(in_control.astype(np.int8)))
    return [*changes.tolist(), *(changes + 1).tolist()]


def nearest_indices(time_s: NDArray[np.float64], at_s: Iterable[float]) -> list[int]:
    """Return, for each time, the index of the last of the samples (N,) not after it.

    It is 0 before the first; all times are in s.
    """
    indices = np.searchsorted(time_s, np.asarray(list(at_s), dtype=np.float64), side="right") - 1
    return [int(index) for index in np.clip(indices, 0, len(time_s) - 1)]


def lowest(values: NDArray[np.float64]) -> int | None:
    """Return the index of the least finite value of (N,), None where there is none."""
    known = np.where(np.isfinite(values), values, np.inf)
    index = int(np.argmin(known))
    return index if np.isfinite(known[index]) else None


def flight_indices(flight: Flight, points_max: int = POINTS_MAX) -> NDArray[np.intp]:
    """Choose the samples of a flight that are drawn: sorted indices (M,)."""
    events = [decision.time_s for decision in flight.decisions]
    events += [violation.time_s for violation in flight.violations]
    keep = mode_edges(flight.in_control) + nearest_indices(flight.time_s, events)
    return thin(len(flight.time_s), keep, flight.clearance_m, points_max)


def place(flight: Flight, time_s: float, position: Vec3 | None) -> Vec3:
    """Return where an event took place in m: as told, else read off the flight at `time_s`."""
    if position is not None:
        return position
    index = nearest_indices(flight.time_s, [time_s])[0]
    x, y, z = flight.position[index].tolist()
    return (x, y, z)


def takeovers(decisions: Iterable[Decision]) -> list[Decision]:
    """Return the decisions AC→SC: the paper's red dots."""
    return [decision for decision in decisions if decision.to == "SC"]


def givebacks(decisions: Iterable[Decision]) -> list[Decision]:
    """Return the decisions SC→AC: the paper's green dots."""
    return [decision for decision in decisions if decision.to == "AC"]
