"""Betaflight below the fence: hostile controllers, without a module, and vehicles that are others.

Purpose: the flights of docs/autopilot.md. *violated*: flights that pass a wall, or of which the
monitor raises an alarm (Fenced, Quiet); that pass one (Bare); that pass one before the alarm (the
others). *farthest*: the greatest |x| or |y| of all flights, of a wall at 10 m; *residual*: the
greatest share of the bound that the proof assumes; *left*: flights that pass a wall, floor or
ceiling at all, alarm or not; *down*: how far below the middle, of a floor at 2.5 m.
Non-goals: the proof (`soter verify`), the bound (`examples/autopilot/identify.py`).

    python bench/autopilot/flights.py                     as the table in docs/benchmarks.md
    python bench/autopilot/flights.py --flights 20 --only Fenced Bare
    python bench/autopilot/flights.py --flights 30 --only Fenced Quiet --until 120s

Needs the executable of `examples/autopilot/firmware.py`. Seeds were not used to identify anything.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import soter

if TYPE_CHECKING:
    from soter.campaign.store import FlightOutcome

FILE = Path(__file__).parents[2] / "examples" / "autopilot" / "flights.soter"
FIRST_SEED = 10_001
ARMS = {"Fenced": 1000, "Quiet": 100, "Bare": 200, "Heavy": 100, "Weak": 100, "Gusty": 100}
"""Flights of each system."""


@dataclass(frozen=True)
class Row:
    """What the flights of a system say; `most`: the greatest of a measure, by its name."""

    flights: int
    violated: int
    latched: int
    most: dict[str, float]
    alarmed: int
    left: int
    digest: str
    wall_s: float


def tally(flights: tuple[FlightOutcome, ...], names: list[str], wall_s: float) -> Row:
    """Flights to a row; `names` of the measures, in the order of `looks`."""
    most = {n: max(f.looks[i].most for f in flights) for i, n in enumerate(names)}
    ends = {n: [f.looks[i] for f in flights] for i, n in enumerate(names)}
    return Row(
        flights=len(flights),
        violated=sum(f.violations > 0 for f in flights),
        latched=sum(any("step fault" in text for text in f.broken) for f in flights),
        most=most,
        alarmed=sum(look.most > 0.0 for look in ends.get("alarm", [])),
        left=sum(look.least < 1.0 for look in ends.get("inside", [])),
        digest=hashlib.sha256("".join(f.digest for f in flights).encode()).hexdigest()[:16],
        wall_s=wall_s,
    )


def fly(program: soter.Program, system: str, flights: int, until: str, workers: int) -> Row:
    """Flights of a system from FIRST_SEED on, in a folder that is thrown away."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        flown = program.campaign(
            system=system,
            flights=flights,
            until=until,
            seed=FIRST_SEED,
            workers=workers,
            output=folder,
        )
        names = [m.name for m in flown.result.measures]
        return tally(flown.flights, names, time.perf_counter() - began)


def line(system: str, row: Row) -> str:
    """A row of the table."""
    farthest = max((row.most.get(n, 0.0) for n in ("east", "north")), default=0.0)
    told = [f"{row.flights:>7,}", f"{row.violated:>8}"]
    told.append(f"{farthest:>8.3f}" if farthest else " " * 8)
    told.append(f"{row.most['up']:>6.3f}" if "up" in row.most else " " * 6)
    told.append(f"{row.most['residual']:>8.3f}" if "residual" in row.most else " " * 8)
    faulty = "inside" in row.most
    told.append(f"{row.alarmed:>7} {row.left:>4} {row.most['down']:>6.3f}" if faulty else " " * 19)
    return f"{system:<8} {' '.join(told)} {row.wall_s:>7.0f} s  {row.digest}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--flights", type=int, metavar="N", help="of each arm, at most")
    parser.add_argument("--only", nargs="+", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--until", default="20s", metavar="TIME", help="length of a flight")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    program = soter.load(FILE)
    print("         flights violated farthest    up residual alarmed left   down    wall   digest")
    for system in options.only:
        flights = min(ARMS[system], options.flights or ARMS[system])
        row = fly(program, system, flights, options.until, options.workers)
        print(line(system, row), flush=True)
        if row.latched:
            print(f"  {row.latched} of them stopped: the vehicle, or the autopilot, was gone")


if __name__ == "__main__":
    main()
