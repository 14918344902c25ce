"""Makes targets `ros1` and `ros2`: packages with files for catkin and ament, and their tests.

Purpose: `ros1_package` and `ros2_package` put around the package of target `posix`, which has a
folder of its own, the bridge and what catkin or ament wants: manifest, CMake, launch files,
parameters; and the simulation under /clock. With catkin it builds in a workspace, and with plain
CMake where ROS comes from the distribution (pkg-config), as on Debian. A test starts the nodes
beside one that stands in for the sensors: `test/stand_ins.json` is the person's to change, as its
values are of no robot. Only topics that meet the world are bridged, each mapped.
Non-goals: the robot; AC, whose topics stay silent in the test; what a mapping may say
(`soter.mapping`); compiling.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    RecordType,
    Type,
    Value,
    leaves,
)
from soter.mapping.topic_mapping import Leaf, LogMap, NearestSource, SignalSource, TopicMap
from soter.native.shared_library import RUNTIME
from soter.targets import TRUSTED
from soter.targets.bridge_base import (
    BridgedSystem,
    bridged_topics,
    moved_into_folder,
    promise_notes,
    unmapped_notes,
)
from soter.targets.c99 import c99_package
from soter.targets.package import Package, PackageFile, filled_file, shipped_file
from soter.targets.ros_sources import NodeSources, message_files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import Module, System


NEEDED = {
    1: ("roscpp", "diagnostic_msgs", "rosgraph_msgs", "std_msgs"),
    2: ("rclcpp", "diagnostic_msgs", "builtin_interfaces", "rosgraph_msgs", "std_msgs"),
}
"""The packages that every bridge needs, by version of ROS."""
FOLDER = {1: "catkin", 2: "ament"}
"""The folder of the templates, by version of ROS."""
LAUNCH = {1: (".launch", ".launch.xml"), 2: (".launch.py", ".launch.py")}
"""The endings of launch files, and of their templates, by version of ROS."""


@dataclass(frozen=True)
class RosPackage:
    """The values for the templates; `simulated`: sources of the simulation, beside its node."""

    version: int
    name: str
    bridged: BridgedSystem
    simulated: list[str]
    mapped: list[TopicMap]
    patience_s = 1_000_000_000
    """How long the trusted part waits for its sensors: practically for ever."""

    @property
    def packages(self) -> list[str]:
        """The ROS packages whose messages are used, and those that every bridge needs."""
        used = {m.message.package for m in self.mapped if m.message}
        return sorted({*NEEDED[self.version], *used})

    @property
    def installed(self) -> list[str]:
        """The programs that the package installs."""
        programs = self.bridged.trusted_programs
        bridge = [*programs, f"{self.name}_bridge"] if programs else []
        return [*bridge, f"{self.name}_simulation"]

    @property
    def scripts(self) -> list[str]:
        """The scripts that start the trusted programs and that arm the actuators."""
        return ["scripts/in_channels", *(["scripts/arm"] if self.bridged.has_actuators else [])]

    def template_file(self, path: str, template: str, **more: object) -> PackageFile:
        """A file of the package, filled from a template."""
        return filled_file(
            path, f"ros/{template}", p=self, name=self.name, bridged=self.bridged, **more
        )


def ros_files(p: RosPackage, *, tested: bool) -> list[PackageFile]:
    """The build and launch files; `tested` says whether a catkin package has a `test/` folder."""
    folder, (end, template) = FOLDER[p.version], LAUNCH[p.version]
    files = [
        p.template_file("package.xml", "package.xml"),
        p.template_file("CMakeLists.txt", f"{folder}/CMakeLists.txt", tested=tested),
        replace(p.template_file("config/parameters.yaml", f"{folder}/parameters.yaml"), yours=True),
        p.template_file(f"launch/{p.name}_simulation{end}", f"{folder}/simulation{template}"),
    ]
    if p.bridged.trusted_programs:
        files.append(p.template_file(f"launch/{p.name}{end}", f"{folder}/bridge{template}"))
        files += [p.template_file(path, f"{path.rpartition('/')[2]}.sh") for path in p.scripts]
    if p.bridged.trusted_programs and p.version == 2:
        files.append(p.template_file(f"test/test_{p.name}.py", f"{folder}/test.py"))
    return files


def ros_package_name(prefix: str) -> str:
    """A name that catkin accepts: lower-case letters, digits and underscores, a letter first."""
    name = re.sub(r"[^a-z0-9_]", "_", prefix.lower())
    return name if name[:1].isalpha() else f"soter_{name}"


RAYS = 36


def why_untested(p: RosPackage) -> str:
    """The reason why the package has no test, in words; "" if it has one."""
    if not p.bridged.has_actuators:
        return "no actuators obey"
    if not _awaited_topics(p):
        return "nothing comes in but for ACs"
    several = _publishers(p)
    if several[1:]:
        names = ", ".join(f"`{name}`" for name in several)
        return f"one node stands in for the sensors, and the mapping asks for {names}"
    return ""


def _publishers(p: RosPackage) -> list[str]:
    return sorted({m.publisher.strip("/") for m in _awaited_topics(p) if m.publisher})


def rostest_files(p: RosPackage) -> list[PackageFile]:
    """The files of a catkin package's test; none if `why_untested` gives a reason."""
    if why_untested(p):
        return []
    document = json.dumps(_test_document(p), indent=1) + "\n"
    publisher = next(iter(_publishers(p)), "standing_by")
    return [
        p.template_file(f"test/{p.name}.test", "catkin/test.launch.xml", publisher=publisher),
        p.template_file("test/standing_by.py", "catkin/standing_by.py"),
        PackageFile("test/stand_ins.json", document, yours=True),
    ]


def _awaited_topics(p: RosPackage) -> list[TopicMap]:
    """The incoming topics for which the trusted part waits, without those that only ACs read."""
    return [m for m in p.mapped if p.bridged.world.is_awaited(m.topic)]


def _test_document(p: RosPackage) -> dict[str, object]:
    granted = [g.module for g in p.bridged.world.granted]
    laws = [
        _expected_fields(m, module.law[m.topic.index])
        for m in p.mapped
        for module in granted
        if m.topic.index in module.law and _expected_fields(m, module.law[m.topic.index])
    ]
    return {
        "about": "what stands in for the sensors, and the fail-safe law; change values as you like",
        "stand_ins": [_stand_in(m) for m in _awaited_topics(p)],
        "laws": laws,
        "modules": [m.name for m in granted],
        "of_silent_ac": [m.name for m in granted if _is_ac_silent(p, m)],
    }


def _is_ac_silent(p: RosPackage, module: Module) -> bool:
    """Whether AC of the module waits for a topic that nothing in the test publishes."""
    ac = p.bridged.system.components[module.ac]
    topics = [p.bridged.topic(i) for i in ac.reads] if ac.node is not None else []
    return any(t.driver == "input" and not p.bridged.world.is_awaited(t) for t in topics)


# ---------------------------------------------------------------- values


def _stand_in(m: TopicMap) -> dict[str, object]:
    assert m.message is not None
    fields: dict[str, object] = {}
    for (path, t), value, bound in zip(
        leaves(m.topic.type), _leaves_of(m.topic.type, m.topic.default), m.topic.bounds, strict=True
    ):
        leaf = m.leaves[path]
        if isinstance(leaf, NearestSource):
            fields |= _ring_scan(leaf)
        elif isinstance(leaf, SignalSource):
            high = math.inf if bound is None else bound.high
            fields[leaf.name] = _message_field(t, leaf, _value_off_default(t, value, high))
    if m.frame_id is not None:
        fields["header.frame_id"] = m.frame_id
    stamp = [] if m.stamp is None else [m.stamp.path, _unit_ns(m)]
    return {"topic": m.channel, "type": m.message.ros1, "stamp": stamp, "fields": fields}


def _unit_ns(m: TopicMap) -> float:
    """The unit in ns of a numeric stamp; 0 if the stamp is a time."""
    assert m.stamp is not None
    return float(m.stamp.unit_ns) if m.stamp.kind == "number" else 0.0


def _value_off_default(t: Type, value: Value, high: float) -> Value:
    """A value of the set that differs from the default, which is often the fail-safe law."""
    if not isinstance(t, FloatType) or not math.isfinite(high):
        return value
    assert isinstance(value, float)
    return value + (high - value) / 8.0


def _ring_scan(leaf: NearestSource) -> dict[str, object]:
    """The fields of a scan of one full turn that sees nothing near."""
    step = 2.0 * math.pi / RAYS
    far = 2.0 * leaf.most
    ends = {"angle_min": -math.pi, "angle_max": math.pi - step, "angle_increment": step}
    return {**ends, "range_min": 0.01, "range_max": 2.0 * far, "ranges": [far] * RAYS}


def _expected_fields(m: TopicMap, law: Value) -> dict[str, object]:
    """The fields of a message that holds the law's value; {} if no field is a number."""
    assert m.message is not None
    fields = {
        leaf.name: _message_field(t, leaf, value)
        for (path, t), value in zip(
            leaves(m.topic.type), _leaves_of(m.topic.type, law), strict=True
        )
        if isinstance(leaf := m.leaves[path], SignalSource)
    }
    return {"topic": m.channel, "type": m.message.ros1, "fields": fields} if fields else {}


def _message_field(t: Type, leaf: Leaf, value: Value) -> object:
    assert isinstance(leaf, SignalSource)
    if isinstance(t, BoolType):
        return bool(value)
    if isinstance(t, EnumType):
        return t.members[int(value)]
    if isinstance(t, FloatType):
        return (float(value) - leaf.offset) / leaf.scale
    return int(value)


def _leaves_of(t: Type, value: Value) -> Iterator[Value]:
    if isinstance(t, RecordType):
        for (_, kind), part in zip(t.fields, value, strict=True):
            yield from _leaves_of(kind, part)
    elif isinstance(t, ArrayType):
        for part in value:
            yield from _leaves_of(t.element, part)
    else:
        yield value


SIMULATED = "simulated"
"""The folder of the program that runs under /clock."""
TOPIC = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
"""The names of ROS 1 topics; NodeHandles take no `~`."""
OTHER_MAINS = frozenset(("main.c", "soter_main.c", "soter_virtual.c"))
SIMULATION = ("soter_messages.hpp", "soter_simulation.hpp")
OF_ROS = {1: ("ros1", SIMULATION), 2: ("ros2", (*SIMULATION, "soter_publishers.hpp"))}
"""The folder of the C++ that ships, and its files for the simulation, by version of ROS."""
OF_BOTH = (
    "soter_scan.hpp", "soter_sources.hpp", "soter_stamp_numbers.h", "soter_simulation_core.hpp",
)  # fmt: skip


def ros1_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """Makes the ROS 1 package; raises SoterError D015 if the mapping does not fit.

    `mapping` says which topic is which message. If the system meets the world, the mapping needs
    all incoming topics. A system with its plants inside gets only the node under /clock.
    """
    package, ros = _package_and_values(system, core, folder, mapping, 1)
    why = why_untested(ros)
    package.files += ros_files(ros, tested=not why)
    if system.externals:
        package.files += [*rostest_files(ros), *message_files(ros.name)]
    if system.externals and why:
        package.notes.append(f"there is no `test/`: {why}")
    launch = ros.name if system.externals else f"{ros.name}_simulation"
    package.commands = [
        f"cmake -S {folder} -B {folder}/build && cmake --build {folder}/build",
        f"roslaunch {ros.name} {launch}.launch   (in a catkin workspace)",
    ]
    return package


def ros2_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """Makes the ROS 2 package; parameters and errors are as for `ros1_package`."""
    package, ros = _package_and_values(system, core, folder, mapping, 2)
    package.files += ros_files(ros, tested=True)
    launch = ros.name if system.externals else f"{ros.name}_simulation"
    package.commands = [
        f"colcon build --packages-select {ros.name}   (in a workspace of ROS 2)",
        f"ros2 launch {ros.name} {launch}.launch.py",
    ]
    return package


def _package_and_values(
    system: System, core: CoreSystem, folder: Path, mapping: LogMap, version: int
) -> tuple[Package, RosPackage]:
    """The package without build-system files, and the template values for these files."""
    mapped = bridged_topics(system, mapping, "ROS", TOPIC)
    bridged = BridgedSystem(system, core, folder)
    simulated = c99_package(system, core, folder)
    name = ros_package_name(bridged.unit.prefix)
    nodes = NodeSources(bridged, name, mapped, version)
    of_version, of_simulation = OF_ROS[version]
    code = [
        moved_into_folder(SIMULATED, f)
        for f in simulated.files
        if f.path.endswith((".c", ".h")) and f.path not in OTHER_MAINS
    ]
    files = [
        *bridged.trusted_files(),
        *code,
        PackageFile(f"src/{name}_topics.hpp", nodes.topics_text()),
        PackageFile(f"src/{name}_simulation.cpp", nodes.simulation_text()),
        *(shipped_file(RUNTIME / of_version / n, "src/") for n in of_simulation),
        *(shipped_file(RUNTIME / "bridge" / n, "src/") for n in OF_BOTH),
    ]
    if system.externals:
        files += [
            PackageFile(f"src/{name}_bridge.cpp", nodes.bridge_text()),
            shipped_file(RUNTIME / of_version / "soter_bridge.hpp", "src/"),
            shipped_file(RUNTIME / "bridge" / "soter_bridge_core.hpp", "src/"),
        ]
    package = Package(
        folder,
        files,
        notes=[
            *(bridged.trusted.notes or simulated.notes),
            *unmapped_notes(system, mapped, "in ROS"),
            *promise_notes(system, mapped),
        ],
        programs=bridged.trusted_programs,
        trusted=TRUSTED if system.externals else SIMULATED,
    )
    sources = [f.path for f in code if f.path.endswith(".c")]
    return package, RosPackage(version, name, bridged, sources, [*mapped])
