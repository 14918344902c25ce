"""MAVLink on loopback: the bridge killed, the trusted part killed, AC killed, N times each.

    .venv/bin/python bench/mavlink/peer_loss.py [-n N]

Processes: an autopilot as PX4's documentation describes OFFBOARD (px4_peer.py, COM_OF_LOSS_T 0.5 s
as the mapping says), AC (examples/mavlink/hurry.py: 1.5 m/s east), and of
examples/mavlink/geofence.soter the trusted part, its actuators and the bridge. Times are
CLOCK_MONOTONIC from just before the signal.

What the peer has to have received, and by when:
- bridge killed: not one set-point more; OFFBOARD left within COM_OF_LOSS_T, its own rate of looking
  and the age of the last set-point;
- trusted part killed: the law, 0, within the lease, what the bridge and the peer take besides; no
  other command until somebody arms the actuators; OFFBOARD is kept;
- AC killed: SC's command within the sum of declared times; OFFBOARD is kept.

Exit code 1 where one fails. Non-goals: an autopilot, a radio, a machine that is late: the bounds
are those of processes on one machine, and MARGIN_MS is what its scheduler is given.
"""

from __future__ import annotations

import argparse
import random
import re
import signal
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.mavlink.mavlink_stack import HERE, Stack, built_package, missing, stack  # noqa: E402

HURRY = ROOT / "examples" / "mavlink" / "hurry.py"
WISH = (0.0, 1.5, 0.0)
LOSS_S = 0.5
PEER_LOOKS_MS, MARGIN_MS = 5.0, 20.0
LEASE_MS = 119.0
"""As `soter build` prints it."""
AC_MS = {
    "PATIENCE of a wish": 400.0,
    "Wish, its period": 50.0,
    "DM, its period": 100.0,
    "SC, its period": 100.0,
    "late and response of DM and SC": 34.0,
    "acts within": 30.0,
}
BOUNDS_MS = {
    "bridge": LOSS_S * 1e3 + PEER_LOOKS_MS + MARGIN_MS,
    "trusted": LEASE_MS + PEER_LOOKS_MS + MARGIN_MS,
    "ac": sum(AC_MS.values()) + PEER_LOOKS_MS + MARGIN_MS,
}
SET = re.compile(r"^set (\d+) (\S+) (\S+) (\S+) (\d+) (\d+)$")
MODE = re.compile(r"^mode (\d+) (\w+)$")
PATIENCE_S = 30.0
Velocity = tuple[float, float, float]


class Flight:
    """The processes, and what the peer said."""

    def __init__(self, all_: Stack) -> None:
        self.all = all_
        all_.actuator()
        all_.bridge()
        all_.trusted()
        self.python = [sys.executable, "-u"]
        peer = [*self.python, str(HERE / "px4_peer.py"), str(all_.port), str(LOSS_S)]
        all_.start("peer", *peer)
        self.start_ac()

    def start_ac(self) -> None:
        """Somebody who hurries."""
        self.all.start("ac", *self.python, str(HURRY), str(self.all.port))

    def set_points(self, since_ns: int = 0) -> list[tuple[int, Velocity]]:
        """What the peer received, where it changed."""
        found = [m for m in map(SET.match, [*self.all.heard["peer"]]) if m]
        assert all((m[5], m[6]) == ("3527", "1") for m in found), "another mask, or frame"
        told = [(int(m[1]), (float(m[2]), float(m[3]), float(m[4]))) for m in found]
        return [x for x in told if x[0] > since_ns]

    def modes(self, since_ns: int = 0) -> list[tuple[int, str]]:
        """The peer's modes."""
        found = [m for m in map(MODE.match, [*self.all.heard["peer"]]) if m]
        return [(int(m[1]), m[2]) for m in found if int(m[1]) > since_ns]

    def await_hurry(self) -> None:
        """Until the peer is in OFFBOARD and obeys AC."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            modes, told = self.modes(), self.set_points()
            if modes and modes[-1][1] == "OFFBOARD" and told and told[-1][1] == WISH:
                return
            time.sleep(0.02)
        raise RuntimeError(f"AC has no control: {self.modes()[-2:]}, {self.set_points()[-3:]}")

    def arm(self) -> None:
        """As a person does after a lease has ended."""
        self.all.running["actuator"].send_signal(signal.SIGUSR2)  # wherever it stands

    def kill(self, name: str) -> int:
        """CLOCK_MONOTONIC just before."""
        now = time.monotonic_ns()
        self.all.end(name, signal.SIGKILL)
        return now

    def first(self, since_ns: int, seconds: float) -> float | None:
        """Until the first set-point that is no wish, ms."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for at, what in self.set_points(since_ns):
                if what != WISH:
                    return (at - since_ns) / 1e6
            time.sleep(0.01)
        return None


def bridge_dies(flight: Flight) -> tuple[float | None, str]:
    """Until the peer leaves OFFBOARD; what else was wrong."""
    since = flight.kill("bridge")
    time.sleep(LOSS_S + 0.3)
    later = [x for x in flight.set_points(since) if x[0] - since > 1e6 * PEER_LOOKS_MS]
    left = [at for at, mode in flight.modes(since) if mode == "HOLD"]
    flight.all.bridge()
    flight.all.end("trusted")  # it was without a sensor, and gives no lease any more
    time.sleep(0.3)
    flight.all.trusted()
    time.sleep(0.3)
    flight.arm()
    return (left[0] - since) / 1e6 if left else None, f"{len(later)} set-points more" * bool(later)


def trusted_dies(flight: Flight) -> tuple[float | None, str]:
    """Until the law; what else was wrong."""
    since = flight.kill("trusted")
    delay = flight.first(since, 2.0)
    time.sleep(0.5)
    flight.all.trusted()
    time.sleep(1.0)
    others = {v for _, v in flight.set_points(since) if v not in (WISH, (0.0, 0.0, 0.0))}
    after = [v for at, v in flight.set_points(since) if v == WISH and delay is not None
             and at > since + delay * 1e6]  # fmt: skip
    left = flight.modes(since)
    flight.arm()
    wrong = [f"commands {sorted(others)}"] if others else []
    wrong += ["a wish before anybody armed"] * bool(after) + [f"modes {left}"] * bool(left)
    return delay, ", ".join(wrong)


def ac_dies(flight: Flight) -> tuple[float | None, str]:
    """Until SC's command; what else was wrong."""
    since = flight.kill("ac")
    delay = flight.first(since, 3.0)
    left = flight.modes(since)
    time.sleep(0.5)
    flight.start_ac()
    return delay, f"modes {left}" * bool(left)


KILLS = {"bridge": bridge_dies, "trusted": trusted_dies, "ac": ac_dies}
WORDS = {
    "bridge": "bridge killed: OFFBOARD left",
    "trusted": "trusted part killed: the law",
    "ac": "AC killed: SC's command",
}


def measured(package: Path, who: str, count: int) -> tuple[list[float | None], list[str]]:
    """Delays in ms, and what was wrong."""
    draw = random.Random(count)  # noqa: S311 - when somebody dies
    delays, wrong = [], []
    with stack(package) as all_:
        flight = Flight(all_)
        for _ in range(count):
            flight.await_hurry()
            time.sleep(0.1 + draw.random() * 0.2)
            delay, what = KILLS[who](flight)
            delays.append(delay)
            wrong += [what] * bool(what)
    return delays, wrong


def main() -> int:
    """Run; 1 where a bound does not hold."""
    words = argparse.ArgumentParser()
    words.add_argument("-n", type=int, default=20)
    count = words.parse_args().n
    if why := missing():
        print(f"not run: {why} is not here")
        return 2
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        package = built_package(Path(folder) / "package")
        print(f"{'':<32} {'times':>6} {'p50 ms':>8} {'max ms':>8} {'bound':>8} {'beyond':>7}")
        for who, text in WORDS.items():
            delays, wrong = measured(package, who, count)
            there = sorted(d for d in delays if d is not None)
            beyond = sum(d is None or d > BOUNDS_MS[who] for d in delays)
            p50 = statistics.median(there) if there else float("nan")
            most = there[-1] if there else float("nan")
            row = f"{text:<32} {len(delays):>6} {p50:>8.1f} {most:>8.1f} {BOUNDS_MS[who]:>8.1f}"
            print(f"{row} {beyond:>7}", flush=True)
            for what in dict.fromkeys(wrong):
                print(f"    {wrong.count(what)} times: {what}")
            failed |= bool(beyond or wrong)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
