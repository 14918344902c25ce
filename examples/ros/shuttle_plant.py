"""The shuttle of shuttle_ros.soter as a node: obeys /cmd_vel, says /odom 50 times a second.

    python3 shuttle_plant.py          in a shell that has sourced ROS 2, or else of ROS 1

Non-goals: noise; being on time (the real shuttle is).
"""

from __future__ import annotations

import os
import time

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry


class Shuttle:
    """Where it is, m, and the speed that it was told last, m/s."""

    def __init__(self) -> None:
        self.x = 0.0
        self.speed = 0.0
        self.at = time.monotonic()

    def move(self) -> None:
        """Up to now."""
        now = time.monotonic()
        self.x += self.speed * (now - self.at)
        self.at = now

    def obey(self, command: Twist) -> None:
        """A command: counts until another one comes."""
        self.move()
        self.speed = command.linear.x

    def odometry(self, stamp: object) -> Odometry:
        """Where it is now."""
        self.move()
        message = Odometry()
        message.header.stamp = stamp
        message.header.frame_id = "odom"
        message.pose.pose.position.x = self.x
        message.pose.pose.orientation.w = 1.0
        message.twist.twist.linear.x = self.speed
        return message


if __name__ == "__main__":
    shuttle = Shuttle()
    if "AMENT_PREFIX_PATH" in os.environ:
        import rclpy

        rclpy.init()
        node = rclpy.create_node("shuttle_plant")
        out = node.create_publisher(Odometry, "/odom", 1)
        node.create_subscription(Twist, "/cmd_vel", shuttle.obey, 1)
        say = lambda: out.publish(shuttle.odometry(node.get_clock().now().to_msg()))  # noqa: E731
        node.create_timer(0.02, say)
        rclpy.spin(node)
    else:
        import rospy

        rospy.init_node("shuttle_plant")
        out = rospy.Publisher("/odom", Odometry, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("/cmd_vel", Twist, shuttle.obey, queue_size=1, tcp_nodelay=True)
        rate = rospy.Rate(50)
        while not rospy.is_shutdown():
            out.publish(shuttle.odometry(rospy.Time.now()))
            rate.sleep()
