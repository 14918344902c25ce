"""The ground robot's package on ROS 1 and 2: scans on the wire, commands on /cmd_vel.

Needs Debian's ROS 1, or a ROS 2 that is sourced, and says so where one is not. Non-goals: what is
nearest in a scan (`tests/unit/targets/test_nearest_in_a_scan.py`), what else is wrong on a wire
(`test_ros_nodes.py`).
"""

from __future__ import annotations

import tempfile
import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros.ros1_nodes import HERE, ROOT

from generators.ros_packages import EITHER, built_package

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import ModuleType

EXAMPLE = ROOT / "examples" / "ros" / "ground_robot.soter"


def commands(ros: ModuleType, all_: Any, build: Path, case: str) -> list[tuple[str, float]]:
    """What /cmd_vel said, with what the scanner saw then."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        all_.start("actuator", build / "ground_robot_actuator", "--channels", channels)
        all_.start("bridge", build / "ground_robot_bridge", *ros.parameters(channels=channels))
        scanner = all_.start("scanner", ros.PYTHON, HERE / "scan.py", case)
        while "ready\n" not in all_.heard["scanner"] and scanner.poll() is None:
            time.sleep(0.01)
        words = ["--channels", channels, "--misses", "1000000"]
        all_.start("trusted", build / "ground_robot", *words)
        scanner.wait(60)
        for name in [n for n in all_.running if n != "master"]:
            all_.end(name)
        lines = all_.heard.pop("scanner")
    told = [line[4:].strip().rpartition(" ") for line in lines if line.startswith("cmd ")]
    return [(phase, float(value)) for phase, _, value in told]


@pytest.fixture(scope="module", params=EITHER)
def heard(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Any]:
    ros, folder = request.param, tmp_path_factory.mktemp("robot") / "package"
    build = built_package(ros, EXAMPLE, "Vehicle", EXAMPLE.with_suffix(".toml"), folder)
    with ros.nodes() as all_:
        yield lambda case: commands(ros, all_, build, case)


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("case", "least", "most"),
    [
        ("far", 0.2, 0.2),
        ("two unseen", 0.2, 0.2),
        ("near ahead", -0.15, -0.001),  # SC goes back
        ("near behind", 0.001, 0.15),
        ("too near", 0.0, 0.0),
        ("a sector unseen", 0.0, 0.0),  # no lease, and the law
        ("zeros", 0.0, 0.0),
    ],
)
def test_a_scan_decides_what_a_wish_may(heard: Any, case: str, least: float, most: float) -> None:
    told = heard(case)
    assert ("far", 0.2) in told  # before that it drove as it was wished
    assert least <= told[-1][1] <= most, told
