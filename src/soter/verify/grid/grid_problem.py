"""The ranges and times from which the analysis of a group on a grid starts.

Purpose: `grid_inputs_of` reads the ranges, times and scheme of one module for `GridGroup`; tests
write them by hand.
Non-goals: reading a program (`problem/extract.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.verify.problem.problem import NS, ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.problem.problem import Interval, Problem, ProblemKind

    Range = tuple[float, float]


@dataclass(frozen=True)
class GridInputs:
    """The inputs of the analysis of a group, made by `grid_inputs_of`, or by hand in tests.

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
    """D: the largest age of the read behind a command while the command acts (`Schedule.read_age`).
    0: no command acts later than half a period, so d and j are used."""
    parameters: tuple[int, ...] = ()
    plant_period_ns: int = 0
    """The simulator's RK4 step, whose error becomes a disturbance; 0: it is not covered."""
    map_step_ns: int = 0
    """The period of a map, of which `period_ns` is a multiple; 0: that is `period_ns` itself."""
    still: frozenset[int] = frozenset()
    """The states that never change."""
    schemes: tuple[tuple[float, int, int], ...] = ()
    """`SimulatedFlow.steps` where plants differ; empty: `plant_period_ns` is that of all states."""
    names: tuple[str, ...] = ()
    """The names of the states, for messages."""

    @property
    def steps(self) -> tuple[tuple[float, int, int], ...]:
        """`SimulatedFlow.steps` of all states; empty if the simulator's steps are not known."""
        if self.schemes or not self.plant_period_ns:
            return self.schemes
        return ((self.plant_period_ns * NS, ORDER, 0),) * len(self.states)

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The ranges of all inputs, in their order in the enclosure unit."""
        return self.states + self.controls + self.disturbances + self.errors + self.others


def _ranges_of(intervals: Sequence[Interval]) -> tuple[Range, ...]:
    return tuple((x.low, x.high) for x in intervals)


def grid_inputs_of(problem: Problem, parameters: Sequence[int] = ()) -> GridInputs:
    """The inputs of a problem for one combination of parameter values."""
    times = problem.times
    is_map = problem.kind == "map"
    return GridInputs(
        _ranges_of(problem.states),
        _ranges_of(problem.controls),
        _ranges_of(problem.disturbances),
        _ranges_of(problem.errors),
        _ranges_of(problem.others),
        kind=problem.kind,
        period_ns=times.delta_sc,
        delay_ns=0 if is_map else times.delay_sc,
        jitter_ns=0 if is_map else times.jitter_sc,
        read_age_ns=0 if is_map or times.schedule.are_windows_short else times.schedule.read_age,
        parameters=tuple(parameters),
        schemes=problem.schemes,
        names=tuple(s.name for s in problem.quantities.states),
        map_step_ns=problem.plant_period_ns if is_map else 0,
        still=problem.still,
    )
