"""The package of examples/mavlink/geofence.soter, built, and its processes, for this folder.

Purpose: build, start, end; what they printed. Non-goals: what is measured.
"""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.processes import Processes

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
EXAMPLE = ROOT / "examples" / "mavlink" / "geofence.soter"
MAPPING = EXAMPLE.with_suffix(".toml")
SHARED = Path("/dev/shm")  # noqa: S108 - where channels belong


def missing() -> str:
    """What this machine lacks; "": nothing."""
    if find_spec("pymavlink") is None:
        return "pymavlink (pip install 'soter-rta[robots]')"
    if not SHARED.is_dir():
        return str(SHARED)
    return "" if shutil.which("make") and shutil.which("cc") else "make and cc"


def built_package(folder: Path, mapping: Path = MAPPING) -> Path:
    """The package, compiled."""
    words = [sys.executable, "-m", "soter", "build", str(EXAMPLE), "--system", "Companion"]
    words += ["--target", "mavlink", "--map", str(mapping), "-o", str(folder)]
    subprocess.run(words, check=True, capture_output=True)
    subprocess.run(["make", "-C", str(folder)], check=True, capture_output=True)
    return folder


def free_port() -> int:
    """A port of UDP that nobody had a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Stack(Processes):
    """The processes of the package."""

    def __init__(self, package: Path, channels: Path) -> None:
        super().__init__()
        self.package, self.channels = package, channels
        self.port = free_port()

    def actuator(self) -> None:
        """The leases' side."""
        program = self.package / "trusted" / "geofence_actuator"
        self.start("actuator", program, "--channels", self.channels)

    def bridge(self, *words: str) -> None:
        """The bridge."""
        program = self.package / "build" / "geofence_bridge"
        url = f"udpin://127.0.0.1:{self.port}"
        given = ["--channels", str(self.channels), "--url", url, "--status", "json", *words]
        self.start("bridge", program, *given)

    def trusted(self) -> None:
        """The trusted part, however late it is: machines of tests have no real-time permission."""
        program = self.package / "trusted" / "geofence"
        self.start("trusted", program, "--channels", self.channels, "--misses", "1000000")

    def report(self) -> dict[str, Any]:
        """What the bridge said of itself when it ended."""
        lines = [x for x in self.heard["bridge"] if x.startswith("{")]
        return dict(json.loads(lines[-1]))


@contextmanager
def stack(package: Path) -> Iterator[Stack]:
    """A folder of channels; everything ends with it."""
    with tempfile.TemporaryDirectory(dir=SHARED) as channels:
        made = Stack(package, Path(channels))
        try:
            yield made
        finally:
            made.end_all()
