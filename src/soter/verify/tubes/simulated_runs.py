"""Simulates many runs of SC from a box around rest at once, in doubles, before a tube is asked.

Purpose: `runs_from` starts runs at corners of the box, under extreme disturbances, with exact and
new reads. If at no output of SC all runs from one start are back in the box, no tube can show that
start. `values_of_nodes` computes expressions at many points.
Non-goals: verdicts by runs: if all simulated runs come back, that proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import in_order, middle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.tube_check import TubeCheck

    Values = NDArray[np.float64]


CORNERS_MAX = 64
PLACES = 7
"""Along the range of a state that need not come back runs start at one more place than this."""
STEPS_MAX = 20_000
"""The most Runge-Kutta steps of one run."""
STILL = 1e-9
"""A state that moves less than this share of the box's width between outputs of SC has settled."""
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
    "sign": lambda x: x > 0.0,
    "not negative": lambda x: x >= 0.0,
    "any_turn": np.positive,
    "wrap_angle": lambda x: np.arctan2(np.sin(x), np.cos(x)),
    "real_sin": np.sin,
    "real_cos": np.cos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "asin": np.arcsin,
    "acos": np.arccos,
    **{
        name: getattr(np, name)
        for name in ("abs", "sin", "cos", "exp", "log", "sqrt", "tan", "tanh")
    },
}


@dataclass(frozen=True)
class RunNotBack:
    """A simulated run that did not come back into the box.

    `start` has the run's first state and `disturbed` its disturbances, by number. After `after_s`
    seconds `state` was at `value`. `calm` says that it is as far out without disturbances.
    """

    state: int
    value: float
    after_s: float
    start: dict[int, float]
    disturbed: dict[int, float]
    calm: bool


@dataclass(frozen=True)
class RestRuns:
    """The results of simulated runs: `reached` has the end ranges, `astray` a run left outside."""

    reached: dict[int, Interval]
    astray: RunNotBack | None


def runs_from(
    check: TubeCheck, box: Mapping[int, Interval], asked: Sequence[int]
) -> RestRuns | None:
    """Simulates runs from `box`, which have to come back in the states `asked`.

    A start is astray if at no output of SC all its runs, one per disturbance, are back; no part of
    the box with this start can then be shown. Returns None if an operation cannot be simulated.
    """
    if not (flow := _SimulatedRuns.of_check(check)):
        return None
    start_points, disturbances = _start_points(check, box, asked), _disturbance_samples(check)
    states = np.repeat(start_points, len(disturbances), axis=0).T
    disturbance_by_run = np.tile(disturbances, (len(start_points), 1)).T
    rows = [check.states.index(s) for s in asked]
    low, high = (np.array([[getattr(box[s], e)] for s in asked]) for e in ("low", "high"))
    width = np.maximum(high - low, np.finfo(float).tiny)
    back = np.zeros(len(start_points), dtype=bool)
    outputs, settled = 0, False
    with np.errstate(all="ignore"):
        while outputs < check.times.switches and not (settled or back.all()):
            outputs += 1
            before, states = states, flow.states_after_hold(states, disturbance_by_run)
            distance = np.maximum(low - states[rows], states[rows] - high) / width
            distance = np.where(np.isfinite(distance), distance, np.inf).reshape(
                len(asked), len(start_points), -1
            )
            back |= (distance <= 0.0).all(axis=(0, 2))
            settled = bool((np.abs(states - before)[rows] <= STILL * width).all())
        ends = states[rows]
        reached = {
            s: Interval(float(np.nanmin(of)), float(np.nanmax(of))) if np.isfinite(of).any()
            else Interval(-np.inf, np.inf)
            for s, of in zip(asked, ends, strict=True)
        }  # fmt: skip
    if back.all():
        return RestRuns(reached, None)
    distance_if_astray = np.where(back[None, :, None], -np.inf, distance)
    state, start, wind = (
        int(k) for k in np.unravel_index(distance_if_astray.argmax(), distance_if_astray.shape)
    )
    run = start * len(disturbances) + wind
    return RestRuns(
        reached,
        RunNotBack(
            asked[state],
            float(ends[state, run]),
            outputs * check.times.period * 1e-9,
            dict(zip(check.states, map(float, start_points[start]), strict=True)),
            dict(enumerate(map(float, disturbances[wind]))),
            bool(distance[state, start, 0] > 1.0),
        ),
    )


def _start_points(check: TubeCheck, box: Mapping[int, Interval], asked: Sequence[int]) -> Values:
    """Starts, shape (n, states): each corner in the states `asked`, the others at each place."""
    corners = _box_corners([[box[s].low, box[s].high] for s in asked])
    rest = [box.get(s, Interval(0.0, 0.0)) for s in check.states]
    rest = [r if np.isfinite(r.high - r.low) else Interval(0.0, 0.0) for r in rest]
    others = [[r.low + (r.high - r.low) * k / PLACES for r in rest] for k in range(PLACES + 1)]
    starts = np.array([other for _ in corners for other in others])
    starts[:, [check.states.index(s) for s in asked]] = np.repeat(corners, len(others), axis=0)
    return starts


def _box_corners(sides: Sequence[list[float]]) -> list[list[float]]:
    """The corners of a box; of many sides only the corners with all but one at the same end."""
    if 2 ** len(sides) <= CORNERS_MAX:
        return [list(c) for c in product(*sides)]
    ends = [[side[0] for side in sides], [side[1] for side in sides]]
    corners = list(ends)
    for of, other in (ends, ends[::-1]):
        corners += [[*of[:k], other[k], *of[k + 1 :]] for k in range(len(sides))]
    return corners


def _disturbance_samples(check: TubeCheck) -> Values:
    """Samples (n, disturbances): all in the middle, all at one end, and only one at an end."""
    ranges = check.problem.disturbances
    still = [middle(d) for d in ranges]
    every = [still, [d.low for d in ranges], [d.high for d in ranges]]
    every += [
        [*still[:k], e, *still[k + 1 :]] for k, d in enumerate(ranges) for e in (d.low, d.high)
    ]
    return np.array(every)


@dataclass(frozen=True)
class _SimulatedRuns:
    """Simulates many runs at once, with arrays of states of shape (states, runs)."""

    check: TubeCheck
    steps: int

    @classmethod
    def of_check(cls, check: TubeCheck) -> _SimulatedRuns | None:
        """The simulation for a check; None if `OPERATIONS` has not all operations of the check."""
        if not has_known_operations(check):
            return None
        fine = -(-check.times.period // max(1, check.problem.plant_period_ns))
        return cls(check, max(2, min(fine, STEPS_MAX // max(1, check.times.switches))))

    def states_after_hold(self, x: Values, w: Values) -> Values:
        """The states after one period of SC under one held command, by Runge-Kutta steps."""
        check, runs = self.check, x.shape[1]
        step = check.times.period * 1e-9 / self.steps
        read = {("y", s): x[k] for k, s in enumerate(check.states)}
        read |= {("l", k): np.full(runs, middle(r)) for k, r in enumerate(check.kept)}
        inputs = {("u", k): u for k, u in enumerate(values_of_nodes(check.law, read, runs))}
        inputs |= {("w", k): wind for k, wind in enumerate(w)}
        rates = [check.rates[s] for s in check.states]

        def rate(at: Values) -> Values:
            states = {("x", s): at[k] for k, s in enumerate(check.states)}
            return np.array(values_of_nodes(rates, {**inputs, **states}, runs))

        for _ in range(self.steps):
            a = rate(x)
            b = rate(x + 0.5 * step * a)
            c = rate(x + 0.5 * step * b)
            d = rate(x + step * c)
            x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return x


def has_known_operations(check: TubeCheck) -> bool:
    """Whether `values_of_nodes` can compute all operations of the rates and of SC."""
    every = in_order([*(check.rates[s] for s in check.states), *check.law])
    return {e.op for e in every} <= {"number", "input", "known", *OPERATIONS}


def values_of_nodes(
    roots: Sequence[Node], inputs: Mapping[tuple[str, int], Values], runs: int
) -> list[Values]:
    """The values of the expressions at these inputs, an array of shape (runs,) for each."""
    found: dict[Node, Any] = {}
    for e in in_order(roots):
        if e.op in ("number", "known"):
            found[e] = np.full(runs, e.of[0])
        elif e.op == "input":
            found[e] = inputs[e.of]
        else:
            found[e] = OPERATIONS[e.op](*(found[x] for x in e.of))
    return [found[e] for e in roots]
