"""Nodes of ROS 2 on loopback, for the benchmarks of this folder: what is sourced, as it is found.

Purpose: build the package of an example and the benchmark's own nodes, start and end them; the same
names as in `ros1_nodes.py`. `$SOTER_ROS2_PYTHON` is the Python that has rclpy, if it is not the
system's. Non-goals: what is measured.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import tempfile
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from bench.processes import Processes
from bench.ros.packages import written

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).resolve().parent
PYTHON = os.environ.get("SOTER_ROS2_PYTHON", "/usr/bin/python3")
VERSION = 2
MESSAGES = ("nav_msgs", "geometry_msgs", "sensor_msgs", "std_msgs", "diagnostic_msgs")
PACKAGES = ("ament_cmake", "rclcpp", "rosgraph_msgs", *MESSAGES)


@cache
def missing() -> str:
    """What of ROS 2 this shell lacks; "": nothing."""
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    if not prefixes:
        return "a sourced ROS 2 (`. .../setup.bash` sets AMENT_PREFIX_PATH)"
    index = "share/ament_index/resource_index/packages"
    absent = [n for n in PACKAGES if not any((p / index / n).exists() for p in prefixes)]
    if absent or shutil.which("cmake") is None:
        return ", ".join(absent or ["cmake"])
    done = subprocess.run(
        [PYTHON, "-c", f"import rclpy, {', '.join(f'{n}.msg' for n in MESSAGES)}"],
        env=environment_of(Path("/tmp")),  # noqa: S108 - nothing is written
        capture_output=True,
        text=True,
        check=False,
    )
    return f"rclpy of {PYTHON}: {done.stderr.strip()[-200:]}" if done.returncode else ""


def version() -> str:
    """Of what is sourced."""
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(":"):
        manifest = Path(prefix) / "share" / "rclcpp" / "package.xml"
        if manifest.exists() and (found := re.search(r"<version>(.*)<", manifest.read_text())):
            return f"ROS 2, rclcpp {found[1]}"
    return "ROS 2"


def environment_of(folder: Path) -> dict[str, str]:
    """Of a node: loopback alone, a domain of this process's own."""
    return {
        **os.environ,
        "ROS_VERSION": "2",
        "ROS_LOCALHOST_ONLY": "1",
        "ROS_DOMAIN_ID": str(os.getpid() % 100 + 1),
        "ROS_LOG_DIR": str(folder),
        "PYTHONPATH": f"{os.environ.get('PYTHONPATH', '')}:{HERE}",
    }


def build_commands(source: str, *more: str) -> list[list[str]]:
    """What builds a folder of CMake in `build`."""
    python = [f"-D{name}_EXECUTABLE={PYTHON}" for name in ("Python3", "PYTHON")]
    made = ["cmake", "-S", source, "-B", "build", "-DBUILD_TESTING=OFF", *python, *more]
    return [made, ["cmake", "--build", "build"]]


INSTALL = ["cmake", "--install", "build", "--prefix", "install"]


def installed(folder: Path) -> Path:
    """The programs of a package that was built there and installed."""
    (programs,) = (folder / "install" / "lib").iterdir()
    return programs


def built_package(
    example: Path, system: str, mapping: Path, folder: Path, actuate: str = ""
) -> Path:
    """The package of a system, compiled: the folder of its programs; `actuate`: its `actuate.c`."""
    written("ros2", example, system, mapping, folder, actuate)
    for step in (*build_commands("."), INSTALL):
        subprocess.run(step, check=True, capture_output=True, cwd=folder)
    return installed(folder)


def built_node(name: str, folder: Path) -> Path:
    """A node of this folder, compiled."""
    made = folder / f"build-{name}"
    made.mkdir()
    for step in build_commands(str(HERE), f"-DNODE={name}"):
        subprocess.run(step, check=True, capture_output=True, cwd=made)
    return made / "build" / name


def parameters(**given: object) -> list[str]:
    """The words that set parameters of a node."""
    return ["--ros-args", *(w for k, v in given.items() for w in ("-p", f"{k}:={v}"))]


class Nodes(Processes):
    """Processes of a domain of their own."""

    ENDED_BY = signal.SIGINT

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.environment = environment_of(folder)


@contextmanager
def nodes() -> Iterator[Nodes]:
    """Everything ends with it."""
    with tempfile.TemporaryDirectory() as place:
        made = Nodes(Path(place))
        try:
            yield made
        finally:
            made.end_all()
