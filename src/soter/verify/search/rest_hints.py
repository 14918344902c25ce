"""Clauses `rest` to try: where runs of the model under SC end, what still moves there, how soon.

Purpose: `rest_hints` simulates SC from the farthest states that it still rescues. A state whose end
does not hang on where the run began is held: it stands in the condition. Any other one moves, by as
much as it did after the condition held first, or, tried later, by more. Larger boxes come later.
Non-goals: whether SC keeps such a box: that is proved (`tubes/rest_claims.py`), or not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.verify.diagnosis.model_runs import NS, TRUE
from soter.verify.search.hint_text import Hints
from soter.verify.search.model_states import SETTLED
from soter.verify.search.written_numbers import duration_text, rounded_outward

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.core.layout import Floats
    from soter.verify.diagnosis.model_runs import ModelTrace
    from soter.verify.search.model_states import ModelStates

LONG = 1000
"""Runs that have to end are as long as this many periods of SC."""
STARTS = 9
LAST = 0.8
"""The share of a run after which it is taken to be at its end."""
FROM = (0.5, 0.25, 0.12, 0.06)
"""Larger boxes, around the same place, hold what runs pass through after these shares of the time
of `ModelStates.holds`."""
HANGS = 0.1
"""A state hangs on where the run began if its ends differ by this share of what was reached."""
FOLLOWS = 0.95
"""Or if its end follows where it began by this share."""
AROUND, LATER = 1.3, (1.3, 2.2)
"""By these factors a box is larger than where runs end, and a time longer than they took: first by
the one, then, where SC is shown to keep the box and not to lead there in time, by the other."""
LEAST = 1e-3
"""The least width of what runs of a state passed through: a bound of 0 leaves no room to round."""
FARTHER = 1.5, 6.0
"""By these factors states move farther than runs do, tried in the same way."""


def rest_hints(found: ModelStates) -> Iterator[Hints]:
    """Clauses to try, smaller boxes first."""
    starts = [*found.points[-1:], *found.points[:-1]][:STARTS]
    runs = found.runs(starts, LONG)
    if not runs:
        return
    width = np.maximum(found.far[1] - found.far[0], 1e-9)
    held, moving = _held_and_moving(found, runs, width)
    if not held or not found.problem.topic_leaf_of_state.keys() >= {*held, *moving}:
        return  # `rest` and `moves` speak of topics, and none shows this state
    least = found.errors / 2 + width / 150
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
            half = AROUND * (reach + found.errors / 2)
        if (half > AROUND * before)[held].any():
            yield from _hints_of_box(found, runs, middle, half, held, moving)
        before = half


def _held_and_moving(
    found: ModelStates, runs: list[ModelTrace], width: Floats
) -> tuple[list[int], list[int]]:
    """The states that stand in the condition, and those in `moves`; adds runs that began elsewhere.

    A state stands in neither that goes on for ever on a way with a bound, or that rates or SC read
    though no set bounds it: a bound of it is not followed.
    """
    quiet = np.array([t.states[-1] for t in runs[:: len(found.patterns)]])
    hangs = np.ptp(quiet, axis=0) > HANGS * width
    for s, more in _moved_starts(found, width).items():
        hangs[s] = True
        runs += more
    late = np.array([t.states[-1] - t.states[int(LAST * len(t.states))] for t in runs])
    down, up = (late < -SETTLED * width).any(axis=0), (late > SETTLED * width).any(axis=0)
    below, above = found.limited.T
    bounded = hangs & ~((down & (below | ~above)) | (up & (above | ~below)))
    return (
        [int(s) for s in np.flatnonzero(~hangs & found.needed)],
        [int(s) for s in np.flatnonzero(bounded & found.needed) if _may_move(found, int(s))],
    )


def _may_move(found: ModelStates, s: int) -> bool:
    """Whether `moves` may name a state: only `safe` reads it, or a set of its topic bounds it."""
    at = found.problem.topic_leaf_of_state.get(s)
    has_set = at is not None and found.problem.system.topics[at[0]].bounds[at[1]] is not None
    return has_set or not np.delete(found.reads, s, axis=0)[:, s].any()


def _moved_starts(found: ModelStates, width: Floats) -> dict[int, list[ModelTrace]]:
    """For each state that ends farther along if it began farther along, the runs that began so."""
    middle, moved = found.points[0], {}
    at = found.runs([middle], LONG)
    for s, (low, high) in enumerate(found.ends):
        away = min((high - low) / 4, 4 * width[s])
        start = middle.copy()
        start[s] += away
        runs = found.runs([start], LONG)
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
    """Clauses with a box around `middle`; none if `safe` fails in it, or a run stays out."""
    ends = _ends_of_box(middle, half, held)
    inside = [
        np.all([(e[0] <= x[:, s]) & (x[:, s] <= e[1]) for s, e in ends.items()], axis=0)
        for x in (np.array(t.states) for t in runs)
    ]
    entered = [(t, int(np.argmax(i))) for t, i in zip(runs, inside, strict=True) if i.any()]
    if len(entered) < len(runs) or not _lies_in_safe(found, runs, ends):
        return
    conditions = " && ".join(_condition(found.names[s], *e) for s, e in ends.items())
    farther: Hints | None = None
    for factor in reversed(FARTHER):
        moves = ", ".join(_moves_in_words(found, entered, s, factor) for s in moving)
        clause = f"rest {conditions}{' moves ' * bool(moves)}{moves} within"
        first, longer = (f"{clause} {duration_text(x)};" for x in _times_in_box(found, entered))
        farther = Hints(clauses=(first,), longer=longer, farther=farther if moves else None)
    if farther is not None:
        yield farther


def _times_in_box(found: ModelStates, entered: list[tuple[ModelTrace, int]]) -> list[float]:
    """Times in s within which runs are in the box, the shorter one first."""
    latest, least_s = max(t.times[k] for t, k in entered), 4 * found.period_s
    return [max(x * latest, least_s) + found.problem.times.jitter_sc * NS for x in LATER]


def _moves_in_words(
    found: ModelStates, entered: list[tuple[ModelTrace, int]], s: int, factor: float
) -> str:
    """How far a state moves, times a factor, after runs entered the box: an item of `moves`."""
    after = [np.array(t.states)[k:, s] - t.states[k][s] for t, k in entered]
    ways = [-min(x.min() for x in after), max(x.max() for x in after)]
    width = found.far[1][s] - found.far[0][s]
    down, up = (
        rounded_outward(factor * float(w) + max(width, LEAST) / 1000, up=True) for w in ways
    )
    name, (below, above) = found.names[s], found.limited[s]
    if below == above:
        return f"{name} by {max(down, up)!r}"
    return f"{name} by {up!r} up" if above else f"{name} by {down!r} down"


def _ends_of_box(middle: Floats, half: Floats, held: list[int]) -> dict[int, tuple[float, float]]:
    """The ends of a box in the states that are held, as they are written."""
    return {s: _symmetric(middle[s] - half[s], middle[s] + half[s]) for s in held}


def _symmetric(low: float, high: float) -> tuple[float, float]:
    """The ends, rounded; equal but for the sign if they nearly are."""
    low, high = rounded_outward(float(low), up=False), rounded_outward(float(high), up=True)
    if abs(low + high) < 0.35 * max(-low, high):
        return -max(-low, high), max(-low, high)
    return low, high


def _condition(name: str, low: float, high: float) -> str:
    return f"abs({name}) < {high!r}" if low == -high else f"{name} > {low!r} && {name} < {high!r}"


def _lies_in_safe(
    found: ModelStates, runs: list[ModelTrace], ends: dict[int, tuple[float, float]]
) -> bool:
    """Whether `safe` holds at corners of the box that were drawn, around ends of runs."""
    draw = np.random.default_rng(5)
    for trace in runs[:STARTS]:
        for _ in range(8):
            x = trace.states[-1].copy()
            for s, e in ends.items():
                x[s] = draw.choice(e)
            if found.model.safe(trace.states[-1]) == TRUE and found.model.safe(x) != TRUE:
                return False
    return True
