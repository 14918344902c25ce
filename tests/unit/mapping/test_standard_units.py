"""Which unit a field of a standard message is in, and that it goes into no other.

Non-goals: units that a mapping says (`test_mapping.py`).
"""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.message_types import MessageTypes
from soter.mapping.read_mapping import make_log_map
from soter.mapping.topic_mapping import SignalSource
from soter.mapping.units import UNITS, standard_unit

if TYPE_CHECKING:
    from pathlib import Path


def read_into(type_: str, field: str, more: dict[str, Any], unit: str, tmp_path: Path) -> float:
    """The factor with which a field of a message goes into a topic in `unit`."""
    path = tmp_path / "p.soter"
    said = f' unit "{unit}"' if unit else ""
    path.write_text(f"soter 1;\ntopic seen: float{said};\n{ONE_TOPIC}")
    row = {"from": field, **more}
    given: dict[str, Any] = {"topics": {"seen": {"type": type_, "fields": {"value": row}}}}
    if type_.startswith("mavlink/"):
        given["mavlink"] = {"url": "udpin://127.0.0.1:14540", "offboard_loss": "500ms"}
    (leaf,) = make_log_map(given, load(path).flat()).topics[0].leaves.values()
    assert isinstance(leaf, SignalSource)
    return leaf.scale


ONE_TOPIC = """plant P period 10ms { drives seen = x; state x: float; }
system S { p: P; }
"""
UNITS_OF_FIELDS = [
    ("nav_msgs/Odometry", "pose.pose.orientation.x", "1"),
    ("nav_msgs/Odometry", "pose.covariance.7", "m^2"),
    ("nav_msgs/Odometry", "pose.covariance.3", "m*rad"),
    ("nav_msgs/Odometry", "pose.covariance.32", "m*rad"),
    ("nav_msgs/Odometry", "pose.covariance.35", "rad^2"),
    ("nav_msgs/Odometry", "twist.covariance.0", "m^2/s^2"),
    ("nav_msgs/Odometry", "twist.covariance.21", "rad^2/s^2"),
    ("geometry_msgs/AccelWithCovariance", "covariance.14", "m^2/s^4"),
    ("geometry_msgs/TransformStamped", "transform.rotation.w", "1"),
    ("geometry_msgs/PoseArray", "poses.0.orientation.z", "1"),
    ("geometry_msgs/Inertia", "ixz", "kg*m^2"),
    ("nav_msgs/OccupancyGrid", "info.resolution", "m"),
    ("nav_msgs/OccupancyGrid", "info.origin.orientation.y", "1"),
    ("sensor_msgs/Imu", "orientation.y", "1"),
    ("sensor_msgs/Imu", "orientation_covariance.4", "rad^2"),
    ("sensor_msgs/Imu", "angular_velocity_covariance.0", "rad^2/s^2"),
    ("sensor_msgs/Imu", "linear_acceleration_covariance.8", "m^2/s^4"),
    ("sensor_msgs/MagneticField", "magnetic_field_covariance.0", "T^2"),
    ("sensor_msgs/LaserScan", "scan_time", "s"),
    ("sensor_msgs/LaserScan", "angle_increment", "rad"),
    ("sensor_msgs/MultiEchoLaserScan", "ranges.0.echoes.1", "m"),
    ("sensor_msgs/BatteryState", "percentage", "1"),
    ("sensor_msgs/BatteryState", "charge", "Ah"),
    ("sensor_msgs/BatteryState", "design_capacity", "Ah"),
    ("sensor_msgs/BatteryState", "cell_voltage.2", "V"),
    ("sensor_msgs/BatteryState", "cell_temperature.2", "degC"),
    ("sensor_msgs/Temperature", "temperature", "degC"),
    ("sensor_msgs/RelativeHumidity", "relative_humidity", "1"),
    ("sensor_msgs/NavSatFix", "latitude", "deg"),
    ("sensor_msgs/NavSatFix", "position_covariance.8", "m^2"),
    ("sensor_msgs/FluidPressure", "variance", "Pa^2"),
    ("mavlink/ATTITUDE_QUATERNION", "q2", "1"),
    ("mavlink/ODOMETRY", "q.0", "1"),
    ("mavlink/BATTERY_STATUS", "current_consumed", "mAh"),
]
"""A type of messages, a field of it, and the unit that it is in."""


@pytest.mark.parametrize(("type_", "field", "unit"), UNITS_OF_FIELDS)
def test_a_field_goes_into_its_own_unit_and_into_no_other(
    type_: str, field: str, unit: str, tmp_path: Path
) -> None:
    if type_.startswith("mavlink/"):
        pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")
    assert read_into(type_, field, {}, unit, tmp_path) == 1.0
    assert read_into(type_, field, {}, "", tmp_path) == UNITS.get(unit, 1.0)
    for other in ("m", "m/s", "A"):
        if other == unit:
            continue
        with pytest.raises(SoterError) as error:
            read_into(type_, field, {}, other, tmp_path)
        (problem,) = error.value.diagnostics
        assert problem.code == "D015"
        assert f"`seen` is in `{other}`" in problem.message.replace("seen.value", "seen")
        assert f"`{field}` is in `{unit}`" in problem.message


UNTOLD = (
    "geometry_msgs/Vector3.[xyz]",
    "geometry_msgs/Vector3Stamped.vector.[xyz]",
    "sensor_msgs/CameraInfo.*",
    "sensor_msgs/ChannelFloat32.values.*",
    "sensor_msgs/PointCloud.channels.*",
    "sensor_msgs/JointState.*",
    "sensor_msgs/Joy.axes.*",
    "sensor_msgs/JoyFeedback*.intensity",
    "sensor_msgs/LaserEcho.echoes.*",
    "sensor_msgs/*LaserScan.intensities.*",
)
"""Fields without a unit of their own: it depends on something else, or nobody says it."""


def test_every_number_of_the_standard_messages_has_a_unit_or_is_known_to_have_none() -> None:
    types = MessageTypes()
    names = {n for known in types.definitions.values() for n in known}
    checked = 0
    for name in sorted(n for n in names if n.startswith(("geometry_", "nav_", "sensor_"))):
        message = types.type_named(name)
        for path, found in message.fields_by_path().items():
            if not found.type.startswith("float"):
                continue
            checked += 1
            at = path.replace("*", "0")
            untold = any(fnmatchcase(f"{message.ros1}.{path}", u) for u in UNTOLD)
            assert untold == (standard_unit(message, at) is None), f"{name}: {path}"
    assert checked > 300


@pytest.mark.parametrize(
    ("more", "factor"),
    [
        ({"unit": "m/s", "scale": 0.2}, 0.2),
        ({"unit": "m/s"}, None),
        ({"scale": 0.2}, None),
    ],
)
def test_a_unit_that_nobody_can_turn_is_turned_by_what_the_mapping_says(
    more: dict[str, Any], factor: float | None, tmp_path: Path
) -> None:
    pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")
    message, field = "mavlink/HIGH_LATENCY2", "airspeed"  # in m/s*5
    if factor is not None:
        assert read_into(message, field, more, "m/s", tmp_path) == factor
        return
    with pytest.raises(SoterError, match=re.escape("is in `m/s*5`")):
        read_into(message, field, more, "m/s", tmp_path)
