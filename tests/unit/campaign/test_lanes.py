"""Flights that take their steps together are, to the last bit, those that are flown alone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from generators.straight_programs import program
from long_tests import examples
from soter.campaign import batch_flights
from soter.campaign.batch_flights import Fleet
from soter.campaign.compiled_unit import generate_measured
from soter.language.front_end import check_file, system_of
from soter.simulate.run import run_interpreted

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

SECOND = 10**9
PROGRAMS = examples("SOTER_LANE_PROGRAMS", quick=6, long=150)
MOVED = """faults {
    late Guard.dm by 2ms; late Guard.Calm by 2ms;
    skip Shape at 9000 per 1h for 40ms;
  }"""
DISTURBED = "faults { nan Guard.Bold at 20000 per 1h for 100ms; silent Shape at 9000 per 1h for 40ms; }"


def whole(folder: Path, number: int, faults: str = "") -> System:
    file = folder / f"straight_{number}.soter"
    file.write_text(program(number, faults), encoding="utf-8")
    return system_of(check_file(str(file)), "Whole")


def steps_with_lanes(system: System) -> int:
    """How many steps, and DMs, of a system have lanes."""
    source = generate_measured(system).source
    tables = re.findall(r"_lanes_(?:step|decide)\[\] = \{(.*?)\n\};", source, re.DOTALL)
    return sum(len(re.findall(r"\w_lanes\b", table)) for table in tables)


@pytest.mark.parametrize("number", range(PROGRAMS))
def test_flights_together_are_flights_alone(number: int, tmp_path: Path) -> None:
    system = whole(tmp_path, number, ("", MOVED, DISTURBED)[number % 3])
    assert steps_with_lanes(system) >= 3
    fleet = Fleet(system, 3 * SECOND, ("-O1", "-O3")[number % 2])
    together = fleet.fly(range(9), first_seed=number)
    alone = [fleet.fly([k], first_seed=number)[0] for k in range(9)]
    assert together == alone
