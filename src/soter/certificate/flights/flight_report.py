"""What a re-check says of the log of a flight.

Purpose: `FlightReport` and `Doubt`: verdicts that are confirmed are counted, all others are named.
Non-goals: checking (`flight_check.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from soter.certificate.format.errors import ACCEPTED, NOT_RECHECKED, REJECTED

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    """Of one log: how many verdicts said "AC", and of how many of these that was confirmed.

    `modules`: whose verdicts; `others` said "SC", which needs no confirmation. `to_ns`: up to where
    the log was read; `cut`: why not to its end, "" where it was. `asked`: so many of the verdicts,
    all but where Ctrl-C ended it (`interrupted`). `unlogged`: topics without a message in the log,
    so that nothing is compared with what was read of them. `seconds` of processor time.
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
