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
    from soter.targets.ros.ros_package_info import RosPackage

NODE = "standing_by.py"
RAYS = 36
NAMED = "standing_by"


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
    return [
        PackageFile(f"test/{p.name}.test", _launch(p, *_publishers(p))),
        PackageFile(f"test/{NODE}", STANDING_BY.replace("@NAME@", p.name)),
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
    read = [ac.scope.topics[s.topic] for s in ac.node.subscribes] if ac.node is not None else []
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


# ---------------------------------------------------------------- files


def _launch(p: RosPackage, publisher: str = NAMED) -> str:
    return f"""\
<launch>
  <!-- the trusted part, its actuators and the bridge, and a node that stands in for the sensors -->
  <arg name="channels" default="/dev/shm/{p.name}_rostest"/>
  <include file="$(find {p.name})/launch/{p.name}.launch">
    <arg name="channels" value="$(arg channels)"/>
    <arg name="misses" value="1000000"/>
  </include>
  <test test-name="{NAMED}" pkg="{p.name}" type="{NODE}" name="{publisher}" time-limit="180">
    <param name="stand_ins" value="$(find {p.name})/test/stand_ins.json"/>
  </test>
</launch>
"""


STANDING_BY = '''\
#!/usr/bin/python3
"""Nothing but the law leaves before somebody arms the actuators; written by soter.

`stand_ins.json` says what stands in for the sensors. AC says nothing here.
"""

import json
import sys
import threading
import time
import unittest

import roslib.message
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray

PATIENCE_S = 40.0
PERIOD_S = 0.01
MESSAGES = 100
WAITS = "until a person arms them"


def member(message, name, more):
    """A member of a message, or an element of a list, which is made as long as it has to be."""
    if not name.isdigit():
        return getattr(message, name)
    at = int(name)
    while len(message) <= at:
        message.append(more() if more else 0)
    return message[at]


def put(message, path, value):
    """Sets a field by its path."""
    *parents, last = path.split(".")
    element = None
    for name in parents:
        owner, message = message, member(message, name, element)
        if isinstance(message, list):
            kind = dict(zip(owner.__slots__, owner._slot_types))[name].partition("[")[0]
            element = roslib.message.get_message_class(kind)
    if last.isdigit():
        member(message, last, None)
        message[int(last)] = value
    else:
        setattr(message, last, value)


def get(message, path):
    """A field by its path."""
    for name in path.split("."):
        message = message[int(name)] if name.isdigit() else getattr(message, name)
    return message


def is_law(message, fields):
    """Whether a message says the law, as exactly as 32 bits hold it."""
    for path, value in fields.items():
        actual = get(message, path)
        if isinstance(value, float):
            if abs(actual - value) > 1e-6 * max(1.0, abs(value)):
                return False
        elif actual != value:
            return False
    return True


class StandIn:
    """Publishes one message again and again, stamped anew, while `speaks` is set."""

    def __init__(self, about, speaks):
        self.about, self.speaks = about, speaks
        self.type = roslib.message.get_message_class(about["type"])
        self.publisher = rospy.Publisher(about["topic"], self.type, queue_size=1)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not rospy.is_shutdown():
            if self.speaks.is_set():
                self.publisher.publish(self.message())
            time.sleep(PERIOD_S)

    def message(self):
        message = self.type()
        for path, value in self.about["fields"].items():
            put(message, path, value)
        if self.about["stamp"]:
            path, unit_ns = self.about["stamp"]
            now = rospy.Time.now()
            put(message, path, now.to_nsec() / unit_ns if unit_ns else now)
        return message


class Heard:
    """What was said: of each module on /diagnostics, and on the topics of the law."""

    def __init__(self, laws):
        self.message, self.values, self.modes = {}, {}, {}
        self.law = {law["topic"]: 0 for law in laws}
        self.other = []
        rospy.Subscriber("/diagnostics", DiagnosticArray, self.on_diagnostics, queue_size=100)
        for law in laws:
            kind = roslib.message.get_message_class(law["type"])
            rospy.Subscriber(law["topic"], kind, self.on_command, law, queue_size=100)

    def on_diagnostics(self, array):
        for status in array.status:
            if status.name.startswith("soter: module "):
                name = status.name[len("soter: module ") :]
                self.values[name] = {value.key: value.value for value in status.values}
                self.message[name] = status.message
                self.modes.setdefault(name, set()).add(self.values[name].get("mode"))

    def on_command(self, message, law):
        if is_law(message, law["fields"]):
            self.law[law["topic"]] += 1
        else:
            self.other.append(f"{law['topic']}: {message}")


class StandingBy(unittest.TestCase):
    """One robot for all tests; they come in the order of their names."""

    @classmethod
    def setUpClass(cls):
        with open(rospy.get_param("~stand_ins")) as file:
            cls.about = json.load(file)
        cls.speaks = threading.Event()
        cls.stand_ins = [StandIn(about, cls.speaks) for about in cls.about["stand_ins"]]
        cls.heard = Heard(cls.about["laws"])

    def eventually(self, what, otherwise):
        end = time.monotonic() + PATIENCE_S
        while not what():
            self.assertFalse(rospy.is_shutdown(), "the test was ended")
            self.assertLess(time.monotonic(), end, f"{otherwise}: {self.heard.message}")
            time.sleep(0.05)

    def test_1_with_a_silent_ac_sc_has_control_and_diagnostics_say_so(self):
        self.speaks.set()
        for name in self.about["modules"]:
            wanted = {"SC"} if name in self.about["of_silent_ac"] else {"SC", "AC"}
            self.eventually(
                lambda name=name, wanted=wanted: self.heard.modes.get(name, set()) & wanted,
                f"/diagnostics never said that {name} is in mode {sorted(wanted)}",
            )

    def test_2_nothing_but_the_law_leaves_before_arming(self):
        heard, modules = self.heard, self.about["modules"]
        self.speaks.set()
        time.sleep(1.0)  # commands that are obeyed, where they differ from the law
        obeyed = len(heard.other)
        self.speaks.clear()
        for name in modules:
            self.eventually(
                lambda name=name: heard.values.get(name, {}).get("armed") == "no",
                "the sensors are silent, and leases do not end",
            )
        self.speaks.set()
        for name in modules:
            self.eventually(
                lambda name=name: WAITS in heard.message.get(name, ""),
                f"/diagnostics never said that the actuators of {name} wait to be armed",
            )
        heard.other.clear()
        before = dict(heard.law)
        for topic in before:
            self.eventually(
                lambda topic=topic: heard.other or heard.law[topic] >= before[topic] + MESSAGES,
                f"nothing is published on {topic}",
            )
        self.assertEqual(heard.other[:3], [], "commands before anybody armed the actuators")
        self.assertTrue(before, "no topic that goes out is in the mapping: nothing was looked at")
        if not obeyed:
            self.skipTest(
                "with these readings the commands are the law anyway, so this says little: "
                "change test/stand_ins.json"
            )

    def test_3_machines_are_told_the_same_on_status(self):
        kind = roslib.message.get_message_class("@NAME@/ModuleStatus")
        if kind is None:
            self.skipTest("the workspace has made no class of ModuleStatus: no genmsg, or genpy")
        statuses = {}

        def hear(message):
            statuses[message.module] = message

        rospy.Subscriber("/@NAME@_bridge/status", kind, hear, queue_size=100)
        for name in self.about["modules"]:
            self.eventually(
                lambda name=name: name in statuses and WAITS in statuses[name].message,
                f"~status never said that the actuators of {name} wait to be armed",
            )
            self.assertFalse(statuses[name].armed)
            self.assertFalse(statuses[name].unchecked)
            self.assertIn(statuses[name].mode, ("AC", "SC"))
            self.assertGreater(statuses[name].stamp.to_nsec(), 0)


if __name__ == "__main__":
    rospy.init_node("standing_by")
    rostest.rosrun("@NAME@", "standing_by", StandingBy, sys.argv)
'''
