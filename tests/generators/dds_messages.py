"""Messages of ROS 2 as PyPI's `cyclonedds` sends and reads them: for the tests of target `dds`.

Purpose: classes of the standard types, named as ROS 2 names them on the wire. Needs the extras
`dds` and `ros`. Non-goals: peers (`dds_machine.py`).
"""

from __future__ import annotations

from functools import cache
from typing import Any

from cyclonedds.idl import make_idl_struct, types
from rosbags.typesys import Stores, get_typestore

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
IDL: Any = types


@cache
def type_of(name: str) -> Any:
    """The class of a message, members named as ROS 2 names them on the wire."""
    members = {f"{m}_": member_type(kind) for m, kind in STORE.fielddefs[name][1]}
    package_, _, last = name.split("/")
    return make_idl_struct(f"{last}_", f"{package_}.msg.dds_.{last}_", members)


def member_type(kind: Any) -> Any:
    """The class of a member."""
    if kind[0] == 1:
        named = {"octet": "byte"}.get(kind[1][0], kind[1][0])
        return str if named == "string" else getattr(types, named)
    if kind[0] == 2:
        return type_of(kind[1])
    inner = member_type(kind[1][0])
    return IDL.array[inner, kind[1][1]] if kind[0] == 3 else IDL.sequence[inner]


def sample(name: str, values: dict[str, Any], path: str = "") -> Any:
    """A message: what `values` says by path, else zeros and empty texts."""
    kind = type_of(name)
    members = {}
    for m, k in STORE.fielddefs[name][1]:
        at = f"{path}{m}"
        if k[0] == 2:
            members[f"{m}_"] = sample(k[1], values, f"{at}.")
        elif k[0] == 1:
            members[f"{m}_"] = values.get(at, "" if k[1][0] == "string" else 0)
        else:
            members[f"{m}_"] = values.get(at, [0.0] * k[1][1])
    return kind(**members)


def stamp(ns: int) -> dict[str, Any]:
    """The header of a message of the robot of `dds_programs.py`, for `sample`."""
    sec, nanosec = divmod(ns, 10**9)
    return {"header.stamp.sec": sec, "header.stamp.nanosec": nanosec, "header.frame_id": "odom"}
