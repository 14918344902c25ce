"""A node of rospy or rclpy that says good odometry, then something bad, then good odometry again.

    hostile.py CASE

It runs under the Python that has them, with $ROS_VERSION. What it hears on /cmd_vel it prints:
`cmd VALUE` for each value that is another than the one before.
Non-goals: judging (bad_input.py).
"""

from __future__ import annotations

import struct
import sys
import time
from typing import TYPE_CHECKING, Any

from either_ros import NS, SECONDS_MAX, VERSION, Node, now, stamp
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64, String

if VERSION == 2:
    from rclpy.serialization import serialize_message

if TYPE_CHECKING:
    from collections.abc import Callable

    from either_ros import Out, Stamp

GOOD = 0.25
RATE_S = 0.01
last = {"command": None}


def hear(message: Twist) -> None:
    """A command."""
    if message.linear.x != last["command"]:
        last["command"] = message.linear.x
        print(f"cmd {message.linear.x!r}\n", end="", flush=True)  # two publishers, two threads


def odometry(x: float = GOOD, stamped: Stamp | None = None, frame: str = "odom") -> Odometry:
    """A message."""
    m = Odometry()
    m.header.stamp = stamp(now()) if stamped is None else stamped
    m.header.frame_id = frame
    m.pose.pose.position.x = x
    m.pose.pose.orientation.w = 1.0
    return m


def ago(seconds: float) -> Stamp:
    """A time that is so long ago."""
    return stamp(now() - int(seconds * NS))


def float64(value: float) -> Float64:
    """A wish."""
    return Float64(data=value)


BAD = {
    "NaN": lambda: odometry(float("nan")),
    "infinity": lambda: odometry(float("inf")),
    "minus infinity": lambda: odometry(float("-inf")),
    "beyond the set": lambda: odometry(1e9),
    "greatest double": lambda: odometry(1.7e308),
    "another frame": lambda: odometry(-3.0, frame="map"),
    "no frame": lambda: odometry(-3.0, frame=""),
    "a frame of a megabyte": lambda: odometry(-3.0, frame="o" * 1_000_000),
    "no stamp": lambda: odometry(-3.0, stamp(0)),
    "stamped in an hour": lambda: odometry(-3.0, ago(-3600.0)),
    "stamped in 50 ms": lambda: odometry(-3.0, ago(-0.05)),
    "the last stamp there is": lambda: odometry(-3.0, stamp(SECONDS_MAX * NS + NS - 1)),
    "stamped an hour ago": lambda: odometry(-3.0, ago(3600.0)),
    "ns beyond a second": lambda: odometry(-3.0, stamp(now(), 3)),
    "stamped 1970": lambda: odometry(-3.0, stamp(1)),
}
ACTUATORS = "the actuators are killed"
LATCHED = "a latched wish"
CUT = 80
"""Bytes of odometry: with its stamp, its frame and no covariance."""
FLOOD = ("a flood of the good", "a flood of NaN")


def say(
    node: Node, out: Out, seconds: float, make: Callable[[], Any], pause_s: float = RATE_S
) -> None:
    """Publish for so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and node.ok():
        out.publish(make())
        if pause_s:
            time.sleep(pause_s)


def bad(case: str, node: Node, out: Out) -> None:
    """The bad part of a case."""
    if case in BAD:
        say(node, out, 0.4, BAD[case])
    elif case in FLOOD:
        value = GOOD if "good" in case else float("nan")
        say(node, out, 1.0, lambda: odometry(value), 0.0)
    elif case == "silence":
        time.sleep(1.0)
    elif case == ACTUATORS:
        print("kill", flush=True)
        say(node, out, 1.0, odometry)
    elif case == "NaN as a wish":
        say(node, node.out("/wish", Float64), 0.5, lambda: float64(float("nan")))
    elif case == "a wish beyond the set":
        say(node, node.out("/wish", Float64), 0.5, lambda: float64(50.0))
    elif case == LATCHED:
        say(node, out, 1.0, odometry)
    elif case == "cut short":
        data = serialize_message(odometry(-3.0))
        say(node, out, 0.5, lambda: data[:CUT])
    else:
        raise SystemExit(f"no case {case}")


def beside(case: str) -> bool:
    """Speak beside the one that the bridge listens to; False: this case is none of these."""
    if case == "as another node":
        node = Node("intruder")
        out = node.out("/odom", Odometry)
        time.sleep(0.5)
        say(node, out, 1.0, lambda: odometry(-3.0))
    elif case == "as another type":
        node = Node("liar")
        say(node, node.out("/odom", String), 3.0, lambda: String(data="x"))
    elif case == "as another commander":
        node = Node("usurper")
        command = Twist()
        command.linear.x = -GOOD
        say(node, node.out("/cmd_vel", Twist), 8.0, lambda: command)
    elif case == "as torn bytes":
        node = Node("torn")
        out = node.out("/odom", Odometry)
        data = struct.pack("<I", 0xFFFFFFF0)
        end = time.monotonic() + 1.0
        while time.monotonic() < end and node.ok():
            out.torn((b"\0\1\0\0" if VERSION == 2 else b"") + data)
            time.sleep(RATE_S)
    else:
        return False
    return True


def main() -> None:
    """As a second publisher, or as the one that the bridge listens to."""
    case = sys.argv[1]
    if beside(case):
        return
    node = Node("driver")
    out = node.out("/odom", Odometry)
    node.hear("/cmd_vel", Twist, hear)
    if case == LATCHED:
        kept = node.out("/wish", Float64, latched=True)
        kept.publish(float64(1.0))
        print("latched", flush=True)
        time.sleep(1.0)
    print("ready", flush=True)
    say(node, out, 2.0, odometry)
    bad(case, node, out)
    say(node, out, 0.5, odometry)


if __name__ == "__main__":
    main()
