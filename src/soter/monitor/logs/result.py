"""What the decision modules of a program would have said to a log.

Purpose: results as plain records, and the list of what such a result takes for granted.
Non-goals: finding them (`replay.py`), printing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.monitor.logs.typed_samples import DerivedValue

ASSUMED = (
    "only reads are judged: where the vehicle was is known to within its estimator's errors",
    (
        "up to its first switch a module decides what it would have decided there; from then on SC "
        "would have flown, which no log shows: later modes are those of the reads alone"
    ),
    (
        "nothing says that this vehicle is the plant of the proof: what was proved holds of it "
        "only as far as its own accelerations, lags and errors keep to the declared ones"
    ),
    (
        "the decision module steps at its period without lateness, and AC's outputs, which are not "
        "judged, are taken to pass the gate"
    ),
)


@dataclass(frozen=True)
class LoggedModeChange:
    """A change of mode, at `time_s` of the log, and why."""

    time_s: float
    to: str
    reason: str


@dataclass(frozen=True)
class NearestMargin:
    """The least distance of a condition from failing; below zero: how far it failed at most.

    `bound`: the comparison that it was, "" where nothing has a distance; its sides have one unit.
    """

    distance: float
    time_s: float
    bound: str


@dataclass
class ModuleOfLog:
    """A module's DM on the reads of a log.

    `missing`: topics without which nothing can be said; everything else is then empty. `steps` of
    the DM; in `stale` of them a read was too old, in `fresh` none; `ttf`, `safer`, `outside` (of
    safe), `nan_looks` (in which `ttf` or `safer` compared a NaN) and `faults` count fresh ones.
    `margin` is of not ttf, `clearance` of `safe`; None where there was no fresh read, or where
    `blind` says what `safe` reads and the log has not. `bounds`: of each comparison of `ttf` its
    least. `span`: where the module is declared.
    """

    module: str
    period_ns: int
    missing: tuple[str, ...] = ()
    blind: tuple[str, ...] = ()
    steps: int = 0
    ac: int = 0
    stale: int = 0
    ttf: int = 0
    safer: int = 0
    outside: int = 0
    faults: int = 0
    nan_looks: int = 0
    first_outside_s: float | None = None
    changes: list[LoggedModeChange] = field(default_factory=list)
    margin: NearestMargin | None = None
    clearance: NearestMargin | None = None
    bounds: dict[str, NearestMargin] = field(default_factory=dict)
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def decided(self) -> bool:
        """Whether the log has all that its decision module reads."""
        return not self.missing

    @property
    def fresh(self) -> int:
        """Steps whose reads were young enough."""
        return self.steps - self.stale

    @property
    def switches(self) -> list[LoggedModeChange]:
        """Takeovers: from AC to SC."""
        return [c for c in self.changes if c.to == "SC"]

    @property
    def first_switch_s(self) -> float | None:
        """When AC would have lost control for the first time."""
        return self.switches[0].time_s if self.switches else None

    @property
    def ac_share(self) -> float:
        """Share of the DM's steps that leave AC in control."""
        return self.ac / self.steps if self.steps else 0.0


@dataclass
class LogJudgement:
    """A log, judged. Times count from its first row.

    `from_s`, `to_s`: what was judged, from when every mapped topic is known. `nodes`: nodes of the
    program that were run for what it reads; `faulted`: those that faulted. `forced`: modules whose
    mode the system forces. `stamps`: by topic the field that says when it was measured.
    `sources`: by topic that has several, how many samples each gave. `left_out`, `refused`: by
    topic how many samples had no usable value, or lay outside the topic's set, and the first.
    """

    log: str
    from_s: float
    to_s: float
    samples: dict[str, int]
    nodes: tuple[str, ...]
    modules: list[ModuleOfLog]
    derived: list[DerivedValue] = field(default_factory=list)
    constants: tuple[str, ...] = ()
    sources: dict[str, str] = field(default_factory=dict)
    forced: tuple[str, ...] = ()
    stamps: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)
    refused: dict[str, tuple[int, str]] = field(default_factory=dict)
    faulted: dict[str, str] = field(default_factory=dict)

    @property
    def assumptions(self) -> list[str]:
        """What the judgement takes for granted."""
        assumptions = list(ASSUMED)
        if self.nodes:
            names = ", ".join(f"`{n}`" for n in self.nodes)
            assumptions.append(f"{names} of the program ran on what the log has")
        if self.forced:
            names = ", ".join(f"`{n}`" for n in self.forced)
            assumptions.append(f"the system forces the mode of {names}; judged as if it did not")
        if self.stamps:
            names = ", ".join(f"`{n}` (`{path}`)" for n, path in self.stamps.items())
            assumptions.append(f"ages count from stamps, in the clock of the log: {names}")
        assumptions += [
            f"`{n}` is read from the source whose turn it is, as a bridge reads it: {counts}"
            for n, counts in self.sources.items()
        ]
        if self.derived:
            assumptions.append(
                "what is derived is not what the estimator said at that time (see its error)"
            )
        if self.constants:
            names = ", ".join(f"`{n}`" for n in self.constants)
            assumptions.append(
                f"the log does not hold {names}: the mapping says that they stood still"
            )
        return assumptions
