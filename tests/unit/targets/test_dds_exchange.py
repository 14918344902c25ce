"""Target `dds`, compiled: samples of a peer on PyPI's `cyclonedds` through the bridge, and back."""

from __future__ import annotations

import os
import random
import signal
import struct
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.ros.dds_peers import LOOPBACK

import processes
from generators.dds_machine import (
    DOMAIN,
    ENVIRONMENT,
    Channel,
    bridge,
    compiled,
    floats,
    missing,
)
from generators.dds_programs import PROGRAM, mapping, package
from soter.api import load
from soter.language.front_end import check_file, system_of
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytest.importorskip("cyclonedds", reason="the extra is absent: soter-rta[robots]")
pytest.importorskip("rosbags", reason="the extra is absent: soter-rta[logs]")
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.rosbag2 import StoragePlugin, Writer

from generators.dds_messages import STORE, member_type, sample, stamp, type_of

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(bool(missing()), reason=missing() or "-"),
]
ODOM, SCAN, TWIST = (
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/LaserScan",
    "geometry_msgs/msg/TwistStamped",
)
SEEN_SIZE = 40
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=5)), Policy.History.KeepAll)
QOS = {"reliability": "reliable", "depth": "all"}


# ---------------------------------------------------------------- the peer


def odometry(ns: int, x: float, **more: Any) -> Any:
    rest = {"child_frame_id": "body", **more}
    return sample(ODOM, {**stamp(ns), "pose.pose.position.x": x, **rest})


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> DomainParticipant:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    return DomainParticipant(DOMAIN)


def writer(peer: DomainParticipant, topic: str, kind: Any, qos: Qos = RELIABLE) -> Any:
    return DataWriter(peer, Topic(peer, topic, kind), qos=qos)


# ---------------------------------------------------------------- the bridge


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built")
    package(folder, mapping(seen={"qos": QOS}, near={"qos": QOS}))
    compiled(folder / "out")
    return folder / "out"


@pytest.fixture
def channels(built: Path, tmp_path: Path) -> Callable[..., Channel]:
    def opened(name: str, size: int, *, writes: bool = False) -> Channel:
        return Channel(built, tmp_path, name, size, writes=writes)

    return opened


def seen_of(value: bytes) -> tuple[float, ...]:
    """x, yaw, cov.0, cov.1, child."""
    return struct.unpack("<4di", value[:36])


def sent_until_heard(
    w: Any, made: Callable[[], Any], channel: Channel, b: Any
) -> tuple[int, bytes]:
    """Sends anew until one comes through: discovery ends when it ends."""
    got: list[tuple[int, bytes]] = []

    def through() -> bool:
        w.write(made())
        time.sleep(0.02)
        value = channel.read()
        got.extend([value] if value is not None else [])
        return bool(got)

    processes.until(through, b.process)
    return got[0]


def test_a_recorded_flight_gives_the_bits_that_monitor_reads_from_its_log(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    rng = random.Random(7)  # noqa: S311
    begun = time.time_ns() - 10**12
    flight = [
        {
            **stamp(begun + k * 10**7),
            "child_frame_id": rng.choice(("body", "base_link")),
            "pose.pose.position.x": rng.uniform(-1e3, 1e3),
            "twist.twist.angular.z": rng.uniform(-1.0, 1.0) * 10.0 ** rng.randrange(-300, 300),
            "pose.covariance": [rng.gauss(0.0, 1.0) for _ in range(36)],
        }
        for k in range(200)
    ]
    log = tmp_path / "bag"
    with Writer(log, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/odom", ODOM, typestore=STORE)
        for k, values in enumerate(flight):
            cdr = STORE.serialize_cdr(_of_rosbags(ODOM, values), ODOM)
            bag.write(connection, begun + k * 10**7 + 10**6, cdr)
    (tmp_path / "p.soter").write_text(PROGRAM)
    system = system_of(check_file(str(tmp_path / "p.soter")), "Robot")
    only = {"topics": {"seen": mapping()["topics"]["seen"]}}
    declared = make_log_map(only, system)
    read = read_samples(log, declared, read_columns(log, declared))[0].values
    assert len(read) == len(flight)
    heard = []
    with bridge(built, tmp_path) as b:
        channel = channels("seen", SEEN_SIZE)
        w = writer(peer, "rt/odom", type_of(ODOM))
        heard.append(sent_until_heard(w, lambda: sample(ODOM, flight[0]), channel, b))
        time.sleep(0.2)
        while channel.read() is not None:
            pass
        for values in flight[1:]:
            w.write(sample(ODOM, values))
            heard.append(channel.next(b))
        counted = b.end()["rt/odom"]
    assert counted["without_a_value"] == counted["backwards"] == 0
    for (_, value), (child, x, yaw, cov) in zip(heard, read, strict=True):
        got = seen_of(value)
        assert floats(*got[:4]) == floats(x, yaw, *cov)
        assert got[4] == child


def _of_rosbags(name: str, values: dict[str, Any], path: str = "") -> Any:
    made = {}
    for m, k in STORE.fielddefs[name][1]:
        at = f"{path}{m}"
        if k[0] == 2:
            made[m] = _of_rosbags(k[1], values, f"{at}.")
        elif k[0] == 1:
            made[m] = values.get(at, "" if k[1][0] == "string" else 0)
        else:
            made[m] = np.array(values.get(at, [0.0] * k[1][1]))
    return STORE.types[name](**made)


def test_stamps_and_frames_and_elements_are_judged_and_counted(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    with bridge(built, tmp_path) as b:
        channel, near = channels("seen", SEEN_SIZE), channels("near", 8)
        w = writer(peer, "rt/odom", type_of(ODOM))
        at, _ = sent_until_heard(w, lambda: odometry(time.time_ns() - 10**8, 1.0), channel, b)
        assert 0 < time.monotonic_ns() - at - 10**8 < 10**9
        now = time.time_ns()
        bad = [
            odometry(0, 2.0),
            odometry(now + 10**10, 3.0),
            odometry(now - 10**12, 4.0),
            odometry(now, 5.0, **{"header.frame_id": "map"}),
            odometry(now, 6.0, child_frame_id="arm"),
        ]
        bad[3].header_.frame_id_ = "map"
        for m in bad:
            w.write(m)
        w.write(odometry(time.time_ns(), 7.0))
        while True:
            _, value = channel.next(b)
            x = seen_of(value)[0]
            assert x in (0.1 * 1.0 + 0.3, 0.1 * 7.0 + 0.3)
            if x == 0.1 * 7.0 + 0.3:
                break
        s = writer(peer, "rt/scan", type_of(SCAN))
        full = {"ranges": [1.0, 2.0, float("inf")], "intensities": []}
        _, value = sent_until_heard(
            s, lambda: sample(SCAN, {**stamp(time.time_ns()), **full}), near, b
        )
        assert value == floats(float("inf"))
        s.write(sample(SCAN, {**stamp(time.time_ns()), "ranges": [1.0, 2.0], "intensities": []}))
        b.wait_for("rt/scan: a sample has no such element")
        counted = b.end()
    names = (
        "without_a_stamp",
        "later_than_now",
        "backwards",
        "in_another_frame",
        "without_a_value",
    )
    assert {n: counted["rt/odom"][n] for n in names} == dict.fromkeys(names, 1)
    assert counted["rt/scan"]["without_a_value"] == 1


def test_a_second_writer_is_not_heard_until_the_first_is_gone(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    with bridge(built, tmp_path) as b:
        channel = channels("seen", SEEN_SIZE)
        first = writer(peer, "rt/odom", type_of(ODOM))
        sent_until_heard(first, lambda: odometry(time.time_ns(), 1.0), channel, b)
        second = writer(peer, "rt/odom", type_of(ODOM))

        def refused() -> bool:
            second.write(odometry(time.time_ns(), 2.0))
            return "a second writer" in b.said

        processes.until(refused, b.process)
        while (held := channel.read()) is not None:
            assert seen_of(held[1])[0] == 0.1 * 1.0 + 0.3
        del first
        _, value = sent_until_heard(second, lambda: odometry(time.time_ns(), 2.0), channel, b)
        assert seen_of(value)[0] == 0.1 * 2.0 + 0.3
        counted = b.end()["rt/odom"]
    assert counted["of_another_writer"] >= 1
    assert counted["writers_bound"] == 2


def test_another_type_is_not_matched_and_is_said(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    members = {"x_": types.float64, "y_": types.float64}
    name = make_idl_struct("Other_", "std_msgs.msg.dds_.Other_", members)
    structure = make_idl_struct("Odometry_", "nav_msgs.msg.dds_.Odometry_", members)
    with bridge(built, tmp_path) as b:
        writers = [writer(peer, "rt/odom", name)]
        b.wait_for("rt/odom: a writer has another type: std_msgs::msg::dds_::Other_")
        writers.append(writer(peer, "rt/odom", structure))
        b.wait_for("rt/odom: a writer has a type of the same name")
        for w in writers:
            w.write(w.topic.data_type(x_=1.0, y_=2.0))
            assert not w.get_matched_subscriptions()
        assert channels("seen", SEEN_SIZE).read() is None
        counted = b.end()["rt/odom"]
    assert counted["peers_of_another_type"] >= 2
    assert counted["taken"] == counted["not_readable"] == 0


def test_a_sample_longer_than_its_type_is_refused_where_names_alone_are_compared(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    members = {f"{m}_": member_type(kind) for m, kind in STORE.fielddefs[ODOM][1]}
    name = "nav_msgs.msg.dds_.Odometry_"
    longer: Any = make_idl_struct("Odometry_", name, {**members, "more_": types.float64})
    with bridge(built, tmp_path, "--types", "named") as b:
        w = writer(peer, "rt/odom", longer)

        def said() -> bool:
            m = odometry(time.time_ns(), 1.0)
            w.write(longer(m.header_, m.child_frame_id_, m.pose_, m.twist_, 1.0))
            return "rt/odom: a sample is longer than its type says" in b.said

        processes.until(said, b.process)
        assert channels("seen", SEEN_SIZE).read() is None
        counted = b.end()["rt/odom"]
    assert counted["taken"] == 0
    assert counted["of_another_size"] >= 1


def test_a_qos_that_does_not_match_is_said(
    built: Path, tmp_path: Path, peer: DomainParticipant
) -> None:
    best = Qos(Policy.Reliability.BestEffort)
    late = Qos(Policy.Durability.TransientLocal, Policy.Reliability.Reliable(duration(seconds=1)))
    with bridge(built, tmp_path) as b:
        kept: list[Any] = [writer(peer, "rt/odom", type_of(ODOM), best)]
        b.wait_for("rt/odom: the QoS of a writer does not match: reliability")
        kept.append(DataReader(peer, Topic(peer, "rt/cmd_vel", type_of(TWIST)), qos=late))
        b.wait_for("rt/cmd_vel: the QoS of a reader does not match: durability")
        counted = b.end()
    assert counted["rt/odom"]["peers_of_another_qos"] == 1
    assert counted["rt/cmd_vel"]["peers_of_another_qos"] == 1


def test_what_is_written_goes_out_with_its_time_and_a_second_writer_of_it_is_said(
    built: Path, tmp_path: Path, peer: DomainParticipant, channels: Callable[..., Channel]
) -> None:
    with bridge(built, tmp_path) as b:
        channel = channels("push", 8, writes=True)
        r = DataReader(peer, Topic(peer, "rt/cmd_vel", type_of(TWIST)), qos=RELIABLE)
        processes.until(r.get_matched_publications, b.process)
        heard: list[Any] = []

        def through() -> bool:
            channel.write(time.monotonic_ns(), floats(0.25))
            heard.extend(r.take(N=10))
            return bool(heard)

        processes.until(through, b.process)
        assert heard[0].twist_.linear_.x_ == 0.25 / 2.0
        assert heard[0].header_.frame_id_ == "base"
        sent = heard[0].header_.stamp_
        assert abs(time.time_ns() - sent.sec_ * 10**9 - sent.nanosec_) < 10 * 10**9
        kept = writer(peer, "rt/cmd_vel", type_of(TWIST))
        b.wait_for("rt/cmd_vel: somebody else writes it, too")
        assert kept is not None
        assert b.end()["rt/cmd_vel"]["other_writers"] >= 1


def test_the_law_is_held_where_nobody_writes_what_the_actuators_hold(
    tmp_path: Path, peer: DomainParticipant, pytestconfig: pytest.Config
) -> None:
    example = pytestconfig.rootpath / "examples" / "ros" / "shuttle_ros"
    out = tmp_path / "out"
    load(example.with_suffix(".soter")).build(
        "dds", out, "Vehicle", mapping=example.with_suffix(".toml")
    )
    compiled(out)
    with bridge(out, tmp_path) as b:
        channel = Channel(out, tmp_path, "speed", 8, writes=True)
        kind = type_of("geometry_msgs/msg/Twist")
        r = DataReader(peer, Topic(peer, "rt/cmd_vel", kind), qos=RELIABLE)
        processes.until(r.get_matched_publications, b.process)
        speeds: list[float] = []

        def heard(speed: float, after: float | None = None) -> bool:
            speeds.extend(m.linear_.x_ for m in r.take(N=100))
            if after is None:
                return speed in speeds
            return after in speeds and speed in speeds[speeds.index(after) :]

        def moving() -> bool:
            channel.write(time.monotonic_ns(), floats(0.5))
            return heard(0.5)

        processes.until(moving, b.process)
        # the law may have come between two of these: what is written now is written once
        channel.write(time.monotonic_ns(), floats(0.25))
        processes.until(lambda: heard(0.0, after=0.25), b.process)
        assert set(speeds) == {0.5, 0.25, 0.0}
        assert b.end()["rt/cmd_vel"]["channel_silent"] is True


@pytest.mark.parametrize(
    ("words", "domain", "code", "said"),
    [
        (["--help"], "0", 0, "--channels FOLDER"),
        ([], "0", 2, "--channels is needed"),
        (["--channels"], "0", 2, "no such option, or no value of it"),
        (["--channels", "x", "--clock-error", "nan"], "0", 2, "--clock-error: no such option"),
        (["--channels", "x", "--status", "xml"], "0", 2, "--status: no such option"),
        (["--channels", "x"], "233", 2, "no number from 0 to 232"),
        (["--channels", "x"], "1.5", 2, "no number from 0 to 232"),
        (["--channels", "x"], "one", 2, "no number from 0 to 232"),
        (["--channels", "/no/such/folder"], "7", 1, "rt/odom: "),
    ],
)
def test_arguments_that_make_no_sense_are_told(
    built: Path, words: list[str], domain: str, code: int, said: str
) -> None:
    env = {**ENVIRONMENT, "ROS_DOMAIN_ID": domain}
    program = built / "build" / "robot_bridge"
    done = processes.run([program, *words], env=env, capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert said in done.stdout + done.stderr


def test_a_signal_asks_for_the_counters(built: Path, tmp_path: Path) -> None:
    program = built / "build" / "robot_bridge"
    words: list[str | Path] = [program, "--channels", tmp_path, "--status", "text"]
    out = tmp_path / "out"
    with (
        out.open("w") as file,
        processes.started(words, env=ENVIRONMENT, stdout=file, stderr=file) as process,
    ):
        processes.until(lambda: "it runs" in out.read_text(), process)
        os.kill(process.pid, signal.SIGUSR1)
        processes.until(lambda: "in  rt/odom: 0 taken" in out.read_text(), process)
        assert "out rt/cmd_vel: 0 published" in out.read_text()
