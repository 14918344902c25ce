"""MAVLink: what is wrong on the wire, beside the whole stack of examples/mavlink/geofence.soter.

    .venv/bin/python bench/mavlink/bad_input.py [CASE ...]

An autopilot says that the vehicle is 1 m east of the middle, so that SC (nobody is AC) commands
-0.3 m/s east, then for a second something bad beside it or instead of it, then the good again. A
wrong command is any that is neither that nor the law, 0. What the bridge and the trusted part
counted is printed. Exit code 1 where a command was wrong, somebody ended, or nobody counted it.
"""

from __future__ import annotations

import math
import random
import re
import socket
import struct
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.mavlink.mavlink_stack import Stack, built_package, missing, stack  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

try:
    from pymavlink.dialects.v20 import common as mavlink
except ImportError:  # `missing` says so
    mavlink = None

EAST = 1.0
RIGHT = {struct.unpack("f", struct.pack("f", -0.3 * EAST))[0], 0.0}
BOOT_NS = 10**11
SECONDS = 1.0
SEED = 7


class Wire:
    """The autopilot's side: two sockets, one of which is somebody else's."""

    def __init__(self, port: int) -> None:
        self.socket, self.other = self._socket(port), self._socket(port)
        self.began = time.monotonic_ns()
        self.link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.link.robust_parsing = True
        self.commands: list[tuple[float, float, float]] = []
        self.draw = random.Random(SEED)  # noqa: S311 - damage
        self.answers = True
        self.recorded: list[bytes] = []

    def close(self) -> None:
        """Both sockets."""
        self.socket.close()
        self.other.close()

    @staticmethod
    def _socket(port: int) -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", 0))
        made.connect(("127.0.0.1", port))
        made.setblocking(False)
        return made

    def boot_ns(self) -> int:
        """Its clock."""
        return time.monotonic_ns() - self.began + BOOT_NS

    def place(self, east: float = EAST, ahead_ms: int = 0, **more: float) -> bytes:
        """LOCAL_POSITION_NED of a moment."""
        fields = {"x": 0.0, "y": east, "z": -16.0, "vx": 0.0, "vy": 0.0, "vz": 0.0, **more}
        ms = min(max(self.boot_ns() // 10**6 + ahead_ms, 0), 2**32 - 1)
        message = mavlink.MAVLink_local_position_ned_message(ms, **fields)
        return self.packed(message)

    def packed(
        self, message: mavlink.MAVLink_message, link: mavlink.MAVLink | None = None
    ) -> bytes:
        """A frame."""
        sender = link or self.link
        frame = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        return frame

    def send(self, data: bytes, *, elsewhere: bool = False) -> None:
        """A datagram; nobody there is no matter."""
        try:
            (self.other if elsewhere else self.socket).send(data)
        except (ConnectionRefusedError, BlockingIOError):
            return

    def good(self) -> None:
        """The truth."""
        frame = self.place()
        self.recorded.append(frame)
        self.send(frame)

    def hear(self) -> None:
        """Answers TIMESYNC, collects commands."""
        while True:
            try:
                data = self.socket.recv(4096)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for m in self.link.parse_buffer(data) or []:
                if m.get_type() == "TIMESYNC" and m.tc1 == 0 and self.answers:
                    answer = mavlink.MAVLink_timesync_message(self.boot_ns(), m.ts1)
                    self.send(self.packed(answer))
                elif m.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                    self.commands.append((m.vx, m.vy, m.vz))

    def during(self, seconds: float, turn: Callable[[], None], every_s: float = 0.02) -> None:
        """Calls `turn` so often, and hears what comes."""
        end, due = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            self.hear()
            if time.monotonic() >= due:
                turn()
                due = time.monotonic() + every_s
            time.sleep(0.001)


def _as(system: int, component: int) -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def _both(w: Wire, bad: Callable[[], bytes]) -> Callable[[], None]:
    def turn() -> None:
        w.good()
        w.send(bad())

    return turn


def _field(ahead_ms: int = 0, **fields: float) -> Callable[[Wire], Callable[[], None]]:
    return lambda w: lambda: w.send(w.place(fields.get("east", EAST), ahead_ms, **_rest(fields)))


def _rest(fields: dict[str, float]) -> dict[str, float]:
    return {k: v for k, v in fields.items() if k != "east"}


def _garbage(w: Wire) -> Callable[[], None]:
    return _both(w, lambda: w.draw.randbytes(w.draw.randint(1, 300)))


def _wrong_checksum(w: Wire) -> Callable[[], None]:
    def bad() -> bytes:
        frame = bytearray(w.place(east=-5.0))
        frame[w.draw.randrange(10, len(frame))] ^= 1 << w.draw.randrange(8)
        return bytes(frame)

    return _both(w, bad)


def _torn(w: Wire) -> Callable[[], None]:
    def bad() -> bytes:
        frame = w.place(east=-5.0)
        return frame[: w.draw.randrange(1, len(frame))]

    return _both(w, bad)


def _stranger(system: int, component: int) -> Callable[[Wire], Callable[[], None]]:
    def case(w: Wire) -> Callable[[], None]:
        link = _as(system, component)
        message = mavlink.MAVLink_local_position_ned_message
        return _both(w, lambda: w.packed(message(2**31, 0, -5.0, -16.0, 0, 0, 0), link))

    return case


def _elsewhere(w: Wire) -> Callable[[], None]:
    def turn() -> None:
        w.good()
        w.send(w.place(east=-5.0), elsewhere=True)

    return turn


def _replayed(w: Wire) -> Callable[[], None]:
    past = [w.place(east=-5.0, ahead_ms=-30_000 + 20 * k) for k in range(60)]
    return _both(w, lambda: past[w.draw.randrange(len(past))])


def _recorded(w: Wire) -> Callable[[], None]:
    def turn() -> None:
        for frame in w.recorded[-20:]:
            w.send(frame)

    return turn


def _signed(w: Wire) -> Callable[[], None]:
    link = _as(1, 1)
    link.signing.secret_key = b"k" * 32
    link.signing.sign_outgoing = True
    link.signing.timestamp = 10**12

    def bad() -> bytes:
        ms = w.boot_ns() // 10**6
        message = mavlink.MAVLink_local_position_ned_message(ms, 0, -5.0, -16.0, 0, 0, 0)
        return w.packed(message, link)

    return _both(w, bad)


def _flood(w: Wire) -> Callable[[], None]:
    def turn() -> None:
        w.good()
        link = _as(9, 9)
        message = mavlink.MAVLink_local_position_ned_message
        frame = w.packed(message(2**31, 0, -5.0, -16.0, 0, 0, 0), link)
        for _ in range(200):
            w.send(frame * 30, elsewhere=True)

    return turn


def _timesync(w: Wire) -> Callable[[], None]:
    def bad() -> bytes:
        hour = 3_600_000_000_000
        return w.packed(
            mavlink.MAVLink_timesync_message(w.boot_ns() + hour, w.draw.getrandbits(62))
        )

    return _both(w, bad)


def _other_mask(w: Wire) -> Callable[[], None]:
    link = _as(1, 192)
    message = mavlink.MAVLink_set_position_target_local_ned_message

    def bad() -> bytes:
        made = message(0, 1, 1, 8, 0xDC7, 0, 0, 0, 1.9, 1.9, 1.9, 0, 0, 0, 0, 0)
        return w.packed(made, link)

    return _both(w, bad)


NAN, INF = math.nan, math.inf
CASES: dict[str, tuple[Callable[[Wire], Callable[[], None]], str]] = {
    "garbage": (_garbage, "torn"),
    "wrong checksums": (_wrong_checksum, "torn"),
    "truncated": (_torn, ""),
    "of another system": (_stranger(2, 1), "strangers"),
    "of another component": (_stranger(1, 2), "strangers"),
    "from another address": (_elsewhere, "from_elsewhere"),
    "signed": (_signed, "signed"),
    "NaN": (_field(east=NAN), "refused"),
    "NaN as a speed": (_field(vx=NAN), "refused"),
    "infinity": (_field(east=INF), "refused"),
    "minus infinity": (_field(z=-INF), "refused"),
    "replayed from before": (_replayed, "backwards"),
    "the last second again": (_recorded, "backwards"),
    "time goes back an hour": (_field(east=-5.0, ahead_ms=-3_600_000), "backwards"),
    "stamped in an hour": (_field(east=-5.0, ahead_ms=3_600_000), "later_than_now"),
    "stamped in 100 ms": (_field(east=-5.0, ahead_ms=100), "later_than_now"),
    "answers that nobody asked for": (_timesync, "unasked"),
    "a wish in another frame": (_other_mask, "of_other_constants"),
    "a flood of a stranger": (_flood, "strangers"),
    "silence": (lambda _w: lambda: None, ""),
}
"""Case, and what counts it ("": nobody can)."""
TOPIC = re.compile(r"topic motion: \d+ values taken, (\d+) refused")


def counted(report: dict[str, Any], trusted: str, key: str) -> int:
    """How often somebody counted it."""
    if key == "refused":
        found = TOPIC.search(trusted)
        return int(found[1]) if found else 0
    total = int(report.get(key, 0)) if key == "strangers" else 0
    for part in (*report["topics"], *report["sources"], *report["links"], report["clock"]):
        total += int(part.get(key, 0))
    return total


def one(package: Path, case: str) -> tuple[set[float], int, str]:
    """The commands eastward, how often the case was counted, and who ended."""
    make, key = CASES[case]
    with stack(package) as all_, closing(begun(all_)) as wire:
        wire.during(3 * SECONDS, wire.good)
        before = len(wire.commands)
        wire.during(SECONDS, make(wire))
        wire.during(SECONDS, wire.good)
        assert len(wire.commands) > before > 0, "nobody commands"
        ended = [n for n, p in all_.running.items() if p.poll() is not None]
        for name in ("trusted", "actuator", "bridge"):
            all_.end(name)
        heard = {east for _, east, _ in wire.commands}
        heard |= {v for north, _, up in wire.commands for v in (north, up) if v != 0.0}
        many = counted(all_.report(), "".join(all_.heard["trusted"]), key) if key else -1
        return heard, many, ", ".join(ended)


def begun(all_: Stack) -> Wire:
    """The processes, and the wire to them."""
    all_.actuator()
    all_.bridge()
    all_.trusted()
    return Wire(all_.port)


def main() -> int:
    """Run; 1 where something was wrong."""
    if why := missing():
        print(f"not run: {why} is not here")
        return 2
    wrong = silent = 0
    chosen = sys.argv[1:] or [*CASES]
    with tempfile.TemporaryDirectory() as folder:
        package = built_package(Path(folder) / "package")
        print(f"{'on the wire':<32} {'commands east, m/s':<24} {'counted as':<20} {'times':>8}")
        for case in chosen:
            heard, many, ended = one(package, case)
            wrong += bool(heard - RIGHT) or bool(ended)
            silent += many == 0
            shown = ", ".join(f"{x:g}" for x in sorted(heard))
            told = f"ENDED: {ended}" if ended else CASES[case][1] or "-"
            print(f"{case:<32} {shown:<24} {told:<20} {max(many, 0):>8}", flush=True)
    print(f"{len(chosen)} cases: {wrong} with a wrong command, {silent} that nobody counted")
    return 1 if wrong or silent else 0


if __name__ == "__main__":
    sys.exit(main())
