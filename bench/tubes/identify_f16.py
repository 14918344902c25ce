"""How far JSBSim's F-16 is off the plant of examples/rest/dive.soter.

    .venv/bin/python bench/tubes/identify_f16.py [--flights 40] [--held-out 80]

Purpose: fly the aircraft in all the ways of `jsbsim_f16.py`, each ended by a recovery; fit what the
plant says of its speed to some of these flights, take what is left of climb rate and speed from
others, with a margin, and hold it to the bounds that the program declares. Two simpler models
stand beside: no lag between what is asked and the path, and one.
Non-goals: a proof that no flight is further off.
"""

from __future__ import annotations

import argparse
import random
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from soter.language.elaborate.derived_systems import faultless  # noqa: E402
from soter.language.front_end import check_file, system_to_prove  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Values = NDArray[np.float64]

PROGRAM = ROOT / "examples" / "rest" / "dive.soter"
HEIGHT, SPEED, PATH, LED, FOLLOWS = range(5)
PERIOD_S = 0.01
MARGIN = 1.25
"""Times the most that was seen."""
TURNS_BACK, AHEAD_S = 200.0, 4.0
"""m, where a recovery begins at the latest, that long ahead."""
FLIGHT_S, RECOVERS_S = 30.0, 15.0


@dataclass(frozen=True)
class Fit:
    """speed' = rate (level - speed) - weight sin(path) + what is left."""

    rate: float
    level: float
    weight: float


def fitted(flights: Iterable[Values]) -> Fit:
    """By least squares over the steps of flights; each (n, 6)."""
    rows = [_steps(f) for f in flights]
    speed, down, change = (np.concatenate([r[k] for r in rows]) for k in range(3))
    inputs = np.c_[speed, down, np.ones(len(speed))]
    slope, weight, at_zero = np.linalg.lstsq(inputs, change, rcond=None)[0]
    return Fit(-float(slope), -float(at_zero / slope), float(weight))


def _steps(flight: Values) -> tuple[Values, Values, Values]:
    """Of each step mean speed, mean -sin(path), and acceleration."""
    speed, down = flight[:, SPEED], -np.sin(flight[:, FOLLOWS])
    mean = [0.5 * (x[1:] + x[:-1]) for x in (speed, down)]
    return mean[0], mean[1], np.diff(speed) / PERIOD_S


def thrusts(flight: Values, fit: Fit) -> Values:
    """What is left of the acceleration, by step."""
    speed, down, change = _steps(flight)
    return change - fit.rate * (fit.level - speed) - fit.weight * down


def sinks(flight: Values, path: int = FOLLOWS) -> Values:
    """What is left of the climb rate, by step, where the path is state `path`."""
    climb = flight[:, SPEED] * np.sin(flight[:, path])
    return np.diff(flight[:, HEIGHT]) / PERIOD_S - 0.5 * (climb[1:] + climb[:-1])


def bound(left: Iterable[Values], margin: float = MARGIN) -> float:
    """The most of either sign, with a margin."""
    return margin * max(float(np.abs(x).max()) for x in left)


def declared() -> dict[str, tuple[float, float]]:
    """Bounds of the program's disturbances, by name."""
    flat = system_to_prove(check_file(str(PROGRAM), PROGRAM.read_text(encoding="utf-8")), None)
    problem: Any = extract(faultless(flat), flat.modules[0])
    names = [d.member for d in problem.quantities.disturbances]
    return {n: (r.low, r.high) for n, r in zip(names, problem.disturbances, strict=True)}


def flown(seeds: Iterable[int]) -> list[Values]:
    """Flights, each in one of the ways, and at a drawn time or height a recovery."""
    from bench.tubes.jsbsim_f16 import F16, Pilot, recover  # noqa: PLC0415 - the extra `simulators`

    flights = []
    for seed in seeds:
        draw = random.Random(seed)  # noqa: S311 - no secret
        f16 = F16(draw.uniform(1500.0, 2500.0), draw.uniform(195.0, 205.0))
        pilot = Pilot(draw, Pilot.WAYS[seed % len(Pilot.WAYS)])
        until, back, rows = draw.uniform(5.0, FLIGHT_S), False, [f16.seen()]
        over = int((until + RECOVERS_S) / PERIOD_S)
        command = (0.0, 0.0)
        for k in range(over):
            if k % 10 == 0:
                back = back or _low(rows[-1]) or k * PERIOD_S > until
                command = recover(rows[-1]) if back else pilot.asks(rows[-1])
            f16.fly(*command)
            rows.append(f16.seen())
            if rows[-1][HEIGHT] < 10.0:  # what touches the ground does not fly
                break
        flights.append(np.array(rows))
    return flights


def _low(seen: list[float]) -> bool:
    climb = seen[SPEED] * float(np.sin(seen[FOLLOWS]))
    return seen[HEIGHT] + AHEAD_S * climb < TURNS_BACK


def main(argv: list[str]) -> int:
    """0; 3 where what is left does not fit into what is declared."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--held-out", type=int, default=80)
    options = parser.parse_args(argv)
    fit = fitted(flown(range(1, options.flights + 1)))
    others = flown(range(1001, 1001 + options.held_out))
    steps = sum(len(f) - 1 for f in others)
    speeds = np.concatenate([f[:, SPEED] for f in others])
    paths = np.concatenate([f[:, PATH] for f in others])
    print(f"{options.flights} flights fitted: v' = {fit.rate:.3f} ({fit.level:.1f} - v) "
          f"- {fit.weight:.2f} sin(follows)")  # fmt: skip
    lowest = min(f[:, HEIGHT].min() for f in others)
    print(f"{options.held_out} others, {steps:,} steps: v {speeds.min():.0f} to "
          f"{speeds.max():.0f} m/s, path {paths.min():.2f} to {paths.max():.2f} rad, "
          f"lowest {lowest:.0f} m")  # fmt: skip
    left = {
        "sink": [sinks(f) for f in others],
        "thrust": [thrusts(f, fit) for f in others],
    }
    said, fits = declared(), True
    for name, of in left.items():
        every = np.abs(np.concatenate(of))
        needs, (low, high) = bound(of), said[name]
        fits = fits and needs <= min(-low, high)
        print(f"{name}: at most {every.max():.2f}, 99 % below {np.quantile(every, 0.99):.2f}, "
              f"rms {np.sqrt((every**2).mean()):.2f}; times {MARGIN}: {needs:.2f}; "
              f"declared [{low:g}, {high:g}]")  # fmt: skip
    for name, path in (("no lag", PATH), ("one lag", LED)):
        print(f"sink with {name}: at most {bound([sinks(f, path) for f in others], 1.0):.2f}")
    print("the bounds hold, with the margin" if fits else "THE BOUNDS ARE TOO SMALL")
    return 0 if fits else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
