"""One flight, written into every kind of log that `soter monitor --map` reads.

Purpose: messages of ROS as plain dictionaries, and writers of CSV, MCAP (JSON, cdr, ros1,
protobuf), bags of ROS 1 and 2, packed and not, by the packages of those formats; the cart's module
judged on them.
Non-goals: what is asked of these logs.
"""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import build_file_descriptor_set
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from soter.api import load
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosbags.typesys.store import Typestore

    from soter.monitor.log_judgement import LogJudgement

ODOMETRY = "nav_msgs/msg/Odometry"
CHANNEL = "/odom"
BASE, NAMED, ARRAY, SEQUENCE = 1, 2, 3, 4
CART = Path(__file__).resolve().parents[2] / "examples" / "wall" / "cart.soter"
T0 = 1_700_000_000 * 10**9
MS = 10**6
FIELDS = {"x": "pose.pose.position.x", "v": "twist.twist.linear.x"}
TYPED: dict[str, Any] = {"channel": CHANNEL, "type": "nav_msgs/Odometry", "fields": FIELDS}
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Recorded:
    """A message, when it arrived, and of which channel and type."""

    arrival_ns: int
    content: dict[str, Any]
    channel: str = CHANNEL
    type: str = ODOMETRY


def stamped(stamp_ns: int, frame: str = "odom") -> dict[str, Any]:
    """The header of a message."""
    seconds, rest = divmod(stamp_ns, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def odometry(stamp_ns: int, x: float, v: float, frame: str = "odom") -> dict[str, Any]:
    """Where something is along x, and how fast."""
    return {
        "header": stamped(stamp_ns, frame),
        "pose": {"pose": {"position": {"x": x}}},
        "twist": {"twist": {"linear": {"x": v}}},
    }


# ---------------------------------------------------------------- from dictionaries to messages


def _fields(store: Typestore, name: str) -> list[tuple[str, Any]]:
    return list(store.fielddefs[name][1])


def ros_message(store: Typestore, name: str, content: dict[str, Any]) -> Any:
    """A message of ROS, all else in it zero."""
    values = {}
    for field, kind in _fields(store, name):
        given = content.get(field)
        values[field] = _ros_value(store, kind, given)
    return store.types[name](**values)


def _ros_value(store: Typestore, kind: Any, given: Any) -> Any:
    if kind[0] == NAMED:
        return ros_message(store, kind[1], given or {})
    if kind[0] == BASE:
        return given if given is not None else {"string": "", "bool": False}.get(kind[1][0], 0)
    (inner, size), rest = kind[1], given or []
    if inner[0] == NAMED:
        return [ros_message(store, inner[1], each) for each in rest]
    values = rest or ([0] * size if kind[0] == ARRAY else [])
    return values if inner[1][0] == "string" else np.array(values, dtype=inner[1][0])


def whole(name: str, content: dict[str, Any], store: Typestore = ROS2) -> dict[str, Any]:
    """A message as JSON writes it, all else in it zero."""
    made: dict[str, Any] = {}
    for field, kind in _fields(store, name):
        given = content.get(field)
        if kind[0] == NAMED:
            made[field] = whole(kind[1], given or {}, store)
        elif kind[0] == BASE:
            made[field] = _ros_value(store, kind, given)
        else:
            made[field] = list(given or ([0] * kind[1][1] if kind[0] == ARRAY else []))
    return made


PROTOBUF = {
    "float64": 1,
    "float32": 2,
    "int32": 5,
    "uint32": 13,
    "string": 9,
    "bool": 8,
    "uint8": 13,
}
"""Primitives, by the numbers that protobuf has for their types."""


def protobuf_class(name: str) -> Any:
    """A class of protobuf with the fields of a ROS type."""
    needed: list[str] = []

    def collect(of: str) -> None:
        if of not in needed:
            needed.append(of)
            for _, kind in _fields(ROS2, of):
                inner = kind if kind[0] in (BASE, NAMED) else kind[1][0]
                if inner[0] == NAMED:
                    collect(inner[1])

    collect(name)
    file = descriptor_pb2.FileDescriptorProto(name="robot.proto", package="robot", syntax="proto3")
    for each in needed:
        message = file.message_type.add(name=each.replace("/", "_"))
        for number, (field, kind) in enumerate(_fields(ROS2, each), 1):
            is_list = kind[0] in (ARRAY, SEQUENCE)
            inner = kind[1][0] if is_list else kind
            made = message.field.add(name=field, number=number, label=3 if is_list else 1)
            if inner[0] == NAMED:
                made.type, made.type_name = 11, ".robot." + inner[1].replace("/", "_")
            else:
                made.type = PROTOBUF[inner[1][0]]
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(
        pool.FindMessageTypeByName("robot." + name.replace("/", "_"))
    )


# ---------------------------------------------------------------- writers


def as_csv(path: Path, flight: list[Recorded]) -> None:
    """A column a field, named by its path; `t` in ns."""
    rows = [{"t": m.arrival_ns, **dict(_flat(whole(m.type, m.content)))} for m in flight]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for name, part in parts:
        at = f"{path}.{name}" if path else str(name)
        if isinstance(part, (dict, list)):
            yield from _flat(part, at)
        else:
            yield at, repr(part) if isinstance(part, float) else part


def _as_mcap(
    path: Path,
    flight: list[Recorded],
    encoding: str,
    schema_of: Callable[[str], tuple[str, str, bytes]],
    bytes_of: Callable[[Recorded], bytes],
    compression: CompressionType = CompressionType.NONE,
) -> None:
    with path.open("wb") as file:
        writer: Any = McapWriter(file, compression=compression, chunk_size=20_000)
        writer.start()
        channels: dict[str, int] = {}
        for m in flight:
            if m.channel not in channels:
                schema = writer.register_schema(*schema_of(m.type))
                channels[m.channel] = writer.register_channel(m.channel, encoding, schema)
            data = bytes_of(m)
            writer.add_message(channels[m.channel], m.arrival_ns, data, m.arrival_ns)
        writer.finish()


def as_json_mcap(path: Path, flight: list[Recorded]) -> None:
    """JSON, chunks of zstd."""
    _as_mcap(
        path,
        flight,
        "json",
        lambda name: (name, "jsonschema", b"{}"),
        lambda m: json.dumps(whole(m.type, m.content)).encode(),
        CompressionType.ZSTD,
    )


def cdr(m: Recorded) -> bytes:
    """The bytes of a message in ROS 2."""
    return bytes(ROS2.serialize_cdr(ros_message(ROS2, m.type, m.content), m.type))


def as_cdr_mcap(path: Path, flight: list[Recorded]) -> None:
    """What ROS 2 records, chunks of lz4."""

    def schema_of(name: str) -> tuple[str, str, bytes]:
        return name, "ros2msg", ROS2.generate_msgdef(name, ros_version=2)[0].encode()

    _as_mcap(path, flight, "cdr", schema_of, cdr, CompressionType.LZ4)


def as_ros1_mcap(path: Path, flight: list[Recorded]) -> None:
    """What ROS 1 published, unpacked."""
    _as_mcap(
        path,
        flight,
        "ros1",
        lambda n: (n.replace("/msg/", "/"), "ros1msg", ROS1.generate_msgdef(n)[0].encode()),
        lambda m: bytes(ROS1.serialize_ros1(ros_message(ROS1, m.type, m.content), m.type)),
    )


def as_protobuf_mcap(path: Path, flight: list[Recorded]) -> None:
    """Messages of protobuf with the same names."""
    classes = {name: protobuf_class(name) for name in {m.type for m in flight}}

    def schema_of(name: str) -> tuple[str, str, bytes]:
        files = build_file_descriptor_set(classes[name])
        return "robot." + name.replace("/", "_"), "protobuf", files.SerializeToString()

    def bytes_of(m: Recorded) -> bytes:
        content = _said_in_words(whole(m.type, m.content))
        message = json_format.ParseDict(content, classes[m.type]())
        return bytes(message.SerializeToString())

    _as_mcap(path, flight, "protobuf", schema_of, bytes_of, CompressionType.ZSTD)


def _said_in_words(value: Any) -> Any:
    """NaN and infinities as the JSON of protobuf writes them."""
    if isinstance(value, dict):
        return {k: _said_in_words(v) for k, v in value.items()}
    words = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
    return words.get(str(value), value) if isinstance(value, float) else value


def as_bag1(path: Path, flight: list[Recorded], packed: Literal["", "BZ2", "LZ4"] = "") -> None:
    """A bag of ROS 1."""
    writer = Bag1Writer(path)
    if packed:
        writer.set_compression(Bag1Writer.CompressionFormat[packed])
    with writer:
        connections: dict[str, Any] = {}
        for m in flight:
            if m.channel not in connections:
                connections[m.channel] = writer.add_connection(m.channel, m.type, typestore=ROS1)
            data = ROS1.serialize_ros1(ros_message(ROS1, m.type, m.content), m.type)
            writer.write(connections[m.channel], m.arrival_ns, data)


def as_bag2(
    path: Path,
    flight: list[Recorded],
    packed: Literal["NONE", "FILE", "MESSAGE"] = "NONE",
    storage: Literal["SQLITE3", "MCAP"] = "SQLITE3",
) -> None:
    """A bag of ROS 2: a folder."""
    if path.exists():
        shutil.rmtree(path)
    writer = Bag2Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for m in flight:
            if m.channel not in connections:
                connections[m.channel] = writer.add_connection(m.channel, m.type, typestore=ROS2)
            writer.write(connections[m.channel], m.arrival_ns, cdr(m))


WRITERS: dict[str, Callable[[Path, list[Recorded]], None]] = {
    "flight.csv": as_csv,
    "json.mcap": as_json_mcap,
    "cdr.mcap": as_cdr_mcap,
    "ros1.mcap": as_ros1_mcap,
    "protobuf.mcap": as_protobuf_mcap,
    "plain.bag": as_bag1,
    "bz2.bag": lambda path, flight: as_bag1(path, flight, "BZ2"),
    "lz4.bag": lambda path, flight: as_bag1(path, flight, "LZ4"),
    "ros2_plain": as_bag2,
    "ros2_file": lambda path, flight: as_bag2(path, flight, "FILE"),
    "ros2_message": lambda path, flight: as_bag2(path, flight, "MESSAGE"),
    "ros2_mcap": lambda path, flight: as_bag2(path, flight, "NONE", "MCAP"),
}
"""Every kind of log, by the name of its file or folder."""
KINDS = [name for name in WRITERS if name != "flight.csv"]
"""Those of messages."""


# ---------------------------------------------------------------- judged


def flight(n: int = 40) -> list[Recorded]:
    """A hundred messages a second, each a millisecond late, as fast as nothing."""
    return [
        Recorded(T0 + k * 10 * MS, odometry(T0 + k * 10 * MS - MS, 0.01 * k, 0.1)) for k in range(n)
    ]


def judge(log: Path, **motion: Any) -> LogJudgement:
    """The cart's module on a log, with other keys for its topic; None takes one away."""
    given = {k: v for k, v in {**TYPED, **motion}.items() if v is not None}
    return load(CART).judge_log(log, {"topics": {"motion": given}}, system="Protected")


def refused(log: Path, code: str = "D016", **motion: Any) -> str:
    """What is said of a log that is not judged."""
    with pytest.raises(SoterError) as error:
        judge(log, **motion)
    (problem,) = error.value.diagnostics
    assert problem.code == code, problem
    return " ".join((problem.message, *problem.helps))


def written(folder: Path, name: str, recorded: list[Recorded] | None = None) -> Path:
    """The path of a log of this kind."""
    WRITERS[name](folder / name, flight() if recorded is None else recorded)
    return folder / name


def changed_bag2(folder: Path, **changes: tuple[str, str]) -> Path:
    """A bag, with texts of its metadata replaced."""
    bag = written(folder, "ros2_plain")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    for before, after in changes.values():
        assert before in text
        text = text.replace(before, after)
    metadata.write_text(text)
    return bag
