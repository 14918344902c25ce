"""What a person does with a package on ROS 2: launch, parameters, names, QoS, life cycles, a bag.

Needs a ROS 2 that is sourced, and says so where none is. The trusted part runs on the machine's
clock. Non-goals: what is wrong on a wire, simulated time (`test_ros_nodes.py`), arming
(`test_ros_arming.py`); `ros2 bag`, whose files PyPI's rosbags writes here.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros import ros2_nodes as ros
from bench.ros.bad_input import EXAMPLE, counters
from bench.ros.ros1_nodes import HERE
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

import processes
from generators.channel_programs import soon
from generators.ros_packages import built_package, here

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = [here(ros), pytest.mark.real_time]
ODOM, COMMAND, MODULE = "soter: /odom", "soter: /cmd_vel", "soter: module Guard"
UNHEARD = "not heard, as its type or its QoS does not fit"


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the shuttle, which hears odometry reliably and of /sensor alone."""
    folder = tmp_path_factory.mktemp("package")
    more = 'publisher = "/sensor"\nqos = { reliability = "reliable" }'
    text = EXAMPLE.with_suffix(".toml").read_text()
    (folder / "map.toml").write_text(
        text.replace("[topics.position]", f"[topics.position]\n{more}")
    )
    return built_package(ros, EXAMPLE, "Vehicle", folder / "map.toml", folder / "package")


class World:
    """Nodes with a folder of channels, and what /diagnostics says."""

    def __init__(self, all_: Any, programs: Path, channels: Path) -> None:
        self.nodes, self.programs, self.channels = all_, programs, channels
        prefix = programs.parents[1]
        all_.environment["AMENT_PREFIX_PATH"] = f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}"
        all_.start("diagnostics", ros.PYTHON, HERE / "diagnostics.py")

    def bridge(self, *words: str) -> Any:
        given = [*ros.parameters(channels=self.channels), *words]
        return self.nodes.start("bridge", self.programs / "shuttle_ros_bridge", *given)

    def source(self, name: str, channel: str = "/odom", position: float = 1.0) -> None:
        words = (name, channel, "10", str(position))
        self.nodes.start(name, ros.PYTHON, HERE / "source.py", *words)

    def script(self, name: str, text: str) -> None:
        self.nodes.start(name, ros.PYTHON, "-c", text)

    def told(self, name: str, key: str) -> str:
        return counters([*self.nodes.heard["diagnostics"]]).get((name, key), "")

    def taken(self) -> int:
        return int(self.told(ODOM, "taken") or 0)

    def goes_on(self) -> None:
        """Odometry is taken from now on."""
        before = self.taken()
        soon(lambda: self.taken() > before + 50)

    def ros2(self, *words: str) -> str:
        done = processes.run(
            ["ros2", *words, *(["--no-daemon"] if words[0] != "run" else [])],
            env=self.nodes.environment,
            capture_output=True,
            text=True,
        )
        return str(done.stdout + done.stderr)

    def pid_of(self, program: str) -> int:
        """Of a process that the launch file started; 0: there is none."""
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                started = (entry / "cmdline").read_text().partition("\0")[0]
            except OSError:
                continue
            if Path(started) == self.programs / program:
                return int(entry.name)
        return 0

    def kill(self, program: str) -> int:
        pid = self.pid_of(program)
        assert pid > 0, "".join(self.nodes.heard["launch"])
        os.kill(pid, signal.SIGKILL)
        return pid


@pytest.fixture
def world(programs: Path, tmp_path: Path) -> Iterator[World]:
    with ros.nodes() as all_:
        yield World(all_, programs, tmp_path / "channels")
        shutil.rmtree(tmp_path / "channels", ignore_errors=True)


@pytest.fixture
def bridged(world: World) -> World:
    world.channels.mkdir()
    world.bridge()
    return world


def test_what_is_launched_is_started_again_and_ends_with_its_actuators(world: World) -> None:
    words = ("shuttle_ros", "shuttle_ros.launch.py", f"channels:={world.channels}", "misses:=9999")
    launch = world.nodes.start("launch", shutil.which("ros2"), "launch", *words)
    world.source("sensor")
    soon(lambda: world.told(MODULE, "mode") == "SC")
    bridge = world.kill("shuttle_ros_bridge")
    soon(lambda: world.pid_of("shuttle_ros_bridge") not in (0, bridge))
    soon(lambda: world.told(MODULE, "armed") == "no")
    soon(lambda: world.told(MODULE, "arming").startswith("taken now"))
    told = world.ros2("run", "shuttle_ros", "arm", str(world.channels))
    soon(lambda: world.told(MODULE, "armed").startswith("yes, after a look"))
    assert "armed" in told
    world.kill("shuttle_ros_actuator")
    launch.wait(processes.TIMEOUT_S)
    assert world.pid_of("shuttle_ros_bridge") == 0


def test_the_packages_own_test_passes(world: World) -> None:
    file = world.programs.parents[2] / "test" / "test_shuttle_ros.py"
    done = processes.run(
        ["launch_test", file], env=world.nodes.environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Ran 1 test" in done.stdout + done.stderr


def test_a_parameter_that_is_set_later_is_refused_and_use_sim_time_makes_nothing_younger(
    bridged: World,
) -> None:
    bridged.source("sensor")
    bridged.goes_on()
    assert "read-only" in bridged.ros2("param", "set", "/shuttle_ros_bridge", "clock_error", "0.5")
    told = bridged.ros2("param", "set", "/shuttle_ros_bridge", "use_sim_time", "true")
    assert "successful" in told
    bridged.goes_on()
    assert bridged.told(ODOM, "stamped later than now") == "0"


def test_a_bridge_that_is_told_to_use_simulated_time_does_not_run(world: World) -> None:
    world.channels.mkdir()
    assert world.bridge("-p", "use_sim_time:=true").wait(processes.TIMEOUT_S) == 1
    world.nodes.end("bridge")
    assert "under /clock start the simulation node" in "".join(world.nodes.heard["bridge"])


def test_a_bridge_in_a_namespace_hears_what_its_names_are_mapped_to(world: World) -> None:
    world.channels.mkdir()
    names = ("odom", "wish", "cmd_vel")
    world.bridge("-r", "__ns:=/robot", *(w for n in names for w in ("-r", f"/{n}:={n}")))
    world.source("sensor", "/robot/odom")
    world.goes_on()


NAMESAKE = """
import time, rclpy
from geometry_msgs.msg import Twist
rclpy.init()
node = rclpy.create_node("shuttle_ros_bridge", namespace="/other")
node.create_publisher(Twist, "/cmd_vel", 1)
time.sleep(1000)
"""


def test_a_node_of_the_same_name_elsewhere_that_commands_too_is_told(bridged: World) -> None:
    bridged.script("namesake", NAMESAKE)
    soon(lambda: bridged.told(COMMAND, "message").endswith(": /other/shuttle_ros_bridge"))
    assert "published by another node" in bridged.told(COMMAND, "message")


QOS = """
import time
from either_ros import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
node = Node("sensor")._node
node.create_publisher(Odometry, "/odom", QoSProfile(
    depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT))
node.create_subscription(Twist, "/cmd_vel", print, QoSProfile(
    depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL))
time.sleep(1000)
"""


def test_a_qos_that_does_not_match_is_told_both_ways(bridged: World) -> None:
    bridged.script("sensor", QOS)
    soon(lambda: bridged.told(ODOM, "message") == f"{UNHEARD}: /sensor (its QoS)")
    soon(lambda: bridged.told(COMMAND, "message") == f"{UNHEARD}, by /sensor (its QoS)")


HEARS = """
import time
from either_ros import Node
from geometry_msgs.msg import Twist
node = Node("wheels")._node
node.create_subscription(Twist, "/cmd_vel", lambda message: None, 1)
while not node.count_publishers("/cmd_vel"):
    time.sleep(0.05)
print("hears", flush=True)
time.sleep(1000)
"""


def test_who_hears_the_commands_is_not_called_unheard(bridged: World) -> None:
    bridged.script("wheels", HEARS)
    soon(lambda: bool(bridged.nodes.heard["wheels"]))
    bridged.script("sensor", QOS)  # comes later: once it is told the wheels are known, too
    soon(lambda: "/sensor" in bridged.told(COMMAND, "message"))
    assert "/wheels" not in bridged.told(COMMAND, "message")


def test_of_two_publishers_only_that_of_the_mapping_is_heard_and_again_when_started_anew(
    bridged: World,
) -> None:
    bridged.source("other", position=-3.0)
    soon(lambda: int(bridged.told(ODOM, "of another publisher") or 0) > 50)
    assert bridged.taken() == 0
    bridged.nodes.end("other")
    bridged.source("sensor")
    bridged.goes_on()
    bridged.nodes.end("sensor", signal.SIGKILL)
    bridged.source("sensor")
    bridged.goes_on()


MANAGED = """
import time
from either_ros import now, stamp
import rclpy
from nav_msgs.msg import Odometry
from rclpy.lifecycle import Node, TransitionCallbackReturn
class Sensor(Node):
    def on_configure(self, state):
        self.out = self.create_lifecycle_publisher(Odometry, "/odom", 1)
        self.create_timer(0.01, self.say)
        return TransitionCallbackReturn.SUCCESS
    def say(self):
        m = Odometry()
        m.header.stamp, m.header.frame_id = stamp(now()), "odom"
        self.out.publish(m)
rclpy.init()
rclpy.spin(Sensor("sensor"))
"""


def test_a_sensor_with_a_life_cycle_is_heard_while_it_is_active(bridged: World) -> None:
    bridged.script("sensor", MANAGED)
    for deed in ("configure", "activate"):
        soon(lambda: "sensor" in bridged.ros2("lifecycle", "nodes"))
        assert "successful" in bridged.ros2("lifecycle", "set", "/sensor", deed)
        if deed == "configure":
            soon(lambda: bridged.told(ODOM, "message") == "silent")
    bridged.goes_on()
    assert "successful" in bridged.ros2("lifecycle", "set", "/sensor", "deactivate")
    soon(lambda: bridged.told(ODOM, "message") == "silent")
    assert "bridge" not in bridged.ros2("lifecycle", "nodes")


RECORDER = """
import time
from either_ros import Node
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64
node = Node("recorder")
wish = node.out("/wish", Float64)
for topic, kind in (("/odom", Odometry), ("/wish", Float64), ("/cmd_vel", Twist)):
    def hear(data, topic=topic):
        print("bag", topic, time.time_ns(), data.hex(), flush=True)
    node._node.create_subscription(kind, topic, hear, 1000, raw=True)
while node.ok():
    wish.publish(Float64())
    time.sleep(0.02)
"""
TYPES = {
    "/odom": "nav_msgs/msg/Odometry",
    "/wish": "std_msgs/msg/Float64",
    "/cmd_vel": "geometry_msgs/msg/Twist",
}


def test_a_bag_of_what_was_said_is_judged_by_the_monitor(bridged: World, tmp_path: Path) -> None:
    bridged.script("recorder", RECORDER)
    bridged.source("sensor")
    words = ("--channels", str(bridged.channels), "--misses", "1000000")
    bridged.nodes.start("actuator", bridged.programs / "shuttle_ros_actuator", *words[:2])
    bridged.nodes.start("trusted", bridged.programs / "shuttle_ros", *words)
    soon(lambda: sum("/cmd_vel" in line for line in bridged.nodes.heard["recorder"]) > 50)
    bridged.nodes.end("recorder")
    lines = [x.split()[1:] for x in bridged.nodes.heard["recorder"] if x.startswith("bag ")]
    with Writer(tmp_path / "bag", version=9) as bag:
        store = get_typestore(Stores.ROS2_HUMBLE)
        told = {t: bag.add_connection(t, kind, typestore=store) for t, kind in TYPES.items()}
        for topic, ns, data in lines:
            bag.write(told[topic], int(ns), bytes.fromhex(data))
    judge = ("monitor", EXAMPLE, tmp_path / "bag", "--map", EXAMPLE.with_suffix(".toml"))
    done = processes.run(
        [sys.executable, "-m", "soter", *judge, "--system", "Vehicle", "--json"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    log = json.loads(done.stdout)["log"]
    assert log["samples"]["position"] == sum(topic == "/odom" for topic, _, _ in lines)
    assert log["modules"]["Guard"]["judged_share"] > 0.9
