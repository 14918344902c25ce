"""Two sensors of one position on ROS 1 and 2: the first is killed, the second read, and back again.

Nodes in Python and the bridge, each a process of its own. What is asserted are the stamps of what
was taken, which the bridge reports, and not when anything came.
Needs Debian's ROS 1, or a ROS 2 that is sourced, and says so where one is not.
Non-goals: every order of arrivals (`tests/unit/mapping/test_topic_sources.py`), what is wrong on a
wire (`test_ros_nodes.py`).
"""

from __future__ import annotations

import json
import signal
import tempfile
import time
from typing import TYPE_CHECKING, Any

import pytest

import processes
from generators.ros_packages import EITHER, built_package

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros.bad_input import counters
from bench.ros.ros1_nodes import HERE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import ModuleType

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
  step { publish speed = clamp(-0.01 * position, -1.0, 1.0); }
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
SPEED = {
    "channel": "/cmd_vel",
    "type": "geometry_msgs/Twist",
    "fields": {"value": "linear.x"},
}
WHEELS, CAMERA = "soter: /odom", "soter: /camera"
PATIENCE_S = processes.TIMEOUT_S
Told = dict[tuple[str, str], str]


@pytest.fixture(scope="module", params=EITHER)
def ros(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture(scope="module")
def package(ros: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("package")
    (folder / "two.soter").write_text(PROGRAM)
    topics = {"position": {"sources": SOURCES}, "speed": SPEED}
    (folder / "map.json").write_text(json.dumps({"topics": topics}))
    return built_package(ros, folder / "two.soter", "Vehicle", folder / "map.json", folder / "out")


@pytest.fixture
def all_(ros: ModuleType, package: Path) -> Iterator[Any]:
    """The bridge, and somebody who listens to /diagnostics."""
    with ros.nodes() as made, tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        made.start("bridge", package / "two_bridge", *ros.parameters(channels=channels))
        made.start("diagnostics", ros.PYTHON, HERE / "diagnostics.py")
        yield made


CLOCK = """
import time
from either_ros import NS, Node, stamp
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
heard = [None]
at = [0]
def hear(m):
    if m.linear.x != heard[0]:
        heard[0] = m.linear.x
        print("cmd", at[0], round(m.linear.x, 6), flush=True)
def odometry(out, t, x):
    m = Odometry()
    m.header.stamp, m.header.frame_id, m.pose.pose.position.x = stamp(t), "odom", x
    out.publish(m)
node = Node("ticker")
node.hear("/cmd_vel", Twist, hear, 1000)
wheels, camera = (node.out(topic, Odometry, depth=100) for topic in ("/odom", "/camera"))
clock = node.out("/clock", Clock, depth=100)
while not all(p.listeners() for p in (wheels, camera, clock)):
    time.sleep(0.01)
clock.publish(Clock(clock=stamp(100 * NS)))
for ms in range(0, 4000, 10):
    t = 100 * NS + ms * 10**6
    if not 1000 <= ms < 3000:
        odometry(wheels, t, 30.0)
    if ms % 50 == 0:
        odometry(camera, t, 31.0 if ms % 100 else float("nan"))
    time.sleep(0.004)
    at[0] = ms + 10
    clock.publish(Clock(clock=stamp(t + 10**7)))
    time.sleep(0.004)
print("end", flush=True)
"""
"""The wheels are silent from 1 s to 3 s, every other sample of the camera is NaN."""


def speak(ros: ModuleType, all_: Any, name: str, channel: str, every_ms: int) -> None:
    all_.start(name, ros.PYTHON, HERE / "source.py", name, channel, str(every_ms))


def first_told(all_: Any, holds: Callable[[Told], bool]) -> Told:
    """The first state of /diagnostics that holds."""
    end = time.monotonic() + PATIENCE_S
    told: Told = {}
    while time.monotonic() < end:
        assert all_.running["bridge"].poll() is None, "".join(all_.heard["bridge"])
        told = counters([*all_.heard["diagnostics"]])
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
    ros: ModuleType, all_: Any
) -> None:
    speak(ros, all_, "wheels", "/odom", WHEELS_MS)
    speak(ros, all_, "camera", "/camera", CAMERA_MS)
    before = first_told(
        all_,
        lambda told: is_read(WHEELS, 40)(told) and int(told[CAMERA, "not its turn"]) >= 3,
    )
    assert before[CAMERA, "message"] == "it stands by"
    all_.end("wheels", signal.SIGKILL)
    after = first_told(all_, is_read(CAMERA, int(before[CAMERA, "taken"]) + 3))
    assert after[CAMERA, "message"] == "it is read"
    assert int(after[CAMERA, "took over"]) == int(before[CAMERA, "took over"]) + 1
    gap_ms = int(after[WHEELS, "longest between stamps taken, us"]) / 1000
    assert AFTER_MS < gap_ms <= AFTER_MS + CAMERA_MS, "the stamps are not those of the bound"

    speak(ros, all_, "wheels", "/odom", WHEELS_MS)
    back = first_told(all_, is_read(WHEELS, int(after[WHEELS, "taken"]) + 20))
    assert int(back[WHEELS, "took over"]) == int(before[WHEELS, "took over"]) + 1
    assert int(back[WHEELS, "longest between stamps taken, us"]) / 1000 == gap_ms
    assert back[CAMERA, "of another publisher"] == "0"


@pytest.mark.real_time
def test_under_clock_the_sources_take_turns_by_simulated_time(
    ros: ModuleType, package: Path
) -> None:
    with ros.nodes() as all_:
        all_.start("simulation", package / "two_simulation")
        ticker = all_.start("ticker", ros.PYTHON, "-c", CLOCK)
        ticker.wait(PATIENCE_S)
        all_.readers["ticker"].join(10)
        said = [line for line in all_.heard["ticker"] if line.startswith(("cmd ", "end"))]
        lines = [line.split() for line in said]
    assert lines[-1] == ["end"], "".join(all_.heard["ticker"])
    told = [(int(at), float(value)) for _, at, value in lines[:-1]]
    begun = [value for _, value in told].index(-0.3)
    (_, wheels), (to_camera, camera), (back, again) = told[begun:]
    assert (wheels, camera, again) == (-0.3, -0.31, -0.3)
    assert 990 + AFTER_MS < to_camera <= 3000 < back
