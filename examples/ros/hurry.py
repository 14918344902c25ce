"""An advanced controller for shuttle_ros.soter: hurries to the right, and does not stop there.

    /usr/bin/python3 hurry.py

Non-goals: walls.
"""

from __future__ import annotations

import rospy
from std_msgs.msg import Float64

if __name__ == "__main__":
    rospy.init_node("hurry")
    wish = rospy.Publisher("/wish", Float64, queue_size=1, tcp_nodelay=True)
    rate = rospy.Rate(50)
    while not rospy.is_shutdown():
        wish.publish(1.0)
        rate.sleep()
