"""Two sensors of one position on ROS 1: the first is killed, the second is read, and back again.

Nodes of rospy, a master and the bridge, each a process of its own. What is asserted are the stamps
of what was taken, which the bridge reports, and not when anything came.
Needs Debian's ROS 1 and says so where it is not.
Non-goals: every order of arrivals (`tests/unit/mapping/test_topic_sources.py`), what is wrong on a
wire (`test_ros1.py`).
"""

from __future__ import annotations

import json
import signal
import tempfile
import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")

from bench.ros.ros1_bad_input import counters
from bench.ros.ros1_nodes import HERE, SYSTEM_PYTHON, built_package, missing, nodes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(bool(missing()), reason=f"ROS 1 is not here: {missing()}")

PROGRAM = """soter 1;
topic position: float unit "m" in [-50.0, 50.0] max_age 3s;
topic speed: float unit "m/s" in [-1.0, 1.0] = 0.0;
plant Shuttle period 5ms {
  reads speed;
  drives position = x;
  state x: float unit "m" = 0.0;
  der x = speed;
  measured position within 0.05;
}
node Away period 50ms { publishes speed; step { publish speed = 0.5; } }
node Back period 50ms {
  subscribes position;
  publishes speed;
  step { publish speed = clamp(-position, -1.0, 1.0); }
}
rta Guard {
  ac Away;
  sc Back;
  period 100ms;
  safe abs(position) < 40.0;
  ttf abs(position) > 20.0;
  safer abs(position) < 10.0;
}
system Track default { c: Shuttle; module Guard; }
system Vehicle deploys Track {
  external topic position every 1s delayed 1s measured position within 0.05;
  external topic speed;
  module Guard;
}
"""
WHEELS_MS, CAMERA_MS, AFTER_MS = 50, 500, 600
SOURCE = {
    "type": "nav_msgs/Odometry",
    "frame_id": "odom",
    "fields": {"value": "pose.pose.position.x"},
    "measured": {"value": 0.05},
    "delayed": "500ms",
}
SOURCES = [
    {**SOURCE, "channel": "/odom", "every": f"{WHEELS_MS}ms"},
    {**SOURCE, "channel": "/camera", "every": f"{CAMERA_MS}ms", "after": f"{AFTER_MS}ms"},
]
WHEELS, CAMERA = "soter: /odom", "soter: /camera"
PATIENCE_S = 60.0
Told = dict[tuple[str, str], str]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("package")
    (folder / "two.soter").write_text(PROGRAM)
    (folder / "map.json").write_text(json.dumps({"topics": {"position": {"sources": SOURCES}}}))
    return built_package(folder / "two.soter", "Vehicle", folder / "map.json", folder / "out")


@pytest.fixture
def all_(package: Path) -> Iterator[Any]:
    """A master, the bridge, somebody who listens to /diagnostics."""
    with nodes() as made, tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        made.start("bridge", package / "two_bridge", f"_channels:={channels}")
        made.start("diagnostics", SYSTEM_PYTHON, "/usr/bin/rostopic", "echo", "/diagnostics")
        yield made


def speak(all_: Any, name: str, channel: str, every_ms: int) -> None:
    all_.start(name, SYSTEM_PYTHON, HERE / "ros1_source.py", name, channel, str(every_ms))


def wait_for(all_: Any, holds: Callable[[Told], bool]) -> Told:
    """The first state of /diagnostics that holds."""
    end = time.monotonic() + PATIENCE_S
    told: Told = {}
    while time.monotonic() < end:
        assert all_.running["bridge"].poll() is None, "".join(all_.heard["bridge"])
        told = counters("".join(all_.heard["diagnostics"]))
        if told and holds(told):
            return told
        time.sleep(0.1)
    raise AssertionError(f"it was never so: {told}")


def is_read(source: str, at_least: int) -> Callable[[Told], bool]:
    return lambda told: (
        told.get((source, "read")) == "yes" and int(told[source, "taken"]) >= at_least
    )


@pytest.mark.real_time
def test_the_second_is_read_when_the_first_is_killed_and_no_later_than_was_derived(
    all_: Any,
) -> None:
    speak(all_, "wheels", "/odom", WHEELS_MS)
    speak(all_, "camera", "/camera", CAMERA_MS)
    before = wait_for(
        all_,
        lambda told: is_read(WHEELS, 40)(told) and int(told[CAMERA, "not its turn"]) >= 3,
    )
    assert before[CAMERA, "message"] == "it stands by"
    all_.end("wheels", signal.SIGKILL)
    after = wait_for(all_, is_read(CAMERA, int(before[CAMERA, "taken"]) + 3))
    assert after[CAMERA, "message"] == "it is read"
    assert int(after[CAMERA, "took over"]) == int(before[CAMERA, "took over"]) + 1
    gap_ms = int(after[WHEELS, "longest between stamps taken, us"]) / 1000
    assert AFTER_MS < gap_ms <= AFTER_MS + CAMERA_MS, "the stamps are not those of the bound"

    all_.start("wheels", SYSTEM_PYTHON, HERE / "ros1_source.py", "wheels", "/odom", str(WHEELS_MS))
    back = wait_for(all_, is_read(WHEELS, int(after[WHEELS, "taken"]) + 20))
    assert int(back[WHEELS, "took over"]) == int(before[WHEELS, "took over"]) + 1
    assert int(back[WHEELS, "longest between stamps taken, us"]) / 1000 == gap_ms
    assert back[CAMERA, "of another publisher"] == "0"
