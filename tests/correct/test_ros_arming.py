"""`rosrun NAME arm`, or `ros2 run`, with all that runs: who is refused, and why.

Needs Debian's ROS 1, or a ROS 2 that is sourced, and says so where one is not. The trusted part
runs on the machine's clock.
"""

from __future__ import annotations

import signal
import tempfile
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros.bad_input import EXAMPLE, counters
from bench.ros.ros1_nodes import HERE

import processes
from generators.channel_programs import soon
from generators.ros_packages import EITHER, built_package

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import ModuleType

pytestmark = pytest.mark.real_time
MODULE = "soter: module Guard"


class Stack:
    """All processes of the shuttle, which stands still somewhere."""

    def __init__(
        self, ros: ModuleType, all_: Any, build: Path, channels: str, position: float
    ) -> None:
        self.nodes, self.build, self.channels = all_, build, channels
        all_.start("actuator", build / "shuttle_ros_actuator", "--channels", channels)
        all_.start("bridge", build / "shuttle_ros_bridge", *ros.parameters(channels=channels))
        all_.start("diagnostics", ros.PYTHON, HERE / "diagnostics.py")
        words = ["sensor", "/odom", "10", str(position)]
        all_.start("sensor", ros.PYTHON, HERE / "source.py", *words)
        self.start()

    def start(self) -> None:
        """The trusted part."""
        words = ["--channels", self.channels, "--misses", "1000000", "--wait", "600"]
        self.nodes.start("trusted", self.build / "shuttle_ros", *words)

    def told(self, key: str) -> str:
        return counters([*self.nodes.heard["diagnostics"]]).get((MODULE, key), "")

    def arm(self, *words: str) -> tuple[int, str]:
        done = processes.run(
            [self.build / "arm", *words, self.channels], capture_output=True, text=True
        )
        return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module", params=EITHER)
def built(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Any, Path]:
    folder = tmp_path_factory.mktemp("package") / "package"
    mapping = EXAMPLE.with_suffix(".toml")
    return request.param, built_package(request.param, EXAMPLE, "Vehicle", mapping, folder)


@pytest.fixture(params=[1.0, 9.9], ids=["in the middle", "at the wall"])
def stack(request: pytest.FixtureRequest, built: tuple[Any, Path]) -> Iterator[tuple[Stack, bool]]:
    """A trusted part that was killed and started anew; whether the state is one to begin from."""
    ros, build = built
    with ros.nodes() as all_, tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        made = Stack(ros, all_, build, channels, request.param)
        soon(lambda: made.told("leases given") not in ("", "0"))
        all_.end("trusted", signal.SIGKILL)
        soon(lambda: (made.told("armed"), made.told("mode")) == ("no", "unknown"))
        made.start()
        soon(lambda: made.told("mode") == "SC")
        yield made, request.param < 9.0


def test_the_actuators_are_armed_where_the_proof_speaks_and_else_by_an_explicit_word(
    stack: tuple[Stack, bool],
) -> None:
    made, begins = stack
    soon(lambda: made.told("arming").startswith("taken now" if begins else "refused now: safer"))
    told, said = made.arm()
    assert (told == 0) == begins, said
    if not begins:
        assert "not armed: Guard: safer does not hold" in said
        assert made.told("armed") == "no"
        told, said = made.arm("--unchecked")
        assert told == 0, said
    how = "yes, after a look" if begins else "yes, without a look"
    soon(lambda: made.told("armed").startswith(how))
