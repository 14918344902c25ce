"""Targets `ros1` and `ros2`: the packages.

Purpose: the package of target `posix` in a folder of its own, and around it the bridge and what
catkin or ament wants; of ROS 1 the simulation, too. Which topics may be bridged is decided here:
those that meet the world, each mapped.
Non-goals: what a mapping may say (`soter.mapping`), compiling.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.build import RUNTIME
from soter.targets.bridged_system import TRUSTED, BridgedSystem, in_folder, shipped
from soter.targets.bridged_topics import bridged_topics, unsaid
from soter.targets.c99 import c99_package
from soter.targets.package import Package, PackageFile
from soter.targets.ros.ament_files import ament_files
from soter.targets.ros.catkin_files import (
    SIMULATED,
    RosPackage,
    catkin_files,
    package_name,
)
from soter.targets.ros.node_sources import ROS2, NodeSources

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap

CORE = "soter_bridge_core.hpp"
BRIDGE, SIMULATION = "soter_bridge.hpp", "soter_simulation.hpp"
MESSAGES, SCAN, STAMPS = "soter_messages.hpp", "soter_scan.hpp", "soter_stamp_numbers.hpp"
TOPIC = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
"""What a topic of ROS 1 may be called: NodeHandles take no `~`."""
OTHER_MAINS = frozenset(("main.c", "soter_main.c", "soter_virtual.c"))


def ros1_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """The package; SoterError D015 where the mapping does not fit.

    `mapping`: which topic is which message; of a system that meets the world all that comes in has
    to be there. Of one with its plants inside there is only the node under /clock.
    """
    mapped = bridged_topics(system, mapping, "ROS", TOPIC)
    bridged = BridgedSystem(system, core, folder)
    simulated = c99_package(system, core, folder)
    name = package_name(bridged.unit.prefix)
    sources = [
        f"{SIMULATED}/{f.path}"
        for f in simulated.files
        if f.path.endswith(".c") and f.path not in OTHER_MAINS
    ]
    nodes = NodeSources(bridged, name, mapped)
    package = Package(folder)
    package.files = bridged.files()
    package.files += [in_folder(SIMULATED, f) for f in simulated.files if _is_code(f)]
    package.files += [
        PackageFile(f"src/{name}_topics.hpp", nodes.topics()),
        PackageFile(f"src/{name}_simulation.cpp", nodes.simulation()),
        *(shipped(RUNTIME / "ros1", n) for n in (MESSAGES, SIMULATION)),
        *(shipped(RUNTIME / "bridge", n) for n in (SCAN, STAMPS)),
        *catkin_files(RosPackage(name, bridged, sources, [*mapped.values()])),
    ]
    if system.externals:
        package.files += [
            PackageFile(f"src/{name}_bridge.cpp", nodes.bridge()),
            shipped(RUNTIME / "ros1", BRIDGE),
            shipped(RUNTIME / "bridge", CORE),
        ]
    package.trusted = TRUSTED if system.externals else SIMULATED
    package.programs = bridged.programs
    package.notes = [*(bridged.trusted.notes or simulated.notes), *unsaid(system, mapped, "in ROS")]
    launch = name if system.externals else f"{name}_simulation"
    package.commands = [
        f"cmake -S {folder} -B {folder}/build && cmake --build {folder}/build",
        f"roslaunch {name} {launch}.launch   (in a catkin workspace)",
    ]
    return package


def ros2_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """The package; SoterError D015 where the mapping does not fit, U001 with plants inside."""
    if not system.externals:
        what = f"`{system.name}` meets no world: with its plants inside there is nothing to bridge"
        helps = ("`system S deploys ... { external topic t; ... }` (docs/deploy.md)",)
        raise SoterError((Diagnostic("U001", what, helps=helps),))
    mapped = bridged_topics(system, mapping, "ROS", TOPIC)
    bridged = BridgedSystem(system, core, folder)
    name = package_name(bridged.unit.prefix)
    nodes = NodeSources(bridged, name, mapped, flavour=ROS2)
    package = Package(folder)
    package.files = bridged.files()
    package.files += [
        PackageFile(f"src/{name}_topics.hpp", nodes.topics()),
        PackageFile(f"src/{name}_bridge.cpp", nodes.bridge()),
        *(shipped(RUNTIME / "ros2", n) for n in (MESSAGES, BRIDGE)),
        *(shipped(RUNTIME / "bridge", n) for n in (CORE, SCAN, STAMPS)),
        *ament_files(RosPackage(name, bridged, [], [*mapped.values()])),
    ]
    package.trusted = TRUSTED
    package.programs = bridged.programs
    package.notes = [*bridged.trusted.notes, *unsaid(system, mapped, "in ROS")]
    package.notes.append("the bridge was checked against interfaces of ROS 2, and run on none")
    package.commands = [
        f"colcon build --packages-select {name}   (in a workspace of ROS 2)",
        f"ros2 launch {name} {name}.launch.py",
    ]
    return package


def _is_code(file: PackageFile) -> bool:
    """What the simulation needs of the package of target `c`."""
    return file.path.endswith((".c", ".h")) and file.path not in OTHER_MAINS
