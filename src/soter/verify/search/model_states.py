"""The states of a module, by runs of the model: their ranges, which of them move together.

Purpose: `ModelStates` simulates the module's plants under SC and under extreme commands, from the
declared start. It has ranges of states from which SC stays in `safe`, the ends that `safe` gives a
state, the states that move together, and how far each moves while a command is held. All of it is
measured at points, so it may be wrong; a search begins with it, and a proof decides.
Non-goals: hints (`grid_hints.py`, `rest_hints.py`); the simulation (`model_runs.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import ceil, inf
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.types import leaf_name, leaves
from soter.verify.diagnosis.model_runs import FALSE, NS, PointModel, patterns_to_try, run_of_sc
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.grid.case import Case
from soter.verify.problem.extract import parameter_cases
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.core.layout import Bools, Floats
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern
    from soter.verify.problem.problem import Interval, Problem

HOLDS = 400
"""Runs under SC last for this many periods of SC at most."""
PUSHES = 64
"""Extreme commands are held for this many horizons H at most."""
CORNERS_MAX = 8
SAMPLES = 40
FARTHEST = 1e7
"""Ends of `safe` farther away than this, in units of the state, count as none."""
STEPS_MAX = 60_000
"""After this many steps of simulation no further push is simulated."""
LEAST_HOLDS, SETTLED = 40, 0.02
"""The fewest periods of SC in a run; it is twice as long as it took until each state stayed at its
final value, up to this share of the range that the state passed through."""


@dataclass(eq=False)
class ModelStates:
    """Measurements, by runs of the model, of the states of a problem, one array entry a state.

    `names`: those in hints. `ends`: (states, 2), where `safe` ends along a line through the start;
    inf: nowhere. `far`: (2, states), the ranges reached by runs whose start was pushed by commands
    as far as SC can still rescue; `near`: half as far. `points`: the farthest starts.
    """

    problem: Problem
    model: PointModel
    names: tuple[str, ...]
    patterns: list[Pattern]
    ends: Floats
    near: Floats
    far: Floats
    points: list[Floats] = field(default_factory=list)
    rescued: bool = False
    """Whether SC keeps all runs from the declared start in `safe`."""
    holds: int = HOLDS
    """The number of periods of SC that a run lasts."""
    steps_done: int = 0

    @classmethod
    def of_problem(cls, problem: Problem, has_time_left: Callable[[], bool]) -> ModelStates:
        """The measurements for a problem on any grid that holds the start, as one cell an axis."""
        library, _ = library_of(problem)
        parameter = next(iter(parameter_cases(problem)))
        model = PointModel(
            Case(problem, parameter, CompiledEnclosures(library, problem, parameter))
        )
        at = np.array([model.start, model.start])
        found = cls(problem, model, _names_in_hints(problem), _some_patterns(model), at, at, at)
        found.ends = found._ends_of_safe()
        found._explore(has_time_left)
        return found

    @property
    def period_s(self) -> float:
        """The period of SC in s."""
        return self.problem.times.delta_sc * NS

    def runs_from(self, starts: Sequence[Floats], holds: int) -> list[ModelTrace]:
        """The runs under SC from each start (states,) with each pattern, if states stay finite."""
        made = (
            run_of_sc(self.model, x, p, holds * self.period_s, lambda: True, beyond=True)
            for x in starts
            for p in self.patterns
        )
        return [trace for trace in made if np.isfinite(trace.states[-1]).all()]

    def _ends_of_safe(self) -> Floats:
        start, ends = self.model.start, []
        for state in range(len(start)):
            for sign in (-1.0, 1.0):
                far, inner = max(1e-3, 1e-3 * abs(start[state])), 0.0
                while far < FARTHEST and not self._is_unsafe(state, sign * far):
                    inner, far = far, 2.0 * far
                for _ in range(60 if far < FARTHEST else 0):
                    middle = (inner + far) / 2
                    inner, far = (
                        (inner, middle) if self._is_unsafe(state, sign * middle) else (middle, far)
                    )
                ends.append(start[state] + sign * far if far < FARTHEST else sign * inf)
        return np.array(ends).reshape(-1, 2)

    def _is_unsafe(self, state: int, by: float) -> bool:
        x = self.model.start
        x[state] += by
        return self.model.safe(x) == FALSE

    def _explore(self, has_time_left: Callable[[], bool]) -> None:
        start = self.model.start
        self.holds = self._holds_until_settled()
        traces = self._rescued_runs(start)
        self.rescued = traces is not None
        near = [np.array([start]), *(np.array(trace.states) for trace in traces or ())]
        far: list[Floats] = []
        for u, w in self._pushes() if self.rescued else ():
            if self.steps_done > STEPS_MAX or not has_time_left():
                break
            pushed = self._pushed_states(start, u, w)
            k = self._last_rescued_index(pushed)
            self.points.append(pushed[k])
            for at, kept in ((k // 2, near), (k, far)):
                kept += [np.array(pushed[: at + 1])]
                kept += [np.array(trace.states) for trace in self._rescued_runs(pushed[at]) or ()]
        self.near = _range_of_states(near)
        self.far = _range_of_states([*near, *far])
        self.points += [start]

    def _holds_until_settled(self) -> int:
        """Twice the SC periods that states need to settle after pushes, but at most `HOLDS`."""
        pushed = [self._pushed_states(self.model.start, u, w)[:8][-1] for u, w in self._pushes()]
        needed = LEAST_HOLDS
        for x in pushed[:: max(1, len(pushed) // 3)]:
            trace = run_of_sc(
                self.model, x, self.patterns[0], HOLDS * self.period_s, lambda: True, beyond=True
            )
            states = np.array(trace.states)
            if not np.isfinite(states).all():
                return HOLDS
            still = np.abs(states - states[-1]) <= SETTLED * np.maximum(
                np.ptp(states, axis=0), 1e-9
            )
            moved = np.flatnonzero(~still.all(axis=1))
            last = trace.times[moved[-1]] if len(moved) else 0.0
            needed = max(needed, int(2.0 * last / self.period_s))
        return min(needed, HOLDS)

    def _pushes(self) -> list[tuple[Floats, Floats]]:
        """Pairs of commands at ends of their ranges and disturbances at ends of theirs."""
        corners = [np.array(c) for c in product(*((u.low, u.high) for u in self.problem.controls))]
        if len(corners) > CORNERS_MAX:
            drawn = np.random.default_rng(0).choice(len(corners), CORNERS_MAX, replace=False)
            corners = [corners[k] for k in sorted({0, len(corners) - 1, *drawn})]
        winds = [
            np.array([getattr(w, e) for w in self.problem.disturbances]) for e in ("low", "high")
        ]
        return [
            (u, w) for u in corners for w in (winds if self.problem.disturbances else winds[:1])
        ]

    def _pushed_states(self, start: Floats, u: Floats, w: Floats) -> list[Floats]:
        """The states after 0, 1, ... horizons H of a held command, while `safe` may hold."""
        horizon = self.problem.whole_periods(self.problem.times.horizon_ns)
        steps = max(1, round(horizon / self.problem.plant_period_ns))
        x, states = start, [start]
        if not self.model.is_map:
            most = self.model.longest_step_s(start, u, w)
            steps = min(steps, max(50, ceil(horizon * NS / most)))
        for _ in range(PUSHES):
            for _ in range(steps):
                x = self.model.rate(x, u, w) if self.model.is_map else self.model.step_rk4(
                    x, u, w, horizon * NS / steps
                )  # fmt: skip
            if not np.isfinite(x).all() or self.model.safe(x) == FALSE:
                break
            states.append(x)
        return states

    def _last_rescued_index(self, states: list[Floats]) -> int:
        """The index of the last of `states` from which SC stays in `safe`, by bisection."""
        low, high = 0, len(states)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (
                (middle, high) if self._rescued_runs(states[middle]) is not None else (low, middle)
            )
        return low

    def _rescued_runs(self, x: Floats) -> list[ModelTrace] | None:
        """The runs under SC from a state, one per pattern; None if a run leaves `safe`."""
        traces = []
        for pattern in self.patterns:
            trace = run_of_sc(self.model, x, pattern, self.holds * self.period_s, lambda: True)
            self.steps_done += len(trace.times)
            if (trace.left and trace.safe) or not np.isfinite(trace.states[-1]).all():
                return None
            traces.append(trace)
        return traces

    @cached_property
    def rate_reads(self) -> Bools:
        """For each pair, shape (states, states), whether a state's rate with SC reads the other."""
        draw, (low, high) = np.random.default_rng(1), self._ranges_to_draw_from()
        states, controls = len(self.names), len(self.problem.controls)
        rates, laws = np.zeros((states, states), bool), np.zeros((controls, states), bool)
        moved = np.zeros((states, controls), bool)
        errors, others = (
            np.array([i.low / 2 + i.high / 2 for i in of])
            for of in (self.problem.errors, self.problem.others)
        )
        u_ends, w_ends = _ends_of(self.problem.controls), _ends_of(self.problem.disturbances)
        for _ in range(SAMPLES):
            x, u, w = draw.uniform(low, high), draw.uniform(*u_ends), draw.uniform(*w_ends)
            rate, law = self.model.rate(x, u, w), self.model.law(x, errors, others)
            for j in range(states):
                other = x.copy()
                other[j] = draw.uniform(low[j], high[j])
                rates[:, j] |= self.model.rate(other, u, w) != rate
                laws[:, j] |= self.model.law(other, errors, others) != law
            for k in range(controls):
                command = u.copy()
                command[k] = draw.uniform(u_ends[0][k], u_ends[1][k])
                moved[:, k] |= self.model.rate(x, command, w) != rate
        return np.asarray(rates | (moved.astype(int) @ laws.astype(int) > 0))

    @cached_property
    def needs_axis(self) -> Bools:
        """Whether SC, `safe` or another state's rate depends on each state, shape (states,)."""
        others = self.rate_reads & ~np.eye(len(self.names), dtype=bool)
        return np.asarray(others.any(axis=0) | self.limited_in_safe.any(axis=1))

    def _ranges_to_draw_from(self) -> Floats:
        """The ranges from which to draw states, as reached; wider for states that stood still."""
        low, high = self.far
        low, high = (
            np.where(np.isfinite(e), e, r) for e, r in zip(self.ends.T, (low, high), strict=True)
        )
        more = np.where(high - low > 0.0, 0.0, np.maximum(1e-3, 1e-3 * np.abs(low)))
        return np.array([low - more, high + more])

    @cached_property
    def compared_in_safe(self) -> Bools:
        """For each pair of states, shape (states, states), whether `safe` compares the two."""
        draw, (low, high) = np.random.default_rng(2), self._ranges_to_draw_from()
        reach = (high - low) / 2
        found = np.zeros((len(self.names), len(self.names)), bool)
        for _ in range(10 * SAMPLES):
            x, y = draw.uniform(low, high), draw.uniform(low - reach, high + reach)
            if self.model.safe(x) == FALSE:
                continue
            single = [self.model.safe(_mixed_state(x, y, i)) != FALSE for i in range(len(x))]
            for i, j in product(range(len(x)), repeat=2):
                if i < j and single[i] and single[j] and not found[i, j]:
                    found[i, j] = found[j, i] = self.model.safe(_mixed_state(x, y, i, j)) == FALSE
        return found

    @cached_property
    def limited_in_safe(self) -> Bools:
        """Whether a smaller or larger value of a state can make `safe` false, (states, 2)."""
        draw, (low, high) = np.random.default_rng(3), self._ranges_to_draw_from()
        found = np.isfinite(self.ends)
        for _ in range(SAMPLES):
            x = draw.uniform(low, high)
            if self.model.safe(x) == FALSE:
                continue
            for state, (side, sign) in product(range(len(x)), ((0, -1.0), (1, 1.0))):
                for far in () if found[state, side] else (1, 10, 1e3, 1e6):
                    y = x.copy()
                    y[state] += sign * far * (high[state] - low[state])
                    found[state, side] |= self.model.safe(y) == FALSE
        return found

    @cached_property
    def estimate_errors(self) -> Floats:
        """The largest error of the estimate of each state, shape (states,)."""
        known = errors_by_state(self.problem)
        return np.array([known.get(s, 0.0) for s in range(len(self.names))])

    @cached_property
    def largest_motion_in_hold(self) -> Floats:
        """How far each state, (states,), may move from a read of SC to the end of the command."""
        draw, (low, high) = np.random.default_rng(4), self._ranges_to_draw_from()
        moved = np.zeros(len(self.names))
        u_ends, w_ends = _ends_of(self.problem.controls), _ends_of(self.problem.disturbances)
        for _ in range(SAMPLES):
            x, u, w = draw.uniform(low, high), draw.uniform(*u_ends), draw.uniform(*w_ends)
            rate = self.model.rate(x, u, w) - (x if self.model.is_map else 0.0)
            moved = np.maximum(moved, np.abs(rate))
        hold = self.period_s + self.problem.times.delay_sc * NS
        return np.asarray((moved if self.model.is_map else moved * hold) + self.estimate_errors)


def _mixed_state(x: Floats, y: Floats, *states: int) -> Floats:
    mixed: Floats = x.copy()
    for state in states:
        mixed[state] = y[state]
    return mixed


def _ends_of(ranges: Sequence[Interval]) -> tuple[Floats, Floats]:
    """The lower ends (n,) and the upper ends (n,) of the ranges."""
    return np.array([i.low for i in ranges]), np.array([i.high for i in ranges])


def _range_of_states(states: Sequence[Floats]) -> Floats:
    every = np.concatenate(states)
    return np.array([every.min(axis=0), every.max(axis=0)])


def _some_patterns(model: PointModel) -> list[Pattern]:
    """A few patterns: the calm one, the first and the last of the others, two random ones."""
    quiet, *worse = patterns_to_try(model)
    drawn = np.random.default_rng(0).integers(0, len(worse), 2) if worse else ()
    chosen = {0, len(worse) - 1, *map(int, drawn)} if worse else set()
    return [quiet, *(worse[k] for k in sorted(chosen))]


def _names_in_hints(problem: Problem) -> tuple[str, ...]:
    """The name of each state in hints, from the topic that shows it, or else from the plant."""
    sc = problem.system.components[problem.module.sc]
    scopes = [
        *(c.scope for c in problem.system.components if c.plant),
        sc.scope,
        problem.module.scope,
    ]
    by_index = {index: symbol for scope in scopes for symbol, index in scope.topics.items()}
    names = []
    for state, leaf in enumerate(problem.quantities.states):
        topic, k = problem.topic_leaf_of_state.get(state, (-1, 0))
        symbol = by_index.get(topic)
        shown = None if symbol is None else leaf_name(symbol.name, list(leaves(symbol.type))[k][0])
        names.append(shown or leaf.name)
    return tuple(names)
