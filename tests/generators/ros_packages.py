"""Packages of the targets `ros1` and `ros2` and nodes beside them, made and built for tests.

Purpose: what cmake and g++ have built of exactly these files, with this compiler and this ROS, is
kept in Soter's cache, as what `make` has (`c_packages.py`). `EITHER`: the modules of the two, each
skipped where its ROS is not here.
Non-goals: what is in them; who runs (`bench/ros/ros1_nodes.py`, `ros2_nodes.py`).
"""

from __future__ import annotations

import os
import shutil
from functools import cache
from typing import TYPE_CHECKING

import pytest
from bench.ros import ros1_nodes, ros2_nodes

import processes
import soter
from generators.c_packages import made_or_kept

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


def here(ros: ModuleType) -> pytest.MarkDecorator:
    """Skips what is marked where this ROS is not here."""
    why = ros.missing()
    return pytest.mark.skipif(bool(why), reason=f"ROS {ros.VERSION} is not here: {why}")


EITHER = [pytest.param(m, id=f"ROS {m.VERSION}", marks=here(m)) for m in (ros1_nodes, ros2_nodes)]


def built_package(ros: ModuleType, example: Path, system: str, mapping: Path, folder: Path) -> Path:
    """The package of a system, compiled: the folder of its programs."""
    soter.load(example).build(f"ros{ros.VERSION}", folder, system, mapping=mapping)
    commands = [["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]]
    if ros is ros2_nodes:
        commands = [*ros2_nodes.build_commands("."), ros2_nodes.INSTALL]
    made_or_kept(f"ros{ros.VERSION}-package", folder, commands, tools(ros), _is_program)
    return ros2_nodes.installed(folder) if ros is ros2_nodes else folder / "build"


def built_node(ros: ModuleType, name: str, folder: Path) -> Path:
    """A node of `bench/ros`, compiled."""
    for file in (f"{name}.cpp", "either_ros.hpp", "CMakeLists.txt"):
        shutil.copy(ros1_nodes.HERE / file, folder)
    if ros is ros2_nodes:
        commands = ros2_nodes.build_commands(".", f"-DNODE={name}")
    else:
        flags = told("pkg-config", "--cflags", "--libs", *ros1_nodes.PACKAGES).split()
        commands = [
            ["mkdir", "build"],
            ["g++", "-O1", "-o", f"build/{name}", f"{name}.cpp", *flags],
        ]
    made_or_kept(f"ros{ros.VERSION}-node", folder, commands, tools(ros), _is_program)
    return folder / "build" / name


@cache
def tools(ros: ModuleType) -> list[str]:
    """Compiler, cmake and ROS, as they name themselves."""
    words = [["c++", "--version"], ["g++", "--version"], ["cmake", "--version"]]
    if ros is ros2_nodes:
        return [*(told(*w) for w in words), os.environ["AMENT_PREFIX_PATH"]]
    return [told(*w) for w in (*words, ["pkg-config", "--modversion", *ros1_nodes.PACKAGES])]


def told(*words: str) -> str:
    return str(processes.run(list(words), capture_output=True, text=True, check=True).stdout)


def _is_program(path: Path) -> bool:
    """Or of what is installed."""
    program = os.access(path, os.X_OK) and "CMakeFiles" not in path.parts
    return program or "/package/install/" in str(path)
