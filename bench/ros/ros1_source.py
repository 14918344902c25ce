"""A node of rospy that is one sensor of a position: odometry, every so many ms.

    /usr/bin/python3 ros1_source.py NODE CHANNEL EVERY_MS

Stamps are whole multiples of EVERY_MS, whenever the messages come, so that the time between two
of them is not this machine's. It prints `speaks` once somebody listens.
Non-goals: noise, motion.
"""

from __future__ import annotations

import sys
import time

import rospy
from nav_msgs.msg import Odometry

NS = 10**9


def main() -> None:
    """Speak until the end."""
    node, channel, every_ms = sys.argv[1:]
    every_ns = int(every_ms) * 10**6
    rospy.init_node(node)
    out = rospy.Publisher(channel, Odometry, queue_size=100, tcp_nodelay=True)
    stamp = (time.time_ns() // every_ns + 1) * every_ns
    told = False
    while not rospy.is_shutdown():
        time.sleep(max(stamp - time.time_ns(), 0) / NS)
        message = Odometry()
        message.header.stamp = rospy.Time(stamp // NS, stamp % NS)
        message.header.frame_id = "odom"
        message.pose.pose.position.x = 0.25
        out.publish(message)
        stamp += every_ns
        if not told and out.get_num_connections():
            told = True
            print("speaks", flush=True)


if __name__ == "__main__":
    main()
