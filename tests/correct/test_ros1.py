"""The nodes of a ROS 1 package, built with roscpp and run beside a master of their own.

Needs Debian's ROS 1 (`libroscpp-dev`, `python3-rosmaster`, cmake) and says so where it is not.
Non-goals: how quickly they are (`bench/ros/`); conversions (`tests/unit/targets/`).
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros import ros1_bad_input
from bench.ros.ros1_nodes import ROOT, SYSTEM_PYTHON, missing, nodes

import processes
import soter
from generators.ros1_packages import built_node, built_package
from long_tests import some

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(bool(missing()), reason=f"ROS 1 is not here: {missing()}")


PROGRAMS: dict[str, tuple[str, str, str, str, dict[str, str], str]] = {
    "cart": (
        *("examples/wall/cart.soter", "Protected", "motion", "nav_msgs/Odometry"),
        {"x": "pose.pose.position.x", "v": "twist.twist.linear.x"},
        "2.0",
    ),
    "mountain car": (
        *("examples/mountain_car/cliff.soter", "Protected", "car", "geometry_msgs/Point"),
        {"x": "x", "v": "y"},
        "20.0",
    ),
    "drone": (
        *("examples/drone/motion_primitive.soter", "Protected", "control"),
        *("geometry_msgs/Vector3", {"x": "x", "y": "y", "z": "z"}, "2.0"),
    ),
}
"""Program, system, a topic that goes out, its messages and fields, step of /clock in ms."""
HASH = re.compile(r"trace_sha256 ([0-9a-f]{64})")


def run_hash(path: Path, system: str) -> str:
    """Of `soter run`."""
    return str(soter.load(path).simulate(system, trace=False).trace_sha256)


def under_clock(build: Path, name: str, clock: Path, *words: str) -> str:
    """What the node says at its end."""
    with nodes() as all_:
        node = all_.start("simulation", build / f"{name}_simulation")
        all_.start("clock", clock, *words)
        node.wait(600)
        told = HASH.search("".join(all_.heard["simulation"]))
        return told[1] if told else "no hash: " + "".join(all_.heard["simulation"])[-200:]


@pytest.fixture(scope="module")
def clock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_node("ros1_clock", tmp_path_factory.mktemp("clock"))


@pytest.mark.parametrize("back", [(), ("3.0",)], ids=["forth", "back once"])
@pytest.mark.parametrize("name", some(PROGRAMS, 1))
def test_under_clock_the_trace_is_that_of_soter_run(
    clock: Path, tmp_path: Path, name: str, back: tuple[str, ...]
) -> None:
    path, system, topic, kind, fields, step = PROGRAMS[name]
    entry = {"channel": f"/{topic}", "type": kind, "fields": fields}
    (tmp_path / "map.json").write_text(json.dumps({"topics": {topic: entry}}))
    build = built_package(ROOT / path, system, tmp_path / "map.json", tmp_path / "package")
    told = under_clock(build, (ROOT / path).stem, clock, step, *back)
    assert told == run_hash(ROOT / path, system)


@pytest.fixture(scope="module")
def shuttle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mapping = ros1_bad_input.EXAMPLE.with_suffix(".toml")
    folder = tmp_path_factory.mktemp("stack") / "package"
    return built_package(ros1_bad_input.EXAMPLE, "Vehicle", mapping, folder)


@pytest.fixture(scope="module")
def stack(shuttle: Path) -> Iterator[Any]:
    with nodes() as all_:
        yield lambda case: ros1_bad_input.one(all_, shuttle, case)


@pytest.mark.parametrize("given", ["1e-2", "true", ".nan"])
def test_a_clock_error_that_is_no_number_ends_the_bridge(
    tmp_path: Path, shuttle: Path, given: str
) -> None:
    """YAML reads 1e-2 as a text: with 0 in its place messages would count as too new."""
    (tmp_path / "parameters.yaml").write_text(f"clock_error: {given}\n")
    load = ("/usr/bin/rosparam", "load", tmp_path / "parameters.yaml", "/shuttle_ros_bridge")
    with nodes() as all_:
        assert all_.start("load", SYSTEM_PYTHON, *load).wait(60) == 0
        bridge = all_.start("bridge", shuttle / "shuttle_ros_bridge", f"_channels:={tmp_path}")
        assert bridge.wait(60) == 1
        all_.end("bridge")
        assert "clock_error is no time" in "".join(all_.heard["bridge"])


LATCHED = """
import sys, time, rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
rospy.init_node(sys.argv[2])
clock = rospy.Publisher("/clock", Clock, queue_size=100)
wish = rospy.Publisher("/wish", Float64, queue_size=100, latch=sys.argv[1] == "latched")
while not clock.get_num_connections() or not wish.get_num_connections():
    time.sleep(0.01)
for second in range(100, 10**6):
    clock.publish(Clock(rospy.Time(second)))
    time.sleep(0.05)
    wish.publish(1.0)
"""


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("latched", "a latched message has no stamp: nobody knows how old it is"),
        ("plain", "a second node publishes it"),
    ],
)
def test_under_clock_what_is_latched_and_has_no_stamp_is_refused(
    shuttle: Path, how: str, why: str
) -> None:
    """Two that do not latch are told apart, so the first of them was heard."""
    with nodes() as all_:
        program = shuttle / "shuttle_ros_simulation"
        simulation = all_.start("simulation", program, "_until:=1000000")
        for name in ("one", "other"):
            all_.start(name, SYSTEM_PYTHON, "-c", LATCHED, how, name)
        processes.until(lambda: "/wish: " in "".join(all_.heard["simulation"]), simulation)
        assert f"/wish: {why}" in "".join(all_.heard["simulation"])


@pytest.mark.real_time
@pytest.mark.parametrize("case", list(ros1_bad_input.CASES))
def test_what_is_wrong_on_the_wire_commands_nothing(stack: Any, case: str) -> None:
    commands, told = stack(case)
    assert {*commands} <= ros1_bad_input.RIGHT
    assert told["ended", ""] == ""
    name, key = ros1_bad_input.CASES[case]
    assert (told["of roscpp", "log"] if not key else told[name, key]) not in ("", "0")
