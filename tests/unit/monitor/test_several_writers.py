"""Several writers of one topic of a log: read as one stream, and never without a word.

Non-goals: sources of a mapping (`test_logs_with_several_sources.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer

from generators.robot_logs import (
    CART,
    CHANNEL,
    MS,
    ODOMETRY,
    ROS1,
    ROS2,
    Recorded,
    cdr,
    flight,
    judge,
    odometry,
    ros_message,
    written,
)
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files.log_columns import Writers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

Owners = list[tuple[Recorded, int]]
ONE, TWO = "/ekf", "/sim"


def interleaved(n: int = 20) -> Owners:
    """Two nodes that do not agree, turn by turn."""
    one = flight(n)
    two = [
        Recorded(m.arrival_ns + MS, odometry(m.arrival_ns, 3.0, 0.0), m.channel, m.type)
        for m in one
    ]
    return [(m, k) for pair in zip(one, two, strict=True) for k, m in enumerate(pair)]


def in_turn(n: int = 20) -> Owners:
    """The second begins where the first ended, as after a restart."""
    return [(m, int(k >= n)) for k, m in enumerate(flight(2 * n))]


def as_mcap(path: Path, owners: Owners, names: Sequence[str | None]) -> Path:
    """Two channels of one topic; `names`: what each says of its node."""
    with path.open("wb") as file:
        writer: Any = McapWriter(file, compression=CompressionType.NONE)
        writer.start()
        definition = ROS2.generate_msgdef(ODOMETRY, ros_version=2)[0].encode()
        schema = writer.register_schema(ODOMETRY, "ros2msg", definition)
        said = [{} if n is None else {"callerid": n} for n in names]
        channels = [writer.register_channel(CHANNEL, "cdr", schema, one) for one in said]
        for m, k in owners:
            writer.add_message(channels[k], m.arrival_ns, cdr(m), m.arrival_ns)
        writer.finish()
    return path


def as_bag1(path: Path, owners: Owners, names: Sequence[str | None]) -> Path:
    """Two connections of one topic."""
    with Bag1Writer(path) as writer:
        connections = [
            writer.add_connection(CHANNEL, ODOMETRY, typestore=ROS1, callerid=n, latching=k)
            for k, n in enumerate(names)
        ]
        for m, k in owners:
            data = ROS1.serialize_ros1(ros_message(ROS1, m.type, m.content), m.type)
            writer.write(connections[k], m.arrival_ns, data)
    return path


KINDS: dict[str, Callable[[Path, Owners, Sequence[str | None]], Path]] = {
    "two.mcap": as_mcap,
    "two.bag": as_bag1,
}


def writers_told(log: Path, word: str = "writers") -> list[str]:
    return [n for n in judge(log).notes if word in n]


@pytest.mark.parametrize("kind", KINDS)
def test_two_nodes_are_named_with_how_many_each_gave(tmp_path: Path, kind: str) -> None:
    (told,) = writers_told(KINDS[kind](tmp_path / kind, interleaved(), (ONE, TWO)))
    assert "`/odom` has 2 writers, which are read as one stream: " in told
    assert "/ekf (20), /sim (20), 39 changes from one to another" in told


@pytest.mark.parametrize("kind", KINDS)
def test_two_without_a_name_are_told_apart_by_their_numbers(tmp_path: Path, kind: str) -> None:
    (told,) = writers_told(KINDS[kind](tmp_path / kind, interleaved(), (None, None)))
    noun = "channel" if kind == "two.mcap" else "connection"
    assert told.count(f"{noun} ") == 2
    assert "(20), " in told


@pytest.mark.parametrize("kind", KINDS)
def test_one_after_the_other_is_told_as_such(tmp_path: Path, kind: str) -> None:
    (told,) = writers_told(KINDS[kind](tmp_path / kind, in_turn(), (ONE, TWO)))
    assert "/ekf (20), /sim (20), 1 change from one to another" in told


@pytest.mark.parametrize("kind", KINDS)
def test_a_node_that_was_started_again_is_one_writer(tmp_path: Path, kind: str) -> None:
    assert writers_told(KINDS[kind](tmp_path / kind, in_turn(), (ONE, ONE))) == []


def quality() -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        10,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        QosTime(0, 0),
        QosTime(0, 0),
        QosLiveliness.AUTOMATIC,
        QosTime(0, 0),
        False,
    )


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("publishers", [0, 1, 2, 3])
def test_a_bag_of_ros2_says_how_many_published_and_not_who(
    tmp_path: Path, storage: str, publishers: int
) -> None:
    writer = Bag2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage])
    with writer:
        qualities = [quality() for _ in range(publishers)]
        connection = writer.add_connection(
            CHANNEL, ODOMETRY, typestore=ROS2, offered_qos_profiles=qualities
        )
        for m, _ in interleaved():
            writer.write(connection, m.arrival_ns, cdr(m))
    told = writers_told(tmp_path / "bag", "publishers")
    assert len(told) == (publishers > 1)
    assert all(t.startswith(f"{publishers} publishers offered `/odom`, which") for t in told)


@pytest.mark.parametrize("name", ["cdr.mcap", "plain.bag", "ros2_plain", "ros2_mcap"])
def test_one_writer_is_no_word(tmp_path: Path, name: str) -> None:
    assert judge(written(tmp_path, name)).notes == ()


def test_two_entries_of_one_topic_in_a_mapping_are_told(tmp_path: Path) -> None:
    """JSON would take the last of them."""
    mapping = tmp_path / "map.json"
    fields = '{"channel": "/odom", "fields": {"x": "a", "v": "b"}}'
    mapping.write_text(f'{{"topics": {{"motion": {fields}, "motion": {fields}}}}}')
    with pytest.raises(SoterError) as error:
        load(CART).judge_log(written(tmp_path, "cdr.mcap"), mapping, system="Protected")
    (problem,) = error.value.diagnostics
    assert problem.code == "D015"
    assert "motion" in problem.message + " ".join(problem.notes)


def test_of_many_writers_the_first_eight_are_named_and_the_others_counted() -> None:
    writers = Writers()
    for n in range(10):
        writers.note_message("/odom", f"n{n}")
    (told,) = writers.notes
    assert "`/odom` has 10 writers" in told
    assert "n7 (1) and 2 more, 9 changes" in told
