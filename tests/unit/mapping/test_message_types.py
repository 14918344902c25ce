"""Types of ROS messages: what a path is, under both names of a type; what a wrong one is like."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from soter.mapping.message_types import (
    MessageType,
    MessageTypes,
    NoSuchFieldError,
    UnknownMessageError,
)
from soter.mapping.units import STANDARD_UNITS, UNITS, standard_unit
from tables import all_rows


def named(name: str, **own: str) -> MessageType:
    types = MessageTypes()
    for each, text in own.items():
        types.add(each.replace("__", "/"), text)
    return types.type_named(name)


@pytest.mark.parametrize("name", ["nav_msgs/Odometry", "nav_msgs/msg/Odometry"])
def test_a_type_has_its_name_in_ros1_and_in_ros2(name: str) -> None:
    message = named(name)
    assert (message.package, message.name) == ("nav_msgs", "Odometry")
    assert (message.ros1, message.ros2) == ("nav_msgs/Odometry", "nav_msgs/msg/Odometry")
    assert message.exists_in(1)
    assert message.exists_in(2)
    assert message == named("nav_msgs/Odometry")


@all_rows(
    ("name", "path", "kind", "through"),
    [
        ("nav_msgs/Odometry", "pose.pose.position.x", "float64", ""),
        ("nav_msgs/Odometry", "pose.covariance.35", "float64", "array"),
        ("nav_msgs/Odometry", "child_frame_id", "string", ""),
        ("nav_msgs/Odometry", "header.stamp", "time", ""),
        ("nav_msgs/Odometry", "header.stamp.nanosec", "uint32", ""),
        ("nav_msgs/Odometry", "header.seq", "uint32", ""),  # of ROS 1
        ("sensor_msgs/LaserScan", "ranges.3", "float32", "sequence"),
        ("sensor_msgs/LaserScan", "ranges.999999", "float32", "sequence"),
        ("nav_msgs/Path", "poses.0.pose.position.x", "float64", "sequence"),
        ("std_msgs/Bool", "data", "bool", ""),
        ("my_msgs/Foo", "corners.2.y", "float64", "array"),
        ("my_msgs/Foo", "scans.0.ranges.1", "float32", "sequence"),
    ],
)
def test_a_path_is_a_primitive_and_says_whether_it_may_be_absent(
    name: str, path: str, kind: str, through: str
) -> None:
    message = named(
        name, my_msgs__Foo="geometry_msgs/Point[4] corners\nsensor_msgs/LaserScan[2] scans\n"
    )
    field = message.field_at(path)
    assert (field.path, field.type, field.through) == (path, kind, through)
    assert message.primitive_type(path) == kind


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("pose.pose.positon.x", "has no `positon`: did you mean `position`?"),
        ("pose.covariance", "is a list"),
        ("pose.covariance.x", "is a list"),
        ("pose.covariance.36", "has 36 elements, no `36`"),
        ("pose.covariance.-1", "is a list"),
        ("header", "is a whole `std_msgs/msg/Header`"),
        ("child_frame_id.0", "is `string` and has no `0`"),
        ("pose.pose.position.x.y", "is `float64` and has no `y`"),
        ("", "has no ``"),
        ("pose..x", "has no ``"),
    ],
)
def test_a_path_that_is_none_is_told_with_what_there_is(path: str, told: str) -> None:
    with pytest.raises(NoSuchFieldError) as error:
        named("nav_msgs/Odometry").primitive_type(path)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nav_msgs/Odometri", "did you mean `nav_msgs/Odometry`?"),
        ("my_msgs/Foo", "named under `[messages]`"),
        ("Odometry", "is written as `nav_msgs/Odometry`"),
        ("nav_msgs/msg/Odometry/x", "is written as"),
        ("nav msgs/Odometry", "is written as"),
        ("", "is written as"),
    ],
)
def test_a_type_that_is_not_known_is_told_with_one_that_is_like_it(name: str, told: str) -> None:
    with pytest.raises(UnknownMessageError) as error:
        named(name)
    assert told in str(error.value)


def test_a_field_of_ros1_alone_is_none_in_ros2() -> None:
    message = named("nav_msgs/Odometry")
    assert message.primitive_type("header.seq", 1) == "uint32"
    with pytest.raises(NoSuchFieldError):
        message.primitive_type("header.seq", 2)


def test_fields_are_all_primitives_in_declared_order() -> None:
    fields = named("sensor_msgs/LaserScan").fields_by_path(2)
    assert list(fields)[:3] == ["header.stamp", "header.frame_id", "angle_min"]
    assert fields["ranges.*"].through == "sequence"
    assert "header.seq" in named("sensor_msgs/LaserScan").fields_by_path(1)


def test_a_type_that_holds_itself_has_an_end() -> None:
    message = named("my_msgs/Tree", my_msgs__Tree="float64 x\nTree[] below\n")
    assert list(message.fields_by_path()) == ["x"]
    assert message.primitive_type("below.0.below.1.x") == "float64"


def test_a_type_of_ones_own_that_names_an_unknown_one_is_told() -> None:
    with pytest.raises(NoSuchFieldError, match="is to be named under `\\[messages\\]`"):
        named("my_msgs/Foo", my_msgs__Foo="Bar b\n").primitive_type("b.x")


def test_a_text_that_is_no_definition_is_refused() -> None:
    for text in ("float64", "float64 x\nfloat64\n", "\0", "struct { }"):
        with pytest.raises(UnknownMessageError, match=r"is no `\.msg`"):
            MessageTypes().add("my_msgs/Foo", text)
    with pytest.raises(UnknownMessageError, match="no name of a type"):
        MessageTypes().add("Foo", "float64 x\n")


@all_rows(
    ("name", "path", "unit"),
    [
        ("nav_msgs/Odometry", "pose.pose.position.z", "m"),
        ("nav_msgs/Odometry", "twist.twist.linear.x", "m/s"),
        ("nav_msgs/Odometry", "twist.twist.angular.z", "rad/s"),
        ("nav_msgs/Odometry", "pose.covariance.0", "m^2"),
        ("geometry_msgs/PoseStamped", "pose.position.x", "m"),
        ("geometry_msgs/PoseStamped", "pose.orientation.w", "1"),
        ("geometry_msgs/Vector3", "x", None),
        ("sensor_msgs/Imu", "linear_acceleration.y", "m/s^2"),
        ("sensor_msgs/LaserScan", "ranges.3", "m"),
        ("sensor_msgs/LaserScan", "angle_min", "rad"),
        ("sensor_msgs/Range", "max_range", "m"),
        ("sensor_msgs/NavSatFix", "latitude", "deg"),
        ("sensor_msgs/JointState", "position.0", None),
        ("my_msgs/Foo", "at.x", "m"),
    ],
)
def test_fields_of_standard_types_are_in_si(name: str, path: str, unit: str | None) -> None:
    assert standard_unit(named(name, my_msgs__Foo="geometry_msgs/Point at\n"), path) == unit


def test_every_row_of_the_standard_units_is_a_field_and_is_made_of_known_units() -> None:
    from fnmatch import fnmatchcase

    known = {*UNITS, "lx", "degC", "Ah"}
    for name, units in STANDARD_UNITS.items():
        fields = [f for v in (1, 2) for f in named(name).fields_by_path(v)]
        for pattern, unit in units.items():
            assert unit in known or {*re.findall(r"[a-zA-Z]+", unit)} <= known
            covariance = re.sub(r"\.[0-9]+$", ".*", pattern)
            assert any(fnmatchcase(f, covariance) for f in fields), (name, pattern)
