"""Logs that are damaged or mean harm: each ends with a code and a reason, within bounds.

Non-goals: logs that only do not fit (`test_logs_of_messages.py`).
"""

from __future__ import annotations

import bz2
import random
import shutil
import sqlite3
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import KINDS, T0, Recorded, changed_bag2, flight, judge, refused, written
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files import bag_files
from soter.monitor.log_files.message_decoding import (
    UndecodableError,
    find_definitions,
    message_decoder,
)
from soter.report import bounded_unpack

# ---------------------------------------------------------------- definitions that mean harm


def doubling(levels: int, last: str) -> str:
    parts = [f"p/T{levels} a\n"]
    for k in range(levels, 0, -1):
        below = f"p/T{k - 1} a\np/T{k - 1} b\n" if k > 1 else last
        parts.append(f"MSG: p/T{k}\n{below}")
    return ("=" * 80 + "\n").join(parts)


@pytest.mark.parametrize(
    "text",
    [
        doubling(40, "uint8 x\n"),
        doubling(40, ""),
        "p/E[] all\n" + "=" * 80 + "\nMSG: p/E\n",
        "p/E[4000000000] all\n" + "=" * 80 + "\nMSG: p/E\nuint8 x\n",
        "p/A a\n" + "=" * 80 + "\nMSG: p/A\np/B b\n" + "=" * 80 + "\nMSG: p/B\np/A a\n",
        "".join(f"float64 x{k}\n" for k in range(6000)),
    ],
)
def test_a_definition_larger_than_its_messages_is_refused(text: str) -> None:
    with pytest.raises(UndecodableError):
        message_decoder("p/Root", find_definitions(text, "p/Root", "msg"), "ros1")


def test_a_definition_longer_than_any_is_not_even_parsed() -> None:
    with pytest.raises(UndecodableError, match="is too long"):
        find_definitions("#" * 300_000, "p/Root", "msg")


WRITTEN_BY_ROS = """
// generated from rosidl_adapter/resource/msg.idl.em
#include "geometry_msgs/msg/Point.idl"

module p {
  module msg {
    typedef double double__36[36];
    module Root_Constants {
      const int8 LEFT = -1;
      const double SMALL = 1.5e-3;
      const string NAME = "a (b) << \\"c\\"";
    };
    @verbatim (language="comment", text=
      "Where it is (in m)." "\\n" "And * how far.")
    struct Root {
      @unit (value="m")
      @default (value=-2.0)
      double x;
      double__36 covariance;
      sequence<double, 3> few;
      sequence<string> names;
    };
  };
};
"""


def test_idl_as_ros_writes_it_is_read() -> None:
    definitions = find_definitions(WRITTEN_BY_ROS, "p/msg/Root", "idl")
    fields = [name for name, _ in definitions["p/msg/Root"][1]]
    assert fields == ["x", "covariance", "few", "names"]


@pytest.mark.parametrize(
    "value",
    ["((1))", "1 << 99999999999", "9 * 9", "1+1", "1 + 1", "2-1", "7 % 2", "~1", '"', "'\"("],
)
def test_idl_that_calculates_is_not_parsed(value: str) -> None:
    text = f"module p {{ module msg {{ const long X = {value}; struct Root {{ double x; }}; }}; }};"
    with pytest.raises(UndecodableError, match="is none that ROS writes"):
        find_definitions(text, "p/msg/Root", "idl")


@pytest.mark.parametrize(
    "text",
    [
        "sequence<" * 30 + "double" + ">" * 30,
        "@a(b=1) " * 3000,
        "@a(" + "b=1," * 3000 + "b=1)",
        'const string X = "a\\"' + "(" * 40,
        "/* " + "(" * 40,
    ],
)
def test_idl_that_would_take_for_ever_is_not_parsed(text: str) -> None:
    with pytest.raises(UndecodableError, match="is none that ROS writes"):
        find_definitions(text, "p/msg/Root", "idl")


@pytest.mark.parametrize("name", ["a/msg/B\nimport os", "a/../b", "", "/a/b", "a/b'c", "Odometry"])
def test_a_name_that_is_none_never_becomes_code(name: str) -> None:
    with pytest.raises(UndecodableError):
        message_decoder(name, find_definitions("float64 x\n", name, "msg"), "cdr")


def test_the_constants_of_a_definition_never_become_code() -> None:
    lines = ["string A=x); import os; os.abort(); (", "float64 x", "float64 B=1e999", "int32 C=7"]
    decode = message_decoder("p/Root", find_definitions("\n".join(lines), "p/Root", "msg"), "ros1")
    assert decode(bytes(8)).x == 0.0
    assert not hasattr(decode(bytes(8)), "C")


# ---------------------------------------------------------------- bags that mean harm


def test_a_file_of_a_bag_that_is_a_device_or_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    import os

    for target in (Path("/dev/zero"), tmp_path / "pipe"):
        if not target.exists():
            os.mkfifo(target)
        bag = changed_bag2(tmp_path)
        file = bag / "ros2_plain.db3"
        file.unlink()
        file.symlink_to(target)
        assert "it is no ordinary file" in refused(bag)
    pipe = tmp_path / "pipe.bag"
    os.mkfifo(pipe)
    assert "it is no ordinary file" in refused(pipe)


@pytest.mark.parametrize(
    "sql",
    [
        "DROP TABLE messages; CREATE VIEW messages AS SELECT id, 1 AS topic_id FROM topics",
        "CREATE TRIGGER t AFTER INSERT ON messages BEGIN SELECT 1; END",
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER, data BLOB AS (zeroblob(99999999)))",
        "CREATE VIRTUAL TABLE other USING fts5(x)",
    ],
)
def test_a_database_that_computes_its_rows_is_refused(tmp_path: Path, sql: str) -> None:
    bag = written(tmp_path, "ros2_plain")
    connection = sqlite3.connect(bag / "ros2_plain.db3")
    connection.executescript(sql)
    connection.close()
    assert "that no bag has" in refused(bag)


def test_a_database_that_takes_too_many_steps_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_files, "STEPS_AT_ONCE", 10)
    monkeypatch.setattr(bag_files, "STEPS_MIN", 20)
    monkeypatch.setattr(bag_files, "STEPS_PER_BYTE", 0)
    assert "it is no bag of ROS, or damaged" in refused(written(tmp_path, "ros2_plain"))


# ---------------------------------------------------------------- much of nothing


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds that a test reaches."""
    monkeypatch.setattr(bounded_unpack, "CHUNK_MAX", 1 << 20)
    monkeypatch.setattr(bounded_unpack, "UNPACKED_MIN", 3 << 20)


@pytest.mark.usefixtures("small")
def test_what_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    import lz4.frame
    import zstandard

    zeros = bytes(2 << 20)
    unpacking = bounded_unpack.BoundedUnpacking(10)
    for unpack, packed in [
        (unpacking.unpack_bz2, bz2.compress(zeros)),
        (unpacking.unpack_lz4, lz4.frame.compress(zeros)),
        (unpacking.unpack_zstd, zstandard.compress(zeros)),
        (unpacking.unpack_zstd, zstandard.compress(bytes(1 << 19)) * 3),
    ]:
        with pytest.raises(bounded_unpack.TooLargeError):
            unpack(packed)
    for _ in range(3):
        unpacking.count_plain(bytes(1 << 20))
    with pytest.raises(bounded_unpack.TooLargeError):
        unpacking.count_plain(b"x")
    bomb = tmp_path / "bomb"
    bomb.mkdir()
    shutil.copy(
        changed_bag2(
            tmp_path,
            one=("compression_mode: ''", "compression_mode: file"),
            two=("compression_format: ''", "compression_format: zstd"),
        )
        / "metadata.yaml",
        bomb,
    )
    (bomb / "ros2_plain.db3").write_bytes(zstandard.compress(bytes(4 << 20)))
    assert "it unpacks to more than any log has" in refused(bomb)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("name", ["cdr.mcap", "json.mcap", "bz2.bag", "lz4.bag", "ros2_message"])
def test_a_message_of_nothing_but_zeros_is_refused(tmp_path: Path, name: str) -> None:
    text = {"header": {"frame_id": "0" * (2 << 20), "stamp": {}}}
    log = written(tmp_path, name, [Recorded(T0, text)])
    assert "unpacks to more than 1 MiB" in refused(log)


def test_an_index_that_is_longer_than_its_bag_is_refused(tmp_path: Path) -> None:
    """Its one chunk, and the index behind it, are told so many times."""
    log = written(tmp_path, "plain.bag", flight(200))
    judge(log)
    told = refused(_with_chunks_repeated(log, log.read_bytes(), 200))
    assert "its index is longer than the bag" in told


def _with_chunks_repeated(log: Path, data: bytes, times: int) -> Path:
    """The bag with every CHUNK_INFO told so many times."""
    import struct
    from io import BytesIO

    from rosbags.rosbag1.reader import Header

    (index_pos,) = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)
    infos, file = [], BytesIO(data)
    file.seek(index_pos)
    while (at := file.tell()) < len(data):
        header = Header.read(file)
        (size,) = struct.unpack("<I", file.read(4))
        file.seek(size, 1)
        if header["op"] == b"\x06":
            infos.append(data[at : file.tell()])
    count_at = data.index(b"chunk_count=") + len(b"chunk_count=")
    many = struct.pack("<I", len(infos) * (times + 1))
    log.write_bytes(data[:count_at] + many + data[count_at + 4 :] + b"".join(infos) * times)
    return log


# ---------------------------------------------------------------- damage


FLIPS = 10
"""Changed copies of each file; thousands were read once."""


def files_of(log: Path) -> list[Path]:
    return [log] if log.is_file() else sorted(log.iterdir())


@pytest.mark.parametrize("name", KINDS)
def test_a_log_that_is_cut_anywhere_is_refused_or_judged_and_never_a_traceback(
    tmp_path: Path, name: str
) -> None:
    log = written(tmp_path, name)
    whole = {file: file.read_bytes() for file in files_of(log)}
    refusals = 0
    for file, data in whole.items():
        for share in (0.0, 0.001, 0.1, 0.3, 0.5, 0.9, 0.99):
            file.write_bytes(data[: int(len(data) * share)])
            refusals += is_refused(log)
        file.write_bytes(data)
    assert refusals >= 5
    judge(log)


@pytest.mark.parametrize("name", KINDS)
def test_a_log_with_other_bytes_is_refused_or_judged_and_never_a_traceback(
    tmp_path: Path, name: str
) -> None:
    log = written(tmp_path, name, flight(8))
    whole = {file: file.read_bytes() for file in files_of(log)}
    generator = random.Random(7)  # noqa: S311 - no secret
    for file, data in whole.items():
        for _ in range(FLIPS):
            changed = bytearray(data)
            for _ in range(generator.choice([1, 1, 1, 4, 16])):
                changed[generator.randrange(len(changed))] = generator.randrange(256)
            file.write_bytes(changed)
            is_refused(log)
        file.write_bytes(data)


def is_refused(log: Path) -> bool:
    """Whether a log ends with a diagnostic; anything else that is raised fails the test."""
    codes: set[str] = set()
    try:
        judge(log)
    except SoterError as error:
        codes = {d.code for d in error.diagnostics}
    assert codes <= {"D016", "D017"}
    return bool(codes)


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3", "a.csv", "a.csv.gz"])
def test_a_link_in_a_circle_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).symlink_to("b")
    (tmp_path / "b").symlink_to(name)
    with pytest.raises(SoterError) as caught:
        judge(tmp_path / name)
    assert {d.code for d in caught.value.diagnostics} <= {"D007", "D016"}
