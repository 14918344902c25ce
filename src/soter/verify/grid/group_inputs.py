"""What a grid group's analysis is told: ranges, times, and which ends of its grid the plant keeps.

Purpose: ranges, times and scheme of one module as `GridGroup` takes them, from a `Problem` or by
hand. `borders_of`: what `soter_reach_invariant_ends.c` goes by: a level that is never below zero,
a state between two stops: a grid may end exactly there, though images round outward; and rates that
are zero but for rounding.
Non-goals: reading a program (`problem/extract.py`); ends that only SC keeps: commands may be
anything in U here.

An end is kept when the flow points inwards, or along it, all over a strip beyond it, for all
commands, disturbances and other states within their ranges. The strip is a part of the domain of
the enclosures: what lies between the grid and what a run, followed back to where it was read, may
have come from. The argument stands in `soter_reach_invariant_ends.c`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from soter.verify.enclose.scheme_error import NS, ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.core.layout import Floats
    from soter.verify.problem.problem import Interval, Problem, ProblemKind

    Range = tuple[float, float]


@dataclass(frozen=True)
class GridInputs:
    """Everything a group's analysis is told; build it with `of_problem`, or by hand in tests.

    Ranges are (low, high) pairs in the order of the inputs of the enclosure unit.
    """

    states: tuple[Range, ...]
    controls: tuple[Range, ...]
    disturbances: tuple[Range, ...] = ()
    errors: tuple[Range, ...] = ()
    others: tuple[Range, ...] = ()
    kind: ProblemKind = "flow"
    period_ns: int = 0
    """delta of SC: how long a command is held."""
    delay_ns: int = 0
    """d: how old the state is that a command answers."""
    jitter_ns: int = 0
    """j."""
    read_age_ns: int = 0
    """D: how old the read may be behind whatever acts, at any instant, where commands may act later
    than half a period (`Schedule.read_age`); 0: they do not, and d and j say it."""
    parameters: tuple[int, ...] = ()
    plant_period_ns: int = 0
    """Of the simulator's RK4 step, whose error becomes disturbance; 0: not covered."""
    map_step_ns: int = 0
    """Period of a map, of which `period_ns` is a multiple; 0: that is `period_ns` itself."""
    still: frozenset[int] = frozenset()
    """States without dynamics."""
    schemes: tuple[tuple[float, int, int], ...] = ()
    """Of each state, where `plant_period_ns` does not say it of all: `Stepped.steps`."""
    names: tuple[str, ...] = ()
    """Of the states, for people."""

    @property
    def steps(self) -> tuple[tuple[float, int, int], ...]:
        """`Stepped.steps`; none where the simulator's steps are not known."""
        if self.schemes or not self.plant_period_ns:
            return self.schemes
        return ((self.plant_period_ns * NS, ORDER, 0),) * len(self.states)

    @property
    def ranges(self) -> tuple[Range, ...]:
        """All inputs in order."""
        return self.states + self.controls + self.disturbances + self.errors + self.others


def _ranges(intervals: Sequence[Interval]) -> tuple[Range, ...]:
    return tuple((x.low, x.high) for x in intervals)


def of_problem(problem: Problem, parameters: Sequence[int] = ()) -> GridInputs:
    """The inputs of a problem for one combination of parameter values."""
    times = problem.times
    is_map = problem.kind == "map"
    return GridInputs(
        _ranges(problem.states),
        _ranges(problem.controls),
        _ranges(problem.disturbances),
        _ranges(problem.errors),
        _ranges(problem.others),
        kind=problem.kind,
        period_ns=times.delta_sc,
        delay_ns=0 if is_map else times.delay_sc,
        jitter_ns=0 if is_map else times.jitter_sc,
        read_age_ns=0 if is_map or times.schedule.ordered else times.schedule.read_age,
        parameters=tuple(parameters),
        schemes=problem.schemes,
        names=tuple(s.name for s in problem.quantities.states),
        map_step_ns=problem.plant_period_ns if is_map else 0,
        still=problem.still,
    )


UNBOUNDED, WRAPS = 2, 3
"""As `SOTER_REACH_UNBOUNDED`, `SOTER_REACH_WRAPS`: beyond such an end of an axis is its last cell,
or its first one."""
BACK = 4.0
"""How much further than |x'| (d + 2 j) the strip goes: a-priori boxes are larger than runs."""
DUST = 1e-10
"""Rates of this share of the largest one may be zero but for rounding: worth a second look."""
LOOK_AHEAD = 4.0
"""Steps of the simulator by whose rates its stages stay near the state."""


class BorderedModel(Protocol):
    """What of a group's model the borders look at."""

    c: Any
    inputs: GridInputs
    axes: tuple[int, ...]
    open_ends: frozenset[int]
    unbounded: frozenset[int]
    wraps: frozenset[int]
    covers_scheme: bool
    low: Floats
    high: Floats

    @property
    def edges(self) -> Sequence[Floats]:
        """Breakpoints of each axis, (cells + 1,)."""

    def rates_within(self, low: Floats, high: Floats) -> Floats | None:
        """Bounds (states, 2) of the rates over ranges of all inputs; None: a possible fault."""

    def hangs_on_states(self, state: int, low: Floats, high: Floats) -> bool:
        """Whether the rate of a state hangs on states in these ranges (one a number)."""


@dataclass(eq=False)
class Borders:
    """What is known of the ends of a group's axes, and the ranges beyond those that are kept."""

    low: Floats
    high: Floats
    scheme: float
    dust: list[float] = field(default_factory=list)
    """By axis: rates that may be zero but for rounding."""
    kept: dict[tuple[int, bool], int] = field(default_factory=dict)
    """(axis, whether it is the upper end) -> how it is kept, as the engine counts it."""
    crossed: list[str] = field(default_factory=list)
    """Ends that the flow keeps, and the scheme was not shown to."""


def borders_of(model: BorderedModel) -> Borders | None:
    """The ends that are kept; the domain goes on beyond them. None where a rate has no bounds.

    An end that is kept by the exact flow only, not with what the simulator's scheme adds, is none:
    the scheme of a linear flow is in the proof. A rate that no state changes is the same in all
    stages of a step, which then goes the way it says, rounding included.
    """
    g = model.c
    whole = _rates(model, model.low, model.high)
    if whole is None:
        return None
    steps = [step for step, _, _ in model.inputs.steps]
    step = max(steps, default=0.0) if model.covers_scheme else 0.0
    found = Borders(model.low.copy(), model.high.copy(), LOOK_AHEAD * step)
    back = BACK * (g.delay + max(2 * g.jitter, g.swept)) if g.is_local else 0.0
    for i, state in enumerate(model.axes):
        largest = float(np.abs(whole[state]).max())
        found.dust.append(DUST * largest + 8.0 * g.extra_w[i])
        endless = UNBOUNDED if state in model.unbounded else WRAPS if state in model.wraps else 0
        for upper in (False, True):
            if endless:
                found.kept[i, upper] = endless
            else:
                _keep_end(model, found, i, back * largest, upper=upper)
    return found


def _keep_end(model: BorderedModel, found: Borders, i: int, back: float, *, upper: bool) -> None:
    """One end of one axis."""
    state, edges = model.axes[i], model.edges[i]
    low, high = found.low.copy(), found.high.copy()
    if upper:
        low[state], high[state] = edges[-1], high[state] + back
    else:
        low[state], high[state] = low[state] - back, edges[0]
    rates = _rates(model, low, high)
    if rates is None:
        return
    if not (upper and state in model.open_ends):
        inwards = -rates[state][1] if upper else rates[state][0]
        if not inwards >= 0.0:
            return
        if not inwards >= model.c.extra_w[i] and model.hangs_on_states(
            state, found.low, found.high
        ):
            count = len(model.inputs.states)
            names = model.inputs.names or tuple(f"state {k}" for k in range(count))
            side, end = ("below", edges[-1]) if upper else ("above", edges[0])
            found.crossed.append(f"{names[state]} {side} {float(end):g}")
            return
    found.kept[i, upper] = 1
    if upper:
        found.high[state] = high[state]
    else:
        found.low[state] = low[state]


def _rates(model: BorderedModel, low: Floats, high: Floats) -> Floats | None:
    """Bounds (states, 2) of every rate of the exact flow; None where a step fault is possible."""
    ends = model.rates_within(low, high)
    return ends if ends is not None and bool(np.all(np.isfinite(ends))) else None
