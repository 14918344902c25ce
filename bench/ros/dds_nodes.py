"""Nodes of ROS 2 as peers of the bridge of `--target dds`, which has nothing of ROS.

Purpose: the names of `ros2_nodes.py`, for the benchmarks of this folder. Non-goals: other peers of
that bridge (`dds_samples.py`).
"""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from bench.ros import ros2_nodes
from bench.ros.dds_peers import LOOPBACK
from bench.ros.packages import by_cmake, written
from bench.ros.ros2_nodes import PYTHON, Nodes, built_node

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["PYTHON", "Nodes", "built_node"]
VERSION = "2, target dds"


@cache
def missing() -> str:
    """What of ROS 2 or of Cyclone DDS is not here; "": nothing."""
    idlc = "" if shutil.which("idlc") else "idlc (Debian: cyclonedds-tools, cyclonedds-dev)"
    return ros2_nodes.missing() or idlc


def version() -> str:
    """Of the peers."""
    return f"{ros2_nodes.version()}, with the bridge of target dds"


def built_package(
    example: Path, system: str, mapping: Path, folder: Path, actuate: str = ""
) -> Path:
    """The package of a system, compiled: the folder of its programs; `actuate`: its `actuate.c`."""
    return by_cmake(written("dds", example, system, mapping, folder, actuate))


def parameters(**given: object) -> list[str]:
    """The words that set options of the bridge."""
    return [w for k, v in given.items() for w in (f"--{k}", str(v))]


@contextmanager
def nodes() -> Iterator[Nodes]:
    """Everything ends with it."""
    with ros2_nodes.nodes() as made:
        assert made.environment is not None
        made.environment |= {"CYCLONEDDS_URI": LOOPBACK, "ROS_LOCALHOST_ONLY": "0"}
        yield made
