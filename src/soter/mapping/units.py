"""Units of numbers, those of standard ROS messages among them.

Purpose: `UNITS` has the units that a mapping or a program may name, with their factors to SI.
`DIMENSIONS` has the quantity that each measures, so that no length is taken for a speed.
`standard_unit` gives the unit of a field of a standard ROS message, from REP 103 and the message
definitions; a mapping that names another unit is refused.
Non-goals: messages of one's own, unless made of standard ones; fields whose unit depends on
something else (`JointState.position`), or is not defined (`LaserScan.intensities`): no unit;
frames (`frames.py`).
"""

from __future__ import annotations

import math
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.mapping.message_types import MessageType


TIME_UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}

NUMBER, LENGTH, ANGLE = "a number", "a length", "an angle"
SPEED, TURN, ACCELERATION = "a speed", "an angular speed", "an acceleration"
_BY_DIMENSION = {
    LENGTH: {"m": 1.0, "km": 1000.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048},
    SPEED: {
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "dm/s": 0.1,
        "cm/s": 0.01,
        "mm/s": 0.001,
        "kn": 1852.0 / 3600.0,
        "ft/s": 0.3048,
    },
    ACCELERATION: {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    ANGLE: {
        "rad": 1.0,
        "deg": math.pi / 180.0,
        "cdeg": math.pi / 18000.0,
        "degE5": math.pi / 180.0e5,
        "degE7": math.pi / 180.0e7,
    },
    TURN: {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180.0, "ddeg/s": math.pi / 1800.0},
    NUMBER: {"%": 0.01, "d%": 0.001, "c%": 0.0001, "1": 1.0},
    "a length of time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "an angular acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180.0},
    "a force": {"N": 1.0},
    "a torque": {"Nm": 1.0},
    "a mass": {"kg": 1.0},
    "a voltage": {"V": 1.0, "mV": 1e-3},
    "a current": {"A": 1.0, "cA": 0.01, "mA": 1e-3},
    "a pressure": {"Pa": 1.0, "hPa": 100.0, "kPa": 1000.0},
    "a field strength": {"T": 1.0},
}
UNITS = {unit: factor for units in _BY_DIMENSION.values() for unit, factor in units.items()}
"""Unit -> the factor from a number in this unit to SI."""
DIMENSIONS = {unit: name for name, units in _BY_DIMENSION.items() for unit in units}
"""Unit -> the quantity that it measures, in words."""
RATES = {LENGTH: SPEED, SPEED: ACCELERATION, ANGLE: TURN, TURN: "an angular acceleration"}
"""Quantity -> the quantity of its rate of change, if that has a unit here."""


def factor_between(unit: str, declared: str) -> float | None:
    """Gives the factor from numbers in `unit` to numbers in `declared`; None if they do not fit.

    A `declared` unit of "" means SI. A `unit` that is not in UNITS (`m^2`, `Ah`) has the factor 1
    to itself and to "", and fits no other unit.
    """
    if declared == unit:
        return 1.0
    if not declared:
        return UNITS.get(unit, 1.0)
    if unit not in UNITS or DIMENSIONS.get(declared) != DIMENSIONS[unit]:
        return None
    return UNITS[unit] / UNITS[declared]


def full_turn(unit: str | None, declared: str) -> float:
    """Gives a full turn in the unit of a leaf (default: rad); infinity if it is no angle."""
    is_angle = DIMENSIONS.get(declared or unit or "") == ANGLE
    return math.tau / UNITS.get(declared, 1.0) if is_angle else math.inf


def _covariance_units(field: str, linear: str, mixed: str, angular: str) -> dict[str, str]:
    """Gives the unit of each element of a row-major 6 x 6 covariance: 3 linear, 3 angular axes."""
    units = (linear, mixed, angular)
    return {f"{field}.{6 * i + j}": units[i // 3 + j // 3] for i in range(6) for j in range(6)}


_SCAN = {"ranges.*": "m", "range_*": "m", "angle_*": "rad", "time_increment": "s", "scan_time": "s"}
STANDARD_UNITS = {
    "geometry_msgs/Point": {"[xyz]": "m"},
    "geometry_msgs/Point32": {"[xyz]": "m"},
    "geometry_msgs/Pose2D": {"[xy]": "m", "theta": "rad"},
    "geometry_msgs/PoseWithCovariance": _covariance_units("covariance", "m^2", "m*rad", "rad^2"),
    "geometry_msgs/Quaternion": {"[xyzw]": "1"},
    "geometry_msgs/Transform": {"translation.*": "m"},
    "geometry_msgs/Twist": {"linear.*": "m/s", "angular.*": "rad/s"},
    "geometry_msgs/TwistWithCovariance": _covariance_units(
        "covariance", "m^2/s^2", "m*rad/s^2", "rad^2/s^2"
    ),
    "geometry_msgs/Accel": {"linear.*": "m/s^2", "angular.*": "rad/s^2"},
    "geometry_msgs/AccelWithCovariance": _covariance_units(
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
    "sensor_msgs/Range": {"range": "m", "*_range": "m", "field_of_view": "rad", "variance": "m^2"},
    "sensor_msgs/LaserScan": _SCAN,
    "sensor_msgs/MultiEchoLaserScan": _SCAN,
}
"""Message type -> pattern of field paths in it -> the unit of those fields."""


def standard_unit(message: MessageType, path: str) -> str | None:
    """Gives a field's unit as set by the outermost type that sets it; None if no type does."""
    by_message = message.unit(path)
    if by_message is not None:
        return by_message
    for owner, rest in message.owning_types(path):
        for pattern, unit in STANDARD_UNITS.get(owner, {}).items():
            if fnmatchcase(rest, pattern):
                return unit
    return None
