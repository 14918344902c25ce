"""An autopilot as PX4's documentation describes OFFBOARD, over UDP, for tests and benchmarks.

    .venv/bin/python bench/mavlink/px4_peer.py PORT [LOSS_S]

It streams HEARTBEAT (1 Hz) and LOCAL_POSITION_NED (50 Hz, with its own clock since boot), answers
TIMESYNC, and moves as the set-points say: velocities, with a lag. It enters OFFBOARD once
set-points came more often than twice a second for a second, and leaves it where none came for
COM_OF_LOSS_T (LOSS_S); then it stops. Every set-point that changed, and every mode, is a line on
standard output with CLOCK_MONOTONIC in ns.

Purpose: somebody to talk with. Non-goals: flying: what a real autopilot does is its own matter.
"""

from __future__ import annotations

import socket
import sys
import time
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as mavlink

LAG_S, BOOT_S = 0.4, 100.0
PROOF_OF_LIFE_S = 0.5
BEFORE_OFFBOARD_S = 1.0
PX4_OFFBOARD, PX4_HOLD = 6 << 16, (4 << 16) | (3 << 24)
ARMED = 128


@dataclass
class Peer:
    """The autopilot, on for `BOOT_S` when it begins."""

    port: int
    loss_s: float = 0.5
    place: list[float] = field(default_factory=lambda: [0.0, 0.0, -16.0])
    speed: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    wanted: tuple[float, ...] = (0.0, 0.0, 0.0)
    offboard: bool = False
    stream_began: float = -1.0
    last_set_point: float = -1.0
    refused: int = 0

    def __post_init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.connect(("127.0.0.1", self.port))
        self.socket.setblocking(False)
        self.began = time.monotonic()
        self.link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.link.robust_parsing = True
        self.told: tuple[float, ...] | None = None

    def boot_ns(self) -> int:
        """Its clock."""
        return int((time.monotonic() - self.began + BOOT_S) * 1e9)

    def send(self, message: mavlink.MAVLink_message) -> None:
        """One frame; nobody there is no matter."""
        try:
            self.socket.send(message.pack(self.link))
        except (ConnectionRefusedError, BlockingIOError):
            return
        self.link.seq = (self.link.seq + 1) % 256

    def hear(self) -> None:
        """What came."""
        while True:
            try:
                data = self.socket.recv(4096)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for message in self.link.parse_buffer(data) or []:
                self.obey(message)

    def obey(self, m: mavlink.MAVLink_message) -> None:
        """A message of the companion computer."""
        name = m.get_type()
        if name == "TIMESYNC" and m.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(self.boot_ns(), m.ts1))
        if name != "SET_POSITION_TARGET_LOCAL_NED":
            return
        if (m.target_system, m.target_component) != (1, 1) or m.get_srcComponent() != 191:
            self.refused += 1
            return
        now = time.monotonic()
        if now - self.last_set_point > PROOF_OF_LIFE_S:
            self.stream_began = now
        self.last_set_point = now
        self.wanted = (m.vx, m.vy, m.vz)
        if self.wanted != self.told or (m.type_mask, m.coordinate_frame) != (0xDC7, 1):
            self.told = self.wanted
            numbers = " ".join(f"{v!r}" for v in self.wanted)
            print(f"set {time.monotonic_ns()} {numbers} {m.type_mask} {m.coordinate_frame}")
            sys.stdout.flush()

    def decide(self) -> None:
        """Its mode."""
        now = time.monotonic()
        silent = now - self.last_set_point
        lives = self.last_set_point > 0.0 and silent < PROOF_OF_LIFE_S
        before = self.offboard
        if self.offboard and silent > self.loss_s:
            self.offboard = False
            self.stream_began = now
        elif not self.offboard and lives and now - self.stream_began > BEFORE_OFFBOARD_S:
            self.offboard = True
        if before != self.offboard:
            word = "OFFBOARD" if self.offboard else "HOLD"
            print(f"mode {time.monotonic_ns()} {word}", flush=True)

    def move(self, step_s: float) -> None:
        """By the set-points, in OFFBOARD; else it comes to rest."""
        for k in range(3):
            target = self.wanted[k] if self.offboard else 0.0
            self.speed[k] += (target - self.speed[k]) * step_s / LAG_S
            self.place[k] += self.speed[k] * step_s

    def run(self) -> None:
        """Until somebody ends it."""
        step_s = 0.005
        beat = sent = 0.0
        last = time.monotonic()
        while True:
            time.sleep(step_s)
            now = time.monotonic()
            self.hear()
            self.decide()
            self.move(now - last)
            last = now
            if now - sent >= 0.02:
                ms = self.boot_ns() // 1_000_000
                self.send(mavlink.MAVLink_local_position_ned_message(ms, *self.place, *self.speed))
                sent = now
            if now - beat >= 1.0:
                mode = PX4_OFFBOARD if self.offboard else PX4_HOLD
                self.send(mavlink.MAVLink_heartbeat_message(2, 12, ARMED | 1, mode, 4, 3))
                print(f"at {time.monotonic_ns()} {' '.join(f'{p:.3f}' for p in self.place)}")
                sys.stdout.flush()
                beat = now


def main() -> None:
    """For ever, at the port that is named."""
    port, loss_s = [*sys.argv[1:], "0.5"][:2]
    Peer(int(port), float(loss_s)).run()


if __name__ == "__main__":
    main()
