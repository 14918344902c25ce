"""Flight k of a campaign is the run of seed `--seed` + k, every byte, whatever the system is.

Also of C that keeps something from call to call, of any number of flights and workers, and of arms.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import pytest

from generators import random_programs, stateful_externs, straight_programs
from generators.engine_comparison import until_of
from generators.flights_of_runs import alone, figures, figures_of
from long_tests import examples
from soter.campaign.batch_flights import Fleet
from soter.campaign.fly_campaign import flights_of
from soter.language.elaborate.derived_systems import with_faults
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from pathlib import Path

    from generators.flights_of_runs import Figures
    from soter.language.model.system import System

PROGRAMS = examples("SOTER_FLOWN_PROGRAMS", quick=8, long=200)
EXTERNS = examples("SOTER_FLOWN_EXTERNS", quick=1, long=20)
FLIGHTS = (9, 17, 64, 1)
INSTANTS = 150
"""Of a campaign: more than any vector has lanes, one, and more than one batch."""
FAULTS = """faults {
    late Guard.dm by 2ms; skip Shape at 9000 per 1h for 40ms;
    nan Guard.Bold at 20000 per 1h for 100ms; silent Shape at 9000 per 1h for 40ms;
  }"""


def random_system(folder: Path, number: int) -> System:
    """Every second one is any program; the others have faults, some an order by chance."""
    file = folder / f"flown_{number}.soter"
    straight = straight_programs.program(number, FAULTS if number % 4 else "")
    text = random_programs.program(number) if number % 2 else straight
    file.write_text(text, encoding="utf-8")
    system = system_of(check_file(str(file)), None)
    return with_faults(system, (), shuffled=True) if number % 8 == 4 else system


def compared(system: System, number: int, count: int) -> None:
    """Flights of a system beside runs of their seeds, each run where no C was called before."""
    first, until_ns = 3 + number, until_of(system, INSTANTS)
    fleet = Fleet(system, until_ns, "-O1")
    program = NativeProgram(system, "-O1")

    @cache
    def run(seed: int) -> Figures:
        return alone(lambda: figures(program.run(until_ns, seed, keep_trace=True)))

    for workers in (1, 1 + number % 3):
        batches = list(flights_of(fleet, range(count), first, workers))
        flown = [figures_of(f) for batch in batches for f in batch]
        assert flown == [run(first + k) for k in range(count)]


@pytest.mark.parametrize("number", range(PROGRAMS))
def test_flights_of_random_systems(number: int, tmp_path: Path) -> None:
    compared(random_system(tmp_path, number), number, FLIGHTS[number % 4])


@pytest.mark.whole
@pytest.mark.parametrize("kind", stateful_externs.KINDS)
@pytest.mark.parametrize("number", range(EXTERNS))
def test_flights_of_c_that_keeps_something(kind: str, number: int, tmp_path: Path) -> None:
    system = stateful_externs.system(tmp_path, kind, number)
    place = list(stateful_externs.KINDS).index(kind)
    compared(system, number + place, FLIGHTS[(number + place) % 3])
