"""Reads MCAP files: all their records in order, and the logs that `soter run --log` wrote.

Purpose: `McapRecords` reads all records in one pass, within bounds, and compares what the file says
of itself with its content: checksums, sizes, ids, indexes, statistics, its end. It refuses a file
that contradicts itself or has no end, with the place; a checksum of 0 is none (by the format).
`log_messages` and `log_metadata` read a log of Soter's own; SoterError D006 if it cannot be read.
Non-goals: what messages mean; a reader that jumps by the index; logs of other systems
(`monitor/log_files/`).
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections import Counter
from contextlib import contextmanager
from importlib.util import find_spec
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import open_finite_file
from soter.report.bounded_unpack import BoundedUnpacking
from soter.report.mcap_log import (
    ABNORMALLY,
    DATA_END,
    END_NAME,
    FOOTER,
    MAGIC,
    METADATA,
    METADATA_NAME,
    RECORD,
    crc_between,
)
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


RECORD_MAX = 1 << 30
"""Most bytes of a record, as a packed chunk or an attachment is."""
HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 3, 4, 5, 6, 7
CHUNK_INDEX, ATTACHMENT, STATISTICS = 8, 9, 11
IN_DATA = (SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA)
IN_SUMMARY = (SCHEMA, CHANNEL, STATISTICS, CHUNK_INDEX, 10, 13, 14)
PRIVATE = 128
"""Record kinds from this number on are private to their writer."""
MESSAGE_HEAD = struct.Struct("<HIQQ")
ENDS = "its end is missing: the recorder died, or the file was cut"
REMEDY = (
    "`mcap doctor FILE` says more; `mcap recover FILE -o NEW` keeps what is whole, which is less "
    "than what was recorded"
)


MERGED = "put logs together with `mcap merge`, which gives ids anew, or give them one by one"


class DamagedMcapError(ValueError):
    """Raised if a file contradicts itself. The text says where; `remedy` says what to do."""

    def __init__(self, text: str, remedy: str = REMEDY) -> None:
        super().__init__(text)
        self.remedy = remedy


class CutMcapError(DamagedMcapError):
    """Raised if the end of a file is missing, after all messages before the cut were yielded."""


class McapRecords:
    """Reads the records of one file, once.

    `metadata`: the metadata records that were read so far, by name. `private`: how many private
    records were skipped. `unchecked`: whether there was a message that no checksum covers.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.size = _file_size(file)
        self.metadata: dict[str, dict[str, str]] = {}
        self.private = 0
        self.unchecked = False
        self._unpacking = BoundedUnpacking(self.size)
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._counts: Counter[int] = Counter()
        self._kinds: Counter[int] = Counter()
        self._times: tuple[int, int] | None = None
        self._chunks: dict[int, tuple[Any, int]] = {}
        self._indexed: Counter[int] = Counter()
        self._of_chunk: dict[int, list[int]] = {}
        self._loose = False

    def messages(self) -> Iterator[tuple[Any, Any, Any]]:
        """Yields each message as (channel, its schema or None, message).

        Raises CutMcapError if only the end is missing, DamagedMcapError for other damage, mcap's
        InvalidMagic if the file is no MCAP, and errors of `mcap` for a record that it cannot read.
        """
        magic = self.file.read(len(MAGIC))
        if magic != MAGIC:
            from mcap.exceptions import InvalidMagic  # noqa: PLC0415 - an extra

            raise InvalidMagic(tuple(magic))
        crc = zlib.crc32(magic)
        summary_at, first = None, True
        while True:
            at = self.file.tell()
            head = self._read_exactly(RECORD.size)
            kind, length = RECORD.unpack(head)
            if length > self.size - at:
                raise CutMcapError(f"the record at byte {at} is longer than the file: {ENDS}")
            if length > RECORD_MAX:
                raise DamagedMcapError(f"the record at byte {at} is longer than any is")
            body = self._read_exactly(length)
            if first != (kind == HEADER):
                raise DamagedMcapError("its header does not stand at its beginning, or not once")
            first = False
            if kind == DATA_END and summary_at is None:
                self._check_index_end(at)
                stored = _read_record("DataEnd", body, at).data_section_crc
                _compare_crc(stored, crc, "its data section (all up to its summary)")
                self.unchecked = self._loose and not stored
                summary_at = self.file.tell()
            elif kind == FOOTER:
                self._check_footer(body, at, summary_at)
                return
            else:
                self._require_known_kind(kind, IN_DATA if summary_at is None else IN_SUMMARY, at)
                if summary_at is None:
                    crc = zlib.crc32(body, zlib.crc32(head, crc))
                    yield from self._data_messages(kind, body, at)
                else:
                    self._read_summary(kind, body, at)

    def _require_known_kind(self, kind: int, known: tuple[int, ...], at: int) -> None:
        if kind >= PRIVATE:
            self.private += 1
        elif kind not in known and kind != HEADER:
            raise DamagedMcapError(f"a record of kind {kind} stands at byte {at}, where none may")

    def _read_exactly(self, length: int) -> bytes:
        data = self.file.read(length)
        if len(data) < length:
            raise CutMcapError(ENDS)
        return data

    # ------------------------------------------------------------ the data section

    def _data_messages(self, kind: int, body: bytes, at: int) -> Iterator[tuple[Any, Any, Any]]:
        self._kinds[kind] += 1
        if kind != MESSAGE_INDEX:
            self._check_index_end(at)
        if kind == CHUNK:
            yield from self._chunk_messages(body, at)
        elif kind == MESSAGE:
            self._loose = True
            yield self._read_message(body, f"at byte {at}")
        elif kind in (SCHEMA, CHANNEL):
            self._enter_definition(kind, body, at)
        elif kind == MESSAGE_INDEX:
            self._check_message_index(body, at)
        elif kind == METADATA:
            record = _read_record("Metadata", body, at)
            self.metadata.setdefault(record.name, dict(record.metadata))
        elif kind == ATTACHMENT and len(body) > 4:
            (crc,) = struct.unpack("<I", body[-4:])
            _compare_crc(crc, zlib.crc32(memoryview(body)[:-4]), f"the attachment at byte {at}")

    def _chunk_messages(self, body: bytes, at: int) -> Iterator[tuple[Any, Any, Any]]:
        chunk = _read_record("Chunk", body, at)
        data = self._unpacked_chunk(chunk)
        where = f"the chunk at byte {at}"
        if len(data) != chunk.uncompressed_size:
            text = f"it says {chunk.uncompressed_size:,} bytes and has {len(data):,}"
            raise DamagedMcapError(f"{where} is damaged: {text}")
        _compare_crc(chunk.uncompressed_crc, zlib.crc32(data), where)
        self._loose |= not chunk.uncompressed_crc
        self._chunks[at] = chunk, RECORD.size + len(body)
        chunk.data = b""
        self._of_chunk = {}
        inside = memoryview(data)
        place = 0
        while place < len(data):
            here = f"at byte {place} of {where}"
            if place + RECORD.size > len(data):
                raise DamagedMcapError(f"a record is cut {here}")
            kind, length = RECORD.unpack_from(data, place)
            begin = place + RECORD.size
            place = begin + length
            if place > len(data):
                raise DamagedMcapError(f"a record is cut {here}")
            if kind == MESSAGE:
                triple = self._read_message(bytes(inside[begin:place]), here)
                channel, _, message = triple
                self._of_chunk.setdefault(channel.id, []).append(message.log_time)
                yield triple
            elif kind in (SCHEMA, CHANNEL):
                self._enter_definition(kind, bytes(inside[begin:place]), at)
            else:
                raise DamagedMcapError(f"a record of kind {kind} stands {here}, where none may")
        times = [t for of_channel in self._of_chunk.values() for t in of_channel]
        said_times = chunk.message_start_time, chunk.message_end_time
        if times and (min(times), max(times)) != said_times:
            raise DamagedMcapError(f"{where} has messages of other times than it says")

    def _unpacked_chunk(self, chunk: Any) -> bytes:  # noqa: ANN401 - a record
        if chunk.compression == "zstd":
            return self._unpacking.unpack_zstd(chunk.data)
        if chunk.compression == "lz4":
            return self._unpacking.unpack_lz4(chunk.data)
        if chunk.compression:
            raise DamagedMcapError(f"a chunk is packed by `{chunk.compression[:40]}`")
        return self._unpacking.count_plain(chunk.data)

    def _read_message(self, body: bytes, here: str) -> tuple[Any, Any, Any]:
        from mcap.records import Message  # noqa: PLC0415 - an extra

        if len(body) < MESSAGE_HEAD.size:
            raise DamagedMcapError(f"the message {here} is cut")
        channel_id, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(body)
        channel = self._channels.get(channel_id)
        if channel is None:
            raise DamagedMcapError(f"the message {here} is of channel {channel_id}, which is none")
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id:
            lost = f"schema {channel.schema_id} of channel `{channel.topic[:80]}` is not there"
            raise DamagedMcapError(lost)
        self._counts[channel_id] += 1
        first, last = self._times or (log_time, log_time)
        self._times = min(first, log_time), max(last, log_time)
        data = body[MESSAGE_HEAD.size :]
        return channel, schema, Message(channel_id, log_time, data, publish_time, sequence)

    def _enter_definition(self, kind: int, body: bytes, at: int) -> None:
        """Enters a schema or channel; DamagedMcapError if its id was in use for another."""
        record = _read_record("Schema" if kind == SCHEMA else "Channel", body, at)
        known = self._schemas if kind == SCHEMA else self._channels
        before = known.setdefault(record.id, record)
        if before != record:
            kind_name, name = ("schema", "name") if kind == SCHEMA else ("channel", "topic")
            was, now = (getattr(r, name)[:80] for r in (before, record))
            text = f"{kind_name} {record.id} is `{was}`, and from byte {at} on another, `{now}`"
            raise DamagedMcapError(text, MERGED)

    def _check_message_index(self, body: bytes, at: int) -> None:
        record = _read_record("MessageIndex", body, at)
        times = self._of_chunk.get(record.channel_id, [])
        if sorted(t for t, _ in record.records) != sorted(times):
            text = f"the index at byte {at} has other messages of channel {record.channel_id}"
            raise DamagedMcapError(f"{text} than the chunk before it")
        self._indexed[record.channel_id] += 1

    def _check_index_end(self, at: int) -> None:
        lost = set(self._of_chunk) - set(self._indexed)
        if self._indexed and lost:
            raise DamagedMcapError(f"the index before byte {at} leaves out channel {min(lost)}")
        self._indexed.clear()
        self._of_chunk = {}

    # ------------------------------------------------------------ what it says of itself

    def _read_summary(self, kind: int, body: bytes, at: int) -> None:
        if kind in (SCHEMA, CHANNEL):
            self._enter_definition(kind, body, at)
        elif kind == STATISTICS:
            self._check_statistics(_read_record("Statistics", body, at))
        elif kind == CHUNK_INDEX:
            entry = _read_record("ChunkIndex", body, at)
            self._indexed[entry.chunk_start_offset] += 1
            chunk, length = self._chunks.get(entry.chunk_start_offset, (None, 0))
            names = ["message_start_time", "message_end_time", "compression", "uncompressed_size"]
            if (
                chunk is None
                or length != entry.chunk_length
                or any(getattr(chunk, name) != getattr(entry, name) for name in names)
            ):
                text = f"its index names a chunk at byte {entry.chunk_start_offset}"
                raise DamagedMcapError(f"{text} that does not stand there so")

    def _check_statistics(self, record: Any) -> None:  # noqa: ANN401 - a record
        read = {
            "messages": (record.message_count, self._counts.total()),
            "chunks": (record.chunk_count, self._kinds[CHUNK]),
            "attachments": (record.attachment_count, self._kinds[ATTACHMENT]),
            "metadata": (record.metadata_count, self._kinds[METADATA]),
        }
        for channel_id in sorted({*record.channel_message_counts, *self._counts}):
            name = getattr(self._channels.get(channel_id), "topic", str(channel_id))
            counts = record.channel_message_counts.get(channel_id, 0), self._counts[channel_id]
            read[f"messages of `{name[:80]}`"] = counts
        for things, (of_file, counted) in read.items():
            if of_file != counted:
                text = f"its statistics count {of_file:,} {things}, and {counted:,} stand there"
                raise DamagedMcapError(text)
        times = record.message_start_time, record.message_end_time
        if self._times is not None and times != self._times:
            raise DamagedMcapError("its messages are of other times than its statistics say")

    def _check_footer(self, body: bytes, at: int, summary_at: int | None) -> None:
        footer = _read_record("Footer", body, at)
        if summary_at is None:
            raise DamagedMcapError("the end of its data section is missing")
        if self._read_exactly(len(MAGIC)) != MAGIC:
            raise CutMcapError(ENDS)
        if self.file.read(1):
            text = f"more bytes stand behind its end, from byte {self.file.tell() - 1} on"
            raise DamagedMcapError(f"{text}: are two logs in it?", MERGED)
        if self._indexed and set(self._indexed) != set(self._chunks):
            raise DamagedMcapError("its index does not name all of its chunks")
        if footer.summary_start not in (0, summary_at):
            raise DamagedMcapError("its summary does not stand where its end says")
        if footer.summary_crc:
            crc = crc_between(self.file, summary_at, at + RECORD.size + len(body) - 4)
            _compare_crc(footer.summary_crc, crc, "its summary")


class _StrictBytes(BytesIO):
    """Bytes in memory; reading more bytes than there are is an error."""

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        if size is not None and 0 <= len(data) < size:
            raise DamagedMcapError("a record is cut")
        return data


def _read_record(name: str, body: bytes, at: int) -> Any:  # noqa: ANN401 - a record of the package
    """The record of kind `name` in `body`; DamagedMcapError if bytes are missing or left over."""
    from mcap import records  # noqa: PLC0415 - an extra
    from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - the same

    stream = ReadDataStream(_StrictBytes(body))
    try:
        record = getattr(records, name).read(stream)
    except (DamagedMcapError, struct.error, UnicodeDecodeError) as error:
        raise DamagedMcapError(f"the record at byte {at} is no {name}") from error
    if stream.count != len(body):
        raise DamagedMcapError(f"the {name} at byte {at} is shorter than it says")
    return record


def _compare_crc(stored: int, counted: int, part: str) -> None:
    """Raises DamagedMcapError if the stored checksum differs from the computed one and is not 0."""
    if stored and stored != counted:
        text = f"{part} is damaged: its checksum is {stored:08x}, and its bytes give {counted:08x}"
        raise DamagedMcapError(text)


def _file_size(file: BinaryIO) -> int:
    return len(file.getbuffer()) if isinstance(file, BytesIO) else os.fstat(file.fileno()).st_size


def require_log_package() -> None:
    """Raises SoterError D007 if `mcap`, the package for logs, is not installed."""
    if find_spec("mcap") is None:
        raise mistake(
            "D007",
            "logs are written with the package `mcap`, which is not installed",
            f"install it: {pip_command('logs')}",
        )


@contextmanager
def _open_records(path: Path) -> Iterator[McapRecords]:
    """Opens a log's records for a block; raises SoterError D006 if it is unreadable or damaged."""
    try:
        with open_finite_file(path) as file:
            yield McapRecords(file)
    except OSError as error:
        raise unreadable_error(path, reason(error)) from error
    except SoterError:
        raise
    except DamagedMcapError as error:
        text = f"cannot read the log `{path}`: {error}"
        raise mistake("D006", text, error.remedy) from error
    except Exception as error:
        raise unreadable_error(path, damage_text(error)) from error


def log_metadata(path: Path) -> dict[str, str]:
    """What a log says of its run at its beginning; {} if not by `soter run`; SoterError D006."""
    with _open_records(path) as records:
        for _ in _messages_up_to_cut(records, lambda _: None):
            if METADATA_NAME in records.metadata:
                break
        return records.metadata.get(METADATA_NAME, {})


def log_messages(
    path: Path, cut: Callable[[str], None] | None = None
) -> Iterator[tuple[int, str, Any]]:
    """Yields time (ns), channel and message of each log entry, in order; raises SoterError D006.

    It compares checksums and counts with the content. It calls `cut` with a text in two cases: if
    the end of the file is missing (then it reads up to the cut), and if the file says that the end
    of the run was not logged.
    """
    last_ns = 0
    with _open_records(path) as records:
        for channel, _, message in _messages_up_to_cut(records, cut):
            if message.log_time < last_ns:
                text = (
                    f"time goes back from {last_ns / 1e9:.9g} s to {message.log_time / 1e9:.9g} s"
                )
                raise unreadable_error(path, f"{text} at a message of `{channel.topic}`")
            last_ns = message.log_time
            yield message.log_time, channel.topic, json.loads(message.data)
        ended = records.metadata.get(END_NAME, {}).get("ended", "")
        if cut is not None and ended.startswith(ABNORMALLY):
            cut(ended.removeprefix(ABNORMALLY))


def _messages_up_to_cut(
    records: McapRecords, cut: Callable[[str], None] | None
) -> Iterator[tuple[Any, Any, Any]]:
    try:
        yield from records.messages()
    except CutMcapError as error:
        if cut is None:
            raise
        cut(str(error))


def damage_text(error: Exception) -> str:
    """Describes in words which damage of a log made the package `mcap` raise this error."""
    from mcap.exceptions import InvalidMagic, McapError  # noqa: PLC0415 - an extra

    by_mcap = isinstance(error, (McapError, ValueError)) and not isinstance(error, InvalidMagic)
    text = str(error)[:200] if by_mcap else ""
    return text or "it is no MCAP file, or damaged"


def unreadable_error(path: Path, why: str) -> SoterError:
    """The SoterError D006 for a log that is damaged or that `soter run --log` did not write."""
    helps = ("a log of somebody else, a CSV or a bag needs `--map FILE`: docs/real-logs.md",)
    return mistake("D006", f"cannot read the log `{path}`: {why}", *helps)
