"""Target `dds`, compiled: what the bridge says on rt/diagnostics, as a peer reads it.

Non-goals: samples (`test_dds_exchange.py`); the wording of a module, which every bridge shares.
"""

from __future__ import annotations

import struct
import time
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from bench.ros.dds_peers import LOOPBACK

import processes
from generators.dds_machine import DOMAIN, Channel, bridge, compiled, missing
from generators.dds_programs import mapping, package
from soter.api import load

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

pytest.importorskip("cyclonedds", reason="the extra is absent: soter-rta[robots]")
pytest.importorskip("rosbags", reason="the extra is absent: soter-rta[logs]")
pytest.importorskip("tomllib", reason="TOML needs Python 3.11")
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from generators.dds_messages import sample, stamp, type_of

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(bool(missing()), reason=missing() or "-"),
]
SHUTTLE = Path(__file__).resolve().parents[3] / "examples" / "ros" / "shuttle_ros.soter"
RELIABLE = Policy.Reliability.Reliable(duration(seconds=5))
OK, WARN, ERROR, STALE = range(4)
HEAD, OF_MODULE, OF_LEASE, OF_TOPIC = 3, 9, 6, 6
"""Words of soter_status.h."""
HOLDS, ENDED = 2, 3
"""States of a lease: soter_lease.h."""


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> DomainParticipant:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    return DomainParticipant(DOMAIN)


class Diagnostics:
    """A reader of ROS 2's topic; `now`: by the name of a line, as it was said last."""

    def __init__(self, peer: DomainParticipant, b: Any, *policies: Any) -> None:
        topic = Topic(peer, "rt/diagnostics", type_of("diagnostic_msgs/msg/DiagnosticArray"))
        self.reader = DataReader(peer, topic, qos=Qos(*policies or (RELIABLE,)))
        self.bridge = b
        self.now: dict[str, Any] = {}
        self.stamp_ns = 0

    def take(self) -> bool:
        """Whether something was said."""
        heard: Iterable[Any] = self.reader.take(100)
        for m in heard:
            self.now = {s.name_: s for s in m.status_}
            self.stamp_ns = m.header_.stamp_.sec_ * 10**9 + m.header_.stamp_.nanosec_
        return bool(self.now)

    def until(self, name: str, done: Callable[[Any, dict[str, str]], bool]) -> dict[str, str]:
        """The values of a line, as soon as the line is so."""

        def there() -> bool:
            self.take()
            line = self.now.get(name)
            return line is not None and done(line, values(line))

        processes.until(there, self.bridge.process)
        return values(self.now[name])


def values(line: Any) -> dict[str, str]:
    return {v.key_: v.value_ for v in line.values_}


def level(line: Any) -> int:
    return line.level_[0] if isinstance(line.level_, bytes) else int(line.level_)


# ---------------------------------------------------------------- topics


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("robot")
    package(folder, mapping())
    compiled(folder / "out")
    return folder / "out"


def test_a_topic_says_what_was_taken_and_what_was_refused_and_why(
    robot: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    with bridge(robot, tmp_path) as b:
        heard = Diagnostics(peer, b)
        before = heard.until("soter: /odom", lambda line, _: level(line) == WARN)
        assert before["taken"] == "0"
        assert heard.now["soter: /odom"].message_ == "nothing was taken yet"
        assert {"soter: /scan", "soter: /level", "soter: /cmd_vel"} < {*heard.now}
        assert abs(time.time_ns() - heard.stamp_ns) < 10**10
        w = DataWriter(
            peer, Topic(peer, "rt/odom", type_of("nav_msgs/msg/Odometry")), qos=Qos(RELIABLE)
        )
        rest = {"child_frame_id": "body"}

        def send(x: float, **more: Any) -> None:
            at = {**stamp(time.time_ns()), "pose.pose.position.x": x, **rest, **more}
            w.write(sample("nav_msgs/msg/Odometry", at))

        def taken(line: Any, said: dict[str, str]) -> bool:
            send(1.0)
            return int(said["taken"]) > 0 and level(line) == OK

        heard.until("soter: /odom", taken)
        assert len(heard.now["soter: /odom"].hardware_id_) >= 32  # the GUID of who is bound
        send(1.0, **{"header.frame_id": "map"})
        send(1.0, child_frame_id="arm")
        after = heard.until(
            "soter: /odom",
            lambda _, said: said["in another frame"] == said["without a value"] == "1",
        )
        assert after["stamped later than now"] == "0"
        line = heard.now["soter: /odom"]
        assert (level(line), line.message_[:9]) == (ERROR, "a sample ")
        heard.until("soter: /odom", lambda line, _: level(line) == WARN)
        assert heard.now["soter: /odom"].message_ == "silent"


def test_a_topic_that_goes_out_says_who_is_gone(
    robot: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    with bridge(robot, tmp_path) as b:
        heard = Diagnostics(peer, b)
        heard.until("soter: /cmd_vel", lambda line, _: level(line) == OK)
        assert heard.now["soter: /cmd_vel"].message_ == "nothing to publish yet"
        push = Channel(robot, tmp_path, "push", 8, writes=True)

        def written(_: Any, said: dict[str, str]) -> bool:
            push.write(time.monotonic_ns(), struct.pack("<d", 0.5))
            return int(said["published"]) > 0

        heard.until("soter: /cmd_vel", written)
        heard.until("soter: /cmd_vel", lambda line, _: level(line) == ERROR)
        assert heard.now["soter: /cmd_vel"].message_.startswith("nobody writes it")


def test_a_topic_whose_writer_was_gone_when_the_bridge_began_says_so(
    robot: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    push = Channel(robot, tmp_path, "push", 8, writes=True)
    push.write(time.monotonic_ns(), struct.pack("<d", 0.5))
    with bridge(robot, tmp_path) as b:
        heard = Diagnostics(peer, b)
        said = heard.until("soter: /cmd_vel", lambda line, _: level(line) == ERROR)
        assert heard.now["soter: /cmd_vel"].message_.endswith("and nothing is published")
        assert said["published"] == "0"


def test_the_writer_has_the_qos_of_ros_2(
    robot: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    with bridge(robot, tmp_path) as b:
        old = Diagnostics(peer, b, RELIABLE, Policy.Durability.TransientLocal)
        new = Diagnostics(peer, b, RELIABLE, Policy.Durability.Volatile)
        new.until("soter: /odom", lambda *_: True)
        assert not old.take()  # volatile: whoever asks for what was said before is not matched


# ---------------------------------------------------------------- modules


@pytest.fixture(scope="module")
def shuttle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shuttle") / "out"
    load(SHUTTLE).build("dds", folder, "Vehicle", mapping=str(SHUTTLE.with_suffix(".toml")))
    compiled(folder)
    return folder


class Trusted:
    """Who writes what the trusted part and the actuators of the shuttle say of themselves."""

    def __init__(self, package_: Path, folder: Path) -> None:
        words = HEAD + OF_MODULE + OF_LEASE + 2 * OF_TOPIC
        self.status = [0] * words
        self.actuators = [0] * 6
        self.channels = [
            Channel(package_, folder, "soter.status", 8 * words, writes=True, row=r"\.hash = "),
            Channel(
                package_, folder, "soter.actuators", 48, writes=True, row=r"\.actuators_hash = "
            ),
        ]

    def say(self) -> None:
        now = time.monotonic_ns()
        for channel, words in zip(self.channels, (self.status, self.actuators), strict=True):
            channel.write(now, struct.pack(f"<{len(words)}Q", *words))


def test_a_module_says_who_has_control_and_why_and_that_it_waits_to_be_armed(
    shuttle: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    name = "soter: module Guard"
    with bridge(shuttle, tmp_path) as b:
        heard = Diagnostics(peer, b)
        heard.until(name, lambda line, _: level(line) == STALE)
        assert heard.now[name].message_ == "the trusted part is silent"
        trusted = Trusted(shuttle, tmp_path)
        module = HEAD
        trusted.status[1] = 4  # releases that were late
        trusted.status[module : module + OF_MODULE] = [1, 2**62, 1, 3, 10, 11, 12, 13, 14]
        trusted.status[module + OF_MODULE] = 77  # leases given
        for k in range(2):
            first = module + OF_MODULE + OF_LEASE + OF_TOPIC * k
            trusted.status[first : first + OF_TOPIC] = [0, 5 + k, 6, 7, 8, 0]
        trusted.actuators[3] = HOLDS

        def said(wanted: int) -> Callable[[Any, dict[str, str]], bool]:
            def there(line: Any, _: dict[str, str]) -> bool:
                trusted.say()
                return level(line) == wanted

            return there

        now = heard.until(name, said(OK))
        assert heard.now[name].message_ == "AC has control"
        assert float(now.pop("margin, s")) > 1e6
        assert now == {
            "mode": "AC",
            "armed": "yes, since they began",
            "SC took over last": "the gate",
            "takeovers: ttf": "10",
            "takeovers: what the DM reads is old": "11",
            "takeovers: the gate": "12",
            "takeovers: AC is silent": "13",
            "takeovers: the trusted part was late": "14",
            "leases given": "77",
            "late releases and completions": "4",
        }
        counted = {n: values(x) for n, x in heard.now.items() if "the trusted part's" in n}
        assert len(counted) == 2
        assert [v["taken"] for v in counted.values()] == ["5", "6"]
        assert {v["not finite, or outside its set"] for v in counted.values()} == {"6"}
        assert {v["older than the one before"] for v in counted.values()} == {"7"}
        assert {v["later than now"] for v in counted.values()} == {"8"}
        trusted.status[module] = 0
        heard.until(name, said(WARN))
        assert heard.now[name].message_ == "SC has control"
        trusted.actuators[3] = ENDED
        waits = heard.until(name, said(ERROR))
        assert waits["armed"] == "no"
        arm = f"shuttle_ros_actuator --channels {tmp_path} --arm"
        assert f"until a person arms them: {arm}" in heard.now[name].message_


@pytest.mark.parametrize(
    ("old", "told"),
    [
        ([1, 93 * 10**6, 80 * 10**6], "position 93.000 ms old, of 80.000 ms"),
        ([2, 2**64 - 2**62, 0], "wish, which nobody had published"),
        ([3, 1, 0], "a topic inside 0.000 ms old, of 0.000 ms"),
        ([0, 0, 0], None),
    ],
)
def test_a_module_whose_leases_have_ended_says_which_reading_was_too_old(
    shuttle: Path, tmp_path: Path, peer: DomainParticipant, old: list[int], told: str | None
) -> None:
    name = "soter: module Guard"
    with bridge(shuttle, tmp_path) as b:
        heard = Diagnostics(peer, b)
        trusted = Trusted(shuttle, tmp_path)
        lease = HEAD + OF_MODULE
        trusted.status[lease : lease + OF_LEASE] = [5, 1, 1, *old]

        def ended(line: Any, _: dict[str, str]) -> bool:
            trusted.say()
            return "its leases have ended" in line.message_

        said = heard.until(name, ended)
        assert said.get("its leases ended with a read of") == told


def test_what_is_new_of_a_module_is_said_at_once(
    shuttle: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    with bridge(shuttle, tmp_path) as b:
        heard = Diagnostics(peer, b)
        trusted = Trusted(shuttle, tmp_path)
        trusted.actuators[3] = HOLDS
        stamps: list[int] = []

        def changed(_: Any, said: dict[str, str]) -> bool:
            if said["mode"] == ("AC" if len(stamps) % 2 else "SC"):
                stamps.append(heard.stamp_ns)
                trusted.status[HEAD] = len(stamps) % 2
            trusted.say()
            return len(stamps) == 21

        heard.until("soter: module Guard", changed)
        gaps = [b - a for a, b in pairwise(stamps)]
        assert min(gaps) < 9 * 10**8  # what is not new is said once a second
