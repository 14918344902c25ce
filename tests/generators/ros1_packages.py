"""Packages of target `ros1` and nodes beside them, made and built for tests.

Purpose: what cmake and g++ have built of exactly these files, with this compiler and this ROS, is
kept in Soter's cache, as what `make` has (`c_packages.py`).
Non-goals: what is in them; a master (`bench/ros/ros1_nodes.py`).
"""

from __future__ import annotations

import os
import shutil
from functools import cache
from typing import TYPE_CHECKING

from bench.ros.ros1_nodes import HERE, PACKAGES

import processes
import soter
from generators.c_packages import made_or_kept

if TYPE_CHECKING:
    from pathlib import Path


def built_package(example: Path, system: str, mapping: Path, folder: Path) -> Path:
    """The package of a system, compiled: the folder of its programs."""
    soter.load(example).build("ros1", folder, system, mapping=mapping)
    commands = [["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]]
    made_or_kept("ros1-package", folder, commands, tools(), _is_program)
    return folder / "build"


def built_node(name: str, folder: Path) -> Path:
    """A node of `bench/ros`, compiled."""
    shutil.copy(HERE / f"{name}.cpp", folder)
    flags = told("pkg-config", "--cflags", "--libs", *PACKAGES).split()
    made_or_kept("ros1-node", folder, [["g++", "-O1", "-o", name, f"{name}.cpp", *flags]], tools())
    return folder / name


@cache
def tools() -> list[str]:
    """Compiler, cmake and ROS, as they name themselves."""
    words = (["c++", "--version"], ["g++", "--version"], ["cmake", "--version"])
    return [told(*w) for w in (*words, ["pkg-config", "--modversion", *PACKAGES])]


def told(*words: str) -> str:
    return str(processes.run(list(words), capture_output=True, text=True, check=True).stdout)


def _is_program(path: Path) -> bool:
    return os.access(path, os.X_OK) and "CMakeFiles" not in path.parts
