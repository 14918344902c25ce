"""`soter build --target ros1`: what is written, and what is refused before anything is.

Non-goals: nodes that run (`tests/correct/test_ros_nodes.py`).
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "ros"
POSITION = {
    "channel": "/odom",
    "type": "nav_msgs/Odometry",
    "frame_id": "odom",
    "fields": {"value": "pose.pose.position.x"},
}
WISH = {"channel": "/wish", "type": "std_msgs/Float64", "fields": {"value": "data"}}
SPEED = {"channel": "/cmd_vel", "type": "geometry_msgs/Twist", "fields": {"value": "linear.x"}}
ALL = {"position": POSITION, "wish": WISH, "speed": SPEED}
SHUTTLE = ("shuttle_ros.soter", "--system", "Vehicle", "--target", "ros1", "-o", "out")


@pytest.fixture
def shuttle(here: Path) -> Path:
    for name in ("shuttle_ros.soter", "shuttle_ros.toml"):
        shutil.copy(EXAMPLES / name, here / name)
    return here


def built(soter: Soter, folder: Path, topics: dict[str, Any], **more: Any) -> Any:
    (folder / "map.json").write_text(json.dumps({"topics": topics, **more}))
    return soter("build", *SHUTTLE, "--map", "map.json", "--json")


def test_a_package_has_what_catkin_wants_and_the_trusted_part_knows_no_ros(
    soter: Soter, shuttle: Path
) -> None:
    done = soter("build", *SHUTTLE, "--map", "shuttle_ros.toml", "--json")
    assert done.exit == 0, done.out
    assert done.document["target"] == "ros1"
    package = ET.parse(shuttle / "out" / "package.xml").getroot()  # noqa: S314 - our own
    depends = {x.text for x in package.iter("depend")}
    assert {"roscpp", "nav_msgs", "geometry_msgs", "std_msgs", "diagnostic_msgs"} <= depends
    for file in (shuttle / "out" / "launch").iterdir():
        ET.parse(file)  # noqa: S314 - the same
    trusted = list((shuttle / "out" / "trusted").rglob("*.[ch]"))
    assert len(trusted) > 20
    assert not [p for p in trusted if "ros::" in p.read_text() or "ros/ros.h" in p.read_text()]
    assert (shuttle / "out" / "scripts" / "in_channels").exists()
    stand_ins = json.loads((shuttle / "out" / "test" / "stand_ins.json").read_text())
    (odometry,) = stand_ins["stand_ins"]  # the wish is AC's, and stays silent
    assert odometry["fields"] == {"pose.pose.position.x": 6.25, "header.frame_id": "odom"}
    (law,) = stand_ins["laws"]
    assert (law["topic"], law["fields"]) == ("/cmd_vel", {"linear.x": 0.0})
    ET.parse(shuttle / "out" / "test" / "shuttle_ros.test")  # noqa: S314 - the same
    compile((shuttle / "out" / "test" / "standing_by.py").read_text(), "standing_by.py", "exec")


def test_what_the_mapping_leaves_out_is_said(soter: Soter, shuttle: Path) -> None:
    done = built(soter, shuttle, {"position": POSITION, "wish": WISH})
    assert done.exit == 0
    assert any("not published in ROS" in n and "speed" in n for n in done.document["notes"])


def test_the_test_of_a_package_stands_in_for_every_source(soter: Soter, shuttle: Path) -> None:
    source = {**POSITION, "every": "10ms", "measured": {"value": 0.05}}
    camera = {**source, "channel": "/camera", "frame_id": "camera", "after": "10ms"}
    topics = {**ALL, "position": {"sources": [source, camera]}}
    assert built(soter, shuttle, topics).exit == 0
    stand_ins = json.loads((shuttle / "out" / "test" / "stand_ins.json").read_text())["stand_ins"]
    assert [(x["topic"], x["fields"]["header.frame_id"]) for x in stand_ins] == [
        ("/odom", "odom"), ("/camera", "camera"),
    ]  # fmt: skip


def test_two_sources_that_ros_calls_one_topic_are_refused(soter: Soter, shuttle: Path) -> None:
    source = {**POSITION, "every": "10ms", "measured": {"value": 0.05}}
    again = {**source, "channel": "odom", "after": "10ms"}
    done = built(soter, shuttle, {**ALL, "position": {"sources": [source, again]}})
    assert done.exit == 1
    (message,) = [d["message"] for d in done.document["diagnostics"]]
    assert message == "two `sources` of `position` are one topic: `odom`"


def test_a_scale_is_taken_back_and_a_named_sensor_has_its_name(soter: Soter, shuttle: Path) -> None:
    topics = changed(
        "position",
        publisher="/ekf",
        fields={"value": {"from": "pose.pose.position.x", "scale": -0.5, "offset": 1.0}},
    )
    assert built(soter, shuttle, topics).exit == 0
    stand_ins = json.loads((shuttle / "out" / "test" / "stand_ins.json").read_text())
    assert stand_ins["stand_ins"][0]["fields"]["pose.pose.position.x"] == (6.25 - 1.0) / -0.5
    test = ET.parse(shuttle / "out" / "test" / "shuttle_ros.test").getroot()  # noqa: S314 - our own
    assert [x.attrib["name"] for x in test.iter("test")] == ["ekf"]


def test_where_no_test_can_be_written_the_build_says_why(soter: Soter, shuttle: Path) -> None:
    source = {**POSITION, "every": "10ms", "measured": {"value": 0.05}, "publisher": "/ekf"}
    again = {**source, "channel": "/slam", "after": "10ms", "publisher": "/slam"}
    done = built(soter, shuttle, {**ALL, "position": {"sources": [source, again]}})
    assert done.exit == 0
    assert not (shuttle / "out" / "test").exists()
    assert "there is no `test/`: one node stands in for the sensors" in str(done.document["notes"])
    assert "`ekf`, `slam`" in str(done.document["notes"])


@pytest.mark.parametrize("target", ["ros1", "ros2"])
def test_a_system_with_its_plants_has_the_simulation_alone(
    soter: Soter, shuttle: Path, target: str
) -> None:
    (shuttle / "map.json").write_text(json.dumps({"topics": {"position": POSITION}}))
    words = ["shuttle_ros.soter", "--system", "Track", "--target", target, "-o", "out"]
    assert soter("build", *words, "--map", "map.json", "--json").exit == 0
    names = {p.name for p in (shuttle / "out" / "src").iterdir()}
    assert "shuttle_ros_simulation.cpp" in names
    assert "shuttle_ros_bridge.cpp" not in names
    assert not (shuttle / "out" / "trusted").exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--target", "ros1"), "U001"),
        (("--target", "c", "--map", "shuttle_ros.toml"), "U001"),
        (("--target", "posix", "--map", "shuttle_ros.toml"), "U001"),
        (("--target", "ros1", "--map", "none.toml"), "D015"),
        (("--target", "ros1", "--map", "shuttle_ros.soter"), "D015"),
    ],
)
def test_a_mapping_is_where_it_is_needed_and_nowhere_else(
    soter: Soter, shuttle: Path, words: tuple[str, ...], code: str
) -> None:
    done = soter("build", "shuttle_ros.soter", "--system", "Vehicle", "-o", "out", *words, "--json")
    assert done.codes == [code]
    assert not (shuttle / "out").exists()


@pytest.mark.parametrize("target", ["dds", "mavlink"])
def test_a_system_with_its_plants_is_refused_alike_where_there_is_only_a_bridge(
    soter: Soter, shuttle: Path, target: str
) -> None:
    (shuttle / "map.json").write_text(json.dumps({"topics": {"position": POSITION}}))
    words = ["shuttle_ros.soter", "--system", "Track", "--target", target, "-o", "out"]
    done = soter("build", *words, "--map", "map.json", "--json")
    assert (done.exit, done.codes) == (2, ["U001"])
    (problem,) = done.document["diagnostics"]
    assert problem["message"] == (
        "`Track` meets no world: with its plants inside there is nothing to bridge"
    )
    assert not (shuttle / "out").exists()


def changed(topic: str, **entries: Any) -> dict[str, Any]:
    """The mapping with other entries of a topic; None takes one away."""
    entry = {**ALL[topic], **entries}
    return {**ALL, topic: {k: v for k, v in entry.items() if v is not None}}


@pytest.mark.parametrize(
    ("topics", "said"),
    [
        ({"position": POSITION, "speed": SPEED}, "`wish` comes from the world"),
        (changed("position", channel=None), "has no `channel`"),
        (changed("position", type=None), "has no `type`"),
        (changed("position", type="nav_msgs/Odometri"), "Odometri"),
        (changed("position", type="String"), "String"),
        (changed("position", channel="/odom one"), "no name of a topic of ROS"),
        (changed("position", channel='/odom"; x'), "no name of a topic of ROS"),
        (changed("position", channel="//odom"), "no name of a topic of ROS"),
        (changed("position", fields={"value": "pose.position.x"}), "position"),
        (changed("position", fields={"value": "pose.pose.position"}), "position"),
        (changed("position", fields={"value": "child_frame_id"}), "child_frame_id"),
        (changed("position", fields={"value": "twist.twist.linear.x"}), "m/s"),
        (changed("position", fields={"value": {"from": "pose.pose.position.x", "unit": "cm"}}), ""),
        (changed("position", fields={"value": {"slope": "value", "window": "1s"}}), "slope"),
        (changed("position", fields={"value": "pose.covariance.36"}), "36"),
        (changed("position", fields={}), "missing"),
        (changed("position", stamp="pose.pose"), "pose"),
        (
            changed(
                "position",
                type="tf2_msgs/TFMessage",
                stamp="transforms.0.header.stamp",
                frame_id=None,
                fields={"value": "transforms.0.transform.translation.x"},
            ),
            "in a list, which may be empty",
        ),
        (changed("position", stamp={"from": "pose.pose.position.x"}), "there are s"),
        (changed("wish", frame_id="odom"), "header"),
        (changed("position", frame="NED"), "turns nothing"),
        (changed("position", frame="UP"), "UP"),
        (changed("speed", fields={"value": {"from": "linear.x", "scale": 0}}), "`scale`"),
        (changed("speed", set={"linear.x": 1.0}), "linear.x"),
        (changed("speed", set={"linear.q": 1.0}), "linear"),
        (changed("speed", set={"linear.y": "fast"}), "linear.y"),
        ({**ALL, "ghost": WISH}, "ghost"),
        (changed("wish", channel="/odom"), "with messages of two types"),
        (changed("wish", channel="/cmd_vel"), "with messages of two types"),
        (
            changed("wish", channel="/cmd_vel", type=SPEED["type"], fields=SPEED["fields"]),
            "one of them goes out",
        ),
        (
            changed("wish", channel="cmd_vel", type=SPEED["type"], fields=SPEED["fields"]),
            "one of them goes out",
        ),
        (changed("position", channel="~odom"), "no name of a topic of ROS"),
        (changed("position", set={"header.frame_id": "odom"}), "`set` is of what goes out"),
        (changed("speed", publisher="/base"), "`publisher` is who sends what comes in"),
        (
            changed(
                "speed",
                type="geometry_msgs/TwistStamped",
                frame_id="base",
                fields={"value": "twist.linear.x"},
            ),
            "`frame_id` is said in `set`",
        ),
        ({**ALL, "wish": "x"}, "no table"),
    ],
)
def test_a_mapping_that_does_not_fit_is_d015_before_anything_is_written(
    soter: Soter, shuttle: Path, topics: Any, said: str
) -> None:
    done = built(soter, shuttle, topics)
    assert done.exit == 1
    assert set(done.codes) == {"D015"}, done.codes
    assert said in " ".join(d["message"] for d in done.document["diagnostics"])
    assert not (shuttle / "out").exists()


def test_two_parts_of_a_command_do_not_go_out_in_one_field(soter: Soter, here: Path) -> None:
    """The second would overwrite the first, and nobody would obey that."""
    for name in ("ground_robot.soter", "ground_robot.toml"):
        shutil.copy(EXAMPLES / name, here / name)
    mapping = here / "ground_robot.toml"
    head, drive, _ = mapping.read_text().partition("[topics.drive]")
    mapping.write_text(
        f'{head}{drive}\nchannel = "/cmd_vel"\ntype = "std_msgs/ColorRGBA"\n'
        'fields = { v = "r", w = "r" }\n'
    )
    words = ["ground_robot.soter", "--system", "Vehicle", "--target", "ros1", "-o", "out"]
    done = soter("build", *words, "--map", mapping.name, "--json")
    assert (done.exit, {*done.codes}) == (1, {"D015"})
    said = [d["message"] for d in done.document["diagnostics"]]
    assert said == ["`drive.v` and `drive.w` go out in the same field, `r`"]


def test_a_type_that_ros_1_does_not_have_is_refused(soter: Soter, shuttle: Path) -> None:
    topics = changed("wish", type="rcl_interfaces/Log", fields={"value": "level"})
    done = built(soter, shuttle, topics)
    assert (done.exit, done.codes) == (1, ["D015"])
