"""States that matter to a module, how far they get, which move together: by runs of the model.

Purpose: `ModelStates` simulates the module's plants under SC and under commands at their ends, from
the declared start, and tells ranges of states from which SC stays in `safe`, the ends that `safe`
gives a state, which states move together, and how far each moves within a hold. All of it is
measured at points, so it may be wrong: it is what a search begins with, and a proof decides.
Non-goals: hints made of it (`grid_hints.py`, `rest_hints.py`); the simulation (`model_runs.py`).
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
from soter.verify.problem.inputs import errors_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.core.layout import Bools, Floats
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern
    from soter.verify.problem.problem import Interval, Problem

HOLDS = 400
"""Runs under SC last for this many of its periods at most."""
PUSHES = 64
"""Commands at their ends are held for so many horizons H at most."""
CORNERS_MAX = 8
SAMPLES = 40
FARTHEST = 1e7
"""A state without an end nearer than this, in its own unit, has none."""
STEPS_MAX = 60_000
"""After so many steps of simulation no further push is followed."""
LEAST_HOLDS, SETTLED = 40, 0.02
"""A run is at least so long, and twice as long as it took until each state stayed at its end, but
for this share of what it passed through."""


@dataclass(eq=False)
class ModelStates:
    """What runs of the model say of the states of a problem, one array entry a state.

    `names`: as hints call them. `ends`: (states, 2), where `safe` ends along an axis through the
    start; inf: nowhere. `near` and `far`: (2, states), the ranges that runs reached whose start is
    half as far, and as far, pushed by commands as SC still rescues. `points`: the farthest starts.
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
    """Whether the runs from the start stay in `safe`."""
    holds: int = HOLDS
    """How many periods of SC a run lasts."""
    steps_done: int = 0

    @classmethod
    def of(cls, problem: Problem, going: Callable[[], bool]) -> ModelStates:
        """Simulates; `problem` is on any grid that holds the start, as one cell an axis."""
        library, _ = library_of(problem)
        parameter = next(iter(parameter_cases(problem)))
        model = PointModel(
            Case(problem, parameter, CompiledEnclosures(library, problem, parameter))
        )
        at = np.array([model.start, model.start])
        found = cls(problem, model, _names(problem), _some_patterns(model), at, at, at)
        found.ends = found._ends_of_safe()
        found._explore(going)
        return found

    @property
    def period_s(self) -> float:
        """SC's period in s."""
        return self.problem.times.delta_sc * NS

    def runs(self, starts: Sequence[Floats], holds: int) -> list[ModelTrace]:
        """Runs under SC from each start, (states,), and under each pattern, those that ended."""
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

    def _explore(self, going: Callable[[], bool]) -> None:
        start = self.model.start
        self.holds = self._holds_until_settled()
        traces = self._rescue(start)
        self.rescued = traces is not None
        near = [np.array([start]), *(np.array(trace.states) for trace in traces or ())]
        far: list[Floats] = []
        for u, w in self._pushes() if self.rescued else ():
            if self.steps_done > STEPS_MAX or not going():
                break
            pushed = self._pushed(start, u, w)
            k = self._last_rescued(pushed)
            self.points.append(pushed[k])
            for at, kept in ((k // 2, near), (k, far)):
                kept += [np.array(pushed[: at + 1])]
                kept += [np.array(trace.states) for trace in self._rescue(pushed[at]) or ()]
        self.near = _range_of(near)
        self.far = _range_of([*near, *far])
        self.points += [start]

    def _holds_until_settled(self) -> int:
        """For how many periods of SC runs are followed: as it needs after pushes, and some more."""
        pushed = [self._pushed(self.model.start, u, w)[:8][-1] for u, w in self._pushes()]
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
        """Commands at their ends, with disturbances at theirs."""
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

    def _pushed(self, start: Floats, u: Floats, w: Floats) -> list[Floats]:
        """The states after 0, 1, ... horizons of a command, while `safe` may hold."""
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

    def _last_rescued(self, states: list[Floats]) -> int:
        """The number of the last state from which SC stays in `safe`, by bisection."""
        low, high = 0, len(states)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (
                (middle, high) if self._rescue(states[middle]) is not None else (low, middle)
            )
        return low

    def _rescue(self, x: Floats) -> list[ModelTrace] | None:
        """The runs from a state under SC; None where one of them leaves `safe`."""
        traces = []
        for pattern in self.patterns:
            trace = run_of_sc(self.model, x, pattern, self.holds * self.period_s, lambda: True)
            self.steps_done += len(trace.times)
            if (trace.left and trace.safe) or not np.isfinite(trace.states[-1]).all():
                return None
            traces.append(trace)
        return traces

    @cached_property
    def reads(self) -> Bools:
        """(states, states): whether a state's rate, with SC, reads another state."""
        draw, (low, high) = np.random.default_rng(1), self._drawn_from()
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
    def needed(self) -> Bools:
        """(states,): whether another state's rate, SC or `safe` hangs on a state."""
        others = self.reads & ~np.eye(len(self.names), dtype=bool)
        return np.asarray(others.any(axis=0) | self.limited.any(axis=1))

    def _drawn_from(self) -> Floats:
        """Ranges to draw states from: those reached, and a little more where a state stood."""
        low, high = self.far
        low, high = (
            np.where(np.isfinite(e), e, r) for e, r in zip(self.ends.T, (low, high), strict=True)
        )
        more = np.where(high - low > 0.0, 0.0, np.maximum(1e-3, 1e-3 * np.abs(low)))
        return np.array([low - more, high + more])

    @cached_property
    def compared(self) -> Bools:
        """(states, states): whether `safe` compares a state with another one."""
        draw, (low, high) = np.random.default_rng(2), self._drawn_from()
        reach = (high - low) / 2
        found = np.zeros((len(self.names), len(self.names)), bool)
        for _ in range(10 * SAMPLES):
            x, y = draw.uniform(low, high), draw.uniform(low - reach, high + reach)
            if self.model.safe(x) == FALSE:
                continue
            single = [self.model.safe(_with(x, y, i)) != FALSE for i in range(len(x))]
            for i, j in product(range(len(x)), repeat=2):
                if i < j and single[i] and single[j] and not found[i, j]:
                    found[i, j] = found[j, i] = self.model.safe(_with(x, y, i, j)) == FALSE
        return found

    @cached_property
    def limited(self) -> Bools:
        """(states, 2): whether less, or more, of a state can make `safe` false somewhere."""
        draw, (low, high) = np.random.default_rng(3), self._drawn_from()
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
    def errors(self) -> Floats:
        """(states,): how far the estimate of each state may be off."""
        known = errors_of(self.problem)
        return np.array([known.get(s, 0.0) for s in range(len(self.names))])

    @cached_property
    def steps(self) -> Floats:
        """How far each state, (states,), moves from a read of SC until its command ends."""
        draw, (low, high) = np.random.default_rng(4), self._drawn_from()
        moved = np.zeros(len(self.names))
        u_ends, w_ends = _ends_of(self.problem.controls), _ends_of(self.problem.disturbances)
        for _ in range(SAMPLES):
            x, u, w = draw.uniform(low, high), draw.uniform(*u_ends), draw.uniform(*w_ends)
            rate = self.model.rate(x, u, w) - (x if self.model.is_map else 0.0)
            moved = np.maximum(moved, np.abs(rate))
        hold = self.period_s + self.problem.times.delay_sc * NS
        return np.asarray((moved if self.model.is_map else moved * hold) + self.errors)


def _with(x: Floats, y: Floats, *states: int) -> Floats:
    mixed: Floats = x.copy()
    for state in states:
        mixed[state] = y[state]
    return mixed


def _ends_of(ranges: Sequence[Interval]) -> tuple[Floats, Floats]:
    """The lower and the upper ends, (n,) each."""
    return np.array([i.low for i in ranges]), np.array([i.high for i in ranges])


def _range_of(states: Sequence[Floats]) -> Floats:
    every = np.concatenate(states)
    return np.array([every.min(axis=0), every.max(axis=0)])


def _some_patterns(model: PointModel) -> list[Pattern]:
    """A few patterns: nothing disturbs, all is high or low, and some that were drawn."""
    quiet, *worse = patterns_to_try(model)
    drawn = np.random.default_rng(0).integers(0, len(worse), 2) if worse else ()
    chosen = {0, len(worse) - 1, *map(int, drawn)} if worse else set()
    return [quiet, *(worse[k] for k in sorted(chosen))]


def _names(problem: Problem) -> tuple[str, ...]:
    """The name of each state as a hint writes it: the topic that shows it, or the plant's own."""
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
