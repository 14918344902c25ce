"""The shuttle of shuttle_ros.soter as a node: obeys /cmd_vel, says /odom 50 times a second.

    /usr/bin/python3 shuttle_plant.py

Non-goals: noise; being on time (the real shuttle is).
"""

from __future__ import annotations

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry


class Shuttle:
    """Where it is, m, and the speed that it was told last, m/s."""

    def __init__(self) -> None:
        self.x = 0.0
        self.speed = 0.0
        self.at = rospy.Time.now()
        self.odometry = rospy.Publisher("/odom", Odometry, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("/cmd_vel", Twist, self.obey, queue_size=1, tcp_nodelay=True)

    def move(self) -> rospy.Time:
        """Up to now."""
        now = rospy.Time.now()
        self.x += self.speed * (now - self.at).to_sec()
        self.at = now
        return now

    def obey(self, command: Twist) -> None:
        """A command: counts until another one comes."""
        self.move()
        self.speed = command.linear.x

    def say(self, _event: object) -> None:
        """Odometry."""
        message = Odometry()
        message.header.stamp = self.move()
        message.header.frame_id = "odom"
        message.pose.pose.position.x = self.x
        message.pose.pose.orientation.w = 1.0
        message.twist.twist.linear.x = self.speed
        self.odometry.publish(message)


if __name__ == "__main__":
    rospy.init_node("shuttle_plant")
    shuttle = Shuttle()
    timer = rospy.Timer(rospy.Duration(0.02), shuttle.say)
    rospy.spin()
