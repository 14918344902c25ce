"""A node that is a scanner, encoders and somebody who wishes, for the ground robot.

    scan.py CASE

First all is far, and for the last two seconds it is CASE; /cmd_vel_nav wishes 0.2 m/s all the time.
What it hears on /cmd_vel it prints, `cmd PHASE VALUE`, where it is another than the one before.
Non-goals: a robot that moves (`examples/ros/ground_robot_hall.soter`); judging.
"""

from __future__ import annotations

import math
import sys
import time
from typing import TYPE_CHECKING

from either_ros import Node, now, stamp
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

if TYPE_CHECKING:
    from collections.abc import Callable

RAYS = 360
RATE_HZ = 50
PHASE_TICKS = 2 * RATE_HZ
CASES: dict[str, Callable[[int], float]] = {
    "near ahead": lambda i: 0.3 if i < 5 else math.inf,
    "near behind": lambda i: 0.3 if 178 < i < 183 else math.inf,
    "far": lambda _: math.inf,
    "two unseen": lambda i: math.nan if i < 2 else 3.0,
    "a sector unseen": lambda i: math.nan if i < 3 else 3.0,
    "zeros": lambda _: 0.0,
    "too near": lambda i: -math.inf if i == 7 else 3.0,
}
last = {"command": math.nan}
phase = {"now": "far"}


def hear(message: Twist) -> None:
    """A command."""
    if message.linear.x != last["command"]:
        last["command"] = message.linear.x
        print(f"cmd {phase['now']} {message.linear.x!r}", flush=True)


def scan(case: str) -> LaserScan:
    """A message whose last ray is now."""
    m = LaserScan()
    m.time_increment = 0.1 / RAYS
    m.header.stamp = stamp(now() - int(m.time_increment * RAYS * 1e9))
    m.angle_increment = 2.0 * math.pi / RAYS
    m.angle_max = 2.0 * math.pi - m.angle_increment
    m.ranges = [CASES[case](i) for i in range(RAYS)]
    return m


def main() -> None:
    """Speak, listen, end."""
    case = sys.argv[1]
    node = Node("scanner_and_wish")
    node.hear("/cmd_vel", Twist, hear, 1000)
    out = {
        "scan": node.out("/scan", LaserScan),
        "odom": node.out("/odom", Odometry),
        "wish": node.out("/cmd_vel_nav", Twist),
    }
    wish = Twist()
    wish.linear.x = 0.2
    began = time.monotonic()
    for k in range(10**9):
        if not node.ok():
            return
        connected = all(p.listeners() for p in out.values())
        if k == RATE_HZ and connected:
            print("ready", flush=True)
        ticks = k - 2 * PHASE_TICKS  # the trusted part starts when all is far
        phase["now"] = case if ticks >= PHASE_TICKS else "far"
        if ticks >= 2 * PHASE_TICKS:
            return
        odometry = Odometry()
        odometry.header.stamp = stamp(now())
        out["odom"].publish(odometry)
        out["wish"].publish(wish)
        if k % (RATE_HZ // 10) == 0:
            out["scan"].publish(scan(phase["now"]))
        time.sleep(max(began + (k + 1) / RATE_HZ - time.monotonic(), 0.0))


if __name__ == "__main__":
    main()
