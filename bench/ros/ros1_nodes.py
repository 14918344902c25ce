"""A master of ROS 1 and nodes beside it, on loopback, for the benchmarks of this folder.

Purpose: build the package of an example and the benchmark's own nodes, start and end them.
Non-goals: what is measured.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from bench.processes import Processes
from bench.ros.packages import by_cmake, written

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
PYTHON = "/usr/bin/python3"
"""Debian's ROS is of the system's Python."""
VERSION = 1
PACKAGES = ("roscpp", "nav_msgs", "geometry_msgs", "std_msgs", "rosgraph_msgs")
PYTHON_PACKAGES = (
    *("rospy", "diagnostic_msgs", "nav_msgs", "geometry_msgs", "sensor_msgs", "std_msgs"),
)


@cache
def missing() -> str:
    """What of ROS 1 this machine lacks; "": nothing."""
    if shutil.which("rosmaster") is None:
        return "rosmaster (Debian: python3-rosmaster)"
    if shutil.which("cmake") is None:
        return "cmake"
    told = subprocess.run(["pkg-config", "--exists", *PACKAGES], check=False)
    if told.returncode != 0:
        return "roscpp (Debian: libroscpp-dev)"
    absent_of = f"print(*[n for n in {PYTHON_PACKAGES} if not find_spec(n)])"
    look = f"from importlib.util import find_spec; {absent_of}"
    words = [PYTHON, "-c", look]
    absent = subprocess.run(words, check=True, capture_output=True, text=True).stdout.split()
    debian = " ".join(f"python3-{name.replace('_', '-')}" for name in absent)
    return f"rospy's {' '.join(absent)} (Debian: {debian})" if absent else ""


def version() -> str:
    """Of what is installed."""
    words = ["pkg-config", "--modversion", "roscpp"]
    told = subprocess.run(words, check=True, capture_output=True, text=True)
    return f"ROS 1, roscpp {told.stdout.strip()}"


def built_package(
    example: Path, system: str, mapping: Path, folder: Path, actuate: str = ""
) -> Path:
    """The package of a system, compiled: the folder of its programs; `actuate`: its `actuate.c`."""
    return by_cmake(written("ros1", example, system, mapping, folder, actuate))


def built_node(name: str, folder: Path) -> Path:
    """A node of this folder, compiled."""
    told = subprocess.run(
        ["pkg-config", "--cflags", "--libs", *PACKAGES], check=True, capture_output=True, text=True
    )
    program = folder / name
    words = ["g++", "-O1", "-o", str(program), str(HERE / f"{name}.cpp"), *told.stdout.split()]
    subprocess.run(words, check=True)
    return program


def parameters(**given: object) -> list[str]:
    """The words that set parameters of a node."""
    return [f"_{k}:={v}" for k, v in given.items()]


class Nodes(Processes):
    """Processes with a master of their own."""

    ENDED_BY = signal.SIGINT

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.environment = {
            **os.environ,
            "ROS_VERSION": "1",
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}",
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder / "home"),
            "PYTHONPATH": f"/usr/lib/python3/dist-packages:{HERE}",
        }


@contextmanager
def nodes() -> Iterator[Nodes]:
    """A master and a folder; everything ends with it."""
    with tempfile.TemporaryDirectory() as place:
        made = Nodes(Path(place))
        (Path(place) / "home").mkdir()
        master = ["/usr/bin/rosmaster", "--core", "-p", str(made.port)]
        made.start("master", PYTHON, *master)
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", made.port)) == 0:
                    break
            time.sleep(0.05)
        try:
            yield made
        finally:
            made.end_all()
