"""What stands around the robot of scenes.py: sensors, a wish, and whoever is told its commands.

    python bench/real_time/scenes_world.py PACKAGE CHANNELS

Purpose: says 100 times a second where the robot is and what it wishes, by channels or, where
CHANNELS is empty, over DDS; prints when it is told another speed (CLOCK_MONOTONIC, ns), and which.
Non-goals: a plant: the robot stands where it stands.
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from typing import Any

WISH = 0.75


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

        robot = soter.remote.connect(f"{package}/channels.json", channels=channels)
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
