"""Target `dds`: what is written, by the conventions of ROS 2, and mappings that do not fit."""

from __future__ import annotations

import re
import shutil
from typing import TYPE_CHECKING, Any

import pytest

import processes
from generators.dds_machine import missing
from generators.dds_programs import PROGRAM, SEEN_FIELDS, mapping, package
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("rosbags", reason="the extra is absent: soter-rta[logs]")


def text(folder: Path, name: str) -> str:
    return (folder / "out" / name).read_text("utf-8")


def bridge(folder: Path, given: dict[str, Any], program: str = PROGRAM) -> str:
    package(folder, given, program)
    return text(folder, "src/robot_bridge.c")


def row(source: str, topic: str) -> str:
    """Of the table: what is said of a topic, up to its QoS."""
    found = re.search(rf'\{{"{topic}", .*?\}}', source, re.DOTALL)
    assert found is not None
    return found[0]


# ---------------------------------------------------------------- types


def test_a_type_is_named_and_nested_as_ros_2_does(tmp_path: Path) -> None:
    package(tmp_path, mapping())
    idl = text(tmp_path, "idl/robot_messages.idl")
    assert "module nav_msgs { module msg { module dds_ {\n@final struct Odometry_ {" in idl
    assert "  std_msgs::msg::dds_::Header_ header_;\n" in idl
    assert "  builtin_interfaces::msg::dds_::Time_ stamp_;\n  string frame_id_;\n" in idl
    assert "  int32 sec_;\n  uint32 nanosec_;\n" in idl
    assert "  double covariance_[36];\n" in idl
    assert "  sequence<float > ranges_;\n" in idl
    assert "  octet data_;\n" in idl


def test_a_type_stands_after_its_parts_and_once(tmp_path: Path) -> None:
    package(tmp_path, mapping())
    idl = text(tmp_path, "idl/robot_messages.idl")
    structs = re.findall(r"struct (\w+) ", idl)
    assert len(structs) == len(set(structs))
    assert structs.index("Time_") < structs.index("Header_") < structs.index("Odometry_")
    assert structs.index("Vector3_") < structs.index("Twist_") < structs.index("TwistStamped_")


def test_bounds_and_an_empty_message_are_those_of_the_wire(tmp_path: Path) -> None:
    own = "string<=5 name\nfloat32[<=3] few\nstring<=4[<=2] both\nstd_msgs/Empty none\nfloat64 x\n"
    (tmp_path / "Own.msg").write_text(own)
    given = mapping(near={"type": "own_msgs/Own", "fields": {"value": "x"}})
    given["messages"] = {"own_msgs/Own": str(tmp_path / "Own.msg")}
    package(tmp_path, given)
    idl = text(tmp_path, "idl/robot_messages.idl")
    assert "  string<5> name_;\n  sequence<float, 3> few_;\n" in idl
    assert "  sequence<string<4>, 2> both_;\n" in idl
    assert "  uint8 structure_needs_at_least_one_member_;\n" in idl


# ---------------------------------------------------------------- what is generated


def test_topics_are_named_as_ros_2_names_them_on_the_wire(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert '"rt/odom", &nav_msgs_msg_dds__Odometry__desc' in row(source, "seen")
    assert '"rt/cmd_vel", &geometry_msgs_msg_dds__TwistStamped__desc' in row(source, "push")
    assert 'system = {"robot_bridge", inward, 3, outward, 1, &trusted}' in source


def test_the_qos_of_what_comes_in_is_that_of_sensors_and_of_what_goes_out_the_default(
    tmp_path: Path,
) -> None:
    source = bridge(tmp_path, mapping())
    assert row(source, "seen").endswith("{false, false, 5}")
    assert row(source, "push").endswith("{true, false, 10}")


def test_the_mapping_says_another_qos(tmp_path: Path) -> None:
    asked = {"reliability": "reliable", "depth": "all", "durability": "transient_local"}
    source = bridge(
        tmp_path,
        mapping(seen={"qos": asked}, push={"qos": {"reliability": "best_effort", "depth": 1}}),
    )
    assert row(source, "seen").endswith("{true, true, 0}")
    assert row(source, "push").endswith("{false, false, 1}")


def test_a_number_is_scaled_and_then_shifted_and_goes_out_the_other_way(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert "(*to).x = 0.1 * (double)(*m).pose_.pose_.position_.x_ + 0.3;" in source
    assert "(*m).twist_.linear_.x_ = ((*from) / 2.0);" in source


def test_an_array_is_written_where_c_has_it(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert "(*to).cov.at[1] = (double)(*m).pose_.covariance_[35];" in source


def test_a_text_that_is_no_member_of_the_enum_refuses_the_sample(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert 'if (strcmp((*m).child_frame_id_, "base_link") == 0) {' in source
    assert re.search(r"\} else \{\n +return false;\n", source)


def test_an_element_that_is_not_there_refuses_the_sample(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert "if ((*m).ranges_._length <= 2U) {" in source
    assert "(*to) = (double)(*m).ranges_._buffer[2];" in source


def test_a_byte_of_ros_2_has_no_sign_so_that_200_is_not_taken_for_a_small_number(
    tmp_path: Path,
) -> None:
    assert "if ((uint64_t)(*m).data_ > UINT64_C(127)) {" in bridge(tmp_path, mapping())


def test_stamps_frames_and_publishers_are_those_of_the_mapping(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping(seen={"publisher": "localizer"}, near={"stamp": "arrival"}))
    assert 'return strcmp((*m).header_.frame_id_, "odom") == 0;' in source
    assert "soter_dds_stamp((*m).header_.stamp_.sec_, (*m).header_.stamp_.nanosec_)" in source
    assert '"localizer", true, INT64_C(0), seen_frame, seen_stamp, seen_convert}' in source
    assert '"", false, INT64_C(0), near_frame, near_stamp, near_convert}' in source


@pytest.mark.parametrize(("stamp", "delay_ns"), [("arrival", 7_000_000), ("header.stamp", 0)])
def test_a_message_that_counts_from_its_arrival_is_as_much_older_as_the_topic_is_delayed(
    tmp_path: Path, stamp: str, delay_ns: int
) -> None:
    program = PROGRAM.replace("topic near;", "topic near every 50ms delayed 7ms;")
    assert program != PROGRAM
    source = bridge(tmp_path, mapping(near={"stamp": stamp}), program)
    assert f"INT64_C({delay_ns}), near_frame" in source


def test_a_stamp_that_is_a_number_has_its_unit(tmp_path: Path) -> None:
    stamp = {"from": "scan_time", "unit": "ms"}
    source = bridge(tmp_path, mapping(near={"stamp": stamp}))
    assert "soter_ns_of_number((long double)(*m).scan_time_, 1000000, 1)" in source


def test_a_message_that_goes_out_has_its_stamp_and_its_constants(tmp_path: Path) -> None:
    source = bridge(tmp_path, mapping())
    assert '(*m).header_.frame_id_ = (char*)"base";' in source
    assert "(*m).header_.stamp_.sec_ = (int32_t)(stamp / 1000000000);" in source


def test_the_trusted_part_is_that_of_target_posix(tmp_path: Path) -> None:
    package(tmp_path, mapping())
    load(tmp_path / "robot.soter").build("posix", tmp_path / "posix", "Robot")
    plain = tmp_path / "posix"
    files = [p.relative_to(plain) for p in plain.rglob("*") if p.is_file()]
    kept = [p for p in files if p.name != ".soter-files.json"]
    assert len(kept) > 20
    for name in kept:
        assert (plain / name).read_bytes() == (tmp_path / "out/trusted" / name).read_bytes()


def test_a_second_build_writes_the_same(tmp_path: Path) -> None:
    package(tmp_path, mapping())
    files = {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}
    package(tmp_path, mapping())
    assert files == {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}


def test_flags_that_belong_to_the_meaning_come_last(tmp_path: Path) -> None:
    """CFLAGS are anybody's: `make CFLAGS=-Ofast` must not change what a conversion computes."""
    package(tmp_path, mapping())
    lines = (tmp_path / "out" / "Makefile").read_text().splitlines()
    compiles = [line for line in lines if "$(CC)" in line]
    assert compiles
    assert all(line.index("$(CFLAGS)") < line.index("$(FLAGS)") for line in compiles)


# ---------------------------------------------------------------- mappings that do not fit

ALSO_ODOMETRY = {"channel": "/odom", "type": "nav_msgs/Odometry"}
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "no channel": (mapping(seen={"channel": None}), "`seen` has no `channel`"),
    "no type": (mapping(seen={"type": None, "frame_id": None}), "`seen` has no `type`"),
    "a choice of a log": (mapping(seen={"where": {"id": "1"}}), "`where` of `seen` chooses rows"),
    "relative": (mapping(seen={"channel": "odom"}), "`odom` is no name of a topic of ROS 2"),
    "private": (mapping(seen={"channel": "~/odom"}), "is no name of a topic of ROS 2"),
    "a digit": (mapping(seen={"channel": "/a/1b"}), "is no name of a topic of ROS 2"),
    "a slash": (mapping(seen={"channel": "/odom/"}), "is no name of a topic of ROS 2"),
    "two underscores": (mapping(seen={"channel": "/a__b"}), "is no name of a topic of ROS 2"),
    "a quote": (mapping(seen={"channel": '/a"b'}), "is no name of a topic of ROS 2"),
    "too long": (mapping(seen={"channel": "/" + 300 * "a"}), "is longer than 240 bytes"),
    "two types on one": (mapping(near={"channel": "/odom"}), "with messages of two types"),
    "two topics on one": (
        mapping(near={**ALSO_ODOMETRY, "fields": {"value": "pose.pose.position.z"}}),
        "are both on `/odom`",
    ),
    "reliability": (
        mapping(seen={"qos": {"reliability": "exact"}}),
        "`reliability` in `qos` of `seen` is best_effort or reliable, not 'exact'",
    ),
    "durability": (
        mapping(seen={"qos": {"durability": "persistent"}}),
        "`durability` in `qos` of `seen` is volatile or transient_local, not 'persistent'",
    ),
    "depth 0": (mapping(seen={"qos": {"depth": 0}}), "`depth` in `qos` of `seen` is a number"),
    "depth true": (mapping(seen={"qos": {"depth": True}}), "`depth` in `qos` of `seen`"),
    "depth 1.5": (mapping(seen={"qos": {"depth": 1.5}}), "`depth` in `qos` of `seen`"),
    "another policy": (mapping(seen={"qos": {"deadline": "1s"}}), "says `deadline`"),
    "qos is a text": (mapping(seen={"qos": "reliable"}), "`qos` of `seen` is no table"),
    "old values": (
        mapping(near={"stamp": "arrival", "qos": {"durability": "transient_local"}}),
        "`near` has no stamp and is `transient_local`",
    ),
    "all of what goes out": (
        mapping(push={"qos": {"depth": "all"}}),
        "`push` goes out with all of its history",
    ),
    "slope": (
        mapping(seen={"fields": {**SEEN_FIELDS, "yaw": {"slope": "x", "window": "1s"}}}),
        "is a slope",
    ),
    "into a sequence": (
        mapping(
            push={
                "type": "sensor_msgs/LaserScan",
                "fields": {"value": "ranges.0"},
                "set": {},
            }
        ),
        "goes into an element of a sequence",
    ),
    "a type of ROS 1 only": (
        mapping(near={"type": "dynamic_reconfigure/DoubleParameter", "fields": {"value": "value"}}),
        "which ROS 2 does not know",
    ),
}


@all_rows("name", BAD)
def test_a_mapping_that_does_not_fit_is_refused_and_nothing_is_written(
    tmp_path: Path, name: str
) -> None:
    given, why = BAD[name]
    with pytest.raises(SoterError) as refused:
        package(tmp_path, given)
    assert {d.code for d in refused.value.diagnostics} == {"D015"}
    assert why in "\n".join(d.message for d in refused.value.diagnostics)
    assert not (tmp_path / "out").exists()


def test_what_comes_in_has_to_be_mapped(tmp_path: Path) -> None:
    given = mapping()
    del given["topics"]["near"]
    with pytest.raises(SoterError, match="comes from the world, and the mapping does not say how"):
        package(tmp_path, given)


def test_what_goes_out_and_is_not_mapped_is_told(tmp_path: Path) -> None:
    given = mapping()
    del given["topics"]["push"]
    made = package(tmp_path, given)
    assert any("not published in DDS" in n and "push" in n for n in made.notes)


@pytest.mark.parametrize("own", ["wstring text\nfloat64 x\n", "Own again\nfloat64 x\n"])
def test_a_type_without_idl_is_refused(tmp_path: Path, own: str) -> None:
    (tmp_path / "Own.msg").write_text(own)
    given = mapping(near={"type": "own_msgs/Own", "fields": {"value": "x"}})
    given["messages"] = {"own_msgs/Own": str(tmp_path / "Own.msg")}
    with pytest.raises(SoterError) as refused:
        package(tmp_path, given)
    assert {d.code for d in refused.value.diagnostics} == {"D015"}


def test_a_package_called_like_a_word_of_idl_is_refused(tmp_path: Path) -> None:
    (tmp_path / "Own.msg").write_text("float64 x\n")
    given = mapping(near={"type": "Module/Own", "fields": {"value": "x"}})
    given["messages"] = {"Module/Own": str(tmp_path / "Own.msg")}
    with pytest.raises(SoterError, match="is a word of IDL"):
        package(tmp_path, given)


def test_a_constant_longer_than_the_text_it_goes_into_is_refused(tmp_path: Path) -> None:
    (tmp_path / "Own.msg").write_text("string<=3 name\nfloat64 x\n")
    given = mapping(
        push={"type": "own_msgs/Own", "fields": {"value": "x"}, "set": {"name": "four"}}
    )
    given["messages"] = {"own_msgs/Own": str(tmp_path / "Own.msg")}
    with pytest.raises(SoterError, match="holds 3 bytes, not 'four'"):
        package(tmp_path, given)
    given["topics"]["push"]["set"] = {"name": "abc"}
    assert '(void)strcpy((*m).name_, "abc");' in bridge(tmp_path, given)


@pytest.mark.parametrize("topic", ["near", "push"])
def test_what_the_bridge_says_of_itself_has_its_topic_to_itself(tmp_path: Path, topic: str) -> None:
    with pytest.raises(SoterError, match="the bridge says how things are"):
        package(tmp_path, mapping(**{topic: {"channel": "/diagnostics"}}))


def test_a_system_without_a_world_is_refused(tmp_path: Path) -> None:
    inside = re.sub(r"  external topic \w+;\n", "", PROGRAM)
    with pytest.raises(SoterError, match="meets no world"):
        package(tmp_path, mapping(), inside)


# ---------------------------------------------------------------- QoS of target ros2

OF_ROS_2 = """soter 1;
input topic seen: float;
topic out: float = 0.0;
node N period 10ms { subscribes seen; publishes out; step { publish out = seen; } }
system Robot { external topic seen; external topic out; n: N; until 1s; }
"""


def topics_hpp(folder: Path, seen: dict[str, Any], out: dict[str, Any]) -> str:
    field = {"type": "std_msgs/Float64", "fields": {"value": "data"}}
    topics = {
        "seen": {**field, "channel": "/seen", **seen},
        "out": {**field, "channel": "/out", **out},
    }
    (folder / "robot.soter").write_text(OF_ROS_2)
    load(folder / "robot.soter").build("ros2", folder / "made", "Robot", mapping={"topics": topics})
    (file,) = (folder / "made" / "src").glob("*_topics.hpp")
    return file.read_text()


def test_topics_go_as_their_qos_says_and_else_as_sensors_and_commands_do(tmp_path: Path) -> None:
    text = topics_hpp(tmp_path, {}, {})
    assert "return rclcpp::QoS(rclcpp::KeepLast(1U)).best_effort();" in text
    assert "return rclcpp::QoS(rclcpp::KeepLast(1U)).reliable();" in text
    asked = {"reliability": "reliable", "depth": "all"}
    text = topics_hpp(tmp_path, {"qos": asked}, {"qos": {"durability": "transient_local"}})
    assert "return rclcpp::QoS(rclcpp::KeepAll()).reliable();" in text
    assert "return rclcpp::QoS(rclcpp::KeepLast(1U)).reliable().transient_local();" in text


@pytest.mark.parametrize(
    ("seen", "out", "why"),
    [
        ({"durability": "transient_local"}, {}, "`seen` has no stamp and is `transient_local`"),
        ({}, {"depth": "all"}, "`out` goes out with all of its history"),
    ],
)
def test_a_qos_that_makes_old_values_new_or_holds_readers_up_is_refused(
    tmp_path: Path, seen: dict[str, Any], out: dict[str, Any], why: str
) -> None:
    with pytest.raises(SoterError, match=why):
        topics_hpp(tmp_path, {"qos": seen}, {"qos": out})


@pytest.mark.skipif(bool(missing()) or not shutil.which("cmake"), reason=missing() or "no cmake")
def test_the_package_is_built_by_cmake_too(tmp_path: Path) -> None:
    package(tmp_path, mapping())
    for words in (["-S", ".", "-B", "made"], ["--build", "made"]):
        done = processes.run(
            ["cmake", *words], cwd=tmp_path / "out", capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert any((tmp_path / "out" / "made").glob("*_bridge"))
