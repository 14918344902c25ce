"""Clauses `rest` to try, from the ends of runs of the model under SC.

Purpose: `rest_hints` simulates SC from the farthest states that it still rescues. A state whose end
does not depend on the start of the run is *held*: the condition bounds it. Any other state moves,
by as much as it did after the condition first held, or, tried later, by more. Larger boxes follow.
Non-goals: the proof that SC keeps such a box (`tubes/rest_claims.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.diagnosis.model_runs import NS, TRUE
from soter.verify.search.hint_text import Hints
from soter.verify.search.model_states import SETTLED
from soter.verify.search.written_numbers import duration_text, rounded_outward

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.core.layout import Floats
    from soter.verify.diagnosis.model_runs import ModelTrace
    from soter.verify.problem.problem import Interval
    from soter.verify.search.model_states import ModelStates

LONG = 1000
"""The length in periods of SC of runs that have to come to an end."""
STARTS = 9
LAST = 0.8
"""A run is taken to be at its end after this share of its time."""
FROM = (0.5, 0.25, 0.12, 0.06)
"""Larger boxes around the same place hold the states of runs after these shares of the time of
`ModelStates.holds`."""
HANGS = 0.1
"""A state depends on the start if its ends differ by more than this share of the range reached,"""
FOLLOWS = 0.95
"""or if its end moves with its start by more than this share."""
AROUND, LATER = 1.3, (1.3, 2.2)
"""Factors by which a box is larger than the ends of runs, and a time longer than they took. The
longer time is tried where SC is shown to keep the box but not to lead there in time."""
LEAST = 1e-3
"""The least range that a state is taken to pass through, as a bound of 0 leaves no rounding."""
FARTHER = 1.5, 6.0
"""Factors by which the bounds of `moves` are larger than in runs, tried in turn."""


def rest_hints(found: ModelStates) -> Iterator[Hints]:
    """Clauses `rest` to try, smaller boxes first."""
    starts = [*found.points[-1:], *found.points[:-1]][:STARTS]
    runs = found.runs_from(starts, LONG)
    if not runs:
        return
    width = np.maximum(found.far[1] - found.far[0], 1e-9)
    held, moving = _condition_and_moves_states(found, runs, width)
    if not held or not found.problem.topic_leaf_of_state.keys() >= {*held, *moving}:
        return  # `rest` and `moves` name topics, and none shows this state
    least = found.estimate_errors / 2 + width / 150
    ends_s = [LAST * LONG * found.period_s]
    ends_s += [share * found.holds * found.period_s for share in FROM]
    before, middle = np.zeros_like(least), None
    for end_s in ends_s:
        tails = np.concatenate(
            [np.array(t.states)[np.searchsorted(t.times, min(end_s, t.times[-1])) :] for t in runs]
        )
        low, high = tails.min(axis=0), tails.max(axis=0)
        middle = (low + high) / 2 if middle is None else middle
        reach = np.maximum(high - middle, middle - low)
        half = AROUND * (reach + least)
        if end_s == ends_s[0] and not _lies_in_safe(found, runs, _ends_of_box(middle, half, held)):
            half = AROUND * (reach + found.estimate_errors / 2)
        if (half > AROUND * before)[held].any():
            yield from _hints_of_box(found, runs, middle, half, held, moving)
        before = half


def _condition_and_moves_states(
    found: ModelStates, runs: list[ModelTrace], width: Floats
) -> tuple[list[int], list[int]]:
    """The states for the condition and those for `moves`; adds runs from other starts to `runs`.

    A state is in neither list if it moves for ever towards a bound, or if rates or SC read it and
    no set bounds it, because the check does not follow a bound of `moves` there.
    """
    quiet = np.array([t.states[-1] for t in runs[:: len(found.patterns)]])
    hangs = np.ptp(quiet, axis=0) > HANGS * width
    for s, more in _moved_starts(found, width).items():
        hangs[s] = True
        runs += more
    late = np.array([t.states[-1] - t.states[int(LAST * len(t.states))] for t in runs])
    down, up = (late < -SETTLED * width).any(axis=0), (late > SETTLED * width).any(axis=0)
    below, above = found.limited_in_safe.T
    bounded = hangs & ~((down & (below | ~above)) | (up & (above | ~below)))
    return (
        [int(s) for s in np.flatnonzero(~hangs & found.needs_axis)],
        [int(s) for s in np.flatnonzero(bounded & found.needs_axis) if _may_move(found, int(s))],
    )


def _may_move(found: ModelStates, s: int) -> bool:
    """Whether `moves` may name a state, as only `safe` reads it or its topic's set bounds it."""
    at = found.problem.topic_leaf_of_state.get(s)
    has_set = at is not None and found.problem.system.topics[at[0]].bounds[at[1]] is not None
    return has_set or not np.delete(found.rate_reads, s, axis=0)[:, s].any()


def _moved_starts(found: ModelStates, width: Floats) -> dict[int, list[ModelTrace]]:
    """For each state whose final value moves with its start, the runs from moved starts."""
    middle, moved = found.points[0], {}
    at = found.runs_from([middle], LONG)
    for s, (low, high) in enumerate(found.ends):
        away = min((high - low) / 4, 4 * width[s])
        start = middle.copy()
        start[s] += away
        runs = found.runs_from([start], LONG)
        if at and runs and abs(runs[0].states[-1][s] - at[0].states[-1][s]) > FOLLOWS * away:
            moved[s] = runs
    return moved


def _hints_of_box(
    found: ModelStates,
    runs: list[ModelTrace],
    middle: Floats,
    half: Floats,
    held: list[int],
    moving: list[int],
) -> Iterator[Hints]:
    """Clauses for a box around `middle`; none if `safe` fails inside or a run never enters."""
    ends = _ends_of_box(middle, half, held)
    inside = [
        np.all([(e[0] <= x[:, s]) & (x[:, s] <= e[1]) for s, e in ends.items()], axis=0)
        for x in (np.array(t.states) for t in runs)
    ]
    entered = [(t, int(np.argmax(i))) for t, i in zip(runs, inside, strict=True) if i.any()]
    if len(entered) < len(runs) or not _lies_in_safe(found, runs, ends):
        return
    conditions = " && ".join(_condition_text(found.names[s], *e) for s, e in ends.items())
    farther: Hints | None = None
    for factor in reversed(FARTHER):
        moves = ", ".join(_moves_in_words(found, entered, s, factor) for s in moving)
        clause = f"rest {conditions}{' moves ' * bool(moves)}{moves} within"
        first, longer = (f"{clause} {duration_text(x)};" for x in _times_in_box(found, entered))
        farther = Hints(clauses=(first,), longer=longer, farther=farther if moves else None)
    if farther is not None:
        yield farther


def _times_in_box(found: ModelStates, entered: list[tuple[ModelTrace, int]]) -> list[float]:
    """Two times in seconds by which all runs have entered the box, the shorter time first."""
    latest, least_s = max(t.times[k] for t, k in entered), 4 * found.period_s
    return [max(x * latest, least_s) + found.problem.times.jitter_sc * NS for x in LATER]


def _moves_in_words(
    found: ModelStates, entered: list[tuple[ModelTrace, int]], s: int, factor: float
) -> str:
    """An item of `moves` with a state's motion after runs enter the box, times `factor`."""
    after = [np.array(t.states)[k:, s] - t.states[k][s] for t, k in entered]
    ways = [-min(x.min() for x in after), max(x.max() for x in after)]
    width = found.far[1][s] - found.far[0][s]
    down, up = (
        rounded_outward(factor * float(w) + max(width, LEAST) / 1000, up=True) for w in ways
    )
    name, (below, above) = found.names[s], found.limited_in_safe[s]
    if below == above:
        return f"{name} by {max(down, up)!r}"
    return f"{name} by {up!r} up" if above else f"{name} by {down!r} down"


def _ends_of_box(middle: Floats, half: Floats, held: list[int]) -> dict[int, tuple[float, float]]:
    """The rounded ends of a box for the states in `held`, by state."""
    return {s: _rounded_ends(middle[s] - half[s], middle[s] + half[s]) for s in held}


def _rounded_ends(low: float, high: float) -> tuple[float, float]:
    """The ends rounded outward, and made symmetric around 0 if they nearly are."""
    low, high = rounded_outward(float(low), up=False), rounded_outward(float(high), up=True)
    if abs(low + high) < 0.35 * max(-low, high):
        return -max(-low, high), max(-low, high)
    return low, high


def hints_with_box(hints: Hints, box: Mapping[str, Interval]) -> Hints:
    """The hints with another box in the clause `rest`; `box` has a range for each topic leaf."""
    ends = {name: _rounded_ends(r.low, r.high) for name, r in box.items()}
    condition = " && ".join(_condition_text(name, *e) for name, e in ends.items())

    def clause_with_box(clause: str) -> str:
        return f"rest {condition} within{clause.rpartition(' within')[2]}"

    longer = hints.longer and clause_with_box(hints.longer)
    return Hints(clauses=(clause_with_box(hints.clauses[0]), *hints.clauses[1:]), longer=longer)


def _condition_text(name: str, low: float, high: float) -> str:
    return f"abs({name}) < {high!r}" if low == -high else f"{name} > {low!r} && {name} < {high!r}"


def _lies_in_safe(
    found: ModelStates, runs: list[ModelTrace], ends: dict[int, tuple[float, float]]
) -> bool:
    """Whether `safe` holds at some drawn corners of the box, in which runs end."""
    draw = np.random.default_rng(5)
    for trace in runs[:STARTS]:
        for _ in range(8):
            x = trace.states[-1].copy()
            for s, e in ends.items():
                x[s] = draw.choice(e)
            if found.model.safe(trace.states[-1]) == TRUE and found.model.safe(x) != TRUE:
                return False
    return True
