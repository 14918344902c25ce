"""Targets `ros1` and `ros2`: the packages.

Purpose: the package of target `posix` in a folder of its own, and around it the bridge and what
catkin or ament wants; and the simulation under /clock. Which topics may be bridged is decided here:
those that meet the world, each mapped.
Non-goals: what a mapping may say (`soter.mapping`), compiling.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.native.shared_library import RUNTIME
from soter.targets.bridge_base import (
    TRUSTED,
    BridgedSystem,
    bridged_topics,
    compared,
    in_folder,
    shipped,
    unsaid,
)
from soter.targets.c99 import c99_package
from soter.targets.package import Package, PackageFile
from soter.targets.ros.node_sources import NodeSources, message_files
from soter.targets.ros.ros_files import RosPackage, package_name, ros_files
from soter.targets.ros.rostest_files import rostest_files, untested

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap

SIMULATED = "simulated"
"""The folder of the program under /clock."""
TOPIC = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
"""What a topic of ROS 1 may be called: NodeHandles take no `~`."""
OTHER_MAINS = frozenset(("main.c", "soter_main.c", "soter_virtual.c"))
SIMULATION = ("soter_messages.hpp", "soter_simulation.hpp")
OF_ROS = {
    1: ("ros1", SIMULATION),
    2: ("ros2", (*SIMULATION, "soter_publishers.hpp")),
}
"""By the version: the folder of what ships, and what of it the simulation needs."""
OF_BOTH = (
    "soter_scan.hpp", "soter_sources.hpp", "soter_stamp_numbers.h", "soter_simulation_core.hpp",
)  # fmt: skip


def ros1_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """The package; SoterError D015 where the mapping does not fit.

    `mapping`: which topic is which message; of a system that meets the world all that comes in has
    to be there. Of one with its plants inside there is only the node under /clock.
    """
    package, ros = _package(system, core, folder, mapping, 1)
    why = untested(ros)
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
    """The package; as `ros1_package`."""
    package, ros = _package(system, core, folder, mapping, 2)
    package.files += ros_files(ros, tested=True)
    package.notes.append("the nodes were checked against interfaces of ROS 2, and run on none")
    launch = ros.name if system.externals else f"{ros.name}_simulation"
    package.commands = [
        f"colcon build --packages-select {ros.name}   (in a workspace of ROS 2)",
        f"ros2 launch {ros.name} {launch}.launch.py",
    ]
    return package


def _package(
    system: System, core: CoreSystem, folder: Path, mapping: LogMap, version: int
) -> tuple[Package, RosPackage]:
    """All but what a build system wants, and what that is about."""
    mapped = bridged_topics(system, mapping, "ROS", TOPIC)
    bridged = BridgedSystem(system, core, folder)
    simulated = c99_package(system, core, folder)
    name = package_name(bridged.unit.prefix)
    nodes = NodeSources(bridged, name, mapped, version)
    own, of_simulation = OF_ROS[version]
    package = Package(folder)
    package.files = bridged.files()
    package.files += [in_folder(SIMULATED, f) for f in simulated.files if _is_code(f)]
    package.files += [
        PackageFile(f"src/{name}_topics.hpp", nodes.topics()),
        PackageFile(f"src/{name}_simulation.cpp", nodes.simulation()),
        *(shipped(RUNTIME / own, n) for n in of_simulation),
        *(shipped(RUNTIME / "bridge", n) for n in OF_BOTH),
    ]
    if system.externals:
        package.files += [
            PackageFile(f"src/{name}_bridge.cpp", nodes.bridge()),
            shipped(RUNTIME / own, "soter_bridge.hpp"),
            shipped(RUNTIME / "bridge", "soter_bridge_core.hpp"),
        ]
    package.trusted = TRUSTED if system.externals else SIMULATED
    package.programs = bridged.programs
    package.notes = [*(bridged.trusted.notes or simulated.notes), *unsaid(system, mapped, "in ROS")]
    package.notes += compared(system, mapped)
    sources = [
        f"{SIMULATED}/{f.path}" for f in simulated.files if f.path.endswith(".c") and _is_code(f)
    ]
    return package, RosPackage(version, name, bridged, sources, [*mapped])


def _is_code(file: PackageFile) -> bool:
    """What the simulation needs of the package of target `c`."""
    return file.path.endswith((".c", ".h")) and file.path not in OTHER_MAINS
