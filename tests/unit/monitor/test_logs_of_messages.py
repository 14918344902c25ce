"""Bags and MCAPs that do not fit their mapping: each ends with a code and a reason.

Non-goals: logs that fit (`tests/correct/test_one_flight_many_logs.py`), what a mapping may say,
harm (`test_hostile_logs.py`).
"""

from __future__ import annotations

import math
import sqlite3
from typing import TYPE_CHECKING, Any

import pytest

from soter.version import pip_command

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators import robot_logs
from generators.robot_logs import (
    CART,
    CHANNEL,
    KINDS,
    MS,
    T0,
    TYPED,
    Recorded,
    changed_bag2,
    flight,
    judge,
    odometry,
    refused,
    written,
)
from soter.api import load
from soter.cli.terminal.log_judgement import FOREIGN_LOG
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files import message_decoding
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

# ---------------------------------------------------------------- stamps, frames, numbers


def without(k: int, recorded: Recorded) -> list[Recorded]:
    messages = flight()
    messages[k] = recorded
    return messages


LEFT_OUT = [
    (odometry(0, 1.0, 1.0), "its stamp is 0"),
    (odometry(T0 + 105 * MS, 1.0, 1.0), "its stamp lies 5 ms after its arrival"),
    (odometry(T0 + 60 * MS, 1.0, 1.0), "its stamp is older than the one before it"),
    (odometry(T0 + 89 * MS, 1.0, 1.0), "its stamp is older than the one before it, or the same"),
    (odometry(T0 + 99 * MS, 1.0, 1.0, "map"), "its frame is `map`, not `odom`"),
    (odometry(T0 + 99 * MS, math.nan, 1.0), "no finite number for `motion.x`"),
    (odometry(T0 + 99 * MS, 1.0, -math.inf), "no finite number for `motion.v`"),
]


@all_rows(("content", "why"), LEFT_OUT)
@all_rows("name", ["cdr.mcap", "json.mcap", "plain.bag", "protobuf.mcap"])
def test_a_message_that_says_nothing_is_left_out_counted_and_named(
    tmp_path: Path, name: str, content: dict[str, Any], why: str
) -> None:
    log = written(tmp_path, name, without(10, Recorded(T0 + 100 * MS, content)))
    judged = judge(log, frame_id="odom")
    count, first = judged.left_out["motion"]
    assert count == 1
    assert first.startswith(f"message 11 of `{CHANNEL}`: ")
    assert why in first
    assert judged.samples["motion"] == 39


@pytest.mark.parametrize("name", ["cdr.mcap", "plain.bag", "ros2_plain"])
def test_each_reason_for_which_messages_are_left_out_is_counted_and_named(
    tmp_path: Path, name: str
) -> None:
    """One that is rare would stand before the one that ends the flight."""
    died = [
        Recorded(m.arrival_ns, odometry(m.arrival_ns - MS, math.nan, 1.0)) if k >= 25 else m
        for k, m in enumerate(flight(40))
    ]
    late = Recorded(T0 + 100 * MS, odometry(T0 + 105 * MS, 1.0, 1.0))
    later = Recorded(T0 + 120 * MS, odometry(T0 + 127 * MS, 1.0, 1.0))
    log = written(tmp_path, name, [*died[:10], late, died[11], later, *died[13:]])
    judged = judge(log)
    count, first = judged.left_out["motion"]
    assert count == 17
    assert "its stamp lies 5 ms after its arrival" in first
    assert [n for n, _ in judged.reasons["motion"]] == [2, 15], "5 ms and 7 ms are one reason"
    assert len(judged.lost) == 2
    assert judged.lost[0].startswith("left out: 2 samples of motion; the first: ")
    assert judged.lost[1].endswith(": no finite number for `motion.x`")
    left_out = FOREIGN_LOG.of(judged)["left_out"]
    assert isinstance(left_out, dict)
    assert left_out["motion"]["samples"] == sum(r["samples"] for r in left_out["motion"]["reasons"])


def test_of_reasons_that_do_not_end_the_last_is_all_that_are_left(tmp_path: Path) -> None:
    """A frame is a text of the file: each message may have another one."""
    frames = [
        Recorded(m.arrival_ns, odometry(m.arrival_ns - MS, 1.0, 1.0, chr(97 + k % 26) * (k % 37)))
        if k > 0
        else m
        for k, m in enumerate(flight(40))
    ]
    judged = judge(written(tmp_path, "json.mcap", frames), frame_id="odom")
    assert judged.left_out["motion"][0] == 39
    assert [n for n, _ in judged.reasons["motion"]] == [1] * 8 + [31]


def test_a_stamp_from_the_future_makes_no_later_one_old(tmp_path: Path) -> None:
    ahead = Recorded(T0 + 100 * MS, odometry(T0 + 300 * MS, 1.0, 1.0))
    assert judge(written(tmp_path, "plain.bag", without(10, ahead))).left_out["motion"][0] == 1


def test_a_log_of_nothing_but_other_frames_is_refused_with_the_frame(tmp_path: Path) -> None:
    told = refused(written(tmp_path, "plain.bag"), frame_id="map")
    assert "no row of it has all of `motion`" in told
    assert "its frame is `odom`, not `map`" in told


def test_a_stamp_may_be_a_number_in_a_unit(tmp_path: Path) -> None:
    log = written(tmp_path, "ros1.mcap")
    told = refused(log, stamp={"from": "header.seq", "unit": "us"})
    assert "its stamp is 0" in told
    judged = judge(log, stamp={"from": "header.stamp.sec", "unit": "s"})
    assert judged.left_out["motion"][0] == 38  # there are two seconds in it


GEOFENCE = CART.parents[1] / "mavlink" / "geofence.soter"
LINK = {"url": "udpin://127.0.0.1:14540", "delay": "70ms"}


@pytest.mark.parametrize(
    ("typed", "late_ms", "told"),
    [
        ({"stamp": "arrival"}, 70, "arrival less 70 ms"),
        ({}, 30, "time_boot_ms"),
        ({"type": "nav_msgs/Odometry", "stamp": "arrival"}, 60, "arrival less 60 ms"),
    ],
)
def test_a_value_of_a_log_is_as_old_as_its_bridge_takes_it(
    tmp_path: Path, typed: dict[str, Any], late_ms: int, told: str
) -> None:
    """As `by_arrival` of soter_mavlink_topics.c and `measured_at` of the others have it."""
    pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")
    of_ros = "type" in typed
    p, v = ("pose.pose.position", "twist.twist.linear") if of_ros else ("", "v")
    fields = {
        "p": [f"{p}.{a}" if of_ros else a for a in "xyz"],
        "v": [f"{v}.{a}" if of_ros else f"{v}{a}" for a in "xyz"],
    }
    columns = ("t", "time_boot_ms", *fields["p"], *fields["v"])
    rows = [(k / 10, k * 100 - 30, *range(6)) for k in range(1, 30)]
    lines = [",".join(map(str, row)) for row in (columns, *rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    topic = {"type": "mavlink/LOCAL_POSITION_NED", "frame": "NED", "fields": fields, **typed}
    given = {"mavlink": LINK, "time": {"from": "t"}, "topics": {"motion": topic}}
    system = load(GEOFENCE).flat("Companion")
    log_map = make_log_map(given, system)
    columns_read = read_columns(tmp_path / "log.csv", log_map)
    (samples,) = read_samples(tmp_path / "log.csv", log_map, columns_read)
    assert len(samples.times_ns) == 29
    ages = [t - s for t, s in zip(samples.times_ns, samples.stamps_ns, strict=True)]
    assert ages == [late_ms * MS] * 29
    assert samples.stamp == told


def test_an_element_beyond_the_end_of_a_list_leaves_the_message_out(tmp_path: Path) -> None:
    scans = [
        Recorded(
            T0 + k * 10 * MS,
            {"header": robot_logs.stamped(T0 + k * 10 * MS), "ranges": [1.0] * (k % 3)},
            CHANNEL,
            "sensor_msgs/msg/LaserScan",
        )
        for k in range(30)
    ]
    fields = {"x": "ranges.1", "v": {"constant": 0.0}}
    for name in ("cdr.mcap", "json.mcap", "plain.bag", "ros2_plain", "protobuf.mcap"):
        log = written(tmp_path, name, scans)
        judged = judge(log, type="sensor_msgs/LaserScan", fields=fields)
        assert (judged.samples["motion"], judged.left_out["motion"][0]) == (10, 20)


def joints(first: int, *names: tuple[str, ...]) -> list[Recorded]:
    """States of joints; the names of message k are those of `names` in turn, from `first` on."""
    told = []
    for k in range(30):
        order = names[0] if k < first else names[k % len(names)]
        place = {"elbow": 1.0, "wrist": 2.0}
        content = {
            "header": robot_logs.stamped(T0 + k * 10 * MS),
            "name": list(order),
            "position": [place[name] for name in order],
        }
        told.append(Recorded(T0 + k * 10 * MS, content, CHANNEL, "sensor_msgs/msg/JointState"))
    return told


BOTH = (("elbow", "wrist"), ("wrist", "elbow"))
JOINTS: dict[str, Any] = {
    "type": "sensor_msgs/JointState",
    "fields": {"x": "position.0", "v": {"constant": 0.0}},
}


@pytest.mark.parametrize("name", ["cdr.mcap", "json.mcap", "plain.bag", "ros2_plain"])
def test_joints_by_number_are_told_where_two_orders_of_them_meet(tmp_path: Path, name: str) -> None:
    told = "`name` of `/odom` has two orders, elbow, wrist and wrist, elbow, and joints"
    for count, first in ((1, 7), (2, 7), (2, 30)):
        folder = tmp_path / f"{count} {first}"
        folder.mkdir()
        log = written(folder, name, joints(first, *BOTH[:count]))
        notes = " ".join(judge(log, **JOINTS).notes)
        assert (told in notes) == (count == 2 and first < 30)
    one = judge(tmp_path / "2 7" / name, where={"name.0": "elbow"}, **JOINTS)
    assert told not in " ".join(one.notes)
    assert 15 <= one.samples["motion"] < 25


# ---------------------------------------------------------------- logs that do not fit


@pytest.mark.parametrize("name", KINDS)
def test_a_channel_that_is_not_there_is_told_with_those_that_are(tmp_path: Path, name: str) -> None:
    told = refused(written(tmp_path, name), channel="/odmo")
    assert "no message that counts stands on `/odmo`" in told
    assert "did you mean `/odom`?" in told


@pytest.mark.parametrize("name", ["cdr.mcap", "ros1.mcap", "plain.bag", "ros2_plain", "ros2_mcap"])
def test_messages_of_another_type_are_told(tmp_path: Path, name: str) -> None:
    twists = [Recorded(T0, {}, CHANNEL, "geometry_msgs/msg/Twist")]
    told = refused(written(tmp_path, name, twists))
    assert "messages of `/odom` are `geometry_msgs/Twist`" in told
    assert "the mapping says `nav_msgs/Odometry`" in told


@all_rows("name", KINDS)
@all_rows(
    ("field", "told"),
    [
        ("pose.pose.positon.x", "has no `pose.pose.positon.x`"),
        ("pose.covariance", "is no `float`"),
        ("pose.covariance.36", "has no `pose.covariance.36`"),
        ("pose.covariance.x", "has no `pose.covariance.x`"),
        ("pose.pose", "is no `float`"),
        ("header.frame_id", "is no `float`"),
        ("pose.pose.position.x.y", "has no `pose.pose.position.x.y`"),
        ("__class__", "has no `__class__`"),
        ("header.__init__", "has no `header.__init__`"),
        ("pose.DESCRIPTOR", "has no `pose.DESCRIPTOR`"),
    ],
)
def test_without_a_type_a_field_that_is_none_is_told_with_its_message(
    tmp_path: Path, name: str, field: str, told: str
) -> None:
    log = written(tmp_path, name, flight(3))
    said = refused(log, type=None, fields={"x": field, "v": {"constant": 0.0}})
    assert told in said
    assert "message 1 of `/odom`" in said


def test_a_stamp_that_is_no_time_is_told(tmp_path: Path) -> None:
    log = written(tmp_path, "plain.bag")
    told = refused(log, type=None, stamp="pose.pose.position.x")
    assert "is no time of seconds and nanoseconds" in told
    assert 'unit = "us"' in told


def test_a_topic_without_a_channel_is_told(tmp_path: Path) -> None:
    assert "names no `channel`" in refused(written(tmp_path, "plain.bag"), channel=None)


def test_a_table_says_when_it_was_measured_in_columns_of_its_own(tmp_path: Path) -> None:
    log = written(tmp_path, "flight.csv")
    text = log.read_text().replace("header.stamp.sec", "seconds")
    log.write_text(text)
    mapping = {"time": {"from": "t", "unit": "ns"}, "topics": {"motion": TYPED}}
    with pytest.raises(SoterError, match=r"it has no column `header\.stamp\.sec`"):
        load(CART).judge_log(log, mapping, system="Protected")
    mapping["topics"] = {"motion": {**TYPED, "stamp": "arrival"}}
    assert load(CART).judge_log(log, mapping, system="Protected").samples["motion"] == 40


# ---------------------------------------------------------------- MCAP


def mcap(path: Path, encoding: str, schema: tuple[str, str, bytes] | None, data: bytes) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        schema_id = 0 if schema is None else writer.register_schema(*schema)
        channel = writer.register_channel(CHANNEL, encoding, schema_id)
        for k in range(3):
            writer.add_message(channel, T0 + k * 10 * MS, data, T0)
        writer.finish()
    return path


ODOM = "nav_msgs/msg/Odometry"
GOOD = robot_logs.cdr(flight(1)[0])
EMPTIES = b"std_msgs/Empty[1000000000] all\n" + b"=" * 80 + b"\nMSG: std_msgs/Empty\n"


@all_rows(
    ("encoding", "schema", "data", "told"),
    [
        ("cbor", (ODOM, "ros2msg", b""), b"", "are `cbor`, not json: json, cdr, ros1 and protobuf"),
        ("", None, b"", "messages of `/odom` are ``"),
        ("cdr", ("x", "jsonschema", b"{}"), GOOD, "are `cdr` with a schema in `jsonschema`"),
        ("cdr", (ODOM, "ros2msg", b"float64"), GOOD, "the definition of `nav_msgs/msg/Odometry`"),
        ("cdr", (ODOM, "ros2msg", b"\xff"), GOOD, "cannot be used"),
        ("cdr", (ODOM, "ros2idl", b"struct {"), GOOD, "the definition of `nav_msgs/msg/Odometry`"),
        ("cdr", (ODOM, "ros2msg", b"Odometry x\n"), GOOD, "has no end"),
        ("cdr", (ODOM, "ros2msg", b"a/B x\n"), GOOD, "the type `a/msg/B` is not defined"),
        ("cdr", (ODOM, "ros2msg", EMPTIES), GOOD, "a list of messages that are empty"),
        ("cdr", (ODOM, "ros2msg", b"float64 x\n"), GOOD, "a message is no `nav_msgs/Odometry`"),
        ("cdr", (ODOM, "ros2msg", b"float64 class\n" * 2), GOOD, "cannot be used"),
        ("cdr", None, GOOD[:40], "a message is no `nav_msgs/Odometry`"),
        ("cdr", None, b"", "a message is no `nav_msgs/Odometry`"),
        ("ros1", None, GOOD, "a message is no `nav_msgs/Odometry`"),
        ("protobuf", None, b"", "are protobuf without a schema of it"),
        ("protobuf", ("a.B", "protobuf", b"\xff\xff"), b"", "the schema of `/odom` cannot be used"),
        ("protobuf", ("a.B", "protobuf", b""), b"", "the schema of `/odom` cannot be used"),
        ("json", None, b"[" * 100_000, "cannot be used"),
        ("json", None, b"\xff", "cannot be used"),
        ("json", None, b"3", "has no `pose.pose.position.x`"),
    ],
)
def test_messages_that_cannot_be_decoded_are_told(
    tmp_path: Path,
    encoding: str,
    schema: tuple[str, str, bytes] | None,
    data: bytes,
    told: str,
) -> None:
    assert told in refused(mcap(tmp_path / "a.mcap", encoding, schema, data))


def test_messages_of_ros2_without_a_schema_are_of_the_type_of_the_mapping(tmp_path: Path) -> None:
    assert judge(mcap(tmp_path / "a.mcap", "cdr", None, GOOD), stamp="arrival").modules
    told = refused(mcap(tmp_path / "a.mcap", "cdr", None, GOOD), type=None)
    assert "are `cdr` with no schema" in told


IDL = b"""================================================================================
IDL: robot/msg/Motion
module robot { module msg { struct Motion { double x; sequence<double> v; }; }; };
"""


def test_a_schema_may_be_written_in_idl(tmp_path: Path) -> None:
    data = b"\0\1\0\0" + bytes(8) + b"\1\0\0\0\0\0\0\0" + bytes(8)
    log = mcap(tmp_path / "a.mcap", "cdr", ("robot/msg/Motion", "ros2idl", IDL), data)
    judged = judge(log, type=None, fields={"x": "x", "v": "v.0"})
    assert judged.samples["motion"] == 3


@pytest.mark.parametrize(
    ("package", "name"),
    [
        ("rosbags", "cdr.mcap"),
        ("rosbags", "plain.bag"),
        ("mcap_protobuf", "protobuf.mcap"),
    ],
)
def test_without_a_package_the_log_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, name: str
) -> None:
    from importlib.util import find_spec

    from soter.mapping import message_types

    log = written(tmp_path, name)

    def found(asked: str) -> Any:
        return None if asked == package else find_spec(asked)

    monkeypatch.setattr(message_types, "find_spec", found)
    monkeypatch.setattr(message_decoding, "find_spec", found)
    assert pip_command("logs") in refused(log, "D007", type=None)


# ---------------------------------------------------------------- bags of ROS 2


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("rosbag2_bagfile_information", "something", "`metadata.yaml` is none of a bag"),
        ("sqlite3", "leveldb", "it is stored as `leveldb`: sqlite3, mcap are read"),
        ("ros2_plain.db3", "nowhere.db3", "there is no such file"),
        ("ros2_plain.db3", "..", "names a file that can be none of it"),
        ("ros2_plain.db3", "a.db3?mode=rwc", "names a file that can be none of it"),
        ("ros2_plain.db3", "[a.db3]", "names a file that can be none of it"),
        ("ros2_plain.db3", "/etc/passwd", "there is no such file"),
        ("sqlite3", "mcap", "cannot be used"),
        ("compression_mode: ''", "compression_mode: chunk", "it is packed by ``, mode `chunk`"),
        ("rosbag2_bagfile_information:", "a: [", "`metadata.yaml` is none of a bag"),
        ("rosbag2_bagfile_information:", "!!python/object:os.system", "is none of a bag"),
    ],
)
def test_metadata_that_do_not_fit_are_told(
    tmp_path: Path, before: str, after: str, told: str
) -> None:
    assert told in refused(changed_bag2(tmp_path, one=(before, after)))


def test_a_folder_that_is_no_bag_is_told(tmp_path: Path) -> None:
    assert "`metadata.yaml` cannot be read: there is no such file" in refused(tmp_path)
    (tmp_path / "metadata.yaml").write_bytes(b"\xff\xfe")
    assert "it is not UTF-8" in refused(tmp_path)
    (tmp_path / "metadata.yaml").write_text("a: 1\n" * 2_000_000)
    assert "it is too large" in refused(tmp_path)


def test_a_file_of_a_bag_may_be_given_alone(tmp_path: Path) -> None:
    bag = written(tmp_path, "ros2_plain")
    assert judge(bag / "ros2_plain.db3").modules == judge(bag).modules


@pytest.mark.parametrize(
    ("sql", "told"),
    [
        ("UPDATE messages SET data = 'text'", "a message of `/odom` is no bytes with a time"),
        ("UPDATE messages SET data = NULL", "cannot be used"),
        ("UPDATE messages SET data = x'0001'", "a message is no `nav_msgs/Odometry`"),
        ("UPDATE messages SET timestamp = 'soon'", "cannot be used"),
        ("UPDATE topics SET serialization_format = 'cbor'", "are `cbor`, not cdr"),
        ("UPDATE topics SET type = 'a/b/c/d'", "messages of `/odom` are `a/b/c/d`"),
        ("DROP TABLE topics", "cannot be used"),
        ("DROP TABLE messages", "cannot be used"),
        ("DELETE FROM messages", "its metadata count 40 messages of `/odom`, and 0 stand there"),
        ("UPDATE message_definitions SET encoding = 'xml'", "cannot be used"),
        ("UPDATE messages SET timestamp = 5", "time stands still: all that counts"),
    ],
)
def test_a_database_that_does_not_fit_is_told(tmp_path: Path, sql: str, told: str) -> None:
    bag = written(tmp_path, "ros2_plain")
    connection = sqlite3.connect(bag / "ros2_plain.db3")
    try:
        connection.execute(sql)
    except sqlite3.IntegrityError:
        connection.execute("PRAGMA ignore_check_constraints = 1")
        connection.execute("CREATE TABLE other AS SELECT * FROM messages")
        connection.executescript("DROP TABLE messages; ALTER TABLE other RENAME TO messages")
        connection.execute(sql)
    connection.commit()
    connection.close()
    assert told in refused(bag)
