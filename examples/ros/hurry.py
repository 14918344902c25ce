"""An advanced controller for shuttle_ros.soter: hurries to the right, and does not stop there.

    python3 hurry.py          in a shell that has sourced ROS 2, or else of ROS 1

Non-goals: walls.
"""

from __future__ import annotations

import os

from std_msgs.msg import Float64

if __name__ == "__main__":
    if "AMENT_PREFIX_PATH" in os.environ:
        import rclpy

        rclpy.init()
        node = rclpy.create_node("hurry")
        wish = node.create_publisher(Float64, "/wish", 1)
        node.create_timer(0.02, lambda: wish.publish(Float64(data=1.0)))
        rclpy.spin(node)
    else:
        import rospy

        rospy.init_node("hurry")
        wish = rospy.Publisher("/wish", Float64, queue_size=1, tcp_nodelay=True)
        rate = rospy.Rate(50)
        while not rospy.is_shutdown():
            wish.publish(1.0)
            rate.sleep()
