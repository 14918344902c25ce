"""What is done to a process in a scene of scenes.py, and what stands around its robot.

    python bench/real_time/scene_parts.py PACKAGE CHANNELS

Purpose: a `Deed` spoils the descriptors of a process, or sends a signal. As a program: says 100
times a second where the robot is and what it wishes, by channels or, where CHANNELS is empty, over
DDS; prints when it is told another speed (CLOCK_MONOTONIC, ns), and which. Non-goals: a plant: the
robot stands where it stands.
"""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import sys
import termios
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import subprocess

WISH = 0.75


class Deed:
    """What is done to a process: how it is `given` its descriptors, what happens, `ends` it."""

    def __init__(self, what: str) -> None:
        self.stream, _, self.how = what.partition(" ")
        self.given: dict[str, Any] = {}
        self.files: tuple[int, ...] = ()
        number, stays = getattr(signal, what, None), "USR1 PIPE XFSZ TSTP TTIN TTOU CONT WINCH"
        self.number = number or (signal.SIGRTMIN + 3 if what == "SIGRTMIN+3" else None)
        self.ends = what == "terminal gone" or (bool(self.number) and what[3:] not in stays.split())
        if self.stream == "terminal":
            self.files = pty.openpty()
            self.given = dict.fromkeys(("stdin", "stdout", "stderr"), self.files[1])
            self.given["preexec_fn"] = lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        elif self.how == "closed":
            self.given = {"preexec_fn": lambda: os.close(("in", "out", "err").index(what[3:-7]))}
        elif self.how:
            self.files = os.pipe()
            self.given = {self.stream: self.files[1]}

    def now(self, process: subprocess.Popen[Any]) -> None:
        """It happens."""
        if self.number:
            process.send_signal(self.number)
        elif self.how == "stopped":
            os.write(self.files[0], b"\x13")
        elif self.how == "full":
            os.set_blocking(self.files[1], False)
            for size in (4096, 1):
                with suppress(BlockingIOError):
                    while True:
                        os.write(self.files[1], b" " * size)
            os.set_blocking(self.files[1], True)
        elif self.how == "gone":
            self.over()

    def over(self) -> None:
        """Nothing of it stays open."""
        while self.files:
            os.close(self.files[-1])
            self.files = self.files[:-1]


class Peer:
    """The same over DDS, a message of one float a topic."""

    def __init__(self) -> None:
        from cyclonedds import domain, idl, pub, sub, topic  # noqa: PLC0415 - an extra

        self.of: Any = idl.make_idl_struct(
            "Float64_", "std_msgs.msg.dds_.Float64_", {"data_": float}
        )
        me = domain.DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        ends = {t: topic.Topic(me, f"rt/{t}", self.of) for t in ("position", "wish", "speed")}
        self.writers = {t: pub.DataWriter(me, ends[t]) for t in ("position", "wish")}
        self.reader, self.value = sub.DataReader(me, ends["speed"]), None

    def publish(self, name: str, value: float) -> None:
        """A message."""
        self.writers[name].write(self.of(value))

    def read(self, _: str) -> Peer | None:
        """The last value, as `value`; None: there is none yet."""
        values = [m.data_ for m in self.reader.take(99) if hasattr(m, "data_")]
        self.value = values[-1] if values else self.value
        return None if self.value is None else self


def world(package: str, channels: str) -> None:
    """Runs until it is ended."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(70))
    if channels:
        import soter.remote  # noqa: PLC0415 - builds a library

        robot: Any = soter.remote.connect(f"{package}/channels.json", channels=channels)
    else:
        robot = Peer()
    last = None
    while True:
        robot.publish("position", 0.0)
        robot.publish("wish", WISH)
        for _ in range(10):
            now = robot.read("speed")
            if now is not None and now.value != last:
                print(time.monotonic_ns(), last := now.value, flush=True)
            time.sleep(0.001)


if __name__ == "__main__":
    world(*sys.argv[1:])
