"""Flights of a campaign, flown again to see that they are what its folder says.

Purpose: the same program, system, parameters and seeds; digests compared.
Non-goals: campaigns (`campaigning.py`); flights with externs, whose code nothing names.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.explore.results import ExploreReport
    from soter.program.model.system import System


class AssuredProgram(Protocol):
    """What a case needs of `soter.api.Program`, which imports this room."""

    path: str

    def flat(self, system: str | None = None, params: Mapping[str, object] | None = None) -> System:
        """A system, fresh each time."""

    def explore(self, *, params: Mapping[str, object] | None, output: None) -> ExploreReport:
        """Every test, explored now."""


@dataclass(frozen=True)
class Again:
    """`why`: what is missing; "": every flight that was flown again is the one on the disk."""

    goal: str
    text: str
    why: str = ""
    violated: str = ""


def again(program: AssuredProgram, flat: System, params: Any, folder: Path, most: int) -> Again:  # noqa: ANN401
    """Fly up to `most` flights again, evenly over the campaign; SoterError D006."""
    from soter.campaign.fleet import Fleet  # noqa: PLC0415 - compiles

    about, rows = _read(folder)
    total = f"{len(rows):,} flights of {about['until_ns'] / 1e9:g} s as recorded, "
    total += f"{sum(int(r['violations']) for r in rows)} violations"
    goal = f"No property is violated in the flights of campaign {folder} that were flown again"
    if about["program_sha256"] != flat.program.sha256 or about["system"] != flat.name:
        return Again(goal, total, "the campaign is of another program or system: hashes differ")
    if about["arm"] or about["lateness"] or about["horizon_ns"]:
        return Again(goal, total, "flights of an arm, or with saves, are not flown again here")
    step = max(1, -(-len(rows) // max(most, 1)))
    chosen = rows[::step] if most > 0 else []
    if not chosen:
        return Again(goal, total, "no flight was flown again")
    if not program.flat(flat.name, params).properties:
        return Again(goal, total, "the system has no property: its flights are judged by nothing")
    first, until_ns = int(about["first_seed"]), int(about["until_ns"])
    fleet = Fleet(program.flat(flat.name, params), until_ns)
    flown = {f.number: f for f in fleet.fly([int(r["number"]) for r in chosen], first)}
    other = [r["number"] for r in chosen if flown[int(r["number"])].digest != r["digest"]]
    broken = [f.number for f in flown.values() if f.violations]
    text = f"{len(flown)} flights flown again just now, bit for bit; {total}"
    if other:
        return Again(goal, text, f"flight {other[0]} is another one than the folder says")
    if broken:
        said = f"flight {broken[0]} of the campaign violates a property"
        return Again(goal, text, said, said)
    return Again(goal, text)


def _read(folder: Path) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """What was flown, and a row a flight."""
    try:
        about = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
        with (folder / "flights.csv").open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for r in rows:
            int(r["number"]), int(r["violations"]), r["digest"]
        for name in ("program_sha256", "system", "until_ns", "first_seed", "arm", "lateness"):
            about[name]
    except (OSError, ValueError, KeyError, TypeError) as error:
        message = f"`{folder}` is no folder of `soter campaign`: {error}"
        raise SoterError((Diagnostic("D006", message),)) from error
    return about, rows
