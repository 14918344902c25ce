"""The three verdicts of a re-check, what was confirmed, about what, and what it does not say.

Purpose: `rechecker.py` raises `RejectedError` where something in a certificate is false, and
`NotRecheckedError` where nothing is known to be false, but this room cannot show it. `Report` and
`RecheckedModule` say for people and programs what it found, and what follows. `FlightReport` counts
the verdicts in the log of a flight that are confirmed; a `Doubt` names each other one.
Non-goals: checking (`rechecker.py`, `flight_check.py` for flights); the verdict itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from soter.language.model.assumption_words import numbered_assumptions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    Said = Iterator[tuple[str, str]]
    """(key, text) of one statement of the report after the other."""


ACCEPTED, REJECTED, NOT_RECHECKED = VERDICTS = "accepted", "rejected", "not re-checked"
"""All that is claimed holds; something is false; nothing is known to be, but not all is shown."""
FOLLOWED = "its decision module follows SC in flight (`rest`), and its entry does not say so"
"""Why a module with `rest` is not re-checked as others are."""
Kind = Literal["contradicted", "not confirmed"]
CONTRADICTED: Kind = "contradicted"
"""The log contradicts itself, or the program."""
UNCONFIRMED: Kind = "not confirmed"
"""It is not certain that the estimate is good; it may be."""
GETS = "AC never has control"
KEEPS = "AC never keeps control"
SAFETY = ("P1a", "P1b", "P1c", "P2a", "P3", "ttf", "safer", "start")
"""Without one of them there is no theorem (docs/proof.md); P2b is about AC's return only."""
IN_FLIGHT = ("P3", "ttf", "safer")
"""The claims that a DM with `rest` decides by its own check: no certificate proves them."""


class RejectedError(Exception):
    """A statement of the certificate is false, or its sets do not show what they must show."""


class NotRecheckedError(Exception):
    """The certificate may be right, but the re-checker cannot show something that it claims."""


@dataclass(frozen=True)
class Doubt:
    """Why a verdict is not confirmed, with its time, its module, and the estimate that it read."""

    time_ns: int
    module: str
    kind: Kind
    reason: str
    estimate: Mapping[str, float] = field(default_factory=dict)


@dataclass
class FlightReport:
    """One log: how many verdicts said "AC", and how many of these were confirmed.

    `modules`: whose verdicts were read; `others`: how many said "SC", which needs no confirmation.
    `to_ns`: the time up to which the log was read; `cut`: why not to its end, or "". `asked`: how
    many verdicts were looked at: all, unless Ctrl-C came (`interrupted`). `unlogged`: topics
    without a message; verdicts that read them are not confirmed. `seconds` of processor time.
    """

    log: str
    system: str
    modules: list[str] = field(default_factory=list)
    verdicts: int = 0
    asked: int = 0
    confirmed: int = 0
    others: int = 0
    to_ns: int = 0
    cut: str = ""
    doubts: list[Doubt] = field(default_factory=list)
    seconds: float = 0.0
    interrupted: bool = False
    unlogged: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """The verdict: REJECTED if something in the log is false, ACCEPTED if all is confirmed."""
        if any(d.kind == CONTRADICTED for d in self.doubts):
            return REJECTED
        return NOT_RECHECKED if self.doubts or self.interrupted else ACCEPTED


def missing_properties(claims: dict[str, str], confirmed: list[str]) -> list[str]:
    """The properties that safety needs but a certificate does not establish; P1c may be assumed.

    An assumed P1c is H >= H* with delays taken as zero: `check_static_claims` compares the two.
    """
    held = {*confirmed, *(n for n in ("P1c",) if claims.get(n) == "assumed")}
    return [n for n in SAFETY if n not in held]


@dataclass(frozen=True)
class RecheckAssumption:
    """An assumption as text. `key` names the subject, in the same way in every verdict."""

    key: str
    text: str


@dataclass
class RecheckedModule:
    """The findings about a module of a system, for these values of the parameters.

    `not_rechecked`: why no claim was checked; `vacuous`: why the claims say almost nothing, as AC
    never has or keeps control; `unseen`: why that was not checked. `stays`: the module has `recover
    never`; `in_flight`: its DM decides by a check in flight, and the basis of that is confirmed.
    `safe`: as in the program. `parameters`: the checked values; `otherwise`: other values in the
    program for that system; `contradicted`: a `set` gives them. `times`: in ns, by their names in a
    manifest, with several plans those of the first; `plan_times`: those of each. `shown`: what was
    confirmed besides the claims.
    """

    name: str
    claims: dict[str, str]
    cells: int = 0
    confirmed: list[str] = field(default_factory=list)
    not_rechecked: str = ""
    vacuous: str = ""
    unseen: str = ""
    stays: bool = False
    in_flight: bool = False
    system: str = ""
    safe: str = ""
    parameters: dict[str, str] = field(default_factory=dict)
    otherwise: dict[str, str] = field(default_factory=dict)
    contradicted: bool = False
    times: dict[str, int] = field(default_factory=dict)
    plan_times: dict[str, dict[str, int]] = field(default_factory=dict)
    assumptions: list[RecheckAssumption] = field(default_factory=list)
    shown: list[RecheckAssumption] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """ACCEPTED or NOT_RECHECKED; a false statement makes the whole certificate REJECTED."""
        return NOT_RECHECKED if self.not_rechecked else ACCEPTED

    @property
    def unconfirmed_claims(self) -> list[str]:
        """The claims that are not confirmed here, with their verdicts in the certificate."""
        return [f"{n} ({v})" for n, v in self.claims.items() if n not in self.confirmed]

    @property
    def says_nothing_of_law(self) -> bool:
        """Whether the certificate claims nothing about the law of `failsafe`."""
        return "failsafe" not in (*self.confirmed, *self.unconfirmed_claims)

    @property
    def missing(self) -> list[str]:
        """The properties that safety needs but that are not established; safe if there are none."""
        return missing_properties(self.claims, self.confirmed)

    @property
    def lacks_flight_only(self) -> bool:
        """Whether everything is confirmed except the claims that its DM decides in flight."""
        return self.in_flight and not {*self.missing} - {*IN_FLIGHT}

    @property
    def has_return(self) -> bool:
        """Whether P2b, that SC gives control back, is confirmed."""
        return "P2b" in self.confirmed


@dataclass
class Report:
    """The verdict, one of `VERDICTS`, and the reason; `seconds` and cells are for people.

    ACCEPTED means that all claims hold; `safe` tells whether that is safety. The verdict is about
    `program` and the system, module and parameter values of each of `modules`, not about the
    modules in `not_covered`. Assumptions are derived from the program; only the numbers of the
    prover's `stated` assumptions are used.
    """

    verdict: str = NOT_RECHECKED
    reason: str = ""
    """Why it is not accepted; "": it is."""
    modules: list[RecheckedModule] = field(default_factory=list)
    program: str = ""
    not_covered: list[RecheckAssumption] = field(default_factory=list)
    stated: list[RecheckAssumption] = field(default_factory=list)
    program_sha256: str = ""
    seal: str = ""
    """SHA-256 of the manifest that was checked, in hexadecimal."""
    seconds: float = 0.0
    flights: list[FlightReport] = field(default_factory=list)
    """The findings on the logs of flights, where some were given."""

    @property
    def accepted(self) -> bool:
        """Whether every claim holds."""
        return self.verdict == ACCEPTED

    @property
    def all_assumptions(self) -> list[RecheckAssumption]:
        """The assumptions of all modules, each once."""
        return list(dict.fromkeys(a for m in self.modules for a in m.assumptions))

    @property
    def assumptions(self) -> list[str]:
        """The assumptions of all modules as texts, each once."""
        return [a.text for a in self.all_assumptions]

    @property
    def assumption_numbers(self) -> dict[str, str]:
        """Numbers each assumption: the prover's in their order, then those that we add."""
        return numbered_assumptions((a.text for a in self.stated), self.assumptions)

    @property
    def safe(self) -> bool:
        """Whether safety is established, for every module."""
        return self.accepted and all(not m.missing for m in self.modules)

    @property
    def modules_decided_in_flight(self) -> list[str]:
        """The modules of which everything is confirmed except what their DMs decide in flight."""
        return [m.name for m in self.modules if m.lacks_flight_only and m.missing]

    @property
    def is_safe_with_flight(self) -> bool:
        """Whether safety is established, or only waits for decisions of DMs in flight."""
        return self.accepted and all(m.lacks_flight_only or not m.missing for m in self.modules)

    @property
    def why_vacuous(self) -> dict[str, str]:
        """For each module whose confirmed claims say almost nothing, the reason."""
        return {m.name: m.vacuous for m in self.modules if m.vacuous}

    @property
    def contradicted(self) -> bool:
        """Whether a module was checked with other values than a system of the program sets."""
        return any(m.contradicted for m in self.modules)

    @property
    def has_return(self) -> bool:
        """Whether P2b is confirmed for all modules of which the program demands it."""
        return self.accepted and all(m.has_return or m.stays for m in self.modules)
