"""Frames, and how a vector is turned from one into another.

Purpose: `turn_between`: which component becomes which, and its sign, between north-east-down and
east-north-up of the world, and between forward-right-down and forward-left-up of a body (REP 103).
`likely_frame` finds the frame of a vector by names and units.
Non-goals: turning quaternions and covariances; transforms between places.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.mapping.units import standard_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.mapping.message_types import MessageType

WORLD, BODY = ("ENU", "NED"), ("FLU", "FRD")
FRAMES = (*WORLD, *BODY)
BODY_OF = {"ENU": "FLU", "NED": "FRD"}
"""The frame of a body that goes with one of the world."""
Turn = tuple[tuple[int, float], tuple[int, float], tuple[int, float]]
"""For each axis the index of the component of the other frame, and the sign to multiply by."""
SAME: Turn = ((0, 1.0), (1, 1.0), (2, 1.0))
_WORLD_TURN: Turn = ((1, 1.0), (0, 1.0), (2, -1.0))
_BODY_TURN: Turn = ((0, 1.0), (1, -1.0), (2, -1.0))
NED = re.compile(
    r"(?i)^(mavlink|px4_msgs)/|(^|/)vehicle_(local|odom|visual|mocap)|trajectory_setpoint"
    r"|(?<![a-z])ned(?![a-z])"
)
FRD = re.compile(
    r"(?i)(?<![a-z])frd(?![a-z])|(^|/)(scaled|raw|highres)_imu"
    r"|(^|/)(vehicle_?(accel|angular_|angularv|magnetom)|sensor_?(combined|accel|gyro|mag)(?![a-z]))"
)
NORTH = re.compile(r"(?i)(?<![a-z])n(?![a-z])")
DOWN = re.compile(r"(?i)(?<![a-z])(down|[pv]d)(?![a-z])")
"""What MAVLink, PX4 and people call what points north, east, down, or front, right, down."""


def likely_frame(message: MessageType | None, fields: Sequence[str], labels: Sequence[str]) -> str:
    """The likely frame of a vector, by names and units; "" if unknown or a latitude, longitude."""
    units = [message and standard_unit(message, name) for name in fields]
    if {"deg", "degE7"} & {*units} or any(re.match("(?i)lat|lon", name) for name in fields):
        return ""
    names = (*fields, *labels, *(() if message is None else (message.ros1,)))
    if any(map(FRD.search, names)):
        return "FRD"
    first, _, third = map(str.lower, fields)
    if any(map(NED.search, names)) or DOWN.search(third) or NORTH.sub("d", first) == third:
        return "NED"
    return "ENU" if all(units) else ""


def turn_between(frame: str, program: str) -> Turn:
    """The turn from `frame` into the frame `program` (one of WORLD); the same turn leads back."""
    if frame in WORLD:
        return SAME if frame == program else _WORLD_TURN
    return SAME if frame == BODY_OF[program] else _BODY_TURN
