"""What catkin or ament, their launch files and people want of a package of ROS.

Purpose: the text around the nodes: manifest, CMake, launch files, parameters, a test that starts
them. With catkin it builds in a workspace, and with plain CMake where ROS comes from the
distribution (pkg-config), as on Debian.
Non-goals: the nodes (`node_sources.py`), the trusted part (`targets/posix`), what the test of a
catkin package says and expects (`rostest_files.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.targets.package import filled_file

if TYPE_CHECKING:
    from soter.mapping.topic_mapping import TopicMap
    from soter.targets.bridge_base import BridgedSystem
    from soter.targets.package import PackageFile

NEEDED = {
    1: ("roscpp", "diagnostic_msgs", "rosgraph_msgs", "std_msgs"),
    2: ("rclcpp", "diagnostic_msgs", "builtin_interfaces", "rosgraph_msgs", "std_msgs"),
}
"""By the version of ROS: what every bridge needs."""
FOLDER = {1: "catkin", 2: "ament"}
"""Of the templates."""
LAUNCH = {1: (".launch", ".launch.xml"), 2: (".launch.py", ".launch.py")}
"""How launch files end, and their templates."""


@dataclass(frozen=True)
class RosPackage:
    """What the files are about; `simulated`: sources of the simulation, beside its node."""

    version: int
    name: str
    bridged: BridgedSystem
    simulated: list[str]
    mapped: list[TopicMap]
    patience_s: int = 1_000_000_000
    """How long the trusted part waits for its sensors: for ever."""

    @property
    def packages(self) -> list[str]:
        """Of ROS: whose messages are used, and what every bridge needs."""
        used = {m.message.package for m in self.mapped if m.message}
        return sorted({*NEEDED[self.version], *used})

    @property
    def installed(self) -> list[str]:
        """Its programs."""
        programs = self.bridged.programs
        bridge = [*programs, f"{self.name}_bridge"] if programs else []
        return [*bridge, f"{self.name}_simulation"]

    @property
    def scripts(self) -> list[str]:
        """What starts the programs of the trusted folder, and what arms the actuators."""
        return ["scripts/in_channels", *(["scripts/arm"] if self.bridged.actuated else [])]

    def file(self, path: str, template: str, **more: object) -> PackageFile:
        """One file of it."""
        return filled_file(
            path, f"ros/{template}", p=self, name=self.name, bridged=self.bridged, **more
        )


def ros_files(p: RosPackage, *, tested: bool) -> list[PackageFile]:
    """All of them; `tested`: whether a catkin package has `test/`."""
    folder, (end, template) = FOLDER[p.version], LAUNCH[p.version]
    files = [
        p.file("package.xml", "package.xml"),
        p.file("CMakeLists.txt", f"{folder}/CMakeLists.txt", tested=tested),
        replace(p.file("config/parameters.yaml", f"{folder}/parameters.yaml"), yours=True),
        p.file(f"launch/{p.name}_simulation{end}", f"{folder}/simulation{template}"),
    ]
    if p.bridged.programs:
        files.append(p.file(f"launch/{p.name}{end}", f"{folder}/bridge{template}"))
        files += [p.file(path, f"{path.rpartition('/')[2]}.sh") for path in p.scripts]
    if p.bridged.programs and p.version == 2:
        files.append(p.file(f"test/test_{p.name}.py", f"{folder}/test.py"))
    return files


def package_name(prefix: str) -> str:
    """A name that catkin takes: letters, digits and underscores, in lower case, a letter first."""
    name = re.sub(r"[^a-z0-9_]", "_", prefix.lower())
    return name if name[:1].isalpha() else f"soter_{name}"
