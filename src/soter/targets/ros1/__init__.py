"""Target `ros1`: a catkin package around a program in real time.

`ros1_package` puts it together: the trusted part and the actuators are those of target `posix` and
know nothing of ROS; `node_sources` the roscpp node between topics of ROS and their channels, and
the node that steps the same program under /clock; `catkin_files` what catkin,
roslaunch and rostest want. What the nodes have in common is C++ that ships: `runtime/ros1/`.
"""
