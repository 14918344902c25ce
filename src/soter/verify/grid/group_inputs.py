"""What a grid group's analysis is told.

Purpose: ranges, times and scheme of one module as `GridGroup` takes them, from a `Problem` or by
hand.
Non-goals: grids; reading a program (`extract.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.verify.enclose.scheme_error import NS, ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

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
