"""The nodes of a package for ROS 1, or 2, built with roscpp or rclcpp and run beside others.

Needs Debian's ROS 1 (`libroscpp-dev`, `python3-rosmaster`, cmake), or a ROS 2 that is sourced, and
says so where one is not.
Non-goals: how quickly they are (`bench/ros/`); conversions (`tests/unit/targets/`).
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros import bad_input, ros1_nodes

import processes
import soter
from generators.ros_packages import EITHER, built_node, built_package
from long_tests import some

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import ModuleType

ROOT = bad_input.ROOT


@pytest.fixture(scope="module", params=EITHER)
def ros(request: pytest.FixtureRequest) -> Any:
    return request.param


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


def under_clock(ros: ModuleType, build: Path, name: str, clock: Path, *words: str) -> str:
    """What the node says at its end."""
    with ros.nodes() as all_:
        node = all_.start("simulation", build / f"{name}_simulation")
        all_.start("clock", clock, *words)
        node.wait(600)
        told = HASH.search("".join(all_.heard["simulation"]))
        return told[1] if told else "no hash: " + "".join(all_.heard["simulation"])[-200:]


@pytest.fixture(scope="module")
def clock(ros: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_node(ros, "clock", tmp_path_factory.mktemp("clock"))


@pytest.mark.parametrize("back", [(), ("3.0",)], ids=["forth", "back once"])
@pytest.mark.parametrize("name", some(PROGRAMS, 1))
def test_under_clock_the_trace_is_that_of_soter_run(
    ros: ModuleType, clock: Path, tmp_path: Path, name: str, back: tuple[str, ...]
) -> None:
    path, system, topic, kind, fields, step = PROGRAMS[name]
    entry = {"channel": f"/{topic}", "type": kind, "fields": fields}
    (tmp_path / "map.json").write_text(json.dumps({"topics": {topic: entry}}))
    build = built_package(ros, ROOT / path, system, tmp_path / "map.json", tmp_path / "package")
    told = under_clock(ros, build, (ROOT / path).stem, clock, step, *back)
    assert told == run_hash(ROOT / path, system)


@pytest.fixture(scope="module")
def shuttle(ros: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    mapping = bad_input.EXAMPLE.with_suffix(".toml")
    folder = tmp_path_factory.mktemp("stack") / "package"
    return built_package(ros, bad_input.EXAMPLE, "Vehicle", mapping, folder)


@pytest.fixture(scope="module")
def stack(ros: ModuleType, shuttle: Path) -> Iterator[Any]:
    with ros.nodes() as all_:
        yield lambda case: bad_input.one(ros, all_, shuttle, case)


@pytest.mark.parametrize("given", ["1e-2", "true", ".nan"])
def test_a_clock_error_that_is_no_number_ends_the_bridge(
    ros: ModuleType, tmp_path: Path, shuttle: Path, given: str
) -> None:
    """ROS 1's YAML reads 1e-2 as a text: with 0 in its place messages would count as too new."""
    if (ros.VERSION, given) == (2, "1e-2"):
        given = "1.5"  # to ROS 2 1e-2 is a number
    file = tmp_path / "parameters.yaml"
    words = ros.parameters(channels=tmp_path)
    with ros.nodes() as all_:
        if ros is ros1_nodes:
            file.write_text(f"clock_error: {given}\n")
            load = ("/usr/bin/rosparam", "load", file, "/shuttle_ros_bridge")
            assert all_.start("load", ros.PYTHON, *load).wait(60) == 0
        else:
            file.write_text(f"/**:\n  ros__parameters:\n    clock_error: {given}\n")
            words += ["--params-file", str(file)]
        bridge = all_.start("bridge", shuttle / "shuttle_ros_bridge", *words)
        assert bridge.wait(60) == 1
        all_.end("bridge")
        assert "clock_error is no time" in "".join(all_.heard["bridge"])


LATCHED = """
import sys, time
from either_ros import NS, Node, stamp
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
node = Node(sys.argv[2])
clock = node.out("/clock", Clock, depth=100)
wish = node.out("/wish", Float64, depth=100, latched=sys.argv[1] == "latched")
while not clock.listeners() or not wish.listeners():
    time.sleep(0.01)
for second in range(100, 10**6):
    clock.publish(Clock(clock=stamp(second * NS)))
    time.sleep(0.05)
    wish.publish(Float64(data=1.0))
"""


UNDATED = "a latched message has no stamp: nobody knows how old it is"
SECOND = "a second node publishes it"
WHICH = "which node publishes it cannot be told"


@pytest.mark.parametrize(("how", "why"), [("latched", UNDATED), ("plain", SECOND)])
def test_under_clock_what_is_latched_and_has_no_stamp_is_refused(
    ros: ModuleType, shuttle: Path, how: str, why: str
) -> None:
    """Two that do not latch are told apart, so the first of them was heard.

    In ROS 2 nobody can tell whether a message is a latched one, and none of before is sent to who
    hears as this node does: there this is about two publishers alone.
    """
    with ros.nodes() as all_:
        program = shuttle / "shuttle_ros_simulation"
        simulation = all_.start("simulation", program, *ros.parameters(until="1000000.0"))
        for name in ("one", "other"):
            all_.start(name, ros.PYTHON, "-c", LATCHED, how, name)
        processes.until(lambda: "/wish: " in "".join(all_.heard["simulation"]), simulation)
        told = "".join(all_.heard["simulation"])
        assert f"/wish: {why}" in told or (ros.VERSION == 2 and (SECOND in told or WHICH in told))


@pytest.mark.real_time
@pytest.mark.parametrize("case", list(bad_input.CASES | bad_input.OF_ROS_2))
def test_what_is_wrong_on_the_wire_commands_nothing(ros: ModuleType, stack: Any, case: str) -> None:
    if case not in bad_input.cases(ros):
        return  # roscpp ends such a connection
    commands, told = stack(case)
    assert {*commands} <= bad_input.RIGHT
    assert told["ended", ""] == ""
    name, key = bad_input.cases(ros)[case]
    assert (told["of ROS", "log"] if not key else told[name, key]) not in ("", "0")
