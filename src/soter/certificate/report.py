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


class RejectedError(Exception):
    """A statement of the certificate is false, or does not show what it is there to show."""


class NotRecheckedError(Exception):
    """The certificate may be right, but needs something that the re-checker does not know or do."""


Kind = Literal["contradicted", "not confirmed"]
CONTRADICTED: Kind = "contradicted"
"""The log contradicts itself, or the program."""
UNCONFIRMED: Kind = "not confirmed"
"""It is not certain that the estimate is good; it may be."""


@dataclass(frozen=True)
class Doubt:
    """Why a verdict is not confirmed: when (ns), whose, and of which estimate, by `topic.leaf`."""

    time_ns: int
    module: str
    kind: Kind
    reason: str
    estimate: Mapping[str, float] = field(default_factory=dict)


@dataclass
class FlightReport:
    """One log: how many verdicts said "AC", and how many of these were confirmed.

    `modules`: whose verdicts; `others` said "SC", which needs no confirmation. `to_ns`: up to where
    the log was read; `cut`: why not to its end, "" where it was. `asked`: so many of the verdicts,
    all but where Ctrl-C ended it (`interrupted`). `unlogged`: topics without a message in the log,
    so that verdicts which read them are not confirmed. `seconds` of processor time.
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
        """REJECTED where something in the log is false, ACCEPTED where all is confirmed."""
        if any(d.kind == CONTRADICTED for d in self.doubts):
            return REJECTED
        return NOT_RECHECKED if self.doubts or self.interrupted else ACCEPTED


GETS = "AC never has control"
KEEPS = "AC never keeps control"
SAFETY = ("P1a", "P1b", "P1c", "P2a", "P3", "ttf", "safer", "start")
"""Without one of them there is no theorem (docs/proof.md); P2b is about AC's return only."""

IN_FLIGHT = ("P3", "ttf", "safer")
"""The claims that a DM with `rest` decides by its own check: no certificate proves them."""


def missing_of(claims: dict[str, str], confirmed: list[str]) -> list[str]:
    """The properties that safety needs and a certificate does not establish; P1c may be assumed.

    An assumed P1c is H >= H* with delays taken for zero: `check_static_claims` compares them.
    """
    held = {*confirmed, *(n for n in ("P1c",) if claims.get(n) == "assumed")}
    return [n for n in SAFETY if n not in held]


@dataclass(frozen=True)
class RecheckAssumption:
    """An assumption; `key`: its subject, the same for the same subject in every verdict."""

    key: str
    text: str


@dataclass
class RecheckedModule:
    """The findings on one module of a system, for these values of the parameters.

    `not_rechecked`: why its claims were not checked, none of which is confirmed then; `vacuous`:
    why that says next to nothing, as AC never has, or keeps, control; `unseen`: why that was not
    looked at. `stays`: `recover never`; `in_flight`: its DM decides by a check of its own, of which
    what it rests on is confirmed; `safe`: as the program writes it. `parameters`: each of the
    program with the value that was checked; `otherwise`: those to which the program gives another
    value in that system, with that one; `contradicted`: a `set` does. `times`: in ns, by their
    names in a manifest, what the claims were held to; of several plans the first's, and
    `plan_times` has those of each; `shown`: what was confirmed beside the
    claims.
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
        """ACCEPTED or NOT_RECHECKED: where something is false, that is said of the whole."""
        return NOT_RECHECKED if self.not_rechecked else ACCEPTED

    @property
    def other(self) -> list[str]:
        """Properties that are not confirmed here, with what the certificate says."""
        return [f"{n} ({v})" for n, v in self.claims.items() if n not in self.confirmed]

    @property
    def law_untold(self) -> bool:
        """Whether the certificate says nothing of the law of `failsafe`."""
        return "failsafe" not in (*self.confirmed, *self.other)

    @property
    def missing(self) -> list[str]:
        """The properties that safety needs and that are not established; empty: it is safe."""
        return missing_of(self.claims, self.confirmed)

    @property
    def decided(self) -> bool:
        """Whether all is confirmed but what its DM decides in flight."""
        return self.in_flight and not {*self.missing} - {*IN_FLIGHT}

    @property
    def returns(self) -> bool:
        """Whether P2b is confirmed: SC gives control back."""
        return "P2b" in self.confirmed


@dataclass
class Report:
    """The verdict, one of `VERDICTS`, and why; `seconds` and cells for people.

    Accepted says that what is claimed holds: whether that is safety, see `safe`. It is about
    `program`, and the system, module and parameter values of each of `modules`; not about what
    stands in `not_covered`. The assumptions are derived from the program; `stated`: what the
    prover wrote about its own, of which nothing but the numbers is taken.
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
    def said(self) -> list[RecheckAssumption]:
        """The assumptions of all modules, each once."""
        return list(dict.fromkeys(a for m in self.modules for a in m.assumptions))

    @property
    def assumptions(self) -> list[str]:
        """The assumptions of all modules in words, each once."""
        return [a.text for a in self.said]

    @property
    def assumption_numbers(self) -> dict[str, str]:
        """The number of each text: the prover's in its order, then what is derived beyond them."""
        return numbered_assumptions((a.text for a in self.stated), self.assumptions)

    @property
    def safe(self) -> bool:
        """Whether safety is established, for every module."""
        return self.accepted and all(not m.missing for m in self.modules)

    @property
    def in_flight(self) -> list[str]:
        """Modules of which all is confirmed but what their DMs decide in flight."""
        return [m.name for m in self.modules if m.decided and m.missing]

    @property
    def decided(self) -> bool:
        """Whether safety is established, or rests on what DMs decide in flight alone."""
        return self.accepted and all(m.decided or not m.missing for m in self.modules)

    @property
    def vacuous(self) -> dict[str, str]:
        """Modules of which what is confirmed says next to nothing, and why."""
        return {m.name: m.vacuous for m in self.modules if m.vacuous}

    @property
    def contradicted(self) -> bool:
        """Whether it is about other values than a system of the program sets."""
        return any(m.contradicted for m in self.modules)

    @property
    def returns(self) -> bool:
        """Whether P2b is confirmed wherever the program asks for it."""
        return self.accepted and all(m.returns or m.stays for m in self.modules)
