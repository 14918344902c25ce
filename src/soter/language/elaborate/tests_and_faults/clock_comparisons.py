"""How many comparisons of times may have to hold together, so that a grid can be fine enough.

Purpose: into how many parts the grid of a test is cut (`elaborate/time_grid.py`, docs/testing.md).
Non-goals: thresholds and the greatest common divisor (`elaborate/time_grid.py`).

Times of steps are the nodes of a graph, time zero one of them: what cannot be late stands with it.
A comparison of two is an edge, its length a multiple of the greatest common divisor g. That the
comparisons of an execution hold, and the order of its steps, is that every circle has a length of
at least zero, and of more, so of g, where one of its edges is strict. If no circle has more than s
strict edges, each of them can be made shorter by g/s: then there are times on the grid of g/s at
which the same comparisons hold. That a configuration is observable is an edge as well, and strict:
it comes before the end of every window that is still open.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.source import Span
    from soter.language.model.system import System

FINEST = 8
"""Into so many parts a grid is cut at most."""
AT_A_STEP = 2
"""Edges of a circle at one time."""


@dataclass
class ReadClocks:
    """The clocks that one text reads: of a `component`, or of a property that is looked at.

    `ages`: topic indices; `now`: `time`; `kept`: locals that hold a time of an earlier step;
    `crossed`: whether a clock is compared with a clock. `looks`: of a property, so many moments
    decide on it; `deadline`: of which kind.
    """

    component: int | None = None
    looks: int = 1
    deadline: str = ""
    ages: set[int] = field(default_factory=set)
    now: bool = False
    kept: bool = False
    crossed: bool = False
    compared: list[Span] = field(default_factory=list)

    @property
    def clocks(self) -> int:
        """How many it reads."""
        return len(self.ages) + self.now + self.kept


def together(system: System, watched: Sequence[ReadClocks]) -> int:
    """Strict comparisons in one circle of times at most: the parts that the grid is cut into."""
    late = _may_be_late(system)
    if not late:
        return 1
    moved = _published_late(system, late)
    in_steps, looked_at, seen, from_zero, clocks = 0, 0, 0, False, 0
    for w in watched:
        free = late if w.component is None else late & {w.component}
        ages = {_source(system, t) for t in w.ages}
        edges, moving, has_zero = _edges(w, ages, moved, free=bool(free))
        from_zero |= has_zero
        clocks += moving
        if w.component is not None:
            in_steps += edges * releases(system, w.component)
        else:
            looks = w.looks * edges + (w.deadline in {"leadsto", "invariant"})
            looked_at, seen = max(looked_at, looks), max(seen, looks + (edges < AT_A_STEP))
    strict = in_steps + (looked_at + 2 if from_zero else seen)
    asked = any(w.deadline == "invariant" for w in watched)
    return max(strict, 2) if clocks or asked else 1


def _may_be_late(system: System) -> set[int]:
    """Components whose steps may be late."""
    assert system.test is not None
    late = {f.component for f in system.test.faults if f.kind != "skip" and f.by_ns}
    if system.test.skew_ns:
        late |= {c.index for c in system.components if c.plant is None}
    return late


def _edges(w: ReadClocks, ages: set[int], moved: set[int], *, free: bool) -> tuple[int, int, bool]:
    """Strict edges each time a text is run, clocks in it that move, whether time zero is a node.

    `ages`: of which topics, `moved`: those with stamps of steps that may be late; `free`: whether
    the text itself may run late.
    """
    loose = len(ages & moved)
    loose += w.kept if free or loose else 0
    edges = 0
    if w.crossed and loose:
        edges = loose + free
    elif free:
        edges = min(loose, AT_A_STEP)
    fixed = ages - moved if free else ages & moved
    clocks = (loose if free else 0) + len(fixed) + (free and w.now)
    return edges, clocks, bool(fixed) or (free and (w.now or w.deadline == "eventually"))


def _published_late(system: System, late: set[int]) -> set[int]:
    """Topics whose stamps are times of steps that may be late."""
    return {
        c.scope.topics[t]
        for c in system.components
        if c.index in late and c.node is not None
        for t in c.node.publishes
    }


def _source(system: System, topic: int) -> int:
    """The topic itself, or of a queue that which fills it: its age is that one's."""
    of = system.topics[topic].queue_of
    return topic if of is None else of


def releases(system: System, component: int) -> int:
    """Of a component, up to the horizon."""
    assert system.test is not None
    c = system.components[component]
    return max(0, (system.test.horizon_ns - c.phase_ns) // c.period_ns + 1)
