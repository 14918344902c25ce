"""Two drones as processes of their own, with DDS between them, along one street.

Purpose: `examples/fleet/vehicle.soter`, its system Drone, by `--target dds`: two packages on
loopback; here are the bodies, the clocks and whoever flies and plans, who wants any piece of the
street and rushes. One drone is killed or stopped; how near they came, whether one left its claim,
and how often claims changed before and afterwards.
Non-goals: measured delays of networks; what was proved (`soter verify`).

    python bench/fleet/dds_drones.py
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.fleet.dds_junction import FLEET, LOOPBACK, Machine, build_package, message_types  # noqa: E402

DRONES = ("drone_0", "drone_1")
STREET, APART, V, PICKUP, BRAKE = 40, 2, 1.0, 0.8, 1.1
STEP_S = 0.01
CLOCK_ERROR_S = 0.005
"""A drone takes its own measurements by its own clock, and a claim by the number in it."""
WATCHDOG_S = 0.3
"""Without a command for so long the autopilot stays where it is."""


def build(folder: Path) -> None:
    """The two packages, of a copy without the fail-safe law.

    With it one step that is late ends the leases for good, and a shared machine has such steps.
    """
    source = folder / "source"
    shutil.copytree(FLEET, source, dirs_exist_ok=True)
    program = (FLEET / "drone.soter").read_text("utf-8")
    without = program.replace("  failsafe velocity = 0.0;\n", "")
    if without == program:
        raise ValueError("drone.soter declares another fail-safe law")
    (source / "drone.soter").write_text(without, "utf-8")
    text = (FLEET / "drone.toml").read_text("utf-8")
    other = text.replace("/drone_0/", "/drone_x/").replace("/drone_1/", "/drone_0/")
    maps = {"drone_0": text, "drone_1": other.replace("/drone_x/", "/drone_1/")}
    for i, name in enumerate(DRONES):
        own = ("--set", f"drone.ID={i}", "--set", f"drone.START={5 + 20 * i}")
        build_package(folder / name, "Drone", "drone.toml", maps[name], *own, source=source)


@dataclass
class Body:
    """A drone's motion, as the plant of drone.soter has it; the autopilot obeys velocities."""

    x: float
    v: float = 0.0
    commanded: float = 0.0
    heard_s: float = 0.0

    def step(self, now: float) -> None:
        """So much time later; `now` in s."""
        u = self.commanded if now - self.heard_s < WATCHDOG_S else 0.0
        up, down = (BRAKE if self.v < 0 else PICKUP), (BRAKE if self.v > 0 else PICKUP)
        step_up, step_down = self.v + up * STEP_S, self.v - down * STEP_S
        gained = min(step_up, u) if self.v < u else max(step_down, u)
        self.x += 0.5 * (self.v + gained) * STEP_S
        self.v = gained


class World:
    """Bodies, clocks, pilots and planners, over DDS."""

    def __init__(self) -> None:
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - an extra
        from cyclonedds.pub import DataWriter  # noqa: PLC0415 - an extra
        from cyclonedds.sub import DataReader  # noqa: PLC0415 - an extra
        from cyclonedds.topic import Topic  # noqa: PLC0415 - an extra

        self.types = message_types()
        peer = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))

        def ends(kind: type, topic: str, message: str) -> list[Any]:
            kinds = self.types[message]
            return [kind(peer, Topic(peer, f"rt/{d}/{topic}", kinds)) for d in DRONES]

        self.odom = ends(DataWriter, "odom", "Motion")
        self.wish = ends(DataWriter, "wish", "Float64")
        self.wanted = ends(DataWriter, "wanted", "Claim")
        self.clock = ends(DataWriter, "clock", "Int64")
        self.velocity = ends(DataReader, "cmd_vel", "Float64")
        self.claim = ends(DataReader, "claim", "Claim")
        self.bodies = [Body(5.0), Body(25.0)]
        self.claims = [(1, 9), (21, 29)]
        self.rush = [10.0, -10.0]
        self.changes = [0, 0]
        self.nearest = 20.0
        self.outside = 0
        self.overlaps = 0
        self.chance = np.random.default_rng(1)

    def _read(self, now: float) -> None:
        for i, body in enumerate(self.bodies):
            for message in self.velocity[i].take(20):
                if hasattr(message, "data_"):
                    body.commanded, body.heard_s = message.data_, now
            for message in self.claim[i].take(20):
                if hasattr(message, "lo_"):
                    piece = (message.lo_, message.hi_)
                    self.changes[i] += int(piece != self.claims[i])
                    self.claims[i] = piece
            body.step(now)

    def turn(self, k: int, now: float) -> None:
        """One step of all of it: `now` in s since it began."""
        self._read(now)
        a, b = self.bodies
        self.nearest = min(self.nearest, abs(a.x - b.x))
        self.outside += sum(
            not lo <= d.x <= hi for d, (lo, hi) in zip(self.bodies, self.claims, strict=True)
        )
        (low, high), (other_low, other_high) = self.claims
        self.overlaps += int(high + APART > other_low and other_high + APART > low)
        sec, nanosec = divmod(time.time_ns(), 10**9)
        header = self.types["Header"](self.types["Time"](sec, nanosec), "")
        for i, body in enumerate(self.bodies):
            self.odom[i].write(self.types["Motion"](header, body.x, body.v))
            self.clock[i].write(self.types["Int64"](int(1000.0 * now)))
            if k % 10 == 0:
                if self.chance.random() < 0.01:
                    self.rush[i] = -self.rush[i]
                self.wish[i].write(self.types["Float64"](self.rush[i]))
                lo = int(self.chance.integers(0, 31))
                hi = min(lo + int(self.chance.integers(4, 31)), STREET)
                self.wanted[i].write(self.types["Claim"](header, i, lo, hi, 0))


@dataclass(frozen=True)
class Row:
    """What happens to drone 1 after a third of the time."""

    name: str
    signal: int


ROWS = (
    Row("nothing", 0),
    Row("drone 1 killed", signal.SIGKILL),
    Row("drone 1 stopped", signal.SIGSTOP),
)


def fly(row: Row, folder: Path, seconds: float) -> str:
    """A row of the table."""
    world = World()
    machines = {n: Machine(n, folder / "channels" / n, CLOCK_ERROR_S) for n in DRONES}
    try:
        for n, m in machines.items():
            m.start(folder / n)
        begun = time.monotonic()
        k, after, changes = 0, False, 0
        moved_s = 0.0
        while (now := time.monotonic() - begun) < seconds:
            world.turn(k, now)
            k += 1
            if row.signal and not after and now > seconds / 3:
                machines["drone_1"].send(row.signal)
                after, changes, at = True, world.changes[0], now
            if after and abs(world.bodies[1].v) > 0.0:
                moved_s = now - at
            time.sleep(max(0.0, begun + k * STEP_S - time.monotonic()))
        late = time.monotonic() - begun - k * STEP_S
        later = f"{world.changes[0] - changes:>9}" if after else f"{'-':>9}"
        still = f"{moved_s:>8.2f}" if after else f"{'-':>8}"
        return (
            f"{row.name:<18} {world.nearest:>10.2f} {world.overlaps:>8} {world.outside:>7} "
            f"{sum(world.changes):>7} {later} {still} {late:>6.2f}"
        )
    finally:
        for m in machines.values():
            m.end()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(os.getpid() % 200 + 1), "CYCLONEDDS_URI": LOOPBACK}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        build(folder)
        print(
            f"{'one drone':<18} {'nearest, m':>10} {'overlaps':>8} {'outside':>7} {'changes':>7} "
            f"{'of 0 then':>9} {'moved, s':>8} {'late':>6}"
        )
        for row in ROWS:
            print(fly(row, folder, arguments.seconds), flush=True)


if __name__ == "__main__":
    main()
