"""What the nodes of this folder need of rospy, or of rclpy where $ROS_VERSION is 2.

Purpose: one text of each node for both. Non-goals: everything else.
"""

from __future__ import annotations

import atexit
import os
import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from io import BytesIO

    from rospy import Publisher
    from rospy import Time as Stamp

VERSION = int(os.environ.get("ROS_VERSION", "1"))
NS = 10**9
SECONDS_MAX = 2**31 - 1 if VERSION == 2 else 2**32 - 1
"""The last second of a stamp."""

if VERSION == 2:
    import rclpy
    from builtin_interfaces.msg import Time
    from rclpy.qos import DurabilityPolicy, QoSProfile
else:
    import rospy


class Node:
    """A node that hears on a thread of its own."""

    def __init__(self, name: str) -> None:
        if VERSION == 2:
            rclpy.init()
            self._node = rclpy.create_node(name)
            hears = threading.Thread(target=self._spin, daemon=True)
            hears.start()
            atexit.register(hears.join, 5.0)
            atexit.register(rclpy.try_shutdown)  # the first of the two that is called
        else:
            rospy.init_node(name)

    def _spin(self) -> None:
        try:
            rclpy.spin(self._node)
        except rclpy.executors.ExternalShutdownException:  # SIGINT, which ends these nodes
            return

    def out(self, topic: str, kind: type, *, latched: bool = False, depth: int = 1) -> Out:
        """Somebody who publishes; `latched`: also the last one, to whoever comes later."""
        if VERSION == 1:
            words = {"queue_size": depth, "latch": latched, "tcp_nodelay": True}
            return Out(rospy.Publisher(topic, kind, **words))
        kept = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        return Out(
            self._node.create_publisher(kind, topic, QoSProfile(depth=depth, durability=kept))
        )

    def hear(self, topic: str, kind: type, hear: Callable[[Any], None], depth: int = 1) -> None:
        """Call `hear` with each message."""
        if VERSION == 1:
            rospy.Subscriber(topic, kind, hear, queue_size=depth, tcp_nodelay=True)
        else:
            self._node.create_subscription(kind, topic, hear, depth)

    def ok(self) -> bool:
        """Whether it goes on."""
        return bool(rclpy.ok() if VERSION == 2 else not rospy.is_shutdown())


class Out:
    """A publisher."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher

    def publish(self, message: object) -> None:
        """Say it."""
        try:
            self._publisher.publish(message)
        except Exception:
            if VERSION == 1 or rclpy.ok():
                raise

    def listeners(self) -> int:
        """How many hear it."""
        if VERSION == 2:
            return int(self._publisher.get_subscription_count())
        return int(self._publisher.get_num_connections())

    def torn(self, data: bytes) -> None:
        """Say bytes that are not what the type says."""
        if VERSION == 2:
            self._publisher.publish(data)
        else:
            self._publisher.impl.acquire()
            self._publisher.impl.publish(Torn(data))


class Torn:
    """What rospy takes for a message."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def serialize(self, buffer: BytesIO) -> None:
        """The bytes."""
        buffer.write(self.data)


def stamp(ns: int, carried: int = 0) -> Stamp:
    """A time; with `carried` its seconds are so many less, and its ns more: it is none."""
    seconds, rest = ns // NS - carried, ns % NS + carried * NS
    if VERSION == 2:
        return Time(sec=seconds, nanosec=rest)
    made = rospy.Time(0, 1)
    made.secs, made.nsecs = seconds, rest
    return made


def now() -> int:
    """Of the clock of stamps, ns."""
    return time.time_ns()
