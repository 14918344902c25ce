"""Which unit a field of a standard ROS message is in.

Purpose: SI as REP 103 and the comments of the message definitions say it, so that a mapping that
takes another unit is refused.
Non-goals: messages of one's own, unless made of standard ones; fields whose unit depends on
something else (`JointState.position`), or on nothing (`LaserScan.intensities`), which are in none.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.mapping.message_types import MessageType


def _covariance(field: str, linear: str, mixed: str, angular: str) -> dict[str, str]:
    """Units of a row-major 6 x 6 covariance: three linear quantities, then three angular ones."""
    units = (linear, mixed, angular)
    return {f"{field}.{6 * i + j}": units[i // 3 + j // 3] for i in range(6) for j in range(6)}


_SCAN = {
    "ranges.*": "m",
    "range_*": "m",
    "angle_*": "rad",
    "time_increment": "s",
    "scan_time": "s",
}
STANDARD_UNITS = {
    "geometry_msgs/Point": {"[xyz]": "m"},
    "geometry_msgs/Point32": {"[xyz]": "m"},
    "geometry_msgs/Pose2D": {"[xy]": "m", "theta": "rad"},
    "geometry_msgs/PoseWithCovariance": _covariance("covariance", "m^2", "m*rad", "rad^2"),
    "geometry_msgs/Quaternion": {"[xyzw]": "1"},
    "geometry_msgs/Transform": {"translation.*": "m"},
    "geometry_msgs/Twist": {"linear.*": "m/s", "angular.*": "rad/s"},
    "geometry_msgs/TwistWithCovariance": _covariance(
        "covariance", "m^2/s^2", "m*rad/s^2", "rad^2/s^2"
    ),
    "geometry_msgs/Accel": {"linear.*": "m/s^2", "angular.*": "rad/s^2"},
    "geometry_msgs/AccelWithCovariance": _covariance(
        "covariance", "m^2/s^4", "m*rad/s^4", "rad^2/s^4"
    ),
    "geometry_msgs/Wrench": {"force.*": "N", "torque.*": "Nm"},
    "geometry_msgs/Inertia": {"m": "kg", "com.*": "m", "i[xyz][xyz]": "kg*m^2"},
    "nav_msgs/GridCells": {"cell_*": "m"},
    "nav_msgs/MapMetaData": {"resolution": "m"},
    "sensor_msgs/Imu": {
        "angular_velocity.*": "rad/s",
        "linear_acceleration.*": "m/s^2",
        "orientation_covariance.*": "rad^2",
        "angular_velocity_covariance.*": "rad^2/s^2",
        "linear_acceleration_covariance.*": "m^2/s^4",
    },
    "sensor_msgs/MagneticField": {"magnetic_field.*": "T", "magnetic_field_covariance.*": "T^2"},
    "sensor_msgs/FluidPressure": {"fluid_pressure": "Pa", "variance": "Pa^2"},
    "sensor_msgs/Illuminance": {"illuminance": "lx", "variance": "lx^2"},
    "sensor_msgs/RelativeHumidity": {"relative_humidity": "1", "variance": "1"},
    "sensor_msgs/Temperature": {"temperature": "degC", "variance": "degC^2"},
    "sensor_msgs/BatteryState": {
        "voltage": "V",
        "cell_voltage.*": "V",
        "current": "A",
        "percentage": "1",
        "*temperature*": "degC",
        "charge": "Ah",
        "*capacity": "Ah",
    },
    "sensor_msgs/NavSatFix": {
        "latitude": "deg",
        "longitude": "deg",
        "altitude": "m",
        "position_covariance.*": "m^2",
    },
    "sensor_msgs/Range": {
        "range": "m",
        "*_range": "m",
        "field_of_view": "rad",
        "variance": "m^2",
    },
    "sensor_msgs/LaserScan": _SCAN,
    "sensor_msgs/MultiEchoLaserScan": _SCAN,
}
"""By type, of which a field may be a part: fields as patterns, and their unit."""


def standard_unit(message: MessageType, path: str) -> str | None:
    """The unit of a field, from the outermost type that says it; None where none does."""
    said = message.unit(path)
    if said is not None:
        return said
    for owner, rest in message.owners(path):
        for pattern, unit in STANDARD_UNITS.get(owner, {}).items():
            if fnmatchcase(rest, pattern):
                return unit
    return None
