"""Trajectories of ROS 2, a point a wish: `examples/ros/play_trajectory.py`, and a bridge behind it.

The node needs a ROS 2 that is sourced, with trajectory_msgs, and says so where it is not.
Non-goals: how AC's module judges wishes (`test_arm_through_remote.py`), what else a bridge refuses
(`tests/correct/test_ros_nodes.py`).
"""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros import ros2_nodes as ros

import soter.remote
from generators.channel_programs import soon
from generators.ros_packages import built_package, here

ROOT = Path(__file__).resolve().parents[3]
PLAYER = ROOT / "examples" / "ros" / "play_trajectory.py"
JOINTS = ["shoulder", "elbow"]
SECOND_NS = 10**9
PROGRAM = """soter 1;
input topic wish: { shoulder: float, elbow: float };
node Wish period 20ms { subscribes wish; step {} }
system Robot { external topic wish; node Wish; }
"""
PUBLISHES = """
import rclpy
from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
rclpy.init()
node = rclpy.create_node("planner")
out = node.create_publisher(JointTrajectory, "/joint_trajectory", 1)
def point(k, *velocities):
    at = Duration(sec=k // 10, nanosec=k % 10 * 10**8)
    return JointTrajectoryPoint(velocities=velocities, time_from_start=at)
message = JointTrajectory(joint_names=["elbow", "shoulder"])
message.points = [point(k, 0.5, 0.001 * k) for k in range(1000)]
message.header.stamp = node.get_clock().now().to_msg()
timer = node.create_timer(0.25, lambda: out.publish(message))
rclpy.spin(node)
"""
HAS_MESSAGES = any(
    (Path(p) / "share" / "trajectory_msgs").exists()
    for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":")
)


@pytest.fixture(scope="module")
def player() -> ModuleType:
    spec = importlib.util.spec_from_file_location("play_trajectory", PLAYER)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def time_of(ms: int) -> SimpleNamespace:
    return SimpleNamespace(sec=ms // 1000, nanosec=ms % 1000 * 10**6)


def point(ms: int, *velocities: float) -> SimpleNamespace:
    return SimpleNamespace(velocities=velocities, time_from_start=time_of(ms))


def trajectory(
    *points: SimpleNamespace, joints: list[str] = JOINTS, stamp_ms: int = 0
) -> SimpleNamespace:
    header = SimpleNamespace(stamp=time_of(stamp_ms))
    return SimpleNamespace(joint_names=joints, points=points, header=header)


@pytest.mark.parametrize(("stamp_ms", "begin_ms"), [(0, 7000), (5200, 5200)])
def test_points_are_in_the_order_of_the_joints_and_count_from_the_stamp_or_the_arrival(
    player: ModuleType, stamp_ms: int, begin_ms: int
) -> None:
    points = (point(1100, 1.0, 2.0), point(1150, 3.0, 4.0))
    message = trajectory(*points, joints=["elbow", "shoulder"], stamp_ms=stamp_ms)
    assert player.points_of(message, JOINTS, 7 * SECOND_NS) == [
        ((begin_ms + 1100) * 10**6, [2.0, 1.0]),
        ((begin_ms + 1150) * 10**6, [4.0, 3.0]),
    ]


def test_a_point_is_due_once_and_not_before_its_time(player: ModuleType) -> None:
    points = [(10, [0.1]), (20, [0.2]), (30, [0.3])]
    assert player.due(points, 9) == ([], points)
    assert player.due(points, 20) == (points[:2], points[2:])
    assert player.due([], 20) == ([], [])


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (trajectory(joints=["elbow"]), "its joints are elbow"),
        (trajectory(point(0, 1.0)), "a point has no velocity for each joint"),
        (
            trajectory(point(20, 0.0, 0.0), point(20, 0.0, 0.0)),
            "its points do not follow each other in time",
        ),
        (
            trajectory(point(20, 0.0, 0.0), point(0, 0.0, 0.0)),
            "its points do not follow each other in time",
        ),
    ],
)
def test_a_trajectory_that_cannot_be_played_is_refused(
    player: ModuleType, message: Any, why: str
) -> None:
    with pytest.raises(ValueError, match=f"^{why}$"):
        player.points_of(message, JOINTS, 0)


@pytest.mark.real_time
@here(ros)
@pytest.mark.skipif(not HAS_MESSAGES, reason="trajectory_msgs of ROS 2 is not here")
def test_the_points_of_a_trajectory_reach_the_robot_through_its_bridge(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
    (mapping,) = re.findall(r"^```toml\n(\[topics\.wish\]\n[^`]*)```$", page, re.MULTILINE)
    (tmp_path / "robot.soter").write_text(PROGRAM)
    (tmp_path / "map.toml").write_text(mapping)
    channels = tmp_path / "channels"
    channels.mkdir()
    program = tmp_path / "robot.soter"
    built = built_package(ros, program, "Robot", tmp_path / "map.toml", tmp_path / "package")
    seen: dict[int, int] = {}
    with (
        ros.nodes() as all_,
        soter.remote.connect(program, system="Robot", channels=channels) as robot,
    ):
        all_.start("bridge", built / "robot_bridge", *ros.parameters(channels=channels))
        all_.start("player", ros.PYTHON, PLAYER, *JOINTS)
        all_.start("planner", ros.PYTHON, "-c", PUBLISHES)

        def played() -> bool:
            reading = robot.read("wish")
            if reading is not None:
                assert reading.value["elbow"] == 0.5
                seen[round(1000 * reading.value["shoulder"])] = reading.stamp
            return len(seen) > 5

        soon(played)
    starts = [stamp - k * SECOND_NS // 10 for k, stamp in seen.items()]
    assert max(starts) - min(starts) < SECOND_NS // 20, "measured when their time had come"
