"""Holds the results of judging a log: what a program's decision modules would have decided.

Purpose: `LogJudgement` and `ModuleOfLog`, plain records for printing and JSON, with the list of
what such a result takes for granted.
Non-goals: finding them (`log_replay.py`), printing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.monitor.log_files.log_columns import Damage, FarStamps
    from soter.monitor.typed_samples import DerivedValue
    from soter.report.judged_curves import JudgedTimes


ASSUMED = (
    "only reads are judged: where the vehicle was is known to within its estimator's errors",
    (
        "up to its first switch a module decides what it would have decided there; from then on SC "
        "would have flown, which no log shows: later modes are those of the reads alone"
    ),
    (
        "nothing says that this vehicle is the plant of the proof: what was proved holds of it "
        "only as far as its own accelerations, lags and errors keep to the declared ones "
        "(`soter monitor --estimates` asks that)"
    ),
    (
        "the decision module steps at its period without lateness, and AC's outputs, which are not "
        "judged, are taken to pass the gate"
    ),
)


@dataclass(frozen=True)
class LoggedModeChange:
    """A change of mode at `time_s` of the log, and its reason."""

    time_s: float
    to: str
    reason: str


@dataclass(frozen=True)
class NearestMargin:
    """The least `distance` of a condition from failing (< 0: it failed); `bound` is its text."""

    distance: float
    time_s: float
    bound: str


@dataclass
class ModuleOfLog:
    """What one module's DM would have decided on the reads of a log.

    `missing`: topics without which nothing can be decided; all else is then empty. `unheard`:
    topics that let the DM give control back and that the log does not have. Numbers of the DM's
    steps: `waiting` before all its reads had come, `steps` after that. Of these a read was too old
    in `stale`, and in `fresh` none; `ttf`, `safer` and `nan_looks` (one of the two compared a NaN)
    count fresh steps. In `silent` steps the reads were young enough, but not those of nodes before
    the DM, or a measured topic without `max_age` had fallen silent. `last_heard`: the last
    measurement, in s, of each topic that fell silent for good. `safe` was asked in `asked` steps,
    whose reads for it were young enough; in `judged_steps` of these the DM's were, too; in
    `outside` it did not hold. `outside_late`: the times that it did not hold of samples that came
    too late, that the gate refused, or that no step read. `faults`: of predicates. `beyond_s`: how
    long the file goes on after the last chosen row. `damage`: the damage at which judging ended.
    `margin`: the least distance of `ttf` from holding. `clearance`: that of `safe` from failing.
    Each is None if nothing was read, or for `safe` if `blind` names topics that it reads and the
    log does not have. `bounds`: the least distance of each comparison of `ttf`. `span`: where the
    module is declared. `times`: what `safe` compared.
    """

    module: str
    period_ns: int
    missing: tuple[str, ...] = ()
    blind: tuple[str, ...] = ()
    unheard: tuple[str, ...] = ()
    steps: int = 0
    waiting: int = 0
    ac: int = 0
    stale: int = 0
    silent: int = 0
    ttf: int = 0
    safer: int = 0
    asked: int = 0
    judged_steps: int = 0
    outside: int = 0
    outside_late: int = 0
    faults: int = 0
    nan_looks: int = 0
    first_outside_s: float | None = None
    beyond_s: float = 0.0
    damage: Damage | None = None
    changes: list[LoggedModeChange] = field(default_factory=list)
    margin: NearestMargin | None = None
    clearance: NearestMargin | None = None
    bounds: dict[str, NearestMargin] = field(default_factory=dict)
    last_heard: dict[str, float] = field(default_factory=dict)
    span: Span | None = field(default=None, compare=False, repr=False)
    times: JudgedTimes | None = field(default=None, compare=False, repr=False)

    @property
    def decided(self) -> bool:
        """Whether the log has all that the module's DM reads."""
        return not self.missing

    @property
    def judged(self) -> bool:
        """Whether any step was judged: its reads were young enough to ask `safe` about them."""
        return self.judged_steps > 0

    @property
    def judged_share(self) -> float:
        """The share of the DM's steps over the log that were judged."""
        return self.judged_steps / max(1, self.steps + self.waiting)

    @property
    def violated(self) -> bool:
        """Whether `safe` failed on a read; late reads count only if a step was judged as well."""
        return self.outside > 0 or (self.judged and self.outside_late > 0)

    @property
    def why_unjudged(self) -> str:
        """The reason, in words, why no step was judged; "" if some step was judged."""
        if self.judged:
            return ""
        if self.missing:
            return f"its DM reads {', '.join(self.missing)}, which the log does not give"
        if self.blind:
            return f"`safe` reads {', '.join(self.blind)}, which the log does not give"
        if not self.steps:
            return "the log ends before all that its DM reads was there"
        if self.stale == self.steps:
            return "every read of its DM was too old"
        if self.stale + self.silent == self.steps:
            return "what its reads rest on was too old, or silent"
        return "every read of `safe` was too old, or it faulted"

    @property
    def fresh(self) -> int:
        """The number of steps whose reads were young enough."""
        return self.steps - self.stale

    @property
    def switches(self) -> list[LoggedModeChange]:
        """The changes from AC to SC."""
        return [c for c in self.changes if c.to == "SC"]

    @property
    def first_switch_s(self) -> float | None:
        """The time at which AC would first have lost control; None if AC would have kept it."""
        return self.switches[0].time_s if self.switches else None

    @property
    def ac_share(self) -> float:
        """The share of the DM's steps that leave AC in control."""
        return self.ac / self.steps if self.steps else 0.0


def unit_notes(assumed_units: Sequence[str]) -> list[str]:
    """The assumption, if any, that leaves of unknown unit are in the program's units."""
    text = "neither the mapping nor a message says a unit, the program's is taken: "
    return [text + ", ".join(assumed_units)] if assumed_units else []


@dataclass
class LogJudgement:
    """The judgement of a log; times count from the log's first row.

    `from_s`: the first step of a DM; `to_s`: the last record of the log, on any channel. `nodes`:
    the program's nodes that ran for the DMs' reads; `faulted`: those that faulted. `forced`:
    modules whose mode the system forces. By topic: `stamps`: the field with the time of
    measurement; `sources`: the number of samples of each source; `left_out`, `refused`: how many
    samples had no usable value, or lay outside the topic's set, and the first of them; `reasons`:
    the same for each reason of leaving out; `far_stamps`: stamps that differ from the log's clock
    by more than the log's length; `ageless`: the greatest age, in ns, of a read of a topic without
    `max_age`. `lost`: left-out samples and far stamps, in words. `assumed_units`: units that are
    assumed because nobody states them. `notes`: findings that are no errors; `unchecked`: a part of
    the file has no checksum.
    """

    log: str
    from_s: float
    to_s: float
    samples: dict[str, int]
    nodes: tuple[str, ...]
    modules: list[ModuleOfLog]
    derived: list[DerivedValue] = field(default_factory=list)
    constants: tuple[str, ...] = ()
    assumed_units: tuple[str, ...] = ()
    sources: dict[str, str] = field(default_factory=dict)
    forced: tuple[str, ...] = ()
    stamps: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)
    reasons: dict[str, tuple[tuple[int, str], ...]] = field(default_factory=dict)
    refused: dict[str, tuple[int, str]] = field(default_factory=dict)
    faulted: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unchecked: bool = False
    lost: list[str] = field(default_factory=list)
    far_stamps: dict[str, FarStamps] = field(default_factory=dict)
    ageless: dict[str, int] = field(default_factory=dict)

    @property
    def assumptions(self) -> list[str]:
        """The assumptions of the judgement, a sentence each."""
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
            f"`{n}` has no `max_age`: its reads count however old, here up to {show_ns(age)}"
            for n, age in self.ageless.items()
            if age > 0
        ]
        assumptions += [
            f"`{n}` is read from the source whose turn it is, as a bridge reads it: {counts}"
            for n, counts in self.sources.items()
        ]
        assumptions += unit_notes(self.assumed_units)
        if self.unchecked:
            assumptions.append(
                "no checksum covers all of the log: a value or a time that was changed in its "
                "place is not seen"
            )
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
