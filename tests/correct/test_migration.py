"""Modules made of filters of others: proved, and kept by flights that others' rules do not keep.

Purpose: examples/migration. The same adversaries on both sides (bench/peers/worlds.py): behind the
module nothing is violated and AC still acts; behind a documented rule with its document's numbers
something is, so the adversary is one.
Non-goals: peers that have to be installed: bench/peers/beside_peers.py flies those.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="the extra `learn` is not installed")

from bench.peers.beside_peers import fence, protected, zones
from bench.peers.worlds import Copter, Docking, Rover, World, fly

import soter

if TYPE_CHECKING:
    from soter.simulate.result import Run

MIGRATION = Path(__file__).resolve().parents[2] / "examples" / "migration"
WORLDS: dict[str, tuple[type[World], float]] = {
    "docking": (Docking, 10.0),
    "stop_zone": (Rover, 20.0),
    "geofence": (Copter, 30.0),
}


@pytest.mark.parametrize("name", WORLDS)
def test_the_module_is_proved_with_its_times(name: str) -> None:
    (module,) = soter.load(MIGRATION / f"{name}.soter").verify(refute=False).modules
    verdicts = {key: finding.verdict for key, finding in module.findings.items()}
    assert verdicts.pop("failsafe") == "assumed"  # none is declared
    assert verdicts.pop("P2b") == ("assumed" if name == "stop_zone" else "proved")
    assert set(verdicts.values()) == {"proved"}, verdicts


def test_somebody_else_agrees(tmp_path: Path) -> None:
    soter.load(MIGRATION / "stop_zone.soter").verify(refute=False, cert=tmp_path / "cert")
    again = soter.recheck(tmp_path / "cert")
    assert again.accepted, again.reason


@pytest.mark.filterwarnings("ignore::soter.gym.SafetyWarning")
@pytest.mark.parametrize("name", WORLDS)
def test_no_adversary_gets_through_and_wishes_still_act(name: str) -> None:
    world, seconds = WORLDS[name]
    for exact in (True, False):
        flown = protected(world(exact), MIGRATION / f"{name}.soter", 3, seconds)
        assert flown[0] == 0, f"{flown[1]} {world.unit} beyond"
        assert 0.1 < flown[2] < 0.95


def test_the_same_adversaries_get_through_rules_with_numbers_of_their_documents() -> None:
    assert fly(Rover(exact=False), zones(0.4, 0.6), 3, 20.0)[0] == 3
    assert fly(Copter(exact=True), fence(Copter.ends, ahead=False), 3, 30.0)[0] > 0


def test_room_that_somebody_left_keeps_the_rules_in_as_well() -> None:
    assert fly(Rover(exact=False), zones(1.5, 2.0), 3, 20.0)[0] == 0
    assert fly(Copter(exact=False), fence((42.0, 32.0, 27.0), ahead=False), 3, 30.0)[0] == 0
    assert fly(Copter(exact=False), fence(Copter.ends, ahead=True), 3, 30.0)[0] == 0


def flown(name: str, system: str, seeds: int) -> list[Run]:
    program = soter.load(MIGRATION / f"{name}.soter")
    return [program.simulate(system, seed=seed) for seed in range(seeds)]


@pytest.mark.parametrize("name", ["zone_size", "back_away"])
def test_a_rover_of_rest_is_proved_and_somebody_else_agrees(name: str, tmp_path: Path) -> None:
    program = soter.load(MIGRATION / f"{name}.soter")
    (module,) = program.verify(refute=False, cert=tmp_path / "cert").modules
    assert {module.findings[key].verdict for key in ("P2a", "start")} == {"proved"}
    again = soter.recheck(tmp_path / "cert")
    assert again.accepted, again.reason


def test_zones_that_are_computed_keep_people_whom_the_tutorial_s_zone_touches() -> None:
    violated = {
        system: sum(run.violations > 0 for run in flown("zone_size", system, 20))
        for system in ("Protected", "TutorialZone", "ComputedZones")
    }
    assert violated == {"Protected": 0, "TutorialZone": 20, "ComputedZones": 0}


@pytest.mark.long
def test_a_stop_zone_holds_a_rover_that_a_judged_command_lets_go() -> None:
    """Seconds in which the rover was told to leave what is nearer than the zone, and stood."""

    def held(run: Run) -> float:
        front, back, v, wish = (
            run.array(name) for name in ("seen.front", "seen.back", "seen.v", "wish")
        )
        leaves = ((front < 1.5) & (wish < 0.0)) | ((back < 1.5) & (wish > 0.0))
        return float(120.0 * np.mean(leaves & (np.abs(v) < 0.05)))

    protected, plain = (flown("back_away", s, 3) for s in ("BetweenWalls", "PlainZone"))
    assert all(run.violations == 0 for run in protected + plain)
    assert all(m.ac_share > 0.99 for run in protected for m in run.modules.values())
    assert max(held(run) for run in protected) < 1.0
    assert min(held(run) for run in plain) > 50.0


@pytest.mark.long
def test_nobody_who_walks_up_is_touched_by_a_rover_that_may_back_away() -> None:
    runs = flown("back_away", "Protected", 3)
    assert all(run.violations == 0 for run in runs)
