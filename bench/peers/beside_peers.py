"""The same scenario behind a filter of ours and one of somebody else: what each lets through.

    python -m venv RTA && RTA/bin/pip install run-time-assurance==1.18.6
    python -m venv HJ && HJ/bin/pip install hj-reachability==0.7.0
    .venv/bin/python bench/peers/beside_peers.py --rta RTA/bin/python --hj HJ/bin/python
    (and --gatekeeper FOLDER, a checkout of github.com/tkkim-robot/safe_control, and --rtreach
    PROGRAM, which `make x86` in `src` of github.com/verivital/rtreach builds)

Purpose: flights with adversaries (bench/peers/worlds.py), seed by seed the same on both sides: in
how many the property was violated, and for what share of the time the wish acted as it was.
`exact`: no error of a sensor, no disturbance; `as declared`: those that the Soter program declares.
Nav2's and PX4's programs are not run: what stands there is *the documented rule*, some lines of
ours after their documents and sources, on our plant. A peer that is not given is skipped, in words.
Non-goals: which is faster; tuning a peer for disturbances that it does not claim to cover: the rows
`exact` are its own ground.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.peers.worlds import LEAST, Cart, Copter, Docking, Filter, Rover, World, fly  # noqa: E402

from soter.gym import Protected  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

FILTERS = Path(__file__).parent / "peer_filters.py"
EXAMPLES = ROOT / "examples"


class Environment(gymnasium.Env[Any, Any]):
    """A world as Gymnasium wants it."""

    def __init__(self, world: World) -> None:
        """Spaces."""
        self.world = world
        ends = np.array(world.bound)
        self.action_space = gymnasium.spaces.Box(-ends, ends, dtype=np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (world.states,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """Flight number `seed`."""
        super().reset(seed=seed, options=options)
        self.world.reset(seed or 0)
        return self.world.seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """A tick."""
        self.world.step(action)
        return self.world.seen(), 0.0, False, False, {}


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


def fence(ends: tuple[float, float, float], ahead: bool) -> Callable[[], Filter]:
    """PX4, the documented rule: Return (GF_ACTION 3) once a check every 200 ms finds a breach.

    docs.px4.io, "Safety", "Geofence"; GEOFENCE_CHECK_INTERVAL_US. `ahead`: GF_PREDICT, a breach by
    the point where the vehicle would come to rest. A pilot has to switch modes to get the sticks
    back; here that happens within 6 m of home.
    """
    home = np.array([0.0, 0.0, 15.0])
    gains, most = np.array([-0.3, -0.3, -0.5]), np.array([5.0, 5.0, 2.0])

    def begin() -> Filter:
        calls, acting = 0, False

        def answer(state: Any, wish: Any) -> Any:  # noqa: ANN401
            nonlocal calls, acting
            place, speed = state[:3], state[3:]
            if calls % 4 == 0:
                ways = np.array([math.copysign(braking_way(abs(v)), v) for v in speed])
                at = place + (ways if ahead else 0.0)
                if abs(at[0]) > ends[0] or abs(at[1]) > ends[1] or at[2] > ends[2]:
                    acting = True
            calls += 1
            acting = acting and bool(np.any(abs(place - home) > 6.0))
            return np.clip(gains * (place - home), -most, most) if acting else wish

        return answer

    return begin


def protected(world: World, program: Path, flights: int, seconds: float) -> list[float]:
    """Flights behind a module, its compiled C: what `fly` gives."""
    env = Protected(program, Environment(world))
    violated, deepest, asked, steps, done = 0, 0.0, 0, 0, 0
    for seed in range(flights):
        env.reset(seed=seed)
        while world.time < seconds - 1e-9 and not world.done():
            *_, info = env.step(world.wish())
            steps += 1
            asked += info["taken_by"] == "AC" and not info["intervened"]
        violated += world.deepest > LEAST
        deepest = max(deepest, world.deepest)
        done += world.done()
    env.close()
    return [violated, deepest, asked / steps, done]


@dataclass(frozen=True)
class Peer:
    """Somebody else's filter: in a Python of its own, or a documented rule, which is flown here."""

    name: str
    command: list[str]
    rule: Callable[[], Filter] | None = None

    def flown(self, world: World, flights: int, seconds: float) -> list[float]:
        """What `fly` gives."""
        if self.rule:
            return fly(world, self.rule, flights, seconds)
        how = "exact" if world.exact else "declared"
        words = [type(world).__name__, how, str(flights), str(seconds), *self.command[1:]]
        ran = subprocess.run(
            [self.command[0], str(FILTERS), *words], stdout=subprocess.PIPE, text=True, check=True
        )
        return [float(x) for x in ran.stdout.splitlines()[-1].split()]


@dataclass(frozen=True)
class Scenario:
    """A world, our program for it, how long and how many flights, and who else filters there."""

    name: str
    world: type[World]
    program: Path
    seconds: float
    flights: int
    peers: list[Peer]


def installed(given: argparse.Namespace) -> tuple[list[Peer], list[Peer]]:
    """Those that run here: of docking, and of the cart."""
    docking, cart = [], []
    if given.rta:
        name = "run-time-assurance, ExplicitSwitchingRTA"
        docking += [
            Peer(name, [given.rta, "ExplicitSwitching", "0.0"]),
            Peer(f"{name}, 0.3 m kept by hand", [given.rta, "ExplicitSwitching", "0.3"]),
            Peer(
                "run-time-assurance, ExplicitOptimizationRTA",
                [given.rta, "ExplicitOptimization", "0.0"],
            ),
        ]
    else:
        print("skipped: run-time-assurance, no --rta")
    if given.gatekeeper:
        python = given.rta or given.hj or sys.executable
        keeper = [python, "gatekeeper", given.gatekeeper]
        docking.append(Peer("safe_control, Gatekeeper", keeper))
    else:
        print("skipped: gatekeeper of safe_control, no --gatekeeper")
    if given.hj:
        name = "hj_reachability, its optimal control where the value is < {} m"
        cart += [Peer(name.format(m), [given.hj, "reachable", m]) for m in ("0.0", "0.3")]
    else:
        print("skipped: hj_reachability, no --hj")
    return docking, cart


def scenarios(given: argparse.Namespace) -> list[Scenario]:
    """All, with the peers that are there."""
    docking, cart = installed(given)
    rover = [
        Peer("Nav2's documented rule, the tutorial's zones, 0.4 and 0.6 m", [], zones(0.4, 0.6)),
        Peer("Nav2's documented rule, approach, 2 s", [], lambda: approach),
        Peer("Nav2's documented rule, zones for the worst, 1.5 and 2 m", [], zones(1.5, 2.0)),
    ]
    ends, smaller = (50.0, 40.0, 30.0), (42.0, 32.0, 27.0)
    copter = [
        Peer("PX4's documented rule, the fence itself", [], fence(ends, ahead=False)),
        Peer("PX4's documented rule, a fence 8 and 3 m smaller", [], fence(smaller, ahead=False)),
        Peer("PX4's documented rule, GF_PREDICT", [], fence(ends, ahead=True)),
    ]
    here = EXAMPLES / "migration"
    return [
        Scenario("docking on a line", Docking, here / "docking.soter", 10.0, 12, docking),
        Scenario("a cart in the wind", Cart, EXAMPLES / "wall" / "cart.soter", 10.0, 20, cart),
        Scenario("a rover among people", Rover, here / "stop_zone.soter", 30.0, 40, rover),
        Scenario("a copter in a fence", Copter, here / "geofence.soter", 60.0, 40, copter),
    ]


def row(name: str, flown: list[float], flights: int, unit: str) -> None:
    """A line of the table."""
    violated, deepest, share, done = flown
    beyond = f"{deepest:.3g} {unit}" if violated else "-"
    arrived = f"  docked {done:.0f}" if done else ""
    print(
        f"  {name:64} {violated:3.0f} of {flights:<3} {beyond:>10} {share:7.1%}{arrived}",
        flush=True,
    )


def asked(program: str) -> None:
    """What rtreach says, given 20 ms, of the states that its own sources name."""
    answers = ("refused", "allowed by its ellipsoid", "by simulation", "allowed by reachability")
    print("\nrtreach, its cart and pole: place, speed, angle, turn")
    for state in ("-0.1 0 0 1.1", "-0.1 0.6 0 0", "-0.1 0.8 0 0", "-0.1 0.85 0 0", "-0.1 0.9 0 0"):
        told = subprocess.run([program, "20", *state.split()], capture_output=True, check=False)
        print(f"  {state:64} {answers[told.returncode]}")


def main() -> int:
    """Fly all; 1 where a flight of ours violated its property."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--rta", default="", help="a Python with run-time-assurance")
    parser.add_argument("--hj", default="", help="a Python with hj-reachability")
    parser.add_argument("--gatekeeper", default="", help="a folder with safe_control")
    parser.add_argument("--rtreach", default="", help="the program that `make x86` of it builds")
    parser.add_argument("--only", default="", help="scenarios whose name has this in it")
    parser.add_argument("-n", "--flights", type=int, default=60, help="of a row, at most")
    given = parser.parse_args()
    ours = 0.0
    for one in scenarios(given):
        if given.only not in one.name:
            continue
        flights = min(one.flights, given.flights)
        for exact in (True, False):
            head = f"{one.name}, {'exact' if exact else 'as declared'}"
            print(f"\n{head:66} violated  at most by    wish")
            flown = protected(one.world(exact), one.program, flights, one.seconds)
            ours += flown[0]
            name = f"soter, {one.program.relative_to(ROOT).as_posix()}"
            row(name, flown, flights, one.world.unit)
            for peer in one.peers:
                flown = peer.flown(one.world(exact), flights, one.seconds)
                row(peer.name, flown, flights, one.world.unit)
    if given.rtreach:
        asked(given.rtreach)
    else:
        print("skipped: rtreach, no --rtreach")
    return 1 if ours else 0


if __name__ == "__main__":
    sys.exit(main())
