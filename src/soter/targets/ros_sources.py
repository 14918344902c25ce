"""Generates C++ for ROS: traits that map topics to messages, `ModuleStatus`, mains of nodes.

Purpose: `NodeSources` writes `NAME_topics.hpp`, traits for each mapped topic; `NAME_bridge.cpp`,
the node between ROS and the channels of the trusted part; `NAME_simulation.cpp`, the node under
/clock. `message_files` writes, for ROS 1, `msg/ModuleStatus.msg` and the same as a class of roscpp,
so that the bridge needs no generator of messages; the MD5 sum is that of the file.
Non-goals: what is done with them (`runtime/bridge/`, `runtime/ros1/`, `runtime/ros2/`).
"""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING

from soter.mapping.message_types import HEADER_STAMP, MessageType, StampSource
from soter.mapping.topic_mapping import NearestSource, SourcePromise, TopicMap
from soter.report.templates import filled
from soter.targets.bridge_base import BridgedSystem, qos_problems, sources_by_topic
from soter.targets.message_conversion import (
    CPP,
    MessageConverter,
    text_literal,
    topic_tests,
    unmappable,
)
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from collections.abc import Sequence


MESSAGE = "ModuleStatus"
FIELDS = (
    ("time", "stamp", "when this was so"),
    ("string", "module", ""),
    ("string", "mode", "AC or SC; empty: the trusted part is silent"),
    ("float64", "margin", "s from then on that AC surely keeps control; 0 in mode SC"),
    ("uint64", "takeovers", "of SC, since the trusted part began"),
    ("string", "why", "SC took over last: never, ttf, what the DM reads is old, the gate, ..."),
    ("bool", "armed", "false: its actuators hold the fail-safe law until armed, or are silent"),
    ("bool", "unchecked", "they were armed without a look at the state"),
    ("string", "message", "the sentence of /diagnostics"),
)
"""The type, name and meaning of each field of the message."""
MEMBERS = {
    "time": "ros::Time {}",
    "string": "std::string {}",
    "float64": "double {} = 0.0",
    "uint64": "uint64_t {} = 0U",
    "bool": "uint8_t {} = 0U",
}
"""The declaration of a field in the class of roscpp, by the field's type."""


def message_definition() -> str:
    """The text of `ModuleStatus.msg`."""
    rows = [(f"{kind} {name}", about) for kind, name, about in FIELDS]
    lines = [f"{row:<18}# {about}" if about else row for row, about in rows]
    head = "# How a module is: written by the bridge on ~status, at each change and once a second."
    return "\n".join([head, *lines, ""])


def message_md5() -> str:
    """The MD5 sum of the message as genmsg computes it: of the fields alone."""
    text = "\n".join(f"{kind} {name}" for kind, name, _ in FIELDS)
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def message_files(package: str) -> list[PackageFile]:
    """The files of the message `ModuleStatus` of a package, with its C++ code."""
    return [
        PackageFile(f"msg/{MESSAGE}.msg", message_definition()),
        PackageFile(f"src/{package}_module_status.hpp", _message_class(package)),
    ]


def _message_class(package: str) -> str:
    lines = message_definition().splitlines()
    assert not any(mark in line for line in lines for mark in '"\\'), "they go into literals of C"
    return filled(
        "targets/ros/module_status.hpp.j2",
        package=package,
        fields=FIELDS,
        members=MEMBERS,
        md5_sum=message_md5(),
        data_type=text_literal(f"{package}/{MESSAGE}"),
        definition=lines,
    )


def include_path(message: MessageType, version: int) -> str:
    """The path of a message's C++ header, as an `#include` names it."""
    if version == 1:
        return f"{message.package}/{message.name}.h"
    return f"{message.package}/msg/{snake_case(message.name)}.hpp"


def snake_case(name: str) -> str:
    """A name as rosidl writes it in the header of a message: laser_scan for LaserScan."""
    name = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", name)
    return re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name).lower()


class NodeSources:
    """Writes the nodes of a system; `mapped` has an entry for each source of each topic."""

    def __init__(
        self, bridged: BridgedSystem, name: str, mapped: Sequence[TopicMap], version: int
    ) -> None:
        self.version = version
        self.bridged = bridged
        self.name = name
        self.mapped = mapped

    def topics_text(self) -> str:
        """The text of `NAME_topics.hpp`."""
        messages = [m.message for m in self.mapped if m.message]
        return self._filled_template(
            "topics.hpp",
            headers=sorted({include_path(message, self.version) for message in messages}),
            shared=[
                self._shared_values(sources) for sources in sources_by_topic(self.mapped).values()
            ],
        )

    def bridge_text(self) -> str:
        """The text of `NAME_bridge.cpp`."""
        world = self.bridged.world
        return self._filled_template(
            "bridge.cpp",
            status_number=f"{world.status_number:#018x}",
            actuators_number=f"{world.actuators_number:#018x}",
            names=[
                [m.name for m in self.bridged.system.modules],
                [g.module.name for g in world.granted],
                [world.names[t.index] for t in world.topics],
            ],
        )

    def simulation_text(self) -> str:
        """The text of `NAME_simulation.cpp`."""
        return self._filled_template("simulation.cpp")

    def _filled_template(self, template: str, **more: object) -> str:
        return filled(
            f"targets/ros/{template}.j2",
            name=self.name,
            bridged=self.bridged,
            version=self.version,
            topics=[self._topic_values(m) for m in self.mapped],
            **more,
        )

    # ------------------------------------------------------------ a topic

    def _struct_name(self, index: int) -> str:
        names = self.bridged.world.names[index].split("_")
        return "".join(part.capitalize() for part in names)

    def _shared_values(self, sources: list[tuple[TopicMap, SourcePromise]]) -> dict[str, object]:
        """The template's values for the traits that all sources of one topic share."""
        topic = sources[0][0].topic
        return {
            "topic": topic.name,
            "capitals": self._struct_name(topic.index),
            "value": self.bridged.value_type(topic.index),
            "after_ns": [promise.after_ns for _, promise in sources],
            "tests": topic_tests(topic),
        }

    def _topic_values(self, mapped: TopicMap) -> dict[str, object]:
        """The template's values for the traits of a topic, or of a single source of the topic."""
        index, version, message = mapped.topic.index, self.version, mapped.message
        if message is None or not message.exists_in(version):
            named = message.ros1 if message else "no type"
            raise unmappable(
                f"`{mapped.topic.name}` has `{named}`, which ROS {version} does not know"
            )
        inward = self.bridged.is_inward(index)
        rank = None if mapped.promise is None else mapped.promise.rank
        capitals = self._struct_name(index)
        number = "" if rank is None else str(rank + 1)
        return {
            "topic": mapped.topic.name,
            "index": index,
            "inward": inward,
            "rank": rank,
            "struct": f"{capitals}{'In' if inward else 'Out'}{number}",
            "shared": "soter::OneSource" if rank is None else f"{capitals}Sources",
            "ros1": message.ros1,
            "message": f"{message.package}::{'msg::' if version == 2 else ''}{message.name}",
            "value": self.bridged.value_type(index),
            "file": self.bridged.world.names[index],
            "hash": self.bridged.channel_hash(index),
            "channel": mapped.channel,
            "qos": _qos_code(mapped, inward=inward) if version == 2 else "",
            **(self._inward_values(mapped) if inward else self._outward_values(mapped, message)),
        }

    def _inward_values(self, mapped: TopicMap) -> dict[str, object]:
        converter = MessageConverter(mapped, self.version, CPP, "m")
        scanned = any(isinstance(x, NearestSource) for x in mapped.leaves.values())
        frame = mapped.frame_id
        return {
            "publisher": text_literal(mapped.publisher or ""),
            "frame": "true" if frame is None else f"m.header.frame_id == {text_literal(frame)}",
            "stamped": "true" if mapped.stamp else "false",
            "delay_ns": mapped.delay_ns,
            "stamp": _stamp_code(mapped.stamp, converter, scanned=scanned),
            "lines": converter.inward_statements(),
        }

    def _outward_values(self, mapped: TopicMap, message: MessageType) -> dict[str, object]:
        lines = MessageConverter(mapped, self.version, CPP, "(*m)").outward_statements()
        if message.has_header:
            lines.append("(*m).header.stamp = soter::stamp_of(stamp_ns);")
        return {
            "lines": lines,
            "law": self.bridged.law_statements(mapped.topic.index),
            "silent_ns": self.bridged.silent_ns(mapped.topic.index),
        }


def _qos_code(mapped: TopicMap, *, inward: bool) -> str:
    """The C++ expression of the ROS 2 QoS; raises SoterError D015 if the QoS is not allowed."""
    qos = mapped.qos
    for problem in qos_problems(mapped, inward=inward):
        raise unmappable(problem)
    depth = 1 if qos.depth is None else qos.depth
    history = f"KeepLast({depth}U)" if depth else "KeepAll()"
    reliability = qos.reliability or ("best_effort" if inward else "reliable")
    kept = ".transient_local()" if qos.durability == "transient_local" else ""
    return f"rclcpp::QoS(rclcpp::{history}).{reliability}(){kept}"


def _stamp_code(stamp: StampSource | None, converter: MessageConverter, *, scanned: bool) -> str:
    """The C++ expression of the time, in ns, at which a message says that it was measured.

    A scan is stamped with its first ray, and what is nearest in it is as old as the last one.
    """
    if stamp is None:
        return "0"
    if scanned and stamp.path == HEADER_STAMP:
        return "soter::last_ray_ns(m, soter::ns_of(m.header.stamp))"
    if stamp.kind == "time":
        return f"soter::ns_of({converter.field_code(stamp.path)})"
    return converter.number_stamp_code(stamp)
