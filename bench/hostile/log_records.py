"""The records of an MCAP and of a bag of ROS 1, to be changed and put together again.

Purpose: files that contradict themselves, without their checksums where a test is about something
else. Parsed without a look at what they mean.
"""

from __future__ import annotations

import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any

from mcap.data_stream import RecordBuilder
from rosbags.rosbag1.reader import Header

from soter.report.mcap_log import DATA_END, FOOTER, MAGIC, RECORD

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Records = list[tuple[int, bytes]]
Record1 = tuple[int, dict[str, bytes], bytes]
MAGIC1 = b"#ROSBAG V2.0\n"
CHUNK1, INFO1, CONNECTION1 = 5, 6, 7
"""Kinds of records of a bag of ROS 1."""


def mcap_records(path: Path) -> Records:
    """Kind and body of the records of an MCAP, chunks as they are."""
    data, at, records = path.read_bytes(), len(MAGIC), []
    while at < len(data) - len(MAGIC):
        kind, length = RECORD.unpack_from(data, at)
        at += RECORD.size + length
        records.append((kind, data[at - length : at]))
    return records


def as_mcap(path: Path, records: Records) -> Path:
    """The records as a file, with every checksum outside of chunks taken out."""
    parts = [MAGIC]
    for kind, body in records:
        blank = {DATA_END: bytes(4), FOOTER: bytes(20)}.get(kind, body)
        parts.append(RECORD.pack(kind, len(blank)) + blank)
    path.write_bytes(b"".join([*parts, MAGIC]))
    return path


def mcap_record(record: Any) -> tuple[int, bytes]:  # noqa: ANN401 - of the package
    """A record of the package `mcap` as kind and body."""
    builder: Any = RecordBuilder()
    record.write(builder)
    data = builder.end()
    return data[0], data[RECORD.size :]


def place_of(records: Records, kind: int, nth: int = 0) -> int:
    """Which record is the nth of a kind."""
    return [i for i, (k, _) in enumerate(records) if k == kind][nth]


def records_of(data: bytes) -> list[Record1]:
    """Kind, head and content of what stands in a bag, or in a chunk."""
    found, file = [], BytesIO(data)
    while file.tell() < len(data):
        header = Header.read(file)
        (size,) = struct.unpack("<I", file.read(4))
        found.append((header["op"][0], dict(header), file.read(size)))
    return found


def bytes_of(records: list[Record1]) -> bytes:
    """The same as bytes."""
    parts = []
    for _, header, content in records:
        fields = [k.encode() + b"=" + v for k, v in header.items()]
        head = b"".join(struct.pack("<I", len(f)) + f for f in fields)
        parts += [struct.pack("<I", len(head)), head, struct.pack("<I", len(content)), content]
    return b"".join(parts)


def rewritten(log: Path, change: Callable[[list[Record1]], None]) -> Path:
    """The bag with other records; places in it are put right."""
    records = records_of(log.read_bytes()[len(MAGIC1) :])
    change(records)
    place, chunks = len(MAGIC1), []
    for k, record in enumerate(records):
        if record[0] == CHUNK1:
            chunks.append(place)
        if (
            record[0] in (CONNECTION1, INFO1)
            and k
            and records[k - 1][0] not in (CONNECTION1, INFO1)
        ):
            records[0][1]["index_pos"] = struct.pack("<Q", place)
        place += len(bytes_of([record]))
    infos = [r for r in records if r[0] == INFO1]
    for info, chunk in zip(infos, chunks, strict=False):
        info[1]["chunk_pos"] = struct.pack("<Q", chunk)
    log.write_bytes(MAGIC1 + bytes_of(records))
    return log


def inside(records: list[Record1], change: Callable[[list[Record1]], None]) -> None:
    """Change what stands in the first chunk."""
    at = next(k for k, r in enumerate(records) if r[0] == CHUNK1)
    kind, header, content = records[at]
    parts = records_of(content)
    change(parts)
    whole = bytes_of(parts)
    records[at] = kind, {**header, "size": struct.pack("<I", len(whole))}, whole
