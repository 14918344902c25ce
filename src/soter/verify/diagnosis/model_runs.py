"""Runs the model under SC: the dynamics that a proof encloses, at points instead of boxes.

Purpose: `run_of_sc` simulates the verification system with disturbances and errors at their ends,
constant or following a rate, and commands as late as the declared times allow.
`soonest_leaving_run` finds the run that is the first to leave C, the states where `safe` holds.
Non-goals: refuting: these are runs of the plant's equations, integrated by RK4, not of the program
(`verify/refute.py`); finding the worst adversary.

Command k acts from k delta + j on and answers the state of d before. That, and answering at once,
are two of the choices that docs/verification.md (section 3) leaves to the world.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import product
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import LeavingRun
from soter.verify.grid.grid_problem import grid_inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.core.layout import Bools, Floats
    from soter.verify.grid.case import Case


NS = 1e-9
CORNERS_MAX = 6
"""Up to so many signs are tried in all combinations; of more signs only `DRAWN` combinations."""
DRAWN = 48
LENGTHS = (25, 200, 1600, 12800)
"""Lengths of runs in periods of SC: all patterns are tried with the first length, and then the
undisturbed one and those that moved a state furthest."""
STEPS_A_HOLD = 2
STABLE = 2.0
"""The longest step, in times of the fastest lag; above 2.7 a value that sinks grows in RK4."""
SHOWN = 600
"""The number of states of a run that are shown, the first and the last among them."""
FALSE, TRUE = 1, 2
"""The truth values (bit masks) that are certain."""


class StepFaultError(Exception):
    """Raised if SC's law or the flow may fault at a point, so that the run ends there."""


class PointModel:
    """Evaluates the enclosures of one case at points."""

    def __init__(self, case: Case) -> None:
        self.problem, self.inputs = case.problem, grid_inputs_of(case.problem, case.parameter)
        self.forms, self.parameter = case.forms, case.parameter
        self.low, self.high = np.array([(i.low, i.high) for i in case.problem.states]).T
        self.turning = [*case.problem.quantities.turning]
        axes = [a for g in case.problem.groups for a in g.axes]
        self.below_ends = [a.state for a in axes if a.unbounded]
        self.opened = [a.state for a in axes if a.open]
        self.above_ends = [*self.opened, *self.below_ends]
        sizes = [len(v) for v in (self.problem.states, self.problem.controls)]
        sizes += [len(v) for v in (self.problem.disturbances, self.problem.errors)]
        ends = np.cumsum(sizes)
        self.states, self.controls, self.disturbances, self.errors = (
            slice(int(b - n), int(b)) for b, n in zip(ends, sizes, strict=True)
        )
        self.others = slice(int(ends[-1]), len(case.forms.whole))
        self.is_map = self.problem.kind == "map"
        self._point = case.forms.whole.mean(axis=1)
        library = case.forms.library
        self._in = np.zeros((library.inputs, 4 + library.inputs))
        self._out = np.zeros((max(library.inputs, 64), 4 + library.inputs))
        self._truths = self._out.view(np.uint8).reshape(-1)
        param = np.array(list(case.parameter) or [0], dtype=np.int64)
        cast = library.ffi.cast
        self._keep = param
        self._c_arguments = (
            cast("void *", self._in.ctypes.data),
            cast("int64_t *", param.ctypes.data),
            cast("void *", self._out.ctypes.data),
        )
        self._lib = library.lib

    def is_beyond_ends(self, x: Floats) -> Bools:
        """Whether each state lies beyond an end of the grid that bounds it: (states,)."""
        below, above = x < self.low, x > self.high
        below[[*self.turning, *self.below_ends]] = False  # an angle goes on at the other end; an
        above[[*self.turning, *self.above_ends]] = False  # axis has no end, or an open one
        return np.asarray(below | above)

    @property
    def start(self) -> Floats:
        """The middle of the declared start as an array (states,)."""
        return np.array([i.low / 2 + i.high / 2 for i in self.problem.initial])

    @property
    def state_names(self) -> tuple[str, ...]:
        """The names of the states."""
        return tuple(s.name for s in self.problem.quantities.states)

    def _call(self, name: str) -> None:
        self._in[: len(self._point), :3] = self._point[:, None]
        if getattr(self._lib, f"soter_{name}")(*self._c_arguments):
            raise StepFaultError(name)

    def law(self, x: Floats, errors: Floats, others: Floats) -> Floats:
        """The commands of SC for an estimate; the middle of their range if SC's locals matter.

        `x` (states,), `errors` (errors,), `others` (others,) -> (controls,).
        """
        self._point[self.states], self._point[self.errors] = x, errors
        self._point[self.others] = others
        self._call("law")
        out = self._out[: len(self.problem.controls), :2]
        return np.asarray(out[:, 0] / 2 + out[:, 1] / 2)

    def rate(self, x: Floats, u: Floats, w: Floats) -> Floats:
        """The derivative of the state, or a map's next state, (states,).

        `x` (states,), `u` (controls,), `w` (disturbances,).
        """
        self._point[self.states], self._point[self.controls] = x, u
        self._point[self.disturbances] = w
        self._call("next" if self.is_map else "derivative")
        return np.array(self._out[: len(x), 2])

    def safe(self, x: Floats) -> int:
        """Two bits on `safe` at `x` (states,): bit 0 if it may be false, bit 1 if possibly true."""
        self._point[self.states] = x
        try:
            self._call("safe")
        except StepFaultError:
            return FALSE | TRUE
        return int(self._truths[0])

    def safer(self, x: Floats) -> bool:
        """Whether `safer` surely holds for the exact estimate of the state `x` (states,)."""
        self._point[self.states], self._point[self.errors] = x, 0.0
        try:
            self._call("safer")
        except StepFaultError:
            return False
        return int(self._truths[0]) == TRUE

    def step_rk4(self, x: Floats, u: Floats, w: Floats, t: float) -> Floats:
        """One step of RK4, `t` seconds long; arrays as of `rate`, so (states,) -> (states,)."""
        a = self.rate(x, u, w)
        b = self.rate(x + t / 2 * a, u, w)
        c = self.rate(x + t / 2 * b, u, w)
        d = self.rate(x + t * c, u, w)
        return np.asarray(x + t / 6 * (a + 2 * b + 2 * c + d))

    def longest_step_s(self, x: Floats, u: Floats, w: Floats) -> float:
        """The longest step in s with which RK4 can follow the fastest lag at a state.

        `x` (states,), `u` (controls,), `w` (disturbances,).
        """
        at, more = self.rate(x, u, w), np.maximum(1e-6, 1e-6 * np.abs(x))
        try:
            slopes = np.array([(self.rate(x + d, u, w) - at) / d.sum() for d in np.diag(more)]).T
        except StepFaultError:
            return inf
        if not np.isfinite(slopes).all():
            return inf
        fastest = float(np.abs(np.linalg.eigvals(slopes)).max(initial=0.0))
        return STABLE / fastest if fastest > 0.0 else inf


@dataclass(frozen=True, eq=False)
class Pattern:
    """A choice of -1 (low), 0 (middle) or 1 (high) for each disturbance, error and other input.

    `late`: commands act as late, and estimates are as old, as possible. `follows`: disturbances
    have the sign of this state's rate; None means that they are constant.
    """

    disturbances: Floats
    errors: Floats
    others: Floats
    late: bool = False
    follows: int | None = None

    @property
    def is_disturbed(self) -> bool:
        """Whether the pattern is late or has anything that is not in the middle."""
        return bool(self.late or self.disturbances.any() or self.errors.any() or self.others.any())


def patterns_to_try(model: PointModel) -> Iterator[Pattern]:
    """Yields the patterns to try: first the undisturbed one (all in the middle), then corners."""
    sizes = [len(model.problem.disturbances), len(model.problem.errors)]
    sizes.append(len(model.problem.others))
    yield Pattern(np.zeros(sizes[0]), np.zeros(sizes[1]), np.zeros(sizes[2]))
    total, cuts = sum(sizes), np.cumsum(sizes)[:-1]
    late = bool(model.inputs.delay_ns or model.inputs.jitter_ns)
    if total <= CORNERS_MAX:
        signs = [np.array(s) for s in product((-1.0, 1.0), repeat=total)]
    else:
        signs = list(np.random.default_rng(0).choice((-1.0, 1.0), (DRAWN, total)))
    follows = [None, *(range(len(model.low)) if sizes[0] else ())]
    habits = [(late, followed) for followed in follows] + ([(False, None)] if late else [])
    for is_late, followed in habits:
        for s in signs:
            w, e, o = np.split(s, cuts)
            yield Pattern(w, e, o, is_late, followed)


@dataclass(eq=False)
class ModelTrace:
    """The states of a run; `left` means that the last state is outside C."""

    pattern: Pattern
    times: list[float]
    states: list[Floats]
    left: bool = False
    axis: int = -1
    side: int = 0
    safe: bool = False


def run_of_sc(
    model: PointModel,
    start: Floats,
    pattern: Pattern,
    until_s: float,
    going: Callable[[], bool],
    *,
    beyond: bool = False,
) -> ModelTrace:
    """A run under SC from `start` (states,) until it leaves C, at most for `until_s` seconds.

    `going`: whether there is time left; `beyond`: the run goes on outside of C.
    """
    trace = ModelTrace(pattern, [0.0], [np.array(start)])
    try:
        with np.errstate(all="ignore"):  # what is no number ends the run
            for _ in _extend_trace(model, trace, pattern, until_s):
                x = trace.states[-1]
                if (
                    not np.isfinite(x).all()
                    or not going()
                    or (x > model.high)[model.opened].any()  # nothing is claimed of such a run
                    or (not beyond and _enter_if_left(model, trace))
                ):
                    break
    except StepFaultError:
        trace.left = False
    return trace


def _values_of_signs(model: PointModel, part: slice, signs: Floats) -> Floats:
    low, high = model.forms.whole[part].T
    return np.asarray((low + high) / 2 + signs * (high - low) / 2)


def _extend_trace(
    model: PointModel, trace: ModelTrace, p: Pattern, until_s: float
) -> Iterator[None]:
    """Extends the trace state by state, until `until_s` seconds."""
    errors = _values_of_signs(model, model.errors, p.errors)
    others = _values_of_signs(model, model.others, p.others)
    period = model.inputs.period_ns * NS
    delay, jitter = (v * NS if p.late else 0.0 for v in _delay_and_jitter_ns(model))
    x, t = trace.states[0], 0.0
    if model.is_map:
        step = (model.inputs.map_step_ns or model.inputs.period_ns) * NS
        while t < until_s:
            u = model.law(x, errors, others)
            for _ in range(max(1, round(period / step))):
                x, t = model.rate(x, u, _disturbances_at(model, p, x, u)), t + step
                trace.times.append(t)
                trace.states.append(x)
                yield
        return
    longest = max(min(model.problem.plant_period_ns * NS, period), period / STEPS_A_HOLD)
    u = model.law(x, errors, others)
    most = model.longest_step_s(x, u, _disturbances_at(model, p, x, u))
    longest = min(longest, max(most, min(model.problem.plant_period_ns * NS, period)))
    waiting: deque[tuple[float, Floats]] = deque()
    k = 1
    while t < until_s:
        act = k * period + jitter
        read = act - delay
        until = min(max(read, t), waiting[0][0]) if waiting else max(read, t)
        count = int(np.ceil((until - t) / longest - 1e-9))
        w = _disturbances_at(model, p, x, u)
        for i in range(count):
            x = model.step_rk4(x, u, w, (until - t) / count)
            trace.times.append(t + (until - t) * (i + 1) / count)
            trace.states.append(x)
            yield
            w = _disturbances_at(model, p, x, u)
        t = until
        if waiting and waiting[0][0] <= t:
            u = waiting.popleft()[1]
        else:
            waiting.append((act, model.law(x, errors, others)))
            k += 1


def _delay_and_jitter_ns(model: PointModel) -> tuple[int, int]:
    return model.inputs.delay_ns, model.inputs.jitter_ns


def _disturbances_at(model: PointModel, p: Pattern, x: Floats, u: Floats) -> Floats:
    """The disturbances, (disturbances,), that the pattern sets in a state."""
    if p.follows is None:
        return _values_of_signs(model, model.disturbances, p.disturbances)
    middle = _values_of_signs(model, model.disturbances, np.zeros_like(p.disturbances))
    rate = model.rate(x, u, middle)[p.follows] - (x[p.follows] if model.is_map else 0.0)
    return _values_of_signs(
        model, model.disturbances, p.disturbances * (1.0 if rate >= 0.0 else -1.0)
    )


def _enter_if_left(model: PointModel, trace: ModelTrace) -> bool:
    """Whether the last state is outside C; if so, the trace notes by which axis the run left."""
    x = trace.states[-1]
    beyond = model.is_beyond_ends(x)
    false = model.safe(x) == FALSE
    if not false and not beyond.any():
        return False
    trace.left, trace.safe = True, false
    first, width = trace.states[0], np.maximum(model.high - model.low, 1e-300)
    moved = np.abs(x - first) / width
    order = np.argsort(-np.where(beyond, moved + 10.0, moved)) if not false else np.argsort(-moved)
    trace.axis = int(order[0])
    for i in order if false else ():
        back = x.copy()
        back[i] = first[i]
        if model.safe(back) & TRUE:
            trace.axis = int(i)
            break
    trace.side = 1 if x[trace.axis] >= first[trace.axis] else -1
    return True


@dataclass(eq=False)
class LeavingSearch:
    """The run that leaves C soonest, with figures of all runs that were tried."""

    soonest: LeavingRun | None = None
    trace: ModelTrace | None = None
    runs: int = 0
    longest_s: float = 0.0
    undisturbed: ModelTrace | None = None
    """The undisturbed run if it leaves C; None if it was not seen to."""
    furthest: Sequence[Pattern] = ()
    """The patterns that moved states furthest, after the undisturbed one."""
    cut: bool = False


def soonest_leaving_run(
    model: PointModel, start: Floats, whose: str, going: Callable[[], bool]
) -> LeavingSearch:
    """Searches for the run from `start` (states,) that leaves C soonest, while `going` is true."""
    search, period = LeavingSearch(), model.inputs.period_ns * NS
    todo = list(patterns_to_try(model))
    for holds in LENGTHS:
        best = holds * period
        reaches = []
        for pattern in todo:
            if not going():
                search.cut = True
                return search
            trace = run_of_sc(model, start, pattern, best, going)
            search.runs += 1
            search.longest_s = max(search.longest_s, trace.times[-1])
            reaches.append(_reach_of_run(trace))
            if not trace.left:
                continue
            if not pattern.is_disturbed:
                search.undisturbed = trace
            if search.trace is None or trace.times[-1] < search.trace.times[-1] - period / 1000:
                best, search.trace = trace.times[-1], trace
                search.soonest = leaving_run(model, trace, whose)
        todo = [todo[i] for i in dict.fromkeys([0, *np.argmax(reaches, axis=0).tolist()])]
        search.furthest = todo
        if search.soonest is not None:
            break
    return search


def _reach_of_run(trace: ModelTrace) -> Floats:
    """How far a run moves each state down, then how far up: (2 * states,)."""
    moved = np.nan_to_num(np.array(trace.states) - trace.states[0], nan=0.0)
    return np.concatenate([-moved.min(axis=0), moved.max(axis=0)])


def leaving_run(model: PointModel, trace: ModelTrace, whose: str) -> LeavingRun:
    """A run that leaves C, as plain data for results; `whose` describes its start."""
    names = model.state_names
    last = len(trace.times) - 1
    shown = np.unique(np.linspace(0, last, min(last + 1, SHOWN)).astype(int))
    return LeavingRun(
        names=names,
        time_s=np.array(trace.times)[shown],
        states=np.array(trace.states)[shown],
        axis=names[trace.axis],
        side=trace.side,
        safe=trace.safe,
        start=whose,
        chosen=pattern_text(model, trace.pattern),
        parameter=model.parameter,
    )


def point_text(model: PointModel, x: Floats) -> str:
    """Describes the values of the states, (states,), with their names."""
    return ", ".join(
        f"{n} = {without_rounding(v):.5g}" for n, v in zip(model.state_names, x, strict=True)
    )


def without_rounding(value: float) -> float:
    """The value, or 0 if it is nearly 0."""
    return 0.0 if abs(value) < 1e-9 else value


def pattern_text(model: PointModel, pattern: Pattern) -> tuple[str, ...]:
    """A text for each input that a pattern does not leave in the middle."""
    q = model.problem.quantities
    names = tuple(s.name for s in q.states)
    chosen = []
    parts = (
        ("", q.disturbances, model.disturbances, pattern.disturbances),
        ("error of ", q.errors, model.errors, pattern.errors),
        ("", q.others, model.others, pattern.others),
    )
    for kind, leaves, part, signs in parts:
        ends = _values_of_signs(model, part, signs), _values_of_signs(model, part, -signs)
        for leaf, up, down, sign in zip(leaves, *ends, signs, strict=True):
            if sign == 0.0:
                continue
            text = f"{kind}{leaf.name} = {up:.4g}"
            if part is model.disturbances and pattern.follows is not None:
                text += f" while {names[pattern.follows]} rises, {down:.4g} while it falls"
            chosen.append(text)
    if pattern.late:
        chosen.append("commands as late as declared")
    return tuple(chosen)
