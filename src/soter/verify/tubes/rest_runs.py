"""Runs that SC does not lead back: what a proof of rest lacks, as a figure, in a moment.

Purpose: `runs_from` a box: where runs in doubles are, from its corners and under disturbances at
their ends, and one of them, if there is, that no tube shows to be back in the box.
Non-goals: verdicts: that all of these runs come back shows nothing (`leading_back.py` does).

SC reads what is true and new, as it may, and all begins at an output of it, as in rule 1 of
"Decisions by tubes" (docs/proof.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expressions import in_order
from soter.verify.tubes.module_expressions import middle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.verify.tubes.expressions import Node
    from soter.verify.tubes.tube_check import TubeCheck

    Values = NDArray[np.float64]

CORNERS_MAX = 64
PLACES = 7
"""Into so many parts ranges of states that need not come back are cut."""
STEPS_MAX = 20_000
"""Of one run."""
STILL = 1e-9
"""Of the width of its side: a state that moves less in a hold has come to where it stays."""
OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "over": np.divide,
    "neg": np.negative,
    "square": np.square,
    "inverse": np.reciprocal,
    "friction": lambda x, k: x / (np.abs(x) + k),
    "min": np.minimum,
    "max": np.maximum,
    "limit": lambda x, low, high: np.minimum(np.maximum(x, low), high),
    "select": np.where,
    "and": np.logical_and,
    "or": np.logical_or,
    "positive": lambda x: x > 0.0,
    "not negative": lambda x: x >= 0.0,
    "wrap_angle": lambda x: np.arctan2(np.sin(x), np.cos(x)),
    "atan": np.arctan,
    **{name: getattr(np, name) for name in ("abs", "sin", "cos", "exp", "sqrt", "tan", "tanh")},
}


@dataclass(frozen=True)
class Astray:
    """A run that is never back: it began at `start` (by state) under `disturbed` (by disturbance).

    `state` is at `value` when it was followed for `after_s`.
    """

    state: int
    value: float
    after_s: float
    start: dict[int, float]
    disturbed: dict[int, float]


@dataclass(frozen=True)
class RestRuns:
    """`reached`: where all runs are in the end, by state that has to come back."""

    reached: dict[int, Interval]
    astray: Astray | None


def runs_from(check: TubeCheck, box: Mapping[int, Interval], own: Sequence[int]) -> RestRuns | None:
    """Runs from a box, of which the sides `own` have to come back; None: not to be followed.

    A start is astray where at no output of SC all its runs, one under each disturbance, are back:
    a part of the box that holds it is then not shown either.
    """
    if not (flow := _Flow.of(check)):
        return None
    starts, winds = _starts(check, box, own), _winds(check)
    x = np.repeat(starts, len(winds), axis=0).T
    w = np.tile(winds, (len(starts), 1)).T
    rows = [check.states.index(s) for s in own]
    low, high = (np.array([[getattr(box[s], e)] for s in own]) for e in ("low", "high"))
    wide = np.maximum(high - low, np.finfo(float).tiny)
    back = np.zeros(len(starts), dtype=bool)
    n, still = 0, False
    with np.errstate(all="ignore"):
        while n < check.times.switches and not (still or back.all()):
            n += 1
            before, x = x, flow.after_a_hold(x, w)
            off = np.maximum(low - x[rows], x[rows] - high) / wide
            off = np.where(np.isfinite(off), off, np.inf).reshape(len(own), len(starts), -1)
            back |= (off <= 0.0).all(axis=(0, 2))
            still = bool((np.abs(x - before)[rows] <= STILL * wide).all())
        ends = x[rows]
        reached = {
            s: Interval(float(np.nanmin(of)), float(np.nanmax(of))) if np.isfinite(of).any()
            else Interval(-np.inf, np.inf)
            for s, of in zip(own, ends, strict=True)
        }  # fmt: skip
    if back.all():
        return RestRuns(reached, None)
    gone = np.where(back[None, :, None], -np.inf, off)
    state, start, wind = (int(k) for k in np.unravel_index(gone.argmax(), gone.shape))
    run = start * len(winds) + wind
    return RestRuns(
        reached,
        Astray(
            own[state],
            float(ends[state, run]),
            n * check.times.period * 1e-9,
            dict(zip(check.states, map(float, starts[start]), strict=True)),
            dict(enumerate(map(float, winds[wind]))),
        ),
    )


def _starts(check: TubeCheck, box: Mapping[int, Interval], own: Sequence[int]) -> Values:
    """Starts (n, states): corners of the sides that have to come back, the rest at some places."""
    sides = [[box[s].low, box[s].high] for s in own]
    corners = [list(c) for c in product(*sides)] if 2 ** len(own) <= CORNERS_MAX else []
    if not corners:
        ends = [[side[0] for side in sides], [side[1] for side in sides]]
        corners = list(ends)
        for of, other in (ends, ends[::-1]):
            corners += [[*of[:k], other[k], *of[k + 1 :]] for k in range(len(sides))]
    rest = [box.get(s, Interval(0.0, 0.0)) for s in check.states]
    rest = [r if np.isfinite(r.high - r.low) else Interval(0.0, 0.0) for r in rest]
    others = [[r.low + (r.high - r.low) * k / PLACES for r in rest] for k in range(PLACES + 1)]
    starts = np.array([other for _ in corners for other in others])
    starts[:, [check.states.index(s) for s in own]] = np.repeat(corners, len(others), axis=0)
    return starts


def _winds(check: TubeCheck) -> Values:
    """Disturbances (n, disturbances): in the middle, at an end each, one of them at an end."""
    ranges = check.problem.disturbances
    still = [middle(d) for d in ranges]
    every = [still, [d.low for d in ranges], [d.high for d in ranges]]
    every += [
        [*still[:k], e, *still[k + 1 :]] for k, d in enumerate(ranges) for e in (d.low, d.high)
    ]
    return np.array(every)


@dataclass(frozen=True)
class _Flow:
    """What moves states, over arrays of numbers, a column a run."""

    check: TubeCheck
    steps: int

    @classmethod
    def of(cls, check: TubeCheck) -> _Flow | None:
        """None where some operation is none of those above."""
        known = {"number", "input", "known", *OPERATIONS}
        rates = [check.rates[s] for s in check.states]
        if any(e.op not in known for e in in_order([*rates, *check.law])):
            return None
        fine = -(-check.times.period // max(1, check.problem.plant_period_ns))
        return cls(check, max(2, min(fine, STEPS_MAX // max(1, check.times.switches))))

    def after_a_hold(self, x: Values, w: Values) -> Values:
        """States one output of SC later, by Runge-Kutta."""
        check, runs = self.check, x.shape[1]
        step = check.times.period * 1e-9 / self.steps
        read = {("y", s): x[k] for k, s in enumerate(check.states)}
        given = {("u", k): u for k, u in enumerate(_values(check.law, read, runs))}
        given |= {("w", k): wind for k, wind in enumerate(w)}
        rates = [check.rates[s] for s in check.states]

        def rate(at: Values) -> Values:
            states = {("x", s): at[k] for k, s in enumerate(check.states)}
            return np.array(_values(rates, {**given, **states}, runs))

        for _ in range(self.steps):
            a = rate(x)
            b = rate(x + 0.5 * step * a)
            c = rate(x + 0.5 * step * b)
            d = rate(x + step * c)
            x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return x


def _values(
    roots: Sequence[Node], inputs: Mapping[tuple[str, int], Values], runs: int
) -> list[Values]:
    """Expressions of numbers, (runs,) each."""
    found: dict[Node, Any] = {}
    for e in in_order(roots):
        if e.op in ("number", "known"):
            found[e] = np.full(runs, e.of[0])
        elif e.op == "input":
            found[e] = inputs[e.of]
        else:
            found[e] = OPERATIONS[e.op](*(found[x] for x in e.of))
    return [found[e] for e in roots]
