"""Target `ros1`: the package.

Purpose: the package of target `posix` in a folder of its own, and around it the bridge and what
catkin wants. Which topics may be bridged is decided here: those that meet the world, each mapped.
Non-goals: what a mapping may say (`soter.mapping`), compiling.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.native.build import RUNTIME
from soter.targets import c99
from soter.targets.bridged_topics import bridged_topics, unsaid
from soter.targets.c99 import c99_package
from soter.targets.package import Package, PackageFile
from soter.targets.posix import nodes_of, posix_package
from soter.targets.ros1.catkin_files import (
    SIMULATED,
    TRUSTED,
    CatkinPackage,
    catkin_files,
    package_name,
)
from soter.targets.ros1.node_sources import NodeSources
from soter.targets.world_interface import WorldTables

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap

BRIDGE, SIMULATION, MESSAGES = "soter_bridge.hpp", "soter_simulation.hpp", "soter_messages.hpp"
TOPIC = re.compile(r"[~/]?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
"""What a topic of ROS 1 may be called."""
OTHER_MAINS = frozenset(("main.c", "soter_main.c", "soter_virtual.c"))


def ros1_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """The package; SoterError D015 where the mapping does not fit.

    `mapping`: which topic is which message; of a system that meets the world all that comes in has
    to be there. Of one with its plants inside there is only the node under /clock.
    """
    mapped = bridged_topics(system, mapping, "ROS", TOPIC)
    trusted = posix_package(system, core, folder) if system.externals else Package(folder)
    unit = generate(system, core, apart=frozenset(x.index for x in nodes_of(system)))
    world = WorldTables(system, unit)
    simulated = c99_package(system, core, folder)
    name = package_name(unit.prefix)
    sources = [
        f"{SIMULATED}/{f.path}"
        for f in simulated.files
        if f.path.endswith(".c") and f.path not in OTHER_MAINS
    ]
    about = CatkinPackage(
        system,
        name,
        c99.command_name(unit.prefix),
        {n: _sources(words) for n, words in trusted.programs.items()},
        sources,
        [*mapped.values()],
        actuated=bool(world.granted) and bool(system.externals),
    )
    nodes = NodeSources(system, unit, world, name, mapped)
    package = Package(folder)
    package.files = [_in_folder(TRUSTED, f) for f in trusted.files]
    package.files += [_in_folder(SIMULATED, f) for f in simulated.files if _is_code(f)]
    package.files += [
        PackageFile(f"src/{name}_topics.hpp", nodes.topics()),
        PackageFile(f"src/{name}_simulation.cpp", nodes.simulation()),
        *(_shipped(n) for n in (MESSAGES, SIMULATION)),
        *catkin_files(about),
    ]
    if system.externals:
        package.files += [
            PackageFile(f"src/{name}_bridge.cpp", nodes.bridge()),
            _shipped(BRIDGE),
        ]
    package.trusted = TRUSTED if system.externals else SIMULATED
    package.programs = {n: [_inside(w) for w in words] for n, words in trusted.programs.items()}
    package.notes = [*(trusted.notes or simulated.notes), *unsaid(system, mapped, "in ROS")]
    launch = name if system.externals else f"{name}_simulation"
    package.commands = [
        f"cmake -S {folder} -B {folder}/build && cmake --build {folder}/build",
        f"roslaunch {name} {launch}.launch   (in a catkin workspace)",
    ]
    return package


def _shipped(name: str) -> PackageFile:
    return PackageFile(f"src/{name}", (RUNTIME / "ros1" / name).read_text("utf-8"))


def _in_folder(folder: str, file: PackageFile) -> PackageFile:
    return PackageFile(f"{folder}/{file.path}", file.text, file.yours)


def _is_code(file: PackageFile) -> bool:
    """What the simulation needs of the package of target `c`."""
    return file.path.endswith((".c", ".h")) and file.path not in OTHER_MAINS


def _sources(words: list[str]) -> list[str]:
    """The C files of a program, as paths in the package."""
    return [f"{TRUSTED}/{w}" for w in words if w.endswith(".c")]


def _inside(word: str) -> str:
    """A flag or source of a program of the trusted folder, seen from the package."""
    if word.startswith("-I"):
        return f"-I{TRUSTED}/{word[2:]}" if word != "-I." else f"-I{TRUSTED}"
    return f"{TRUSTED}/{word}" if word.endswith(".c") else word
