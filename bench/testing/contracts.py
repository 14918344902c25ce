"""Three modules at once in `soter test`: one at a time among contracts, and all as they are.

    .venv/bin/python bench/testing/contracts.py [--runs 3] [--seconds 175] [--json FILE]

The program is examples/testing/three_modules.soter: planner, motion primitive, battery; 400 ms.
*Planner*, *Primitive*, *Battery* are its tests: the module of that name runs as it is, others are
replaced by their contracts (the motion primitive, for the battery, by a node). *together* is the
same system without any of that, in every order of an instant, for so many seconds at most;
*together, deployed order* declares the order. *stubborn* has a safe controller that forgets to
land: among contracts, and together (its contract cut out, so that only φ_bat is there to be
violated). Times of searches are medians; bytes are of all that is kept.

Purpose: the row of issue 12 on three modules. Non-goals: verdicts (tests/correct).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.explore.engine.search import Found

FILE = Path(__file__).resolve().parents[2] / "examples" / "testing" / "three_modules.soter"
HORIZON_NS = 400_000_000
TARGET_S = 60.0
WHOLE = """
test %s {
  system Stack;
  %s
  horizon 400ms;
  always PhiPlan(inForce) && PhiMpr(body.truth.at) && PhiBat(body.truth.up, cells.truth.left);
}
"""
CLAUSE = "  guarantees lands: command == Command.Down || mission == Mission.Fly;\n"
LANDS = "publish command = mission == Mission.Land ? Command.Down : home;"
STAYS = "publish command = home;"
ABSTRACTED = ("Planner", "Primitive", "Battery")


@dataclass(frozen=True)
class Row:
    """One search: `wanted` is the status that it has to end with, "" where any will do."""

    name: str
    test: str
    text: str
    wanted: str


@dataclass
class Measured:
    """What it took; `covered_ns`: all executions were covered before that."""

    name: str
    status: str
    states: int
    transitions: int
    seconds: float
    covered_ns: int
    total_bytes: int
    as_wanted: bool


def rows() -> list[Row]:
    """All searches, with the programs that they are of."""
    given = FILE.read_text(encoding="utf-8")
    whole = given + WHOLE % ("Together", "") + WHOLE % ("Deployed", "order deployed;")
    assert given.count(LANDS) == 1
    assert given.count(CLAUSE) == 1
    stubborn = whole.replace(LANDS, STAYS)
    unsaid = stubborn.replace(CLAUSE, "")
    return [
        *(Row(t, t, given, "exhausted") for t in ABSTRACTED),
        Row("together", "Together", whole, ""),
        Row("together, deployed order", "Deployed", whole, "exhausted"),
        Row("stubborn: Primitive", "Primitive", stubborn, "violated"),
        Row("stubborn: together", "Together", unsaid, ""),
    ]


def searched(row: Row, seconds: float) -> Found:
    """One search, compiled before; it ends after so many seconds."""
    system = system_of_test(check_file(str(FILE), row.text), row.test)
    with Search(system, SearchOptions(time=seconds)) as search:
        return search.run()


def measured(row: Row, runs: int, seconds: float) -> Measured:
    """The median of some runs; of one where it takes longer than a tenth of the time."""
    searches = [searched(row, seconds)]
    while len(searches) < runs and searches[0].seconds < seconds / 10:
        searches.append(searched(row, seconds))
    one = searches[0]
    return Measured(
        row.name,
        one.status,
        one.states,
        one.transitions,
        median(f.seconds for f in searches),
        HORIZON_NS if one.status == "exhausted" else one.covered_ns,
        one.total_bytes,
        row.wanted in {"", one.status},
    )


def main() -> int:
    """Print a line for each search; 1 where one ends as it should not, or takes too long."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=175.0)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    measurements = [measured(r, given.runs, given.seconds) for r in rows()]
    lines = [
        [
            m.name,
            m.status,
            f"{m.states:,}",
            f"{m.transitions:,}",
            f"{m.seconds:.2f} s",
            f"{m.covered_ns / 1e6:.0f} ms",
            f"{m.total_bytes / 1e6:.0f} MB",
        ]
        for m in measurements
    ]
    head = ["three modules, 400 ms", "ends", "states", "transitions", "search", "covered", "kept"]
    print(table(head, lines))
    abstracted = sum(m.seconds for m in measurements if m.name in ABSTRACTED)
    print(f"one at a time, together: {abstracted:.2f} s (target: {TARGET_S:.0f} s)")
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(m) for m in measurements], indent=1))
    return 0 if all(m.as_wanted for m in measurements) and abstracted <= TARGET_S else 1


if __name__ == "__main__":
    sys.exit(main())
