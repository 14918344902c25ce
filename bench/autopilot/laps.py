"""Laps and one corridor of the drone's city on Betaflight, and on the drone's own attitude loop.

Purpose: issue 30's row of laps. The same boxes, the same law for AC on both vehicles, below the
module that was proved of each, and without it. *touch*: flights that touch a building, ground,
ceiling or edge; *box*: that leave the box that is flown, which is what is proved; *clean*: that do
neither and arrive; *median*, *worst*: their time; *AC share*: until they arrive, of all that do
(hostile controllers have nowhere to go: of the whole flight). *residual*: the greatest share of
the bound that the proof assumes of Betaflight; *alarms*: flights in which the monitor raises one.
Non-goals: the proofs (`soter verify`), the geofence (`flights.py`).

    python bench/autopilot/laps.py                        as the table in docs/benchmarks.md
    python bench/autopilot/laps.py --flights 20

Needs the executable of `examples/autopilot/firmware.py`. Seeds were not used to identify anything,
nor to choose a gain (that was 501 to 510). Exit code 1 where a flight below a module touches
anything, or leaves its box.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import soter
from soter.report.tables import table

if TYPE_CHECKING:
    from soter.campaign.store import FlightOutcome

FILE = Path(__file__).parents[2] / "examples" / "autopilot" / "laps.soter"
FIRST_SEED = 20_001


@dataclass(frozen=True)
class Arm:
    """Flights of a system; `cross`: the corridor, else the lap."""

    name: str
    system: str
    cross: bool
    hostile: bool
    flights: int


ARMS = tuple(
    Arm(f"{where}, {name}", system, where == "corridor", "hostile" in name, flights)
    for where in ("lap", "corridor")
    for name, system, flights in (
        ("Betaflight", "Laps", 200),
        ("own loop", "OwnLaps", 200),
        ("Betaflight, AC alone", "Bare", 200),
        ("own loop, AC alone", "OwnBare", 200),
        ("Betaflight, hostile ACs", "Laps", 100),
        ("Betaflight, hostile ACs alone", "Bare", 100),
    )
)
HEADS = (
    *("arm", "flights", "touch", "box", "clean", "median", "worst", "AC share", "least"),
    *("m/s", "residual", "alarms", "wall", "digest"),
)


def most(flight: FlightOutcome, names: list[str], name: str) -> float:
    """The greatest of a measure; NaN where the system has none of that name."""
    return flight.looks[names.index(name)].most if name in names else float("nan")


def row(arm: Arm, flights: tuple[FlightOutcome, ...], names: list[str], wall_s: float) -> list[str]:
    """Flights as a row of the table."""
    every = {n: np.array([most(f, names, n) for f in flights]) for n in names}
    touched, arrived = every["touched"] > 0.0, every["finished"] > 0.0
    clean = np.array([f.violations == 0 for f in flights]) & arrived
    times = every["lap_s"][clean]
    shares = np.array([f.ac_s[0] / f.seconds for f in flights])
    if not arm.hostile:
        shares = every["ac_s"][arrived] / every["lap_s"][arrived]
    left = sum(f.violations > 0 for f in flights) - int(touched.sum())
    measured = "residual" in names
    return [
        arm.name,
        str(len(flights)),
        str(int(touched.sum())),
        "" if "Bare" in arm.system else str(left),
        str(int(clean.sum())),
        f"{np.median(times):.2f} s" if len(times) else "",
        f"{times.max():.2f} s" if len(times) else "",
        f"{shares.mean():.1%}" if len(shares) else "",
        f"{shares.min():.1%}" if len(shares) else "",
        f"{every['speed'].max():.2f}",
        f"{every['residual'].max():.3f}" if measured else "",
        str(int((every["alarm"] > 0.0).sum())) if measured else "",
        f"{wall_s:.0f} s",
        hashlib.sha256("".join(f.digest for f in flights).encode()).hexdigest()[:12],
    ]


def fly(program: soter.Program, arm: Arm, flights: int, workers: int) -> list[str]:
    """Flights of an arm from FIRST_SEED on, in a folder that is thrown away."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        flown = program.campaign(
            arm.system,
            {"CROSS": arm.cross, "HOSTILE": arm.hostile},
            flights=flights,
            seed=FIRST_SEED,
            workers=workers,
            output=folder,
        )
        names = [m.name for m in flown.result.measures]
        return row(arm, flown.flights, names, time.perf_counter() - began)


def main() -> int:
    """Command line; 1 where a flight below a module touches anything, or leaves its box."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--flights", type=int, metavar="N", help="of each arm, at most")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    program = soter.load(FILE)
    rows = []
    for arm in ARMS:
        flights = min(arm.flights, options.flights or arm.flights)
        rows.append(fly(program, arm, flights, options.workers))
        print(f"{arm.name}: {rows[-1][-2]}", file=sys.stderr, flush=True)
    print(table(HEADS, rows))
    return any(r[3] and (r[2] != "0" or r[3] != "0") for r in rows)


if __name__ == "__main__":
    raise SystemExit(main())
