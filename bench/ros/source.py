"""A node of rospy or rclpy that is one sensor of a position: odometry, every so many ms.

    source.py NODE CHANNEL EVERY_MS [POSITION]

Stamps are whole multiples of EVERY_MS, whenever the messages come, so that the time between two
of them is not this machine's. It prints `speaks` once somebody listens.
Non-goals: noise, motion.
"""

from __future__ import annotations

import sys
import time

from either_ros import NS, Node, now, stamp
from nav_msgs.msg import Odometry


def main() -> None:
    """Speak until the end."""
    name, channel, every_ms, *position = sys.argv[1:]
    every_ns = int(every_ms) * 10**6
    node = Node(name)
    out = node.out(channel, Odometry, depth=100)
    at = (now() // every_ns + 1) * every_ns
    told = False
    while node.ok():
        time.sleep(max(at - now(), 0) / NS)
        message = Odometry()
        message.header.stamp = stamp(at)
        message.header.frame_id = "odom"
        message.pose.pose.position.x = float(position[0]) if position else 0.25
        out.publish(message)
        at += every_ns
        if not told and out.listeners():
            told = True
            print("speaks", flush=True)


if __name__ == "__main__":
    main()
