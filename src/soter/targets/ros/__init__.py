"""Targets `ros1` and `ros2`: a package of ROS around a program in real time.

`ros_packages.py` puts them together: the trusted part and the actuators are those of target `posix`
and know nothing of ROS. `node_sources.py` is the C++ that is generated: the bridge between topics
of ROS and their channels, and the node that steps the same program under /clock, with the message
for machines; `ros_packages.py` is what the build systems and launch files want, `ros_packages.py`
the test of a catkin package. The texts are templates: here, and in `catkin/` and `ament/`. What the
nodes have in common is C++ that ships: `runtime/bridge/`, `runtime/ros1/`, `runtime/ros2/`.
"""
