"""The same scenario behind a filter of ours and one of somebody else: what each lets through.

    python -m venv RTA && RTA/bin/pip install run-time-assurance==1.18.6
    python -m venv HJ && HJ/bin/pip install hj-reachability==0.7.0
    .venv/bin/python bench/peers/beside_peers.py --rta RTA/bin/python --hj HJ/bin/python
    (and --gatekeeper FOLDER, a checkout of github.com/tkkim-robot/safe_control)

Purpose: flights with adversaries (bench/peers/worlds.py), seed by seed the same on both sides: in
how many the property was violated, and for what share of the time the wish acted as it was.
`exact`: no error of a sensor, no disturbance; `as declared`: those that the Soter program declares.
Nav2's and PX4's programs are not run: what stands there is *the documented rule*, some lines of
ours after their documents and sources, on our plant. A peer that is not given is skipped, in words.
Non-goals: which is faster (bench/running/simplex_peer.py); tuning a peer for disturbances that it
does not claim to cover: the rows `exact` are its own ground.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.peers.worlds import Cart, Copter, Docking, Rover, World  # noqa: E402 - needs the path

from soter.gym import Protected  # noqa: E402

FILTERS = Path(__file__).parent / "peer_filters.py"
EXAMPLES = ROOT / "examples"
Filter = Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Flown:
    """What flights came to."""

    violated: int
    flights: int
    shares: list[float]
    """Of each flight: how much of its time the wish acted as it was."""


class Child:
    """A filter in a Python of its own."""

    def __init__(self, command: list[str]) -> None:
        """Start it and wait until it is ready."""
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        if self.process.stdout.readline().strip() != "ready":
            raise RuntimeError(f"`{' '.join(command)}` did not start")

    def begin(self) -> Filter:
        """A new flight."""
        self.write("reset")
        return self.answer

    def write(self, line: str) -> None:
        """A line to it."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def answer(self, state: Any, wish: Any) -> Any:  # noqa: ANN401
        """What acts."""
        self.write(
            " ".join(map(repr, map(float, state))) + ";" + " ".join(map(repr, map(float, wish)))
        )
        assert self.process.stdout is not None
        return np.array([float(x) for x in self.process.stdout.readline().split()])

    def close(self) -> None:
        """End it."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def zones(stop: float, slow: float) -> Callable[[], Filter]:
    """Nav2, the documented rule: a point in the stop zone means zero, one in the slowdown zone 0.3.

    docs.nav2.org, "Using Collision Monitor"; `CollisionMonitor::process`. `stop` and `slow` are how
    far the polygons reach beyond the rover's front.
    """

    def answer(state: Any, wish: Any) -> Any:  # noqa: ANN401
        return wish * (0.0 if state[0] < stop else 0.3 if state[0] < slow else 1.0)

    return lambda: answer


def approach(state: Any, wish: Any) -> Any:  # noqa: ANN401
    """Nav2, the documented rule: `approach` keeps 2 s to a collision (`time_before_collision`)."""
    left = state[0] / wish[0] if wish[0] > 0.0 else math.inf
    return wish * min(max(left, 0.0) / 2.0, 1.0)


def braking_way(speed: float) -> float:
    """PX4's estimate of its braking way: MPC_ACC_HOR 3 m/s^2, MPC_JERK_AUTO 4 m/s^3, and 200 ms."""
    ramps = min(3.0 / 4.0, math.sqrt(speed / 4.0))
    full = max(speed / 3.0 - ramps, 0.0) if ramps == 3.0 / 4.0 else 0.0
    return 0.5 * speed * (2.0 * ramps + full) + 0.2 * speed


def fence(radius: float, high: float, ahead: bool) -> Callable[[], Filter]:
    """PX4, the documented rule: Return (GF_ACTION 3) once a check every 200 ms finds a breach.

    docs.px4.io, "Safety", "Geofence"; GEOFENCE_CHECK_INTERVAL_US. `ahead`: GF_PREDICT, a breach of
    the point where the vehicle would come to rest, with Hold there. The pilot gets the sticks back
    within 6 m of home, or once the vehicle holds for 2 s.
    """

    def begin() -> Filter:
        state_of = {"calls": 0, "back": False, "held": 0}

        def answer(state: Any, wish: Any) -> Any:  # noqa: ANN401
            x, y, z, vx, vy, vz = state
            if state_of["calls"] % 4 == 0:
                speed, out = math.hypot(vx, vy), math.hypot(x, y)
                if ahead:
                    way = braking_way(speed) / max(speed, 0.1)
                    out = max(out, math.hypot(x + way * vx, y + way * vy))
                    z += math.copysign(braking_way(abs(vz)), vz)
                if out > radius or z > high:
                    state_of["back"], state_of["held"] = True, 0
            state_of["calls"] += 1
            state_of["held"] += 1
            if (math.hypot(x, y) < 6.0 and z < 18.0) or (ahead and state_of["held"] > 40):
                state_of["back"] = False
            if not state_of["back"]:
                return wish
            if ahead:
                return np.zeros(3)
            return np.clip([-0.3 * x, -0.3 * y, 0.5 * (15.0 - z)], (-5, -5, -2), (5, 5, 2))

        return answer

    return begin


def fly(world: World, begin: Callable[[], Filter], flights: int, seconds: float) -> Flown:
    """Flights behind a filter: state and wish in, command out."""
    violated, shares = 0, []
    for seed in range(flights):
        state, _ = world.reset(seed=seed)
        answer = begin()
        ticks = round(seconds / world.tick)
        asked = 0
        for _ in range(ticks):
            wish = world.wish()
            command = answer(state, wish)
            asked += bool(np.allclose(command, wish, atol=1e-6))
            state, *_ = world.step(command)
        violated += world.broken
        shares.append(asked / ticks)
    return Flown(violated, flights, shares)


def protected(world: World, program: Path, flights: int, seconds: float) -> Flown:
    """Flights behind a module, its compiled C."""
    env = Protected(program, world)
    violated, shares = 0, []
    for seed in range(flights):
        _, info = env.reset(seed=seed)
        steps = asked = 0
        while world.time < seconds - 1e-9:
            *_, info = env.step(world.wish())
            steps += 1
            asked += info["taken_by"] == "AC" and not info["intervened"]
        violated += world.broken
        shares.append(asked / steps)
    env.close()
    return Flown(violated, flights, shares)


@dataclass(frozen=True)
class Scenario:
    """A world, our program for it, how long a flight is, and who else filters there."""

    name: str
    world: type[World]
    program: Path
    seconds: float
    peers: list[tuple[str, Callable[[], Any]]]


def child(python: str, *words: str) -> Callable[[], Child]:
    """Starts a filter in a Python of its own, when it is asked."""
    return lambda: Child([python, str(FILTERS), *words])


def scenarios(given: argparse.Namespace) -> list[Scenario]:
    """All, with the peers that are there."""
    docking: list[tuple[str, Callable[[], Any]]] = []
    if given.rta:
        kinds = ("ExplicitSwitching", "ImplicitSwitching", "ExplicitOptimization")
        docking += [(f"run-time-assurance, {k}RTA", child(given.rta, k)) for k in kinds]
    else:
        print("skipped: run-time-assurance, no --rta")
    if given.gatekeeper:
        keeper = child(given.rta or given.hj or sys.executable, "gatekeeper", given.gatekeeper)
        docking.append(("safe_control, Gatekeeper", keeper))
    else:
        print("skipped: gatekeeper of safe_control, no --gatekeeper")
    cart: list[tuple[str, Callable[[], Any]]] = []
    if given.hj:
        name = "hj_reachability, its optimal control where the value is < {} m"
        cart += [(name.format(m), child(given.hj, "reachable", m)) for m in ("0.0", "0.3")]
    else:
        print("skipped: hj_reachability, no --hj")
    rover: list[tuple[str, Callable[[], Any]]] = [
        ("Nav2's documented rule, the tutorial's zones (0.4, 0.6 m)", lambda: zones(0.4, 0.6)),
        ("Nav2's documented rule, approach 2 s", lambda: lambda: approach),
        ("Nav2's documented rule, a zone for the worst (1.5, 2 m)", lambda: zones(1.5, 2.0)),
    ]
    copter: list[tuple[str, Callable[[], Any]]] = [
        ("PX4's documented rule, fence 50 m, 30 m", lambda: fence(50.0, 30.0, ahead=False)),
        ("PX4's documented rule, fence 42 m, 27 m", lambda: fence(42.0, 27.0, ahead=False)),
        ("PX4's documented rule, GF_PREDICT, 50 m, 30 m", lambda: fence(50.0, 30.0, ahead=True)),
    ]
    here = EXAMPLES / "migration"
    return [
        Scenario("docking on a line", Docking, here / "docking.soter", 15.0, docking),
        Scenario("a cart in the wind", Cart, EXAMPLES / "wall" / "cart.soter", 15.0, cart),
        Scenario("a rover among people", Rover, here / "stop_zone.soter", 30.0, rover),
        Scenario("a copter in a fence", Copter, here / "geofence.soter", 60.0, copter),
    ]


def row(name: str, flown: Flown) -> None:
    """A line of the table."""
    share = sum(flown.shares) / len(flown.shares)
    print(f"  {name:60} {flown.violated:4} of {flown.flights:<4} {share:6.1%}", flush=True)


def main() -> int:
    """Fly all; 1 where a flight of ours violated its property."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--rta", default="", help="a Python with run-time-assurance")
    parser.add_argument("--hj", default="", help="a Python with hj-reachability")
    parser.add_argument("--gatekeeper", default="", help="a folder with safe_control")
    parser.add_argument("--only", default="", help="scenarios whose name has this in it")
    parser.add_argument("-n", "--flights", type=int, default=60)
    given = parser.parse_args()
    ours = 0
    for one in scenarios(given):
        if given.only not in one.name:
            continue
        for exact in (True, False):
            print(f"\n{one.name}, {'exact' if exact else 'as declared'}"
                  f"{'':36}violated     the wish acted")  # fmt: skip
            flown = protected(one.world(exact), one.program, given.flights, one.seconds)
            ours += flown.violated
            row(f"soter, {one.program.relative_to(ROOT).as_posix()}", flown)
            for name, start in one.peers:
                filtering = start()
                begin = filtering.begin if isinstance(filtering, Child) else filtering
                row(name, fly(one.world(exact), begin, given.flights, one.seconds))
                if isinstance(filtering, Child):
                    filtering.close()
    return 1 if ours else 0


if __name__ == "__main__":
    sys.exit(main())
