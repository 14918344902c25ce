"""Flights of a campaign, flown again to see that they are what its folder says.

Purpose: the same program, system, parameters and seeds; digests compared.
Non-goals: campaigns (`campaigning.py`); flights with externs, whose code nothing names.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Any, Protocol

from soter.api.assurance.certificate_check import file_hash
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.bounded_read import read_bytes, read_json_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.explore.results import ExploreReport
    from soter.language.model.system import System


class AssuredProgram(Protocol):
    """What a case needs of `soter.api.Program`, which imports this room."""

    path: str

    def flat(self, system: str | None = None, params: Mapping[str, object] | None = None) -> System:
        """A system, fresh each time."""

    def declared(
        self, system: str | None = None, params: Mapping[str, object] | None = None
    ) -> System:
        """The same as it is declared."""

    def explore(self, *, params: Mapping[str, object] | None, output: None) -> ExploreReport:
        """Every test, explored now."""


FLIGHTS_MAX = 2**32
"""Bytes of the table of a campaign."""
NUMBERS = 2**31
"""Flights have lower numbers."""


@dataclass(frozen=True)
class ReplayedFlights:
    """`why`: what is missing; "": every flight that was flown again is the one on the disk."""

    goal: str
    text: str
    why: str = ""
    violated: str = ""


@dataclass(frozen=True)
class FlightFolder:
    """The folder of a campaign: what was flown, and a row a flight; `file` holds the rows."""

    file: Path
    sha256: str
    about: dict[str, Any]
    rows: list[dict[str, str]]


def replay_flights(
    program: AssuredProgram,
    flat: System,
    params: Any,  # noqa: ANN401 - as given
    given: FlightFolder,
    most: int,
) -> ReplayedFlights:
    """Fly up to `most` flights again: those that violate as recorded first, then evenly."""
    about, rows = given.about, given.rows
    total = f"{len(rows):,} flights of {about['until_ns'] / 1e9:g} s as recorded, "
    total += f"{sum(int(r['violations']) for r in rows)} violations"
    folder = given.file.parent
    goal = f"No property is violated in the flights of campaign {folder} that were flown again"
    why = _not_flown(flat, about)
    if why:
        return ReplayedFlights(goal, total, why)
    chosen = _chosen(rows, most)
    if not chosen:
        return ReplayedFlights(goal, total, "no flight was flown again")
    if not program.flat(flat.name, params).properties:
        return ReplayedFlights(
            goal, total, "the system has no property: its flights are judged by nothing"
        )
    from soter.campaign.batch_flights import Fleet  # noqa: PLC0415 - compiles

    first, until_ns = int(about["first_seed"]), int(about["until_ns"])
    fleet = Fleet(program.flat(flat.name, params), until_ns)
    code = fleet.code()
    if code["unknown"] or about.get("linked", {}) != code["linked"]:
        said = f"cannot be known ({code['unknown']})" if code["unknown"] else "is another now"
        return ReplayedFlights(goal, total, f"the C of externs that the campaign flew {said}")
    flown = {f.number: f for f in fleet.fly([int(r["number"]) for r in chosen], first)}
    other = [r["number"] for r in chosen if flown[int(r["number"])].digest != r["digest"]]
    broken = [f.number for f in flown.values() if f.violations]
    text = f"{len(flown)} flights flown again just now, bit for bit; {total}"
    if other:
        return ReplayedFlights(goal, text, f"flight {other[0]} is another one than the folder says")
    if broken:
        said = f"flight {broken[0]} of the campaign violates a property"
        return ReplayedFlights(goal, text, said, said)
    if any(int(r["violations"]) for r in rows):
        return ReplayedFlights(
            goal, text, "flights that violate a property as recorded were not flown again"
        )
    return ReplayedFlights(goal, text)


def _not_flown(flat: System, about: dict[str, Any]) -> str:
    """Why nothing is flown again; "": it is."""
    if about["program_sha256"] != flat.program.sha256 or about["system"] != flat.name:
        return "the campaign is of another program or system: hashes differ"
    if about["arm"] or about["lateness"] or about["horizon_ns"]:
        return "flights of an arm, or with saves, are not flown again here"
    if not flat.properties:
        return f"system {flat.name} has no property that a flight could violate"
    return ""


def _chosen(rows: list[dict[str, str]], most: int) -> list[dict[str, str]]:
    """So many rows at most, each flight once."""
    if most <= 0:
        return []
    each = list({int(r["number"]): r for r in rows}.values())
    first = [r for r in each if int(r["violations"])][:most]
    rest = [r for r in each if r not in first]
    left = most - len(first)
    return [*first, *(rest[:: max(1, -(-len(rest) // left))] if left else [])]


def read_flights(folder: Path) -> FlightFolder:
    """What was flown, and a row a flight; SoterError D006."""
    file = folder / "flights.csv"
    try:
        about = json.loads(read_json_text(folder / "campaign.json"))
        text = read_bytes(file, FLIGHTS_MAX).decode("utf-8")
        rows = list(csv.DictReader(StringIO(text, newline="")))
        wrong = _wrong(about, rows)
    except (
        OSError,
        ValueError,
        OverflowError,
        KeyError,
        TypeError,
        RecursionError,
        csv.Error,
    ) as error:
        message = f"`{folder}` is no folder of `soter campaign`: {error}"
        raise SoterError((Diagnostic("D006", message),)) from error
    if wrong:
        message = f"`{folder}` is no folder of `soter campaign`: {wrong}"
        raise SoterError((Diagnostic("D006", message),))
    return FlightFolder(file, file_hash(file), about, rows)


def _wrong(about: dict[str, Any], rows: list[dict[str, str]]) -> str:
    """What is not as it should be; ValueError, KeyError, TypeError as well."""
    for name in ("program_sha256", "system", "arm", "lateness", "horizon_ns"):
        about[name]
    if int(about["until_ns"]) <= 0 or int(about["first_seed"]) < 0:
        return "`until_ns` or `first_seed` is out of range"
    for r in rows:
        if not 0 <= int(r["number"]) < NUMBERS or int(r["violations"]) < 0 or not r["digest"]:
            return f"flight {r['number']} is out of range"
    return ""
