"""The surveillance drone as one program: flown, proved by module, broken where it must be."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from examples_changed import changed
from soter.api import load
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from soter.simulate.result import Run

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
STACK, HOSTILE = DRONE / "surveillance.soter", DRONE / "surveillance_adversaries.soter"
WALLS = ("east", "west", "north", "south", "above", "below")


def flown(path: Path, system: str, until_s: float, seed: int) -> tuple[Run, dict[str, Any]]:
    run = load(path).simulate(system, until=until_s, seed=seed, trace=False)
    topics = run.final["topics"]
    return run, {n.rsplit(".", 1)[-1]: topics[n] for n in topics.dtype.names}


# ---------------------------------------------------------------- proofs, in one program


@pytest.mark.long
def test_the_battery_is_proved_where_everything_flies() -> None:
    (battery,) = load(STACK).verify("SafeBattery", refute=False).modules
    assert battery.verdict == "proved"


@pytest.mark.long
def test_the_motion_primitive_is_proved_where_everything_flies() -> None:
    """By itself, in corridors: `test_corridor_flights.py`."""
    views = load(STACK).verify("SafeMotionPrimitive", refute=False).modules
    assert [m.name.rpartition(" ")[2] for m in views] == list(WALLS)
    assert [m.verdict for m in views] == ["proved"] * 6
    told = [a for a in assumption_texts(views[0].assumptions) if "knows nothing" in a]
    heard = {a.partition(",")[0] for a in told}
    assert heard == {
        "b",
        *("SafeBattery.Land", "SafeBattery.Onwards"),
        *("SafePlanner.KnownWays", "SafePlanner.RRTStar"),
    }


# ---------------------------------------------------------------- flights


def test_the_mission_is_flown() -> None:
    run, last = flown(STACK, "Protected", 200.0, 2)
    assert run.violations == 0
    assert last["inForce"]["adopted"] > 8
    assert run.modules["SafeMotionPrimitive"].ac_share > 0.95
    assert last["landings"]["number"] == 0


@pytest.mark.parametrize(
    ("system", "least"),
    [
        pytest.param("Careless", 1, marks=pytest.mark.long),
        pytest.param("Lying", 2, marks=pytest.mark.long),
        ("Failing", 2),
    ],
)
def test_hostile_parts_break_nothing(system: str, least: int) -> None:
    run, last = flown(HOSTILE, system, 600.0, 5)
    assert run.violations == 0
    book = last["landings"]
    assert book["number"] >= least
    assert book["late"] == 0
    assert book["forced"] >= (1 if system == "Careless" else 0)
    if system != "Careless":
        assert last["inForce"]["refused"] > 0
        assert sum(book["reasons"]) == last["inForce"]["refused"]


@pytest.mark.long
def test_a_landing_is_flown_by_sc_alone(drone: Path) -> None:
    changed(
        drone / HOSTILE.name,
        "  always battery.landing.left > 0.0;\n",
        "  always !battery.landing.active || b.truth.docked\n"
        "      || battery.landing.left > battery.LANDING - 0.5\n"
        "      || mode(SafeMotionPrimitive) == Mode.SC;\n",
    )
    run, last = flown(drone / HOSTILE.name, "Ramming", 400.0, 5)
    assert run.violations == 0
    assert last["landings"]["number"] >= 1


# ---------------------------------------------------------------- what it rests on is needed


@pytest.mark.long
def test_a_landing_that_ac_may_fly_is_not_over_in_time(drone: Path) -> None:
    changed(drone / "corridor.soter", "if !way.careful {", "if true {")
    run, _ = flown(drone / HOSTILE.name, "Ramming", 600.0, 5)
    assert any("landing.left" in v.what for v in run.violation_list)


@pytest.mark.long
def test_a_reserve_for_a_shorter_landing_is_used_up(drone: Path) -> None:
    changed(drone / "battery.soter", "const SPEED: float = 0.5;", "const SPEED: float = 4.0;")
    changed(drone / "battery.soter", "const DELAY: float = 15.0;", "const DELAY: float = 1.0;")
    run, _ = flown(drone / HOSTILE.name, "Careless", 900.0, 5)
    assert any("landing.left" in v.what for v in run.violation_list)


def test_a_planner_that_lets_no_plan_settle_loses_control(drone: Path) -> None:
    """One good plan after the other, faster than any can be taken: delayed, not starved."""

    def straight(inputs: Any) -> dict[str, Any]:
        ends = (inputs.request.start, inputs.request.goal)
        return {"candidate": [(p.x, p.y, p.z) for p in ends]}

    program = load(drone / "planner.soter").bind("RRTStar", straight)
    served = program.simulate(until=150.0, seed=1, trace=False)
    changed(drone / "planner.soter", "|| inForce.overdue;", ";")
    program = load(drone / "planner.soter").bind("RRTStar", straight)
    starved = program.simulate(until=150.0, seed=1, trace=False)
    adopted = [int(r.final["topics"]["inForce"]["adopted"]) for r in (served, starved)]
    assert served.violations == starved.violations == 0
    assert adopted[0] >= 25 > 2 * adopted[1]


# ---------------------------------------------------------------- names


def test_reasons_are_told_in_the_order_of_the_program() -> None:
    def members(text: str) -> list[str]:
        return re.findall(r"\w+", text)

    program = (DRONE / "boxes.soter").read_text(encoding="utf-8")
    verdicts = members(program.split("type Verdict = enum {")[1].split("}")[0])
    logbook = (DRONE / "logbook.soter").read_text(encoding="utf-8")
    listed = re.findall(r"boxes\.Verdict\.(\w+)", logbook.split("REASONS:")[1].split("];")[0])
    script = (DRONE / "patrol.py").read_text(encoding="utf-8")
    said = ast.literal_eval(script.split("REASONS = ")[1].split(")")[0] + ")")
    assert verdicts == listed == list(said)
