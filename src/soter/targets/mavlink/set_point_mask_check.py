"""What a set-point has to say before an autopilot may be sent it.

Purpose: `type_mask` and `coordinate_frame` are said, and the mask ignores exactly what the mapping
does not fill: a field that is neither filled nor ignored would be a command of 0.
Non-goals: which combinations an autopilot supports (PX4's page on OFFBOARD lists its own).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.mapping.topic_mapping import TopicMap

_POSITION: dict[int, tuple[str, ...]] = {
    **{1 << k: (name,) for k, name in enumerate(("x", "y", "z", "vx", "vy", "vz"))},
    **{64 << k: (name,) for k, name in enumerate(("afx", "afy", "afz"))},
    1024: ("yaw",),
    2048: ("yaw_rate",),
}
_GLOBAL = {**_POSITION, 1: ("lat_int",), 2: ("lon_int",), 4: ("alt",)}
IGNORED: dict[str, dict[int, tuple[str, ...]]] = {
    "SET_POSITION_TARGET_LOCAL_NED": _POSITION,
    "SET_POSITION_TARGET_GLOBAL_INT": _GLOBAL,
    "SET_ATTITUDE_TARGET": {
        1: ("body_roll_rate",),
        2: ("body_pitch_rate",),
        4: ("body_yaw_rate",),
        64: ("thrust",),
        128: ("q.0", "q.1", "q.2", "q.3"),
    },
}
"""Message: bit of its `type_mask`, and the fields that an autopilot then ignores."""


def set_point_problems(mapped: TopicMap) -> list[str]:
    """What is wrong with a topic that goes out."""
    message = mapped.message
    bits = IGNORED.get(message.name if message else "")
    if message is None or bits is None:
        return []
    named = f"`{mapped.topic.name}`, {message.ros1}:"
    needed = ["type_mask"]
    needed += ["coordinate_frame"] * (message.name != "SET_ATTITUDE_TARGET")
    missing = [k for k in needed if k not in mapped.constants and k not in mapped.names]
    if missing:
        names = ", ".join(f"`{k}`" for k in missing)
        return [f"{named} `set` has to say {names}: 0 would be a command"]
    mask = mapped.constants.get("type_mask")
    if not isinstance(mask, int):
        return [f"{named} `type_mask` is a constant of the mapping: say it in `set`"]
    filled = {*mapped.names, *mapped.constants}
    problems = []
    for bit, fields in bits.items():
        ignored = bool(mask & bit)
        for name in fields:
            if ignored and name in filled:
                problems.append(f"{named} `type_mask` {mask} ignores `{name}`, which is filled")
            if not ignored and name not in filled:
                problems.append(f"{named} `type_mask` {mask} commands `{name}`, which nobody fills")
    return problems
