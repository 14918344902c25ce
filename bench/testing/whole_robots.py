"""Whole robots under `soter test`, one module at a time; wrong ones to be seen; undivided.

    .venv/bin/python bench/testing/whole_robots.py [--only NAME ...] [--seconds 45]

*delivery*: SOTER-on-ROS's two robots of three modules each (examples/testing/delivery.soter).
*surveillance*: battery, planner and motion primitive of the paper's drone, each in a system of its
own, and the first second of all that flies by parts (examples/drone/surveillance_test.soter).
Each test is run as `soter test` runs it; seconds are those of the search, without its compiler.
*whole* is what the command says of the system that nobody searched. A *mutant* is one line made
wrong; it is caught where a test that is named is violated and the interpreter replays it.
*undivided* is all of the system as it is, for so many seconds.

Purpose: the row of issue 31 on whole robots. Non-goals: verdicts
(tests/correct/test_whole_robots.py).
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.command import TraceHeader, explore_test
from soter.explore.contract_use import replaced_in
from soter.explore.results import EXHAUSTED, VIOLATED, wholes
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.explore.results import TestResult

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TARGET_S, MEMORY = 60.0, 2 << 30


@dataclass(frozen=True)
class Mutant:
    """One line made wrong, and the tests that see it; `file`: beside the program, "": itself."""

    what: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    file: str = ""


@dataclass(frozen=True)
class Robots:
    """A program, a test of all of it (its clauses; "": there is none), and what may be wrong."""

    name: str
    file: Path
    undivided: str
    mutants: tuple[Mutant, ...]


DELIVERY = Robots(
    "delivery",
    EXAMPLES / "testing" / "delivery.soter",
    "system Hall; horizon 160ms; always Apart(r[0].body.truth.at, r[1].body.truth.at);",
    (
        Mutant(
            "the battery is looked at too late",
            "const RESERVE: int = 5;",
            "const RESERVE: int = 0;",
            ("NeverEmpty0",),
        ),
        Mutant(
            "the fence's ttf forgets a tick",
            "ttf Away(place, HOME) > FAR - LOOK;",
            "ttf Away(place, HOME) > FAR - 1;",
            ("Fenced0",),
        ),
        Mutant(
            "the fence's SC goes on outwards",
            "publish wish = Backwards(place, HOME);",
            "publish wish = Move.Out;",
            ("Fenced0",),
        ),
        Mutant(
            "the gap forgets that the other one moves",
            "const GAP: int = 5;",
            "const GAP: int = 3;",
            ("NeverTogether",),
        ),
        Mutant(
            "who backs off goes the wrong way",
            "step { publish drive = Backwards(place, HOME); }",
            "step { publish drive = Move.Out; }",
            ("NeverTogether",),
        ),
        Mutant(
            "Follow flies a mission that was called off",
            "publish drive = mission == Mission.Dock ? Backwards(place, HOME) : wish;",
            "publish drive = wish;",
            ("NeverEmpty0",),
        ),
        Mutant(
            "the other robot is seen when it is there",
            "ttf Near(place, other);",
            "ttf place.column == other.column;",
            ("NeverTogether",),
        ),
    ),
)
SURVEILLANCE = Robots(
    "surveillance",
    EXAMPLES / "drone" / "surveillance_test.soter",
    "",
    (
        Mutant(
            "a landing is counted as too cheap",
            "const DRAIN: float = 1.1 * MOST;",
            "const DRAIN: float = 0.8 * MOST;",
            ("Battery",),
            "battery.soter",
        ),
        Mutant(
            "the battery's ttf is too late",
            "ttf margin < E + SPENT * TURN + CELL;",
            "ttf margin < -0.05;",
            ("Battery",),
            "battery.soter",
        ),
        Mutant(
            "the battery's SC flies on",
            "step { publish go = 0.0; }",
            "step { publish go = 1.0; }",
            ("Battery",),
            "battery.soter",
        ),
        Mutant(
            "a plan through a building comes into force",
            "        if Proper(c) {",
            "        if c.verdict != boxes.Verdict.Empty {",
            ("Planner",),
            "planner.soter",
        ),
        Mutant(
            "the motion primitive's ttf looks at no wall",
            "  ttf !S0(east, west, north, south, above, below, H) || !permit;",
            "  ttf !permit;",
            ("MotionPrimitive",),
            "corridor.soter",
        ),
        Mutant(
            "the motion primitive's SC flies into the wall",
            "  return clamp(9.0 * (clamp(",
            "  return clamp(-9.0 * (clamp(",
            ("MotionPrimitive",),
            "corridor.soter",
        ),
        Mutant(
            "the battery's SC takes off, whatever is left",
            "step { publish go = 0.0; }",
            "step { publish go = 0.5; }",
            ("BatteryPart",),
            "battery.soter",
        ),
        Mutant(
            "who is charged a little may take off",
            "  safer margin > FULL;",
            "  safer margin > 0.3 * FULL;",
            ("BatteryPart",),
            "battery.soter",
        ),
        Mutant(
            "a landing is broken off in the dock",
            "        now.active = !onwards || now.left < LANDING;",
            "        now.active = false;",
            ("BatteryPart",),
            "battery.soter",
        ),
        Mutant(
            "nobody takes off",
            "step { publish onwards = go > 0.0; }",
            "step { publish onwards = go > 1.0; }",
            ("BatteryPart",),
            "battery.soter",
        ),
        Mutant(
            "the follower takes any plan that is not empty",
            "        if Proper(c) {",
            "        if c.verdict != boxes.Verdict.Empty {",
            ("PlannerPart",),
            "planner.soter",
        ),
        Mutant(
            "the safe planner knows no way but straight on",
            "      publish candidate = roadmap.Route(request.start, request.goal);",
            "      publish candidate = [request.start, request.goal];",
            ("PlannerPart",),
            "planner.soter",
        ),
        Mutant(
            "the next box is entered before the vehicle may",
            "      if MayEnter(blocks[at + 1], m) {",
            "      if Wide(blocks[at + 1]) {",
            ("MotionPart",),
            "corridor.soter",
        ),
        Mutant(
            "the motion primitive's SC creeps away from the dock",
            "-creep, creep) - m.w), -u, u);",
            "creep, creep) - m.w), -u, u);",
            ("MotionPart",),
            "corridor.soter",
        ),
        Mutant(
            "a landing may take any way",
            "        asked.longest = docks.LONGEST;",
            "        asked.longest = cover.LONGEST;",
            ("MotionPart",),
            "surveillance.soter",
        ),
        Mutant(
            "the logbook counts a refusal in every step",
            "      refused = planner.inForce.refused;",
            "      refused = planner.inForce.adopted;",
            ("LogbookPart",),
            "logbook.soter",
        ),
    ),
)
ROBOTS = (DELIVERY, SURVEILLANCE)


@dataclass
class Row:
    """One test: `seconds` of the search, `bytes` of all that it kept."""

    robots: str
    test: str
    verdict: str
    states: int
    seconds: float
    bytes: int
    violated: str = ""


def explored(file: Path, text: str, tests: tuple[str, ...], time: float | None) -> list[TestResult]:
    """Tests of a program whose text may be another than that of its file."""
    program = check_file(str(file), text)
    results = []
    for test in tests or tuple(program.tests):
        told = TraceHeader(str(file), {}, replaced_in(program.tests[test]))
        options = SearchOptions(memory=MEMORY, minimise=0.0, time=time)
        results.append(explore_test(system_of_test(program, test), options, told))
    return results


def row_of(robots: Robots, result: TestResult) -> Row:
    return Row(
        robots.name,
        result.name,
        result.verdict if result.bound is None else f"{result.verdict}: {result.bound}",
        result.states,
        result.seconds,
        result.total_bytes,
        "" if result.broken is None else result.broken.text,
    )


def caught(robots: Robots, mutant: Mutant) -> bool:
    """Whether all tests that are named are violated, and the interpreter says so as well."""
    with tempfile.TemporaryDirectory(prefix="soter-bench-") as name:
        folder = Path(shutil.copytree(robots.file.parent, Path(name) / "robots"))
        wrong = folder / (mutant.file or robots.file.name)
        text = wrong.read_text(encoding="utf-8")
        assert text.count(mutant.right) == 1, mutant.what
        wrong.write_text(text.replace(mutant.right, mutant.wrong), encoding="utf-8")
        program = folder / robots.file.name
        text = program.read_text(encoding="utf-8")
        results = explored(program, text, mutant.tests, None)
    return all(r.verdict == VIOLATED and r.replayed is not None for r in results)


def undivided(robots: Robots, seconds: float) -> list[Row]:
    """All of the system, for so many seconds; none where there is no test of all of it."""
    if not robots.undivided:
        return []
    text = robots.file.read_text(encoding="utf-8") + f"\ntest Undivided {{ {robots.undivided} }}\n"
    (result,) = explored(robots.file, text, ("Undivided",), seconds)
    row = row_of(robots, result)
    row.verdict += f", {(result.covered_ns or 0) / 1e6:.0f} ms covered"
    return [row]


def told(robots: Robots, rows: list[Row], sayings: list[str], whole: list[Row]) -> list[str]:
    """Prints one program's rows; what misses its target."""
    cells = [
        (
            r.test,
            r.verdict,
            f"{r.states:,}",
            f"{r.seconds:.2f} s",
            f"{r.bytes / 1e6:.0f} MB",
        )
        for r in (*rows, *whole)
    ]
    print(table((robots.name, "ends", "states", "search", "kept"), cells))
    print("\n".join(sayings))
    missed = [f"{r.test}: {r.verdict} {r.violated}" for r in rows if r.verdict != EXHAUSTED]
    spent = sum(r.seconds for r in rows)
    print(f"tests of {robots.name} together: {spent:.1f} s (target: {TARGET_S:.0f} s)")
    missed += [f"{robots.name}: {spent:.1f} s"] if spent > TARGET_S else []
    for mutant in robots.mutants:
        seen = caught(robots, mutant)
        print(f"  {'caught' if seen else 'MISSED'}  {mutant.what} ({', '.join(mutant.tests)})")
        missed += [] if seen else [f"{robots.name}: {mutant.what}"]
    return missed


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=[r.name for r in ROBOTS])
    parser.add_argument("--seconds", type=float, default=45.0, help="of what is undivided")
    arguments = parser.parse_args()
    all_rows, missed = [], []
    for robots in ROBOTS:
        if arguments.only and robots.name not in arguments.only:
            continue
        text = robots.file.read_text(encoding="utf-8")
        results = explored(robots.file, text, (), 2.0 * TARGET_S)
        rows, sayings = [row_of(robots, r) for r in results], [w.text for w in wholes(results)]
        whole = undivided(robots, arguments.seconds)
        missed += told(robots, rows, sayings, whole)
        all_rows += [*rows, *whole]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"most memory of the process: {peak / 1e6:,.0f} MB (target: {MEMORY / 1e6:,.0f} MB)")
    missed += ["memory"] if peak > MEMORY else []
    print("\n".join(missed) if missed else "every target is met")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
