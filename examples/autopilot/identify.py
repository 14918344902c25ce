"""Identify the closed loop below the module: what the proof's plant says, and how far it is off.

Purpose: fly excitation on the firmware, fit (command -> acceleration) as n equal lags, a dead time
and a drag, compare with the two lags that the adapter is meant to follow, take the greatest
residual of these flights with a margin as the bound, and ask flights of other seeds and of hostile
controllers whether they stay within. It writes `loop.json`, which autopilot.soter reads, and the
monitor `watch.soter` of it.

    python examples/autopilot/identify.py             fit, check, write; ten minutes of a core
    python examples/autopilot/identify.py --check     only whether loop.json still holds

Needs the executable of firmware.py. The bound is measured, not proved: the proof prints it as an
assumption, and watch.soter keeps an eye on it in flight.
Non-goals: loops that are not near a linear one.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import soter

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

HERE = Path(__file__).parent
LOOP = HERE / "loop.json"
EXCITED = ("Slowly", "Quickly", "Wildly")
FITTED, HELD_OUT = range(1, 13), range(101, 107)
"""Seeds of each excitation: those that are fitted, and those that are only asked."""
WITH_MODULE = ("Fenced", "Quiet")
"""Systems of flights.soter, whose controllers mean harm and do not, which are only asked."""
MODULE_SEEDS = range(5001, 5016)
LENGTH = "60s"
"""Of each flight: what grows slowly has to be seen."""
MARGIN = 1.25
"""Times the greatest residual that was seen."""
ORDERS, DEAD_S = (1, 2, 3), (0.0, 0.02, 0.04)
LAGS = tuple(float(x) for x in np.arange(3.0, 15.1, 0.5))
STEP_S = 0.005
LAG = 6.0
"""1/s, twice: the adapter's reference (quad.c, REFERENCE)."""


@dataclass(frozen=True)
class Flown:
    """A flight: commands, speeds and mean accelerations of steps of STEP_S; all (n, 3)."""

    command: Floats
    speed: Floats
    acceleration: Floats
    rest: Floats
    """Acceleration less the adapter's reference, mean of the step."""


def fly(program: soter.Program, system: str, seeds: Iterable[int]) -> list[Flown]:
    """Flights of a system, of LENGTH; ValueError where the vehicle does not fly (it said why)."""
    flights = []
    vehicle = "h." if system in WITH_MODULE else ""
    for seed in seeds:
        run = program.simulate(system, seed=seed, until=LENGTH, sha256=False)
        speed = run.array(f"{vehicle}q.truth.s.v")
        if run.violations or not np.isfinite(speed).all() or not speed.any():
            raise ValueError(f"{system}, seed {seed}: {run.violation_list or 'nothing flew'}")
        command = run.array(f"{vehicle}fence.command" if vehicle else "command")
        flights.append(
            Flown(
                command[:-1],
                speed[1:],
                np.diff(speed, axis=0) / STEP_S,
                run.array(f"{vehicle}q.truth.s.rest")[1:],
            )
        )
    return flights


def response(command: Floats, order: int, lags: Floats, dead_s: float) -> Floats:
    """Commands (n, 3), each held for a step, behind a dead time and `order` lags: (m, n, 3)."""
    dead = round(dead_s / STEP_S)
    delayed = np.concatenate([np.zeros((dead, 3)), command])[: len(command)]
    out = np.repeat(delayed[:, None, :], len(lags), axis=1)
    share = -np.expm1(-lags * STEP_S)[:, None]
    for _ in range(order):
        state, lagged = np.zeros((len(lags), 3)), np.empty_like(out)
        for k, row in enumerate(out):
            following = state + share * (row - state)
            lagged[k] = 0.5 * (state + following)
            state = following
        out = lagged
    return out.swapaxes(0, 1)


def fit(flights: list[Flown], axes: slice) -> list[tuple[float, float, int, float, float, float]]:
    """(rms, greatest residual, order, lag, dead time, drag) of every candidate, the best first."""
    acceleration = np.concatenate([f.acceleration[:, axes] for f in flights])
    speed = np.concatenate([f.speed[:, axes] for f in flights])
    table = []
    for order in ORDERS:
        for dead in DEAD_S:
            models = [response(f.command, order, np.array(LAGS), dead) for f in flights]
            for lag, model in zip(LAGS, np.concatenate(models, axis=1)[..., axes], strict=True):
                left = acceleration - model
                drag = -float((left * speed).sum() / (speed * speed).sum())
                left = left + drag * speed
                rms, most = float(np.sqrt((left * left).mean())), float(np.abs(left).max())
                table.append((rms, most, order, lag, dead, drag))
    return sorted(table)


def drag_of(flights: list[Flown]) -> float:
    """1/s: least squares of what is left beside the reference, over speed."""
    rest = np.concatenate([f.rest for f in flights])
    speed = np.concatenate([f.speed for f in flights])
    return -float((rest * speed).sum() / (speed * speed).sum())


def residuals(flights: list[Flown], drag: float) -> tuple[float, float]:
    """The greatest |acceleration - reference + drag * speed|: on the level, and up."""
    left = np.abs(np.concatenate([f.rest + drag * f.speed for f in flights]))
    return float(left[:, :2].max()), float(left[:, 2].max())


def up(x: float) -> float:
    """The next hundredth above."""
    return math.ceil(x * 100.0) / 100.0


def identify(program: soter.Program) -> dict[str, Any]:
    """Fly, fit, print the best candidates; the content of loop.json."""
    flights = [f for system in EXCITED for f in fly(program, system, FITTED)]
    for name, axes in (("level", slice(0, 2)), ("up", slice(2, 3))):
        for rms, most, order, lag, dead, drag in fit(flights[:: len(FITTED)], axes)[:3]:
            print(
                f"{name:<6} {order} lags of {lag:g}/s, dead {1e3 * dead:.0f} ms, drag {drag:.3f}/s:"
                f" residual rms {rms:.3f}, at most {most:.3f} m/s^2"
            )
    drag = round(drag_of(flights), 3)
    level, vertical = residuals(flights, drag)
    print(f"2 lags of {LAG:g}/s, drag {drag:g}/s: at most {level:.3f} level, {vertical:.3f} up")
    return {
        "$comment": "written by identify.py",
        "lag": LAG,
        "drag": drag,
        "side": up(MARGIN * level),
        "up": up(MARGIN * vertical),
    }


def check(program: soter.Program, loop: dict[str, Any]) -> bool:
    """Whether flights that were not fitted stay within the bounds; prints the shares."""
    within = True
    sets = [(name, program, HELD_OUT) for name in EXCITED]
    flights = soter.load(HERE / "flights.soter")
    sets += [(name, flights, MODULE_SEEDS) for name in WITH_MODULE]
    for system, source, seeds in sets:
        level, vertical = residuals(fly(source, system, seeds), loop["drag"])
        shares = level / loop["side"], vertical / loop["up"]
        within = within and max(shares) <= 1.0
        told = f"{shares[0]:.2f} of the bound level, {shares[1]:.2f} up"
        print(f"{system:<8} {len(seeds)} flights: {told}")
    return within


def main() -> int:
    """Command line: 0 where held-out flights stay within the bounds, else 1."""
    parser = argparse.ArgumentParser(description="identify the closed loop")
    parser.add_argument("--check", action="store_true", help="only whether loop.json still holds")
    options = parser.parse_args()
    program = soter.load(HERE / "autopilot.soter")
    loop = json.loads(LOOP.read_text(encoding="utf-8"))
    if not options.check:
        loop = identify(program)
        print(f"bounds, {MARGIN:g} times that: {loop['side']} level, {loop['up']} up")
        LOOP.write_text(json.dumps(loop, indent=2) + "\n", encoding="utf-8")
        program = soter.load(HERE / "autopilot.soter")
        program.emit_monitor(HERE / "watch.soter", alarm="modelAlarm")
    return 0 if check(program, loop) else 1


if __name__ == "__main__":
    sys.exit(main())
