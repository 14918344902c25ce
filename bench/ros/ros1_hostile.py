"""A node of rospy that says good odometry, then something bad, then good odometry again.

    /usr/bin/python3 ros1_hostile.py CASE

It runs under the system's Python, which has rospy. What it hears on /cmd_vel it prints: `cmd VALUE`
for each value that is another than the one before.
Non-goals: judging (ros1_bad_input.py).
"""

from __future__ import annotations

import struct
import sys
import time

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64, String

GOOD = 0.25
RATE_S = 0.01
last = {"command": None}


def hear(message: Twist) -> None:
    """A command."""
    if message.linear.x != last["command"]:
        last["command"] = message.linear.x
        print(f"cmd {message.linear.x!r}\n", end="", flush=True)  # two publishers, two threads


def odometry(x: float = GOOD, stamp: object = None, frame: str = "odom") -> Odometry:
    """A message."""
    m = Odometry()
    m.header.stamp = rospy.Time.now() if stamp is None else stamp
    m.header.frame_id = frame
    m.pose.pose.position.x = x
    m.pose.pose.orientation.w = 1.0
    return m


def ago(seconds: float) -> rospy.Time:
    """A time that is so long ago; before 1970 it is 0.000000001 s."""
    return rospy.Time.from_sec(max(rospy.Time.now().to_sec() - seconds, 1e-9))


def carried(t: rospy.Time) -> rospy.Time:
    """The same time to whoever adds its parts, and no time: its ns are three seconds and more."""
    t.secs, t.nsecs = t.secs - 3, t.nsecs + 3_000_000_000
    return t


class Torn:
    """A message whose bytes are not what its type says."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def serialize(self, buffer: object) -> None:
        """The bytes."""
        buffer.write(self.data)  # type: ignore[attr-defined]


BAD = {
    "NaN": lambda: odometry(float("nan")),
    "infinity": lambda: odometry(float("inf")),
    "minus infinity": lambda: odometry(float("-inf")),
    "beyond the set": lambda: odometry(1e9),
    "greatest double": lambda: odometry(1.7e308),
    "another frame": lambda: odometry(-3.0, frame="map"),
    "no frame": lambda: odometry(-3.0, frame=""),
    "a frame of a megabyte": lambda: odometry(-3.0, frame="o" * 1_000_000),
    "no stamp": lambda: odometry(-3.0, rospy.Time(0)),
    "stamped in an hour": lambda: odometry(-3.0, ago(-3600.0)),
    "stamped in 50 ms": lambda: odometry(-3.0, ago(-0.05)),
    "the last stamp there is": lambda: odometry(-3.0, rospy.Time(2**32 - 1, 999_999_999)),
    "stamped an hour ago": lambda: odometry(-3.0, ago(3600.0)),
    "ns beyond a second": lambda: odometry(-3.0, carried(rospy.Time.now())),
    "stamped 1970": lambda: odometry(-3.0, rospy.Time(0, 1)),
}
ACTUATORS = "the actuators are killed"
FLOOD = ("a flood of the good", "a flood of NaN")


def say(publisher: rospy.Publisher, seconds: float, make: object, pause_s: float = RATE_S) -> None:
    """Publish for so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not rospy.is_shutdown():
        publisher.publish(make())  # type: ignore[operator]
        if pause_s:
            time.sleep(pause_s)


def bad(case: str, publisher: rospy.Publisher) -> None:
    """The bad part of a case."""
    if case in BAD:
        say(publisher, 0.4, BAD[case])
    elif case in FLOOD:
        value = GOOD if "good" in case else float("nan")
        say(publisher, 1.0, lambda: odometry(value), 0.0)
    elif case == "silence":
        time.sleep(1.0)
    elif case == ACTUATORS:
        print("kill", flush=True)
        say(publisher, 1.0, odometry)
    elif case == "a second publisher":
        rospy.loginfo("the other node speaks")
        say(publisher, 1.0, odometry)
    elif case == "NaN as a wish":
        wish = rospy.Publisher("/wish", Float64, queue_size=1)
        say(wish, 0.5, lambda: Float64(float("nan")))
    elif case == "a wish beyond the set":
        wish = rospy.Publisher("/wish", Float64, queue_size=1)
        say(wish, 0.5, lambda: Float64(50.0))
    elif case == "a latched wish":
        wish = rospy.Publisher("/wish", Float64, queue_size=1, latch=True)
        wish.publish(Float64(1.0))
        say(publisher, 1.0, odometry)
    else:
        raise SystemExit(f"no case {case}")


def main() -> None:
    """As a second publisher, or as the one that the bridge listens to."""
    case = sys.argv[1]
    if case == "as another node":
        rospy.init_node("intruder")
        publisher = rospy.Publisher("/odom", Odometry, queue_size=1, tcp_nodelay=True)
        time.sleep(0.5)
        say(publisher, 1.0, lambda: odometry(-3.0))
        return
    if case == "as another type":
        rospy.init_node("liar")
        publisher = rospy.Publisher("/odom", String, queue_size=1)
        say(publisher, 1.0, lambda: String("x"))
        return
    if case == "as another commander":
        rospy.init_node("usurper")
        publisher = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
        command = Twist()
        command.linear.x = -GOOD
        say(publisher, 8.0, lambda: command)
        return
    if case == "as torn bytes":
        rospy.init_node("torn")
        publisher = rospy.Publisher("/odom", Odometry, queue_size=1)
        data = struct.pack("<I", 0xFFFFFFF0)
        publisher.impl.acquire()
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            publisher.impl.publish(Torn(data))
            time.sleep(RATE_S)
        return
    rospy.init_node("driver")
    publisher = rospy.Publisher("/odom", Odometry, queue_size=1, tcp_nodelay=True)
    rospy.Subscriber("/cmd_vel", Twist, hear, queue_size=1, tcp_nodelay=True)
    print("ready", flush=True)
    say(publisher, 2.0, odometry)
    bad(case, publisher)
    say(publisher, 0.5, odometry)


if __name__ == "__main__":
    main()
