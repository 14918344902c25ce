"""The inputs of a grid group's analysis: ranges, times, and which ends of the grid are kept.

Purpose: `of_problem` reads the ranges, times and scheme of one module for `GridGroup`; tests write
them by hand. `kept_ends_of` finds the ends that no run passes (a level that is never below zero, a
state between two stops), so that a grid may end exactly there though images round outward, and
rates that are zero but for rounding: `soter_reach_invariant_ends.c` uses both.
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
    """delta, the period of SC: how long a command is held."""
    delay_ns: int = 0
    """d: how old the state may be that a command answers when it begins to act."""
    jitter_ns: int = 0
    """j: the length of the window in which an output of SC acts."""
    read_age_ns: int = 0
    """D: how old the read behind a command may be while that acts, where commands may act later
    than half a period (`Schedule.read_age`); 0: they may not, and d and j are used."""
    parameters: tuple[int, ...] = ()
    plant_period_ns: int = 0
    """The simulator's RK4 step, whose error becomes a disturbance; 0: it is not covered."""
    map_step_ns: int = 0
    """The period of a map, of which `period_ns` is a multiple; 0: that is `period_ns` itself."""
    still: frozenset[int] = frozenset()
    """The states that never change."""
    schemes: tuple[tuple[float, int, int], ...] = ()
    """`SimulatedFlow.steps`, where plants differ; else `plant_period_ns` holds for all states."""
    names: tuple[str, ...] = ()
    """The names of the states, for messages."""

    @property
    def steps(self) -> tuple[tuple[float, int, int], ...]:
        """`SimulatedFlow.steps`; empty where the simulator's steps are not known."""
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
"""As `SOTER_REACH_UNBOUNDED` (the last cell holds what lies beyond the end) and `SOTER_REACH_WRAPS`
(beyond the last cell is the first)."""
BACK = 4.0
"""The strip is this much wider than |x'| (d + 2 j), as a-priori boxes are larger than runs."""
DUST = 1e-10
"""A rate below this share of the largest may be zero but for rounding: it is looked at again."""
LOOK_AHEAD = 4.0
"""The stages of the simulator's scheme stay within this many of its steps from the state."""


class ModelWithEnds(Protocol):
    """What `kept_ends_of` needs of a group's model (`GridModel`)."""

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
        """Bounds (states, 2) of the rates over ranges of all inputs; None: a fault, or no bound."""

    def rate_reads_states(self, state: int, low: Floats, high: Floats) -> bool:
        """Whether a state's rate depends on states in these ranges (one a number)."""


@dataclass(eq=False)
class KeptEnds:
    """The ends of a group's axes that are kept, and the domain, which goes on beyond these."""

    low: Floats
    high: Floats
    scheme: float
    dust: list[float] = field(default_factory=list)
    """For each axis the rate below which it may be zero but for rounding."""
    kept: dict[tuple[int, bool], int] = field(default_factory=dict)
    """(axis, whether it is the upper end) -> how it is kept, as a number of the engine."""
    crossed: list[str] = field(default_factory=list)
    """Ends that the flow keeps but the simulator's scheme is not shown to keep, in words."""


def kept_ends_of(model: ModelWithEnds) -> KeptEnds | None:
    """Finds the ends that are kept; None where a rate has no bounds.

    An end counts only if the simulator's scheme keeps it, too: that of a linear flow is part of the
    proof. A rate that depends on no state is the same in all stages of a step, so the scheme then
    moves the way that the rate says, rounding included.
    """
    g = model.c
    whole = model.rates_within(model.low, model.high)
    if whole is None:
        return None
    steps = [step for step, _, _ in model.inputs.steps]
    step = max(steps, default=0.0) if model.covers_scheme else 0.0
    found = KeptEnds(model.low.copy(), model.high.copy(), LOOK_AHEAD * step)
    back = BACK * (g.delay + max(2 * g.jitter, g.swept)) if g.is_local else 0.0
    for i, state in enumerate(model.axes):
        largest = float(np.abs(whole[state]).max())
        found.dust.append(DUST * largest + 8.0 * g.extra_w[i])
        endless = UNBOUNDED if state in model.unbounded else WRAPS if state in model.wraps else 0
        for upper in (False, True):
            if endless:
                found.kept[i, upper] = endless
            else:
                _enter_end(model, found, i, back * largest, upper=upper)
    return found


def _enter_end(model: ModelWithEnds, found: KeptEnds, i: int, back: float, *, upper: bool) -> None:
    """Enters one end of one axis in `found`, if it is kept."""
    state, edges = model.axes[i], model.edges[i]
    low, high = found.low.copy(), found.high.copy()
    if upper:
        low[state], high[state] = edges[-1], high[state] + back
    else:
        low[state], high[state] = low[state] - back, edges[0]
    rates = model.rates_within(low, high)
    if rates is None:
        return
    if not (upper and state in model.open_ends):
        inwards = -rates[state][1] if upper else rates[state][0]
        if not inwards >= 0.0:
            return
        if not inwards >= model.c.extra_w[i] and model.rate_reads_states(
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
