"""Robots of several modules, tested by parts: every part can fail, and all are needed.

*delivery*: SOTER-on-ROS's two robots of three modules each (examples/testing/delivery.soter).
*surveillance*: battery, planner and motion primitive of the paper's drone, each in a system of its
own, and the first second of all that flies by parts (examples/drone/surveillance_test.soter).
"""

from __future__ import annotations

import re
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.explore.assumptions import replacements_in_test
from soter.explore.command import TraceHeader, explore_test
from soter.explore.results import EXHAUSTED, VIOLATED, wholes_by_parts
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.explore.results import TestResult

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MEMORY = 2 << 30


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
    """A program, and what may be wrong."""

    name: str
    file: Path
    mutants: tuple[Mutant, ...]


DELIVERY = Robots(
    "delivery",
    EXAMPLES / "testing" / "delivery.soter",
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


def explored(file: Path, text: str, tests: tuple[str, ...]) -> list[TestResult]:
    """Tests of a program whose text may be another than that of its file."""
    program = check_file(str(file), text)
    results = []
    for test in tests or tuple(program.tests):
        told = TraceHeader(str(file), {}, replacements_in_test(program.tests[test]))
        options = SearchOptions(memory=MEMORY, minimise=0.0)
        results.append(explore_test(system_of_test(program, test), options, told))
    return results


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
        results = explored(program, text, mutant.tests)
    return all(r.verdict == VIOLATED and r.replayed is not None for r in results)


@pytest.mark.long
@pytest.mark.parametrize(
    ("robots", "mutant"),
    [pytest.param(r, m, id=m.what) for r in ROBOTS for m in r.mutants],
)
def test_a_wrong_program_breaks_a_property_or_a_contract(robots: Robots, mutant: Mutant) -> None:
    assert caught(robots, mutant)


@pytest.mark.long
@pytest.mark.parametrize("robots", ROBOTS, ids=lambda r: r.name)
def test_the_right_program_is_clean(robots: Robots) -> None:
    text = robots.file.read_text(encoding="utf-8")
    results = explored(robots.file, text, ())
    assert {r.name: r.verdict for r in results} == {r.name: EXHAUSTED for r in results}
    (whole,) = wholes_by_parts(results)
    assert not whole.missing


def test_a_wrong_battery_of_the_drone_breaks_its_part_of_the_whole() -> None:
    wrong = next(m for m in SURVEILLANCE.mutants if m.tests == ("BatteryPart",))
    assert caught(SURVEILLANCE, wrong)
    text = SURVEILLANCE.file.read_text(encoding="utf-8")
    (right,) = explored(SURVEILLANCE.file, text, wrong.tests)
    assert right.verdict == EXHAUSTED


@pytest.mark.whole
def test_what_is_said_of_the_whole_needs_every_part_clean() -> None:
    given = DELIVERY.file.read_text(encoding="utf-8")
    short = re.sub(r"horizon \d+ms", "horizon 30ms", given)
    names = tuple(check_file(str(DELIVERY.file), short).tests)
    results = explored(DELIVERY.file, short, names)
    assert [r.verdict for r in results] == [EXHAUSTED for _ in names]
    (whole,) = wholes_by_parts(results)
    assert not whole.missing
    assert whole.horizon_ns == 30_000_000
    assert not whole.assumed, "who is replaced by a plant is heard by nobody"
    (some,) = wholes_by_parts(results[1:3])
    assert any("runs as it is in no test" in why for why in some.missing)
    results[1].verdict = VIOLATED
    (broken,) = wholes_by_parts(results)
    assert "Fenced0 is not exhausted and clean" in broken.missing
    assert "not shown as a whole" in broken.text
