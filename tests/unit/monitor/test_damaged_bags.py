"""Bags of ROS that are not as they say: each is refused with the place and a remedy.

Non-goals: values that were changed in their place, which nothing in a bag covers.
"""

from __future__ import annotations

import shlex
import shutil
import sqlite3
import struct
import sys
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.hostile.log_records import CHUNK1, CONNECTION1, INFO1, Record1, inside, rewritten

import processes
from generators.robot_logs import (
    T0,
    Recorded,
    as_bag2,
    flight,
    judge,
    refused,
    written,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

DB = "ros2_plain.db3"


def changed(database: Path, sql: str) -> None:
    connection = sqlite3.connect(database)
    connection.executescript(sql)
    connection.close()


def with_wal(database: Path) -> None:
    """Ten more messages, which SQLite has in its log beside the database only."""
    whole = database.with_name("whole.db3")
    shutil.copy(database, whole)
    connection = sqlite3.connect(whole)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA wal_autocheckpoint = 0")
    more = "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp + 1e9, data"
    connection.execute(f"{more} FROM messages LIMIT 10")
    connection.commit()
    shutil.copy(whole, database)
    shutil.copy(f"{whole}-wal", f"{database}-wal")
    connection.close()
    whole.unlink()


# ---------------------------------------------------------------- what lies beside a database


@pytest.mark.parametrize("alone", [True, False])
def test_messages_that_sqlite_holds_beside_its_database_are_told(
    tmp_path: Path, alone: bool
) -> None:
    bag = written(tmp_path, "ros2_plain")
    with_wal(bag / DB)
    told = refused(bag / DB if alone else bag)
    assert f"`{DB}-wal` beside it holds messages that are not in it yet" in told
    assert "PRAGMA wal_checkpoint(TRUNCATE)" in told


@pytest.mark.parametrize("name", ["ros2_plain", "ros2_file"])
@pytest.mark.parametrize("whole", ["file", "folder"])
def test_what_lies_beside_the_database_that_a_link_points_to_is_told(
    tmp_path: Path, name: str, whole: str
) -> None:
    bag = written(tmp_path, name)
    database = next(p for p in bag.iterdir() if p.name != "metadata.yaml")
    (bag / f"{name}.db3-wal").write_bytes(b"x")
    linked = tmp_path / "links" / name
    linked.parent.mkdir()
    if whole == "folder":
        linked.mkdir()
        (linked / database.name).symlink_to(database)
        shutil.copy(bag / "metadata.yaml", linked)
        assert "beside it holds messages that are not in it yet" in refused(linked)
    elif name == "ros2_plain":
        alone = linked.with_name("other.db3")
        alone.symlink_to(database)
        assert "beside it holds messages that are not in it yet" in refused(alone)
    linked.with_name("twice").symlink_to(bag)
    assert "beside it holds messages that are not in it yet" in refused(linked.with_name("twice"))


def test_the_remedy_for_a_log_of_sqlite_works(tmp_path: Path) -> None:
    (tmp_path / "it's").mkdir()
    bag = written(tmp_path / "it's", "ros2_plain", flight(12))
    with_wal(bag / DB)
    (bag / "metadata.yaml").unlink()
    program, *words = shlex.split(refused(bag / DB).split("put them into it: ")[1])
    assert program == "python3"
    processes.run([sys.executable, *words], check=True)
    assert sum(judge(bag / DB, stamp="arrival").samples.values()) == 22


@pytest.mark.parametrize(
    ("end", "content", "told"),
    [
        ("-journal", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", "was not written to its end"),
        ("-wal", b"x", "holds messages that are not in it yet"),
        ("-journal", bytes(512), ""),
        ("-journal", b"", ""),
        ("-wal", b"", ""),
        ("-shm", b"x", ""),
    ],
)
def test_only_what_sqlite_would_use_is_told(
    tmp_path: Path, end: str, content: bytes, told: str
) -> None:
    bag = written(tmp_path, "ros2_plain")
    (bag / f"{DB}{end}").write_bytes(content)
    if told:
        assert told in refused(bag)
    else:
        assert judge(bag).samples["motion"] == 40


# ---------------------------------------------------------------- parts of bags


def halves(folder: Path, name: str) -> Path:
    """A bag of two parts, as ROS 2 splits it: NAME_0 and NAME_1."""
    whole = flight()
    first = written(folder, name, whole[:20])
    other = written(folder / "other", name, whole[20:])
    bag = folder / "bag"
    bag.mkdir()
    files = [next(p for p in b.iterdir() if p.name != "metadata.yaml") for b in (first, other)]
    end = files[0].name.partition(".")[2]
    for k, file in enumerate(files):
        shutil.copy(file, bag / f"bag_{k}.{end}")
    text = (first / "metadata.yaml").read_text().replace("message_count: 20", "message_count: 40")
    named = f"  - {files[0].name}\n"
    assert named in text
    (bag / "metadata.yaml").write_text(text.replace(named, f"  - bag_0.{end}\n  - bag_1.{end}\n"))
    return bag


SPLIT_KINDS = ["ros2_plain", "ros2_file", "ros2_message", "ros2_mcap"]


@pytest.mark.whole
@pytest.mark.parametrize("name", SPLIT_KINDS)
def test_all_parts_of_a_bag_are_read_or_it_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "other").mkdir()
    bag = halves(tmp_path, name)
    assert judge(bag).samples["motion"] == 40
    metadata = bag / "metadata.yaml"
    lines = [line for line in metadata.read_text().splitlines() if "- bag_1" not in line]
    metadata.write_text("\n".join(lines).replace("message_count: 40", "message_count: 20"))
    assert "lies in it, and its `metadata.yaml` does not name it" in refused(bag)
    one = next(p for p in bag.iterdir() if p.name.startswith("bag_1"))
    one.rename(tmp_path / one.name)
    assert judge(bag).samples["motion"] == 20


@pytest.mark.parametrize("name", ["ros2_plain", "ros2_mcap"])
def test_a_part_that_is_given_alone_is_told_with_the_others(tmp_path: Path, name: str) -> None:
    (tmp_path / "other").mkdir()
    bag = halves(tmp_path, name)
    for part in sorted(bag.glob("bag_*")):
        assert "beside it is another" in refused(part)
    (bag / "metadata.yaml").unlink()
    part = sorted(bag.glob("bag_*"))[1]
    assert "beside it is another" in refused(part)
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copy(part, alone)
    assert judge(alone / part.name).samples["motion"] == 20


@pytest.mark.parametrize("name", ["ros2_plain", "ros2_mcap"])
@pytest.mark.parametrize("there", [True, False])
def test_a_part_that_metadata_name_beside_others_is_told_whatever_it_is_called(
    tmp_path: Path, name: str, there: bool
) -> None:
    (tmp_path / "other").mkdir()
    bag = halves(tmp_path, name)
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("bag_0", "first").replace("bag_1", "then"))
    for part in sorted(bag.glob("bag_*")):
        part.rename(part.with_name(part.name.replace("bag_0", "first").replace("bag_1", "then")))
    part, other = sorted(bag.glob("[ft]*"))
    link = tmp_path / f"link{part.suffix}"
    link.symlink_to(part)
    if not there:
        other.unlink()
    for each in (part, link):
        assert f"its `metadata.yaml` names `{other.name}`, too" in refused(each)
        assert f"give the folder, `{bag}`" in refused(each)
    metadata.unlink()
    assert judge(link).samples["motion"] == 20


def test_a_link_to_a_numbered_part_is_told_with_the_others(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    bag = halves(tmp_path, "ros2_plain")
    (bag / "metadata.yaml").unlink()
    link = tmp_path / "link.db3"
    link.symlink_to(bag / "bag_0.db3")
    assert "beside it is another" in refused(link)
    (bag / "bag_1.db3").rename(bag / "bag_1.db3.zstd")
    assert "beside it is another" in refused(link)
    (bag / "bag_1.db3.zstd").rename(bag / "bag_0.db3.zstd")
    assert judge(link).samples["motion"] == 20


def test_messages_of_an_mcap_that_are_packed_one_by_one_are_told(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    as_bag2(bag, flight(), "MESSAGE", "MCAP")
    assert "packed one by one, which is read of sqlite3 only" in refused(bag)


def test_what_lies_beside_an_mcap_and_is_of_no_bag_is_no_matter(tmp_path: Path) -> None:
    log = written(tmp_path, "cdr.mcap")
    (tmp_path / "metadata.yaml").write_text("pilot: somebody\n")
    assert judge(log).samples["motion"] == 40


def test_counts_of_an_mcap_given_alone_are_compared(tmp_path: Path) -> None:
    bag = written(tmp_path, "ros2_mcap")
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 40", "message_count: 50"))
    told = refused(bag / "ros2_mcap.mcap")
    assert "its metadata count 50 messages of `/odom`, and 40 stand there" in told


def test_numbered_logs_of_others_are_not_parts_of_one(tmp_path: Path) -> None:
    log = written(tmp_path, "cdr.mcap")
    for k in range(2):
        shutil.copy(log, tmp_path / f"run_{k}.mcap")
    assert judge(tmp_path / "run_1.mcap").samples["motion"] == 40


# ---------------------------------------------------------------- counts


@pytest.mark.parametrize("name", ["ros2_plain", "ros2_mcap", "ros2_file"])
@pytest.mark.parametrize("count", [39, 41, 0])
def test_counts_of_metadata_are_compared(tmp_path: Path, name: str, count: int) -> None:
    bag = written(tmp_path, name)
    metadata = bag / "metadata.yaml"
    whole = metadata.read_text()
    metadata.write_text(whole.replace("message_count: 40", f"message_count: {count}"))
    told = refused(bag)
    assert f"its metadata count {count:,} messages of `/odom`, and 40 stand there" in told
    assert "ros2 bag reindex" in told


def test_counts_of_other_topics_are_compared_too(tmp_path: Path) -> None:
    camera = [Recorded(m.arrival_ns + 1, m.content, "/camera") for m in flight(5)]
    bag = written(tmp_path, "ros2_plain", [*flight(), *camera])
    assert judge(bag).samples["motion"] == 40
    changed(bag / DB, "DELETE FROM messages WHERE id > 43")
    assert "its metadata count 5 messages of `/camera`, and 3 stand there" in refused(bag)


def test_a_database_given_alone_is_compared_with_what_lies_beside_it_and_in_it(
    tmp_path: Path,
) -> None:
    bag = written(tmp_path, "ros2_plain")
    changed(bag / DB, "DELETE FROM messages WHERE id > 30")
    told = "its metadata count 40 messages of `/odom`, and 30 stand there"
    assert told in refused(bag / DB)
    (bag / "metadata.yaml").unlink()
    assert told in refused(bag / DB)
    changed(bag / DB, "UPDATE metadata SET metadata = replace(metadata, 'nt: 40', 'nt: 0')")
    assert judge(bag / DB).samples["motion"] == 30  # written before its last messages were


def test_messages_of_no_topic_are_told(tmp_path: Path) -> None:
    bag = written(tmp_path, "ros2_plain")
    changed(bag / DB, "UPDATE messages SET topic_id = 7 WHERE id > 35")
    assert "5 of its messages are of no topic" in refused(bag)


@pytest.mark.parametrize("more", [b"\0", bytes(4096), None])
def test_bytes_that_are_no_part_of_a_database_are_told(tmp_path: Path, more: bytes | None) -> None:
    """None: another one behind it, whose messages SQLite does not see."""
    bag = written(tmp_path, "ros2_plain")
    whole = (bag / DB).read_bytes()
    (bag / DB).write_bytes(whole + (whole if more is None else more))
    assert f"its database has {len(whole):,} bytes, and the file" in refused(bag)


def test_a_time_that_differs_from_the_index_of_its_database_is_told(tmp_path: Path) -> None:
    bag = written(tmp_path, "ros2_plain")
    data = bytearray((bag / DB).read_bytes())
    time = struct.pack(">q", T0 + 200_000_000)
    places = [k for k in range(len(data)) if data.startswith(time, k)]
    assert len(places) == 2, "in its row and in the index"
    data[places[1] + 5] ^= 4
    (bag / DB).write_bytes(data)
    assert "its database is damaged" in refused(bag)


# ---------------------------------------------------------------- ROS 1


def bag1(folder: Path, messages: int = 300) -> Path:
    """A bag of one chunk in which two connections are."""
    folder.mkdir(exist_ok=True)
    other = [Recorded(m.arrival_ns + 1, m.content, "/camera") for m in flight(2)]
    return written(folder, "plain.bag", [*other, *flight(messages)][: messages + 2])


def drop_last(parts: list[Record1]) -> None:
    del parts[-1]


def rename(parts: list[Record1]) -> None:
    at = next(k for k, r in enumerate(parts) if r[0] == CONNECTION1 and b"odom" in r[1]["topic"])
    parts[at] = CONNECTION1, {**parts[at][1], "topic": b"/wheel"}, parts[at][2]


def of_other(parts: list[Record1]) -> None:
    kind, header, content = parts[-1]
    number = struct.pack("<I", 1 - struct.unpack("<I", header["conn"])[0])
    parts[-1] = kind, {**header, "conn": number}, content


def later(parts: list[Record1]) -> None:
    kind, header, content = parts[-1]
    parts[-1] = kind, {**header, "time": struct.pack("<II", 1_800_000_000, 0)}, content


def count(name: str, by: int) -> Callable[[list[Record1]], None]:
    def change(records: list[Record1]) -> None:
        (n,) = struct.unpack("<I", records[0][1][name])
        records[0][1][name] = struct.pack("<I", n + by)

    return change


def size(records: list[Record1]) -> None:
    at = next(k for k, r in enumerate(records) if r[0] == CHUNK1)
    records[at][1]["size"] = struct.pack("<I", 5)


def fewer(records: list[Record1]) -> None:
    at = next(k for k, r in enumerate(records) if r[0] == INFO1)
    kind, header, content = records[at]
    number, n = struct.unpack_from("<II", content)
    records[at] = kind, header, struct.pack("<II", number, n - 1) + content[8:]


def twice(records: list[Record1]) -> None:
    at = next(k for k, r in enumerate(records) if r[0] == CONNECTION1)
    kind, header, content = records[at]
    records.insert(at, (kind, {**header, "topic": b"/wheel"}, content))
    count("conn_count", 1)(records)


DAMAGES: list[tuple[Callable[[list[Record1]], None], str]] = [
    (lambda r: inside(r, drop_last), "has other messages than the index says"),
    (lambda r: inside(r, of_other), "has other messages than the index says"),
    (lambda r: inside(r, later), "has other messages than the index says"),
    (lambda r: inside(r, rename), "is `/odom`, and another one at byte"),
    (twice, "is `/wheel`, and another one at byte"),
    (size, "is damaged: it says 5 bytes"),
    (fewer, "has another number of messages than it says"),
    (count("conn_count", -1), "cannot be used"),
    (count("chunk_count", -1), "cannot be used"),
    (lambda r: r.append(r[-1]), "its head counts other connections or chunks"),
]


@pytest.mark.whole
@pytest.mark.parametrize(("change", "told"), DAMAGES)
def test_a_bag_of_ros1_that_contradicts_itself_is_told(
    tmp_path: Path, change: Callable[[list[Record1]], Any], told: str
) -> None:
    whole = rewritten(bag1(tmp_path / "whole"), lambda _: None)
    assert judge(whole).samples["motion"] == 300
    assert told in refused(rewritten(bag1(tmp_path), change))


def test_a_chunk_that_no_index_names_is_told(tmp_path: Path) -> None:
    """As where somebody counts one chunk less: its messages would be lost without a word."""

    def more(records: list[Record1]) -> None:
        at = next(k for k, r in enumerate(records) if r[0] == CHUNK1)
        records[at:at] = records[at : at + 3]

    told = refused(rewritten(bag1(tmp_path), more))
    assert "the index does not name the chunk at byte" in told


@pytest.mark.parametrize("name", ["plain.bag", "bz2.bag", "lz4.bag"])
def test_bags_one_behind_the_other_are_not_one(tmp_path: Path, name: str) -> None:
    log = written(tmp_path, name)
    log.write_bytes(log.read_bytes() * 2)
    refused(log)
    log.write_bytes(log.read_bytes() + bytes(4))
    refused(log)
