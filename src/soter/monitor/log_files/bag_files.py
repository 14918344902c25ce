"""Reads the files of bags of ROS within bounds, and checks that they make a whole bag.

Purpose: `ros1_messages` and `sqlite_messages` read one file of ROS 1, or one SQLite file of ROS 2,
within bounds: records that point to one another in circles, chunks that unpack to gigabytes and
databases that compute their rows end with an error. They check that a bag is whole: chunks against
the index (ROS 1); databases against SQLite's checks, files beside them and metadata (ROS 2).
Non-goals: values (neither kind has checksums, so one that was changed in its place is not seen);
folders (`ros_bags.py`). Imports the extra `logs`.
"""

from __future__ import annotations

import shlex
import sqlite3
from collections import Counter
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import quote

import apsw
from rosbags.interfaces import ConnectionExtRosbag1, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag1.reader import Header, RecordType, decompressors, read_bytes, read_uint32
from rosbags.rosbag2 import Reader as Reader2

from soter.monitor.log_files.log_columns import REINDEX, Writers
from soter.monitor.log_files.message_decoding import (
    UndecodableError,
    default_definitions,
    find_definitions,
    message_decoder,
    require_type,
    tolerant_decoder,
)
from soter.report.bounded_unpack import CHUNK_MAX, BoundedUnpacking

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO

    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import IndexData
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted
    from soter.monitor.log_files.message_decoding import Format


MAGIC1 = len(b"#ROSBAG V2.0\n")
REMEDY1 = "`rosbag reindex FILE` makes its index anew, of what is there"
RECOVER = "`sqlite3 FILE .recover` saves what can be read"
OPENED = 'python3 -c "import sqlite3, sys; sqlite3.connect(sys.argv[1]).execute({}).fetchall()" {}'
CHECKPOINT, ROLLBACK = "'PRAGMA wal_checkpoint(TRUNCATE)'", "'SELECT 1 FROM messages'"


class ContradictionError(ValueError):
    """Says where and how a bag contradicts itself; `remedy` says how to repair the bag."""

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(message)
        self.remedy = remedy


def _contradiction_error(message: str) -> ContradictionError:
    return ContradictionError(message, REMEDY1)


class WholeBag1:
    """Reads an open ROS 1 bag; `unpack` replaces unpacking functions by bounded versions."""

    def __init__(
        self, reader: Reader, unpack: Mapping[Callable[[bytes], bytes], Callable[[bytes], bytes]]
    ) -> None:
        self.reader, self.unpack = reader, unpack
        self.sizes: dict[int, int] = {}
        self.known: dict[int, tuple[dict[str, bytes], bytes]] = {}

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Gives the connection, time and bytes of every message, in the order of the file.

        Raises ContradictionError if a chunk, the index or a connection contradicts another part.
        """
        self._check_records()
        index: dict[int, Counter[tuple[int, int]]] = {}
        for connection, entries in self.reader.indexes.items():
            for entry in entries:
                index.setdefault(entry.chunk_pos, Counter())[connection, entry.time] += 1
        for info in sorted(self.reader.chunk_infos, key=lambda i: i.pos):
            found: Counter[tuple[int, int]] = Counter()
            for connection, time_ns, data in self._chunk_messages(info.pos):
                found[connection, time_ns] += 1
                yield connection, time_ns, data
            where = f"the chunk at byte {info.pos}"
            if found != index.get(info.pos, Counter()):
                raise _contradiction_error(f"{where} has other messages than the index says")
            counts: Counter[int] = Counter()
            for (connection, _), n in found.items():
                counts[connection] += n
            counts_by_connection = {c: n for c, n in info.connection_counts.items() if n}
            if counts_by_connection != dict(counts):
                raise _contradiction_error(f"{where} has another number of messages than it says")
            times = [time_ns for _, time_ns in found]
            if times and (min(times), max(times) + 1) != (info.start_time, info.end_time):
                raise _contradiction_error(f"{where} has messages of other times than it says")

    def _check_records(self) -> None:
        """Steps over every record up to the end, and compares them with the file's head."""
        file = self.reader.bio
        assert file is not None
        file.seek(0, 2)
        end = file.tell()
        file.seek(MAGIC1)
        seen: Counter[int] = Counter()
        while (at := file.tell()) < end:
            try:
                header = Header.read(file)
                kind, size = header.get_uint8("op"), read_uint32(file)
            except ReaderError as error:
                raise _contradiction_error(f"at byte {at} stands no record") from error
            seen[kind] += 1
            if kind == RecordType.CHUNK:
                if at not in self.reader.chunks:
                    raise _contradiction_error(f"the index does not name the chunk at byte {at}")
                self.sizes[at] = header.get_uint32("size")
            if kind == RecordType.CONNECTION:
                self._define_connection(header, read_bytes(file, size), at)
            else:
                file.seek(size, 1)
        if file.tell() > end:
            raise _contradiction_error("its end is missing")
        index = (
            len(self.reader.connections),
            len(self.reader.chunk_infos),
            len(self.reader.chunks),
        )
        kinds = RecordType.CONNECTION, RecordType.CHUNK_INFO, RecordType.CHUNK
        if index != tuple(seen[kind] for kind in kinds):
            raise _contradiction_error(
                "its head counts other connections or chunks than stand there"
            )

    def _define_connection(self, header: Header, body: bytes, at: int) -> None:
        number = header.get_uint32("conn")
        before, _ = self.known.setdefault(number, (dict(header), body))
        if self.known[number] != (dict(header), body):
            topic = before["topic"].decode("utf-8", "replace")[:80]
            message = f"connection {number} is `{topic}`, and another one at byte {at}"
            raise _contradiction_error(message)

    def _chunk_messages(self, place: int) -> Iterator[tuple[int, int, bytes]]:
        chunk = self.reader.chunks[place]
        file: BinaryIO | None = self.reader.bio
        assert file is not None
        file.seek(chunk.datapos)
        packed = read_bytes(file, chunk.datasize)
        data = self.unpack[chunk.decompressor](packed)
        if len(data) != self.sizes[place]:
            message = f"it says {self.sizes[place]:,} bytes and has {len(data):,}"
            raise _contradiction_error(f"the chunk at byte {place} is damaged: {message}")
        inside = BytesIO(data)
        while inside.tell() < len(data):
            header = Header.read(inside)
            body = read_bytes(inside, read_uint32(inside))
            kind = header.get_uint8("op")
            if kind == RecordType.CONNECTION:
                self._define_connection(header, body, place)
            elif kind != RecordType.MSGDATA:
                raise _contradiction_error(
                    f"a record of kind {kind} stands in the chunk at byte {place}"
                )
            elif header.get_uint32("conn") not in self.known:
                raise _contradiction_error(
                    f"a message of the chunk at byte {place} is of no connection"
                )
            else:
                yield header.get_uint32("conn"), header.get_time("time"), body


# ---------------------------------------------------------------- ROS 2


def require_no_journal(path: Path) -> None:
    """Raises ContradictionError if SQLite left a journal beside a database or a link to it."""
    for each in dict.fromkeys((path, path.resolve())):
        database = each.with_name(each.name.removesuffix(".zstd"))
        wal, journal = (database.with_name(database.name + end) for end in ("-wal", "-journal"))
        if wal.is_file() and wal.stat().st_size:
            why = f"`{wal.name}` beside it holds messages that are not in it yet"
            raise ContradictionError(
                why, "put them into it: " + OPENED.format(CHECKPOINT, shlex.quote(str(database)))
            )
        if journal.is_file() and any(journal.read_bytes()[:8]):
            why = f"`{journal.name}` beside it says that something was not written to its end"
            raise ContradictionError(
                why,
                "let SQLite take it back: " + OPENED.format(ROLLBACK, shlex.quote(str(database))),
            )


def require_intact(database: apsw.Connection, counts: Mapping[str, int], path: Path) -> None:
    """Raises ContradictionError if a database is damaged, or has fewer messages than it announces.

    `counts` are the messages read, by topic. More than announced is right: the metadata are older.
    """
    size = path.stat().st_size
    pages = next(iter(database.execute(SIZE)))[0]
    if size != pages:
        message = f"its database has {pages:,} bytes, and the file {size:,}"
        raise ContradictionError(message, RECOVER)
    try:
        (message,) = next(iter(database.execute("PRAGMA integrity_check(1)")))
    except apsw.InterruptError:
        raise
    except apsw.Error as error:
        message = str(error)
    if message != "ok":
        raise ContradictionError(f"its database is damaged: {str(message)[:120]}", RECOVER)
    (stored,) = next(iter(database.execute("SELECT count(*) FROM messages")))
    if stored != sum(counts.values()):
        lost = stored - sum(counts.values())
        raise ContradictionError(f"{lost:,} of its messages are of no topic", REINDEX)
    if not next(iter(database.execute(HAS_METADATA)), None):
        return
    row = next(iter(database.execute("SELECT metadata FROM metadata ORDER BY id DESC")), None)
    announced = counts_in_metadata(row[0], path.name) if row is not None else {}
    for topic, n in sorted(announced.items(), key=lambda each: each[0] is None):
        if n > (stored if topic is None else counts.get(topic, 0)):
            raise wrong_count_error(topic, n, stored if topic is None else counts.get(topic, 0))


SIZE = "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"
HAS_METADATA = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'metadata'"


def counts_in_metadata(text: Any, file: str) -> dict[str | None, int]:  # noqa: ANN401 - what a row has
    """The number of messages by topic (None: of all) in a database's metadata; {} if unknown."""
    from ruamel.yaml import YAML  # noqa: PLC0415 - comes with rosbags
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415 - the same

    try:
        metadata = YAML(typ="safe").load(text)
        information = metadata.get("rosbag2_bagfile_information", metadata)
        if len(information["relative_file_paths"]) == 1:
            return message_counts(information)
        counts = [int(f["message_count"]) for f in information["files"] if f["path"] == file]
        return {None: counts[0]} if counts else {}
    except (YAMLError, KeyError, TypeError, AttributeError, ValueError, RecursionError):
        return {}


def message_counts(information: Any) -> dict[str | None, int]:  # noqa: ANN401 - what YAML has
    """The numbers of messages by topic (None: of all); raises KeyError, TypeError, ValueError."""
    counts: dict[str | None, int] = {None: int(information["message_count"])}
    for each in information["topics_with_message_count"]:
        name = str(each["topic_metadata"]["name"])
        counts[name] = counts.get(name, 0) + int(each["message_count"])
    return counts


def require_counts(announced: Mapping[str | None, int], read_by_topic: Mapping[str, int]) -> None:
    """Raises ContradictionError if the numbers of read messages differ from `metadata.yaml`."""
    read: dict[str | None, int] = {None: sum(read_by_topic.values())}
    read.update(read_by_topic)
    for topic in (*sorted(t for t in {*announced, *read} if t is not None), None):
        if announced and announced.get(topic, 0) != read.get(topic, 0):
            raise wrong_count_error(topic, announced.get(topic, 0), read.get(topic, 0))


def wrong_count_error(topic: str | None, announced: int, read: int) -> ContradictionError:
    """The ContradictionError for a topic with another number of messages than the metadata say."""
    of = "in all" if topic is None else f"of `{topic[:80]}`"
    message = f"its metadata count {announced:,} messages {of}, and {read:,} stand there"
    return ContradictionError(message, REINDEX + ", of what is there")


STEPS_PER_BYTE, STEPS_MIN = 100, 10_000_000
"""Instructions that SQLite may run for a file: so many for each byte, and so many in addition."""
STEPS_AT_ONCE = 1_000_000
IN_ORDER = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
"""Messages as they were written: sorting would hide a clock that was set back."""


class _BoundedReader1(Reader1):
    """A ROS 1 bag whose index may not be longer than the file itself."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.bytes_left = path.stat().st_size

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Reads index entries at the file's position; raises Reader1Error if they are too long."""
        assert self.bio is not None
        before = self.bio.tell()
        super().read_index_data(pos, indexes)
        self.bytes_left -= self.bio.tell() - before
        if self.bytes_left < 0:
            raise Reader1Error("its index is longer than the bag")


def ros1_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives messages in order: arrival, channel, content (None: unwanted). ContradictionError."""
    facts.unchecked = True
    writers = Writers()
    facts.size = path.stat().st_size
    unpacking = BoundedUnpacking(facts.size)
    bounded = {
        decompressors["none"]: unpacking.count_plain,
        decompressors["bz2"]: unpacking.unpack_bz2,
        decompressors["lz4"]: unpacking.unpack_lz4,
    }
    with _BoundedReader1(path) as reader:
        file = reader.bio
        assert file is not None
        chosen = {c.id: c for c in _wanted_connections(reader.connections, wanted, facts)}
        names = {c.id: c.topic for c in reader.connections}
        decoders = _decoders_by_connection(chosen, wanted, 1, facts)
        nodes = {k: _publishing_node(c) for k, c in chosen.items()}
        for connection, time_ns, data in WholeBag1(reader, bounded).messages():
            facts.there[names[connection]] += 1
            facts.at_byte = file.tell()
            content = None
            if connection in chosen:
                content = decoders[connection](data)
                writers.note_message(names[connection], nodes[connection])
            yield time_ns, None, names[connection], content
    facts.notes += writers.notes


def _announced_publishers(connections: Iterable[Connection]) -> Writers:
    writers = Writers()
    for c in connections:
        if isinstance(c.ext, ConnectionExtRosbag2):
            writers.note_publishers(c.topic, len(c.ext.offered_qos_profiles))
    return writers


def sqlite_messages(
    path: Path, wanted: dict[str, Wanted], facts: FileFacts, *, packed: bool
) -> Iterator[Arrived]:
    """Gives the messages of one SQLite file of ROS 2, in the form of `ros1_messages`.

    `packed`: zstd compresses them. Raises UndecodableError if the file or a message is of no bag.
    """
    facts.unchecked = True
    require_no_journal(path)
    _require_tables(path)
    size = path.stat().st_size
    unpacking = BoundedUnpacking(size)
    unpack = unpacking.unpack_zstd if packed else unpacking.count_plain
    with Reader2(path) as reader:
        database = cast("Sqlite3Reader", reader.storage).dbconn
        assert database is not None
        _limit_steps(database, size)
        require_intact(database, {c.topic: c.msgcount for c in reader.connections}, path)
        chosen = {c.id: c for c in _wanted_connections(reader.connections, wanted, facts)}
        for c in reader.connections:
            facts.there[c.topic] += 0 if c.id in chosen else c.msgcount
        writers = _announced_publishers(chosen.values())
        decoders = _decoders_by_connection(chosen, wanted, 2, facts)
        names = {c.id: c.topic for c in reader.connections}
        for topic, time_ns, data in database.execute(IN_ORDER):
            name = names[topic]
            if topic not in chosen and isinstance(time_ns, int):
                yield time_ns, None, name, None
                continue
            if not isinstance(data, bytes) or not isinstance(time_ns, int):
                raise UndecodableError(f"a message of `{name}` is no bytes with a time")
            facts.there[name] += 1
            writers.note_message(name, f"topic {topic}")
            yield time_ns, None, name, decoders[topic](unpack(data))
    facts.notes += writers.notes


def _wanted_connections(
    connections: list[Connection], wanted: dict[str, Wanted], facts: FileFacts
) -> list[Connection]:
    for connection in connections:
        facts.there.setdefault(connection.topic, 0)
    return [c for c in connections if c.topic in wanted]


def _publishing_node(connection: Connection) -> str:
    """The name of the node that published, or the connection's number if the bag has no name."""
    ext = connection.ext
    node = ext.callerid if isinstance(ext, ConnectionExtRosbag1) else None
    return node or f"connection {connection.id}"


def _decoders_by_connection(
    chosen: Mapping[int, Connection], wanted: dict[str, Wanted], ros: int, facts: FileFacts
) -> dict[int, Callable[[bytes], Any]]:
    return {
        k: tolerant_decoder(partial(_ros_decoder, c, wanted[c.topic], ros), wanted[c.topic], facts)
        for k, c in chosen.items()
    }


def _ros_decoder(connection: Connection, wanted: Wanted, ros: int) -> Callable[[bytes], Any]:
    name, definition = connection.msgtype, connection.msgdef
    require_type(connection.topic, name, wanted.message)
    ext = connection.ext
    if isinstance(ext, ConnectionExtRosbag2) and ext.serialization_format != "cdr":
        shown = f"`{ext.serialization_format[:40]}`, not cdr"
        raise UndecodableError(f"messages of `{connection.topic}` are {shown}")
    if definition.format == MessageDefinitionFormat.NONE:
        definitions = default_definitions(wanted.message, ros)
    else:
        form: Format = "msg" if definition.format == MessageDefinitionFormat.MSG else "idl"
        definitions = find_definitions(definition.data, name, form)
    return message_decoder(name, definitions, "ros1" if ros == 1 else "cdr")


def _require_tables(path: Path) -> None:
    """Raises UndecodableError if a file is no database, or if its database computes values."""
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


def _limit_steps(database: apsw.Connection, size: int) -> None:
    """Bounds the steps that SQLite may take, and how much it reads of a row."""
    left = STEPS_MIN + STEPS_PER_BYTE * size

    def is_too_long() -> bool:
        nonlocal left
        left -= STEPS_AT_ONCE
        return left < 0

    database.limit(apsw.SQLITE_LIMIT_LENGTH, CHUNK_MAX)
    database.set_progress_handler(is_too_long, STEPS_AT_ONCE)
