"""The bridge for ROS 2 against the interfaces that rosidl generates, where no rclcpp is: a stub.

Needs Debian's rosidl (`rosidl-tools`, `rosidl-generator-c-cpp`, `librosidl-runtime-c-cpp-dev`,
`python3-ament-index`) and says so where it is not. Non-goals: nodes that run (`test_ros_nodes.py`).
"""

from __future__ import annotations

import ast
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

import processes
from soter.api import load
from soter.mapping.message_types import MessageTypes

if TYPE_CHECKING:
    from soter.mapping.message_types import MessageType

HERE = Path(__file__).resolve().parents[1]
EXAMPLE = HERE.parent / "examples" / "ros" / "shuttle_ros.soter"
STUB = HERE / "generators" / "rclcpp_stub.hpp"
RUNTIME = Path("/usr/include")
NEEDED = (
    shutil.which("rosidl"),
    shutil.which("g++"),
    (RUNTIME / "rosidl_runtime_cpp").exists() or None,
)
BASE, NAMED, ARRAY, SEQUENCE = 1, 2, 3, 4
MAPPING = {
    "topics": {
        "position": {
            "channel": "/odom", "type": "nav_msgs/msg/Odometry", "frame_id": "odom",
            "fields": {"value": {"from": "pose.pose.position.x", "unit": "m", "scale": 2.0}},
        },
        "wish": {
            "channel": "/scan", "type": "sensor_msgs/LaserScan", "stamp": "arrival",
            "fields": {"value": {"from": "intensities.3", "unit": "m/s"}},
        },
        "speed": {
            "channel": "/cmd_vel", "type": "geometry_msgs/TwistStamped",
            "fields": {"value": "twist.linear.x"}, "set": {"header.frame_id": "base_link"},
        },
    }
}  # fmt: skip

pytestmark = pytest.mark.skipif(
    None in NEEDED, reason="rosidl of ROS 2 (Debian: rosidl-tools and its generator) is not here"
)


def write_definitions(name: str, types: MessageType, folder: Path, done: set[str]) -> None:
    """`package/msg/Name.msg` of a type and all that it has."""
    if name in done:
        return
    done.add(name)
    lines = []
    for field, kind in types.definitions[2][name][1]:
        lines.append(f"{written(kind, types, folder, done)} {field}")
    package, _, short = name.partition("/msg/")
    path = folder / package / "msg" / f"{short}.msg"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def written(kind: Any, types: MessageType, folder: Path, done: set[str]) -> str:
    if kind[0] == BASE:
        return {"octet": "byte"}.get(kind[1][0], str(kind[1][0]))
    if kind[0] == NAMED:
        write_definitions(kind[1], types, folder, done)
        return str(kind[1]).replace("/msg/", "/")
    element, size = kind[1]
    return f"{written(element, types, folder, done)}[{size if kind[0] == ARRAY else ''}]"


@pytest.fixture(scope="module")
def interfaces(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The headers that rosidl makes of what the mapping and the bridge use."""
    folder = tmp_path_factory.mktemp("interfaces")
    types, done = MessageTypes(), set[str]()
    wanted = [t["type"] for t in MAPPING["topics"].values()]
    used = ["diagnostic_msgs/DiagnosticArray", "builtin_interfaces/Time", "rosgraph_msgs/Clock"]
    for name in [*wanted, *used, "std_msgs/String"]:
        message = types.type_named(str(name))
        write_definitions(message.ros2, message, folder / "msg", done)
    for package in sorted(p.name for p in (folder / "msg").iterdir()):
        files = sorted(f"msg/{p.name}" for p in (folder / "msg" / package / "msg").iterdir())
        out = folder / "include" / package / package
        command: list[str | Path] = ["rosidl", "generate", "-o", out, "-t", "cpp"]
        command += ["-I", folder / "msg", package]
        done_ = processes.run(
            [*command, *files], cwd=folder / "msg" / package, capture_output=True, text=True,
            env={"PATH": "/usr/bin:/bin"},
        )  # fmt: skip
        assert done_.returncode == 0, done_.stderr
    return folder / "include"


def checked(
    package: Path, interfaces: Path, stub: Path, node: str = "bridge", part: str = "trusted"
) -> processes.Done:
    """A node of a package as the compiler sees it, over the headers of `part`."""
    includes = [f"-I{p}" for p in interfaces.iterdir()]
    includes += [f"-I{p}" for p in RUNTIME.glob("rosidl_*")]
    words = ["g++", "-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror"]
    words += [f"-I{package / part}", f"-I{package / 'src'}", f"-I{stub}", *includes]
    (source,) = (package / "src").glob(f"*_{node}.cpp")
    return processes.run([*words, source], capture_output=True, text=True)


@pytest.fixture(scope="module")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stub")
    (folder / "rclcpp").mkdir()
    shutil.copy(STUB, folder / "rclcpp" / "rclcpp.hpp")
    for name in ("serialization", "serialized_message"):
        (folder / "rclcpp" / f"{name}.hpp").write_text('#include "rclcpp.hpp"\n')
    return folder


def test_the_bridge_fits_the_interfaces(interfaces: Path, stub: Path, tmp_path: Path) -> None:
    load(EXAMPLE).build("ros2", tmp_path / "out", "Vehicle", mapping=MAPPING)
    done = checked(tmp_path / "out", interfaces, stub)
    assert done.returncode == 0, done.stderr[-3000:]
    for path in (tmp_path / "out").rglob("*.py"):
        ast.parse(path.read_text())


def test_the_bridge_with_two_sources_of_a_topic_fits_them(
    interfaces: Path, stub: Path, tmp_path: Path
) -> None:
    source = {**MAPPING["topics"]["position"], "measured": {"value": 0.05}, "every": "10ms"}
    other = {**source, "channel": "/camera/odom", "after": "10ms"}
    topics = {**MAPPING["topics"], "position": {"sources": [source, other]}}
    load(EXAMPLE).build("ros2", tmp_path / "out", "Vehicle", mapping={"topics": topics})
    assert (tmp_path / "out" / "src" / "soter_sources.hpp").exists()
    done = checked(tmp_path / "out", interfaces, stub)
    assert done.returncode == 0, done.stderr[-3000:]
    (traits,) = (tmp_path / "out" / "src").glob("*_topics.hpp")
    traits.write_text(traits.read_text().replace("size_t rank()", "size_t number()"))
    assert "rank" in checked(tmp_path / "out", interfaces, stub).stderr


def test_a_field_that_the_interface_does_not_have_is_seen(
    interfaces: Path, stub: Path, tmp_path: Path
) -> None:
    load(EXAMPLE).build("ros2", tmp_path / "out", "Vehicle", mapping=MAPPING)
    (topics,) = (tmp_path / "out" / "src").glob("*_topics.hpp")
    topics.write_text(topics.read_text().replace("pose.pose.position.x", "pose.position.x"))
    assert "position" in checked(tmp_path / "out", interfaces, stub).stderr


@pytest.mark.parametrize("system", ["Vehicle", "Track"])
def test_the_node_under_clock_fits_the_interfaces(
    interfaces: Path, stub: Path, tmp_path: Path, system: str
) -> None:
    topics = MAPPING["topics"]
    given = topics if system == "Vehicle" else {"position": topics["position"]}
    load(EXAMPLE).build("ros2", tmp_path / "out", system, mapping={"topics": given})
    done = checked(tmp_path / "out", interfaces, stub, "simulation", "simulated")
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / "out" / "src" / "shuttle_ros_bridge.cpp").exists() == (system == "Vehicle")
    assert (tmp_path / "out" / "trusted").exists() == (system == "Vehicle")
    (launch,) = (tmp_path / "out" / "launch").glob("*_simulation.launch.py")
    assert '"use_sim_time": True' in launch.read_text()
    for path in (tmp_path / "out").rglob("*.py"):
        ast.parse(path.read_text())


def test_what_rclcpp_does_not_have_is_seen_in_the_node_under_clock(
    interfaces: Path, stub: Path, tmp_path: Path
) -> None:
    load(EXAMPLE).build("ros2", tmp_path / "out", "Vehicle", mapping=MAPPING)
    path = tmp_path / "out" / "src" / "soter_simulation.hpp"
    path.write_text(path.read_text().replace("QoS(1000).best_effort()", "QoS(1000).best_efforts()"))
    done = checked(tmp_path / "out", interfaces, stub, "simulation", "simulated")
    assert "best_efforts" in done.stderr
