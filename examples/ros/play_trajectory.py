"""Plays trajectories of ROS 2: each point becomes a message of its own, at its time.

    python3 play_trajectory.py JOINT...          in a shell that has sourced ROS 2

Purpose: hears trajectory_msgs/JointTrajectory on /joint_trajectory, and publishes the velocities of
each point as sensor_msgs/JointState on /wish, in the order of JOINT, stamped with the point's time.
The bridge reads these as any wish, and the robot judges each as it takes effect. The next
trajectory replaces what is left of the one before, one without points ends it, and after the last
point is silence. Times count from the stamp of the header; without one, from the arrival.
Non-goals: values between points; tolerances; the answers of an action server.
"""

from __future__ import annotations

import sys
import time
from typing import Any

SECOND_NS = 10**9
TICK_S = 0.002


def ns(t: Any) -> int:  # noqa: ANN401 - of builtin_interfaces
    """A time, or a duration, of ROS in ns."""
    return int(t.sec) * SECOND_NS + int(t.nanosec)


Points = list[tuple[int, list[float]]]


def points_of(message: Any, joints: list[str], now_ns: int) -> Points:  # noqa: ANN401
    """The time of each point in ns, and the velocities of the joints.

    ValueError where the trajectory has other joints, a point without a velocity for each of them,
    or points that do not follow each other in time.
    """
    names = list(message.joint_names)
    if sorted(names) != sorted(joints):
        raise ValueError(f"its joints are {', '.join(names)}")
    if any(len(p.velocities) != len(names) for p in message.points):
        raise ValueError("a point has no velocity for each joint")
    begin_ns = ns(message.header.stamp) or now_ns
    times = [begin_ns + ns(p.time_from_start) for p in message.points]
    if times != sorted(set(times)):
        raise ValueError("its points do not follow each other in time")
    places = [names.index(j) for j in joints]
    rows = [[float(p.velocities[i]) for i in places] for p in message.points]
    return list(zip(times, rows, strict=True))


def due(left: Points, now_ns: int) -> tuple[Points, Points]:
    """The points whose time has come, and the others."""
    count = sum(at <= now_ns for at, _ in left)
    return left[:count], left[count:]


def main() -> None:
    """Until it is ended."""
    import rclpy  # noqa: PLC0415 - what stands above needs no ROS
    from builtin_interfaces.msg import Time  # noqa: PLC0415 - as above
    from rclpy.executors import ExternalShutdownException  # noqa: PLC0415 - as above
    from sensor_msgs.msg import JointState  # noqa: PLC0415 - as above
    from trajectory_msgs.msg import JointTrajectory  # noqa: PLC0415 - as above

    joints = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("play_trajectory")
    wishes = node.create_publisher(JointState, "/wish", 1)
    left: Points = []

    def begin(message: JointTrajectory) -> None:
        nonlocal left
        try:
            left = points_of(message, joints, time.time_ns())
        except ValueError as error:
            node.get_logger().warning(f"a trajectory is not played: {error}")

    def play() -> None:
        nonlocal left
        now, left = due(left, time.time_ns())
        for at_ns, velocities in now[-1:]:  # those before it are over
            message = JointState(name=joints, velocity=velocities)
            message.header.stamp = Time(sec=at_ns // SECOND_NS, nanosec=at_ns % SECOND_NS)
            wishes.publish(message)

    node.create_subscription(JointTrajectory, "/joint_trajectory", begin, 1)
    node.create_timer(TICK_S, play)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main()
