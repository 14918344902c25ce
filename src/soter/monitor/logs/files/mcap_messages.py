"""The messages of an MCAP, in the order in which they stand there.

Purpose: one pass over the records, chunk by chunk, within bounds; JSON, ROS (cdr, ros1), protobuf.
Non-goals: the index of the file, attachments, the order of times (`message_log.py`).
"""

from __future__ import annotations

import json
import os
from importlib.util import find_spec
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import opened
from soter.monitor.logs.files.bounded_unpack import CHUNK_MAX, BoundedUnpacking, TooLargeError
from soter.monitor.logs.files.log_columns import unusable
from soter.monitor.logs.files.ros_messages import (
    UndecodableError,
    decoder,
    definitions_in,
    known_definitions,
    require_type,
)
from soter.simulate.outputs.to_log import require_log_package
from soter.simulate.trace_to_recorded_run import damaged

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.monitor.logs.files.log_columns import Wanted
    from soter.monitor.logs.files.ros_messages import Format

RECORD_MAX = 1 << 30
"""Bytes of a record: of a chunk as it is packed, or of an attachment, which is stepped over."""
ROS_SCHEMAS: dict[str, tuple[Format, int]] = {
    "ros2msg": ("msg", 2),
    "ros2idl": ("idl", 2),
    "ros1msg": ("msg", 1),
}
READ = "json, cdr, ros1 and protobuf are read"


def mcap_messages(
    path: Path, wanted: dict[str, Wanted], there: dict[str, int]
) -> Iterator[tuple[int, str, Any]]:
    """Log time, channel and content of each message; None for that of a channel nobody wants.

    `there` counts the messages of every channel. SoterError D016, D007.
    """
    require_log_package()
    try:
        with opened(path) as file:
            yield from _Reading(wanted, there, _size(file)).messages(file)
    except SoterError:
        raise
    except (TooLargeError, UndecodableError) as error:
        raise unusable(path, str(error)) from error
    except OSError as error:
        raise unusable(path, reason(error)) from error
    except Exception as error:
        raise unusable(path, damaged(error)) from error


def _size(file: BinaryIO) -> int:
    if isinstance(file, BytesIO):
        return len(file.getbuffer())
    return os.fstat(file.fileno()).st_size


class _Reading:
    """Schemas and channels so far."""

    def __init__(self, wanted: dict[str, Wanted], there: dict[str, int], size: int) -> None:
        self.wanted, self.there = wanted, there
        self.unpacking = BoundedUnpacking(size)
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, Any] = {}
        self.decoders: dict[int, Callable[[bytes], Any]] = {}

    def messages(self, file: BinaryIO) -> Iterator[tuple[int, str, Any]]:
        """Log time, channel and content."""
        from mcap.records import Channel, Message, Schema  # noqa: PLC0415 - an extra

        for record in self._records(file):
            if isinstance(record, Schema):
                self.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                self.channels.setdefault(record.id, record)
            elif isinstance(record, Message):
                channel = self.channels[record.channel_id]
                self.there[channel.topic] = self.there.get(channel.topic, 0) + 1
                asked = channel.topic in self.wanted
                content = self._decoder(channel)(record.data) if asked else None
                yield record.log_time, channel.topic, content

    def _records(self, file: BinaryIO) -> Iterator[Any]:
        """All records of the file, those in chunks too."""
        from mcap.records import Chunk  # noqa: PLC0415 - an extra
        from mcap.stream_reader import StreamReader  # noqa: PLC0415 - an extra

        outer = StreamReader(file, emit_chunks=True, record_size_limit=RECORD_MAX)
        for record in outer.records:
            if not isinstance(record, Chunk):
                yield record
                continue
            data = self._unpacked(record)
            chunk = BytesIO(data)
            inner = StreamReader(
                chunk, skip_magic=True, emit_chunks=True, record_size_limit=CHUNK_MAX
            )
            records = iter(inner.records)
            while chunk.tell() < len(data):
                yield next(records)

    def _unpacked(self, chunk: Any) -> bytes:  # noqa: ANN401 - a record
        if chunk.compression == "zstd":
            return self.unpacking.zstd(chunk.data)
        if chunk.compression == "lz4":
            return self.unpacking.lz4(chunk.data)
        if chunk.compression:
            raise UndecodableError(f"a chunk is packed by `{chunk.compression[:40]}`")
        return self.unpacking.plain(chunk.data)

    def _decoder(self, channel: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - a record
        if channel.id not in self.decoders:
            self.decoders[channel.id] = self._made_decoder(channel)
        return self.decoders[channel.id]

    def _made_decoder(self, channel: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - a record
        schema, encoding = self.schemas.get(channel.schema_id), channel.message_encoding
        wanted = self.wanted[channel.topic].message
        if encoding == "json":
            return json.loads
        if encoding == "protobuf":
            return _protobuf_decoder(channel, schema)
        if encoding not in ("cdr", "ros1"):
            shown = f"messages of `{channel.topic}` are `{encoding[:40]}`"
            raise UndecodableError(f"{shown}, not json: {READ}")
        if schema is None and wanted is not None:
            name, definitions = (
                wanted.ros2,
                known_definitions(wanted, 2 if encoding == "cdr" else 1),
            )
        elif schema is None or schema.encoding not in ROS_SCHEMAS:
            why = "no schema" if schema is None else f"a schema in `{schema.encoding[:40]}`"
            raise UndecodableError(f"messages of `{channel.topic}` are `{encoding}` with {why}")
        else:
            name, form = schema.name, ROS_SCHEMAS[schema.encoding][0]
            require_type(channel.topic, name, wanted)
            definitions = definitions_in(schema.data.decode("utf-8"), name, form)
        return decoder(name, definitions, encoding)


def _protobuf_decoder(channel: Any, schema: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - records
    if find_spec("mcap_protobuf") is None:
        text = (
            f"messages of `{channel.topic}` are protobuf, which the package "
            "`mcap-protobuf-support` reads; it is not installed"
        )
        help_ = "install it: pip install 'soter[protobuf]'"
        raise SoterError((Diagnostic("D007", text, helps=(help_,)),))
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - an extra

    try:
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
    except Exception as error:
        raise UndecodableError(f"the schema of `{channel.topic}` cannot be used") from error
    if decode is None:
        raise UndecodableError(f"messages of `{channel.topic}` are protobuf without a schema of it")

    def decoded(data: bytes) -> Any:  # noqa: ANN401 - a class made of a schema
        try:
            return decode(data)
        except Exception as error:
            raise UndecodableError(
                f"a message of `{channel.topic}` is no `{schema.name}`"
            ) from error

    return decoded
