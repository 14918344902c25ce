"""`test/` of a catkin package: that nothing but the law leaves before somebody arms the actuators.

Purpose: a launch file for rostest, a node that stands in for the sensors and listens, and what it
says and expects: `test/stand_ins.json`, the person's to change, as the values are of no robot.
Non-goals: the robot, AC: its topics stay silent.
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    RecordType,
    leaves,
)
from soter.mapping.topic_mapping import NearestSource, SignalSource
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Module
    from soter.language.model.types import Type, Value
    from soter.mapping.topic_mapping import Leaf, TopicMap
    from soter.targets.ros.ros_files import RosPackage

RAYS = 36


def untested(p: RosPackage) -> str:
    """Why the package has no test; "": it has one."""
    if not p.bridged.actuated:
        return "no actuators obey"
    if not _sensed(p):
        return "nothing comes in but for ACs"
    several = _publishers(p)
    if several[1:]:
        names = ", ".join(f"`{name}`" for name in several)
        return f"one node stands in for the sensors, and the mapping asks for {names}"
    return ""


def _publishers(p: RosPackage) -> list[str]:
    return sorted({m.publisher.strip("/") for m in _sensed(p) if m.publisher})


def rostest_files(p: RosPackage) -> list[PackageFile]:
    """The test; none where `untested`."""
    if untested(p):
        return []
    document = json.dumps(_document(p), indent=1) + "\n"
    publisher = next(iter(_publishers(p)), "standing_by")
    return [
        p.file(f"test/{p.name}.test", "catkin/test.launch.xml", publisher=publisher),
        p.file("test/standing_by.py", "catkin/standing_by.py"),
        PackageFile("test/stand_ins.json", document, yours=True),
    ]


def _sensed(p: RosPackage) -> list[TopicMap]:
    """What comes in and is awaited: not what ACs alone read."""
    return [m for m in p.mapped if p.bridged.world.is_awaited(m.topic)]


def _document(p: RosPackage) -> dict[str, object]:
    granted = [g.module for g in p.bridged.world.granted]
    laws = [
        _expected(m, module.law[m.topic.index])
        for m in p.mapped
        for module in granted
        if m.topic.index in module.law and _expected(m, module.law[m.topic.index])
    ]
    return {
        "about": "what stands in for the sensors, and the fail-safe law; change values as you like",
        "stand_ins": [_stand_in(m) for m in _sensed(p)],
        "laws": laws,
        "modules": [m.name for m in granted],
        "of_silent_ac": [m.name for m in granted if _is_ac_silent(p, m)],
    }


def _is_ac_silent(p: RosPackage, module: Module) -> bool:
    """Whether AC of the module waits for a topic that nobody of the test publishes."""
    ac = p.bridged.system.components[module.ac]
    read = ac.reads if ac.node is not None else []
    awaited = p.bridged.world.is_awaited
    topics = [p.bridged.topic(i) for i in read]
    return any(t.driver == "input" and not awaited(t) for t in topics)


# ---------------------------------------------------------------- values


def _stand_in(m: TopicMap) -> dict[str, object]:
    assert m.message is not None
    fields: dict[str, object] = {}
    for (path, t), value, bound in zip(
        leaves(m.topic.type), _scalars(m.topic.type, m.topic.default), m.topic.bounds, strict=True
    ):
        leaf = m.leaves[path]
        if isinstance(leaf, NearestSource):
            fields |= _ring(leaf)
        elif isinstance(leaf, SignalSource):
            high = math.inf if bound is None else bound.high
            fields[leaf.name] = _field(t, leaf, _beside(t, value, high))
    if m.frame_id is not None:
        fields["header.frame_id"] = m.frame_id
    stamp = [] if m.stamp is None else [m.stamp.path, _unit_ns(m)]
    return {"topic": m.channel, "type": m.message.ros1, "stamp": stamp, "fields": fields}


def _unit_ns(m: TopicMap) -> float:
    """Of a stamp that is a number; 0: it is a time."""
    assert m.stamp is not None
    return float(m.stamp.unit_ns) if m.stamp.kind == "number" else 0.0


def _beside(t: Type, value: Value, high: float) -> Value:
    """A value of the set that is not the default, at which many a command is the law."""
    if not isinstance(t, FloatType) or not math.isfinite(high):
        return value
    assert isinstance(value, float)
    return value + (high - value) / 8.0


def _ring(leaf: NearestSource) -> dict[str, object]:
    """A scan that goes round once and sees nothing near."""
    step = 2.0 * math.pi / RAYS
    far = 2.0 * leaf.most
    ends = {"angle_min": -math.pi, "angle_max": math.pi - step, "angle_increment": step}
    return {**ends, "range_min": 0.01, "range_max": 2.0 * far, "ranges": [far] * RAYS}


def _expected(m: TopicMap, law: Value) -> dict[str, object]:
    """The fields of a message that holds the law; {} where none of them is a number."""
    assert m.message is not None
    fields = {
        leaf.name: _field(t, leaf, value)
        for (path, t), value in zip(leaves(m.topic.type), _scalars(m.topic.type, law), strict=True)
        if isinstance(leaf := m.leaves[path], SignalSource)
    }
    return {"topic": m.channel, "type": m.message.ros1, "fields": fields} if fields else {}


def _field(t: Type, leaf: Leaf, value: Value) -> object:
    """What stands in a message for a value of a leaf."""
    assert isinstance(leaf, SignalSource)
    if isinstance(t, BoolType):
        return bool(value)
    if isinstance(t, EnumType):
        return t.members[int(value)]
    if isinstance(t, FloatType):
        return (float(value) - leaf.offset) / leaf.scale
    return int(value)


def _scalars(t: Type, value: Value) -> Iterator[Value]:
    """The leaves of a value, in declared order."""
    if isinstance(t, RecordType):
        for (_, kind), part in zip(t.fields, value, strict=True):
            yield from _scalars(kind, part)
    elif isinstance(t, ArrayType):
        for part in value:
            yield from _scalars(t.element, part)
    else:
        yield value
