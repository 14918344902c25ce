"""The plan of exploring a tested system: its actors, and what of a configuration can matter.

Purpose: plain data between who plans (`explore/model/actors.py`) and who generates the model
(`explore/model/explorer_model.py`).
Non-goals: computing it, C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span

    Label = tuple[str, int] | tuple[str, int, str]
    """A piece of a configuration: kind, index, name; see `explore/model/actors.py`."""


@dataclass(frozen=True, kw_only=True)
class PlannedActor:
    """A component or an input of a tested system; docs/testing.md. Times in ns.

    Exactly one of `component` and `input` is set. `dependent`: bit i is set iff steps of actor i
    may not commute with its own; `outputs`: topics, in the order of the step's outputs. `reads`
    and `writes` are resources (`explore/model/actors.py`), here what a step's result depends on and
    what it may change.
    """

    name: str
    component: int | None
    input: int | None
    period_ns: int
    phase_ns: int
    window_ns: int
    overrun_ns: int
    least_ns: int
    skips: int
    dependent: int
    visible: bool
    outputs: tuple[int, ...]
    reads: frozenset[Label]
    writes: frozenset[Label]


@dataclass(frozen=True)
class TimeChoices:
    """The grid that steps which may be late choose their times on.

    `open`: where the time is read so that no grid does justice to it, and none was declared;
    `crowded`: where so many times are compared that only a finer grid would.
    """

    quantum_ns: int
    open: tuple[Span, ...]
    crowded: tuple[Span, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ExplorationPlan:
    """What is explored, and what of a configuration can matter.

    `read`: topics that anything reads; `aged`: topics whose age is read; `limited`: module inputs
    whose `max_age` decides; `may_fault`: components whose step may fault; `times`: None where no
    step has a choice; `repeats`: nothing reads the time, so that what comes depends on a
    configuration and the place in the calendar alone.
    """

    actors: tuple[PlannedActor, ...]
    timely: bool
    sampled: bool
    repeats: bool
    tick_ns: int
    quantum_ns: int
    times: TimeChoices | None
    horizon_ns: int
    read: frozenset[int]
    aged: frozenset[int]
    limited: frozenset[int]
    may_fault: frozenset[int]
    observed: frozenset[Label]
    """What properties of configurations read."""

    @property
    def unheard(self) -> frozenset[str]:
        """Actors that write nothing that another one, or a property, reads."""
        alone = [
            a.name
            for a in self.actors
            if not a.visible and not any(a.writes & b.reads for b in self.actors if b is not a)
        ]
        return frozenset(alone)
