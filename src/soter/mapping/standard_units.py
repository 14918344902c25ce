"""Which unit a field of a standard ROS message is in.

Purpose: SI as REP 103 and the comments of the message definitions say it, so that a mapping that
takes another unit is refused.
Non-goals: messages of one's own, unless made of standard ones; fields whose unit depends on
something else (`JointState.position`), which are in none.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from soter.mapping.units import UNITS

if TYPE_CHECKING:
    from soter.mapping.message_types import MessageType

STANDARD_UNITS = {
    "geometry_msgs/Point": {"[xyz]": "m"},
    "geometry_msgs/Point32": {"[xyz]": "m"},
    "geometry_msgs/Pose2D": {"[xy]": "m", "theta": "rad"},
    "geometry_msgs/Transform": {"translation.*": "m"},
    "geometry_msgs/Twist": {"linear.*": "m/s", "angular.*": "rad/s"},
    "geometry_msgs/Accel": {"linear.*": "m/s^2", "angular.*": "rad/s^2"},
    "geometry_msgs/Wrench": {"force.*": "N", "torque.*": "Nm"},
    "geometry_msgs/Inertia": {"m": "kg", "com.*": "m"},
    "sensor_msgs/Imu": {"angular_velocity.*": "rad/s", "linear_acceleration.*": "m/s^2"},
    "sensor_msgs/MagneticField": {"magnetic_field.*": "T"},
    "sensor_msgs/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/BatteryState": {"voltage": "V", "current": "A", "percentage": "1"},
    "sensor_msgs/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/Range": {"range": "m", "*_range": "m", "field_of_view": "rad"},
    "sensor_msgs/LaserScan": {
        "ranges.*": "m",
        "range_*": "m",
        "angle_*": "rad",
        "time_increment": "s",
        "scan_time": "s",
    },
}
"""By type, of which a field may be a part: fields as patterns, and their unit."""


def unknown_unit(message: MessageType, path: str) -> str | None:
    """What a message says that a field is in, where that is none of UNITS: `deg/2`, say."""
    said = message.unit(path)
    return said if said is not None and said not in UNITS else None


def standard_unit(message: MessageType, path: str) -> str | None:
    """The unit of a field, from the outermost type that says it; None where none does."""
    said = message.unit(path)
    if said is not None:
        return said if said in UNITS else None
    for owner, rest in message.owners(path):
        for pattern, unit in STANDARD_UNITS.get(owner, {}).items():
            if fnmatchcase(rest, pattern):
                return unit
    return None
