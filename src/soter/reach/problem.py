"""The verification problem of one module, as plain data.

Purpose: what `extract.py` reads off a program and everything else in this room works on
(docs/verification.md, section 1).
Non-goals: computing anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.codegen.enclosures import Quantities
    from soter.diagnostics.span import Span
    from soter.lower.core import CoreSystem
    from soter.program.system import Module, System


@dataclass(frozen=True)
class Interval:
    """A closed interval."""

    low: float
    high: float


@dataclass(frozen=True)
class Times:
    """Every time of P1c in ns (docs/verification.md, Times). `declared` names those that were."""

    delta_dm: int
    """Delta, the period of the DM."""
    delta_sc: int
    age_dm: int
    age_sc: int
    late_dm: int = 0
    late_sc: int = 0
    response_dm: int = 0
    response_sc: int = 0
    acts: int = 0
    phase_dm: int = 0
    phase_sc: int = 0
    horizon: int | None = None
    """H as declared; None: H*."""
    declared: frozenset[str] = frozenset()

    @property
    def wait(self) -> int:
        """G: from a release of the DM to the next of SC, at worst."""
        g = math.gcd(self.delta_dm, self.delta_sc)
        return self.delta_sc - g + (self.phase_sc - self.phase_dm) % g

    @property
    def h_star(self) -> int:
        """H*: from the sample behind the last "AC" verdict to SC's first acting output."""
        hand_over = max(self.late_dm + self.response_dm, self.wait + self.late_sc)
        return self.age_dm + self.delta_dm + hand_over + self.response_sc + self.acts

    @property
    def horizon_ns(self) -> int:
        """H."""
        return self.h_star if self.horizon is None else self.horizon

    @property
    def delay_sc(self) -> int:
        """d: how old the state is that a command answers."""
        return self.age_sc + self.response_sc + self.acts

    @property
    def jitter_sc(self) -> int:
        """j: how far from its nominal instant a command acts."""
        return self.late_sc + self.response_sc + self.acts

    @property
    def decision(self) -> int:
        """Delta + A + J_dm: from a state to the DM's verdict about it, at worst."""
        return self.delta_dm + self.age_dm + self.late_dm

    @property
    def start(self) -> int:
        """h_0: the first instant at which an output of SC acts."""
        return self.phase_sc + self.late_sc + self.response_sc + self.acts


@dataclass(frozen=True)
class Axis:
    """One axis of a group's grid."""

    state: int
    """Index among the states."""
    name: str
    edges: tuple[float, ...]
    """Breakpoints, strictly increasing; n + 1 of them for n cells."""


@dataclass(frozen=True)
class Group:
    """States that are analysed together."""

    axes: tuple[Axis, ...]
    representation: str = "grid"
    """"grid" or "polytope"."""
    span: Span | None = None


@dataclass(frozen=True)
class Parameter:
    """A discrete plant state without dynamics; proved for each of its values."""

    name: str
    values: tuple[int, ...]


@dataclass(eq=False)
class Problem:
    """One module with its verification plants.

    `states`, `controls`, ... are the ranges of the inputs of `quantities`, in the same order.
    """

    system: System
    """The verification system: the module and its verification plants, nothing else."""
    core: CoreSystem
    module: Module
    quantities: Quantities
    kind: str
    """"flow" or "map"."""
    plant_period_ns: int
    states: tuple[Interval, ...]
    """The grid's extent for each state."""
    initial: tuple[Interval, ...]
    controls: tuple[Interval, ...]
    disturbances: tuple[Interval, ...]
    errors: tuple[Interval, ...]
    others: tuple[Interval, ...]
    parameters: tuple[Parameter, ...]
    groups: tuple[Group, ...]
    """In chain order: a group depends on itself and earlier ones."""
    times: Times
    levels: int = 3
    has_core_hint: bool = False
    computed: bool = False
    """The module has neither `ttf` nor `safer`: they are to be computed."""
    synthesize: bool = False
    """SC is to be found (`soter verify --synthesize`)."""
    topic_leaf_of_state: dict[int, tuple[int, int]] = field(default_factory=dict)
    """State -> (topic, leaf) that equals it, where there is one."""
    assumptions: list[str] = field(default_factory=list)
    name: str = ""
    """Full name of the module in its own system, for people."""
    commands: tuple[tuple[float, ...], ...] = ()
    """For synthesis: the finite set of each control, in their order."""
    parameter_start: tuple[int, ...] = ()
    """Declared first value of each parameter."""
    still: frozenset[int] = frozenset()
    """States without dynamics: constants of a run."""
    scheme_step_ns: int = 0
    """Step of the simulator's RK4 where its error can be part of the proof (linear flows); 0: its
    scheme is not covered: an assumption."""
    recover_ns: int | None = None
    """T of P2b where it is declared: `recover within d;`."""
