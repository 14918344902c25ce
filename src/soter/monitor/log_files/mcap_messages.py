"""Reads the messages of an MCAP, in the order in which they stand there.

Purpose: `mcap_messages` decodes their content: JSON, ROS (cdr, ros1), protobuf.
Non-goals: the records of the file and whether they are whole (`report/mcap_reading.py`), the order
of times (`read_columns.py`).
"""

from __future__ import annotations

import json
import re
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import Diagnostic, SoterError, reason
from soter.language.load.named_files import opened
from soter.monitor.log_files.log_columns import Writers, damaged, remedies, unusable
from soter.monitor.log_files.ros_messages import (
    UndecodableError,
    decoder,
    decoder_made,
    definitions_in,
    known_definitions,
    require_type,
)
from soter.report.bounded_unpack import TooLargeError
from soter.report.mcap_log import MAGIC
from soter.report.mcap_reading import DamagedMcapError, McapRecords, require_log_package
from soter.report.mcap_reading import damaged as words_of_damage
from soter.version import pip_install

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted
    from soter.monitor.log_files.ros_messages import Format


ROS_SCHEMAS: dict[str, tuple[Format, int]] = {
    "ros2msg": ("msg", 2),
    "ros2idl": ("idl", 2),
    "ros1msg": ("msg", 1),
}
PROFILE = re.compile(r"^- ", re.MULTILINE)
"""The beginning of each publisher's settings, as a recorder of ROS 2 lists them."""
READ = "json, cdr, ros1 and protobuf are read"


def mcap_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Log time, channel and content of each message; None for that of a channel nobody wants.

    `facts` counts the messages of every channel. SoterError D016, D007.
    """
    require_log_package()
    try:
        with opened(path) as file:
            _require_mcap(path, file)
            yield from _Reading(wanted, facts).messages(McapRecords(file))
    except SoterError:
        raise
    except (TooLargeError, UndecodableError) as error:
        raise unusable(path, str(error)) from error
    except DamagedMcapError as error:
        raise damaged(path, str(error), error.remedy) from error
    except OSError as error:
        raise unusable(path, reason(error)) from error
    except Exception as error:
        raise damaged(path, words_of_damage(error)) from error


def _require_mcap(path: Path, file: BinaryIO) -> None:
    """SoterError D016 where it does not begin as an MCAP does."""
    if file.read(len(MAGIC)) != MAGIC:
        raise unusable(path, "it is no MCAP", *remedies(path))
    file.seek(0)


class _Reading:
    """Reads messages, and makes the decoder of each channel once."""

    def __init__(self, wanted: dict[str, Wanted], facts: FileFacts) -> None:
        self.wanted, self.facts = wanted, facts
        self.decoders: dict[int, Callable[[bytes], Any]] = {}
        self.writers = Writers()

    def messages(self, records: McapRecords) -> Iterator[Arrived]:
        """Log time, channel and content."""
        self.facts.size = records.size
        for channel, schema, message in records.messages():
            self.facts.at_byte = records.file.tell()
            self.facts.there[channel.topic] = self.facts.there.get(channel.topic, 0) + 1
            content = None
            if channel.topic in self.wanted:
                decode = self.decoders.get(channel.id)
                if decode is None:
                    make = partial(self._made_decoder, channel, schema)
                    decode = decoder_made(make, self.wanted[channel.topic], self.facts)
                    self.decoders[channel.id] = decode
                    offered = channel.metadata.get("offered_qos_profiles", "")
                    self.writers.offer(channel.topic, len(PROFILE.findall(offered)))
                node = channel.metadata.get("callerid") or f"channel {channel.id}"
                self.writers.note(channel.topic, node)
                content = decode(message.data)
            yield message.log_time, message.publish_time, channel.topic, content
        self.facts.notes += self.writers.notes
        self.facts.unchecked |= records.unchecked
        if records.private:
            told = f"{records.private:,} records of kinds that only its writer knows"
            self.facts.notes.append(f"{told} were stepped over")

    def _made_decoder(self, channel: Any, schema: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - records
        encoding = channel.message_encoding
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
        help_ = f"install it: {pip_install('logs')}"
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
