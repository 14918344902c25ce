"""The files of bags, read by `rosbags`, within bounds that it does not set itself.

Purpose: one file of ROS 1, one SQLite file of ROS 2. Records that point to one another in circles,
chunks that unpack to gigabytes and databases that compute their rows end with an error.
Non-goals: folders (`ros_bags.py`). Imports the extra `logs`.
"""

from __future__ import annotations

import sqlite3
from functools import partial
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import quote

import apsw
from rosbags.interfaces import ConnectionExtRosbag1, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2 import Reader as Reader2

from soter.monitor.logs.files.log_columns import Writers
from soter.monitor.logs.files.ros_messages import (
    UndecodableError,
    decoder,
    decoder_made,
    definitions_in,
    known_definitions,
    require_type,
)
from soter.monitor.logs.files.whole_bags import WholeBag1, require_no_journal, require_whole
from soter.report.bounded_unpack import CHUNK_MAX, BoundedUnpacking

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from rosbags.interfaces import Connection
    from rosbags.rosbag1.reader import IndexData
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    from soter.monitor.logs.files.log_columns import Arrived, FileFacts, Wanted
    from soter.monitor.logs.files.ros_messages import Format

STEPS_PER_BYTE, STEPS_MIN = 100, 10_000_000
"""Instructions that SQLite is given for a file: so many a byte, and so many at all."""
STEPS_AT_ONCE = 1_000_000
IN_ORDER = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
"""As they were written: a clock that was set back is not hidden by sorting."""


class _BoundedReader1(Reader1):
    """A bag of ROS 1 whose index is no longer than its file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.bytes_left = path.stat().st_size

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """The entries at the place where the file is read."""
        assert self.bio is not None
        before = self.bio.tell()
        super().read_index_data(pos, indexes)
        self.bytes_left -= self.bio.tell() - before
        if self.bytes_left < 0:
            raise Reader1Error("its index is longer than the bag")


def ros1_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Time of arrival, channel and content of each message; None for what nobody wants.

    In the order of the file; ContradictionError where it is not as it says.
    """
    facts.unchecked = True
    writers = Writers()
    facts.size = path.stat().st_size
    unpacking = BoundedUnpacking(facts.size)
    bounded = {
        decompressors["none"]: unpacking.plain,
        decompressors["bz2"]: unpacking.bz2,
        decompressors["lz4"]: unpacking.lz4,
    }
    with _BoundedReader1(path) as reader:
        file = reader.bio
        assert file is not None
        chosen = {c.id: c for c in _chosen(reader.connections, wanted, facts)}
        names = {c.id: c.topic for c in reader.connections}
        decoders = _decoders_of(chosen, wanted, 1, facts)
        nodes = {k: _node_of(c) for k, c in chosen.items()}
        for connection, time_ns, data in WholeBag1(reader, bounded).messages():
            facts.there[names[connection]] += 1
            facts.at_byte = file.tell()
            content = None
            if connection in chosen:
                content = decoders[connection](data)
                writers.note(names[connection], nodes[connection])
            yield time_ns, None, names[connection], content
    facts.notes += writers.notes


def _offered(connections: Iterable[Connection]) -> Writers:
    writers = Writers()
    for c in connections:
        if isinstance(c.ext, ConnectionExtRosbag2):
            writers.offer(c.topic, len(c.ext.offered_qos_profiles))
    return writers


def sqlite_messages(
    path: Path, wanted: dict[str, Wanted], facts: FileFacts, *, packed: bool
) -> Iterator[Arrived]:
    """The same of one SQLite file of ROS 2; `packed`: its messages are, by zstd.

    Raises UndecodableError where its database or its messages are none of a bag.
    """
    facts.unchecked = True
    require_no_journal(path)
    _require_tables(path)
    size = path.stat().st_size
    unpacking = BoundedUnpacking(size)
    unpack = unpacking.zstd if packed else unpacking.plain
    with Reader2(path) as reader:
        database = cast("Sqlite3Reader", reader.storage).dbconn
        assert database is not None
        _limit(database, size)
        require_whole(database, {c.topic: c.msgcount for c in reader.connections}, path)
        chosen = {c.id: c for c in _chosen(reader.connections, wanted, facts)}
        for c in reader.connections:
            facts.there[c.topic] += 0 if c.id in chosen else c.msgcount
        writers = _offered(chosen.values())
        decoders = _decoders_of(chosen, wanted, 2, facts)
        names = {c.id: c.topic for c in reader.connections}
        for topic, time_ns, data in database.execute(IN_ORDER):
            name = names[topic]
            if topic not in chosen and isinstance(time_ns, int):
                yield time_ns, None, name, None
                continue
            if not isinstance(data, bytes) or not isinstance(time_ns, int):
                raise UndecodableError(f"a message of `{name}` is no bytes with a time")
            facts.there[name] += 1
            writers.note(name, f"topic {topic}")
            yield time_ns, None, name, decoders[topic](unpack(data))
    facts.notes += writers.notes


def _chosen(
    connections: list[Connection], wanted: dict[str, Wanted], facts: FileFacts
) -> list[Connection]:
    for connection in connections:
        facts.there.setdefault(connection.topic, 0)
    return [c for c in connections if c.topic in wanted]


def _node_of(connection: Connection) -> str:
    """Who published, where a bag of ROS 1 says so."""
    ext = connection.ext
    node = ext.callerid if isinstance(ext, ConnectionExtRosbag1) else None
    return node or f"connection {connection.id}"


def _decoders_of(
    chosen: Mapping[int, Connection], wanted: dict[str, Wanted], ros: int, facts: FileFacts
) -> dict[int, Callable[[bytes], Any]]:
    return {
        k: decoder_made(partial(_decoder_of, c, wanted[c.topic], ros), wanted[c.topic], facts)
        for k, c in chosen.items()
    }


def _decoder_of(connection: Connection, wanted: Wanted, ros: int) -> Callable[[bytes], Any]:
    name, definition = connection.msgtype, connection.msgdef
    require_type(connection.topic, name, wanted.message)
    ext = connection.ext
    if isinstance(ext, ConnectionExtRosbag2) and ext.serialization_format != "cdr":
        shown = f"`{ext.serialization_format[:40]}`, not cdr"
        raise UndecodableError(f"messages of `{connection.topic}` are {shown}")
    if definition.format == MessageDefinitionFormat.NONE:
        definitions = known_definitions(wanted.message, ros)
    else:
        form: Format = "msg" if definition.format == MessageDefinitionFormat.MSG else "idl"
        definitions = definitions_in(definition.data, name, form)
    return decoder(name, definitions, "ros1" if ros == 1 else "cdr")


def _require_tables(path: Path) -> None:
    """That a database holds what it says, and computes nothing when it is read."""
    address = f"file:{quote(str(path))}?mode=ro&immutable=1"
    connection = sqlite3.connect(address, uri=True)
    try:
        rows = connection.execute("SELECT type, sql FROM sqlite_master LIMIT 1000").fetchall()
    except sqlite3.Error as error:
        raise UndecodableError("it is no SQLite file, or damaged") from error
    finally:
        connection.close()
    for kind, sql in rows:
        text = " ".join(str(sql or "").upper().split())
        computed = "VIRTUAL TABLE" in text or "GENERATED" in text or " AS (" in text
        if kind not in ("table", "index") or computed:
            raise UndecodableError(f"its database has a `{kind}` that no bag has")


def _limit(database: apsw.Connection, size: int) -> None:
    """Let SQLite end: after so many steps, and with so much of a row."""
    left = STEPS_MIN + STEPS_PER_BYTE * size

    def is_too_long() -> bool:
        nonlocal left
        left -= STEPS_AT_ONCE
        return left < 0

    database.limit(apsw.SQLITE_LIMIT_LENGTH, CHUNK_MAX)
    database.set_progress_handler(is_too_long, STEPS_AT_ONCE)
