"""Decodes messages of logs: of ROS 1 and 2 by their definitions, and all messages of an MCAP.

Purpose: `message_decoder` makes a function of bytes of a ROS definition, whose text is as untrusted
as the rest of a log. `rosbags` makes Python code of definitions: only names that are names get
there, and no definition whose messages could be larger than the bytes that they are made of.
`is_plain_idl` refuses, in one pass over the tokens of IDL, what definitions of messages do not
have: parentheses in parentheses, for which the parser of `rosbags` takes exponential time, and
calculated constants. `mcap_messages` reads the messages of an MCAP in the order in which they stand
there, and decodes JSON, ROS (cdr, ros1) and protobuf.
Non-goals: whether a text is IDL at all, the records of an MCAP and whether they are whole
(`report/mcap_reading.py`), the order of times (`read_columns.py`).
"""

from __future__ import annotations

import json
import re
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import open_finite_file
from soter.mapping.message_types import (
    ARRAY,
    BASE,
    EMPTY_MEMBER,
    NAMED,
    SEQUENCE,
    TIMES,
    Definitions,
    MessageTypes,
    require_ros_package,
)
from soter.monitor.log_files.log_columns import (
    Writers,
    damaged_log_error,
    unusable_log_error,
    wrong_format_error,
)
from soter.report.bounded_unpack import TooLargeError
from soter.report.mcap_log import MAGIC
from soter.report.mcap_reading import DamagedMcapError, McapRecords, require_log_package
from soter.report.mcap_reading import damage_text as words_of_damage
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.mapping.message_types import MessageType
    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted


TOKEN = re.compile(
    r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*(?s:.*?)\*/|[A-Za-z_]\w*|\.?[0-9](?:[0-9.]|[eE][-+]?)*|\s+|.',
    re.ASCII,
)
PARENTHESES_MAX, ANGLES_MAX = 1, 2
"""How deep brackets may be nested: `@default (value=0)`, `sequence<string<5>>`."""
VALUES_MAX = 2000
"""Annotations, values and sizes of arrays: the parser is slow at each of them."""
OPERATORS = set('*/%^|&~"')
"""Operators of calculated constants, and a quotation mark that nothing closes."""


def is_plain_idl(text: str) -> bool:
    """Whether a text of IDL has no deep nesting and no computed values."""
    parentheses = angles = values = 0
    before = ""
    for match in TOKEN.finditer(text):
        piece = match[0]
        if piece.isspace() or piece.startswith(("//", "/*")):
            continue
        parentheses += (piece == "(") - (piece == ")")
        angles += (piece == "<") - (piece == ">")
        values += piece in ("@", "=", "[")
        signed = piece in ("+", "-") and (before[-1:].isalnum() or before[-1:] in ("_", ")"))
        if piece in OPERATORS or signed or piece == before == "<":
            return False
        if not (0 <= parentheses <= PARENTHESES_MAX and 0 <= angles <= ANGLES_MAX):
            return False
        before = piece
    return values <= VALUES_MAX


Format = Literal["msg", "idl"]
TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)+", re.ASCII)
FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
DEFINITION_MAX = 1 << 18
"""Characters of a definition."""
FIELDS_MAX = 5000
"""Fields of a definition, which become code."""
PARTS_MAX = 100_000
"""The most primitives and messages in one message, with all elements of arrays of messages."""
TYPES_MAX = 1000
TIMES_OF_ROS1: Definitions = {
    name: ([], [("sec", (BASE, ("int32", 0))), ("nanosec", (BASE, ("uint32", 0)))])
    for name in TIMES
}
"""Primitives in ROS 1: its definitions do not say what they are."""
INCLUDE = re.compile(r"^[ \t]*#include[^\n]*$", re.MULTILINE)
IDL_SEPARATOR = "=" * 80 + "\n"


class UndecodableError(ValueError):
    """A definition or a message cannot be read; the text says why."""


def tolerant_decoder(
    make: Callable[[], Callable[[bytes], Any]], wanted: Wanted, facts: FileFacts
) -> Callable[[bytes], Any]:
    """Gives the decoder of `make`; on a channel that is not named, a failure becomes None."""
    if not wanted.unnamed:
        return make()
    made: list[Callable[[bytes], Any]] = []

    def decode_message(data: bytes) -> Any:  # noqa: ANN401 - what a message has
        try:
            made[:] = made or [make()]
            return made[0](data)
        except UndecodableError as error:
            made[:] = [lambda _: None]
            facts.notes.append(f"left out: {error}")
            return None

    return decode_message


def ros1_name(name: str) -> str:
    """A type's name as ROS 1 writes it: `nav_msgs/Odometry` for `nav_msgs/msg/Odometry`."""
    return name.replace("/msg/", "/")


def ros2_name(name: str) -> str:
    """A type's name as ROS 2 writes it: `nav_msgs/msg/Odometry` for `nav_msgs/Odometry`."""
    package, _, rest = name.partition("/")
    return name if "/" in rest else f"{package}/msg/{rest}"


def require_type(channel: str, name: str, wanted: MessageType | None) -> None:
    """Raises UndecodableError if messages have another type than the mapping says."""
    if wanted is not None and ros1_name(name) != wanted.ros1:
        shown = f"messages of `{channel}` are `{ros1_name(name)[:80]}`"
        raise UndecodableError(f"{shown}, and the mapping says `{wanted.ros1}`")


def find_definitions(text: str, name: str, form: Format) -> Definitions:
    """The definitions of a type and of the types inside it, from a log; raises UndecodableError."""
    require_ros_package()
    from rosbags.typesys import get_types_from_idl, get_types_from_msg  # noqa: PLC0415 - an extra

    if len(text) > DEFINITION_MAX:
        raise UndecodableError(f"the definition of `{name[:80]}` is too long")
    if not TYPE_NAME.fullmatch(name):
        raise UndecodableError(f"`{name[:80]}` is no name of a type")
    if form == "idl" and not is_plain_idl("\n".join(_idl_files(text))):
        raise UndecodableError(f"the definition of `{name[:80]}` is none that ROS writes")
    try:
        if form == "msg":
            found = dict(get_types_from_msg(text, ros2_name(name)))
        else:
            found = {n: d for part in _idl_files(text) for n, d in get_types_from_idl(part).items()}
    except Exception as error:
        raise UndecodableError(f"the definition of `{name[:80]}` cannot be read") from error
    return {**TIMES_OF_ROS1, **found}


def _idl_files(text: str) -> list[str]:
    """The texts of the IDL files in a definition, without heads and `#include` lines."""
    files = [text]
    if text.startswith(IDL_SEPARATOR):
        files = [part.partition("\n")[2] for part in text.split(IDL_SEPARATOR)[1:]]
    return [INCLUDE.sub("", part) for part in files]


def default_definitions(wanted: MessageType | None, ros: int) -> Definitions:
    """The definitions for a log that has none: the mapping's, or else the standard ones."""
    return wanted.definitions[ros] if wanted is not None else MessageTypes().definitions[ros]


def message_decoder(
    name: str, definitions: Definitions, encoding: Literal["cdr", "ros1"]
) -> Callable[[bytes], Any]:
    """Gives the function from bytes to a message; it and this function raise UndecodableError."""
    from rosbags.typesys.store import Typestore  # noqa: PLC0415 - an extra

    full = ros2_name(name)
    needed = _needed_types(full, definitions)
    store = Typestore()
    try:
        store.register(needed)
        store.get_msgdef(full)
    except Exception as error:
        raise UndecodableError(f"the definition of `{name[:80]}` cannot be used") from error
    decode = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1

    def decode_message(data: bytes) -> Any:  # noqa: ANN401 - a class made of a definition
        try:
            return decode(data, full)
        except Exception as error:
            raise UndecodableError(f"a message is no `{ros1_name(name)[:80]}`") from error

    return decode_message


def _needed_types(full: str, definitions: Definitions) -> Definitions:
    """The types that a message is made of, without constants; UndecodableError if harmful."""
    sizes: dict[str, tuple[int, int]] = {}
    _measure_type(full, definitions, sizes, ())
    if sum(len(definitions[name][1]) for name in sizes) > FIELDS_MAX:
        raise UndecodableError(f"messages of `{full[:80]}` have too many parts")
    return {name: ([], definitions[name][1]) for name in sizes}


def _measure_type(
    name: str, definitions: Definitions, sizes: dict[str, tuple[int, int]], inside: tuple[str, ...]
) -> tuple[int, int]:
    """A type's number of primitives and messages, and its least bytes; raises UndecodableError."""
    if name in sizes:
        return sizes[name]
    if name not in definitions or not TYPE_NAME.fullmatch(name):
        raise UndecodableError(f"the type `{name[:80]}` is not defined")
    if name in inside or len(inside) > 64 or len(sizes) > TYPES_MAX:
        raise UndecodableError(f"the definition of `{name[:80]}` has no end")
    parts, least = 1, 0
    for field, kind in definitions[name][1]:
        if field == EMPTY_MEMBER:
            continue
        if not FIELD_NAME.fullmatch(field):
            raise UndecodableError(f"`{name}` has a field that is called `{field[:40]}`")
        of_member = _measure_member(name, kind, definitions, sizes, inside)
        parts += of_member[0]
        least += of_member[1]
        if parts > PARTS_MAX:
            raise UndecodableError(f"messages of `{name[:80]}` have too many parts")
    sizes[name] = parts, least
    return sizes[name]


def _measure_member(
    name: str,
    kind: Any,  # noqa: ANN401 - as rosbags has it
    definitions: Definitions,
    sizes: dict[str, tuple[int, int]],
    inside: tuple[str, ...],
) -> tuple[int, int]:
    count, inner = 1, kind
    if kind[0] in (ARRAY, SEQUENCE):
        inner, count = kind[1][0], int(kind[1][1]) if kind[0] == ARRAY else 1
    of_one = (1, 1)
    if inner[0] == NAMED:
        of_one = _measure_type(inner[1], definitions, sizes, (*inside, name))
        if not of_one[1] and kind[0] in (ARRAY, SEQUENCE):
            raise UndecodableError(f"`{name}` has a list of messages that are empty")
    elif inner[0] == BASE and inner[1][0] not in ("string", "wstring"):
        count = 1  # an array of numbers is one thing
    return of_one[0] * count, of_one[1] * (count if kind[0] != SEQUENCE else 1)


ROS_SCHEMAS: dict[str, tuple[Format, int]] = {
    "ros2msg": ("msg", 2),
    "ros2idl": ("idl", 2),
    "ros1msg": ("msg", 1),
}
PROFILE = re.compile(r"^- ", re.MULTILINE)
"""The beginning of each publisher's settings, as a recorder of ROS 2 lists them."""
READ = "json, cdr, ros1 and protobuf are read"


def mcap_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives messages: log time, channel, content (None: unwanted). Counts all. D016, D007."""
    require_log_package()
    try:
        with open_finite_file(path) as file:
            _require_mcap(path, file)
            yield from _McapReading(wanted, facts).messages(McapRecords(file))
    except SoterError:
        raise
    except (TooLargeError, UndecodableError) as error:
        raise unusable_log_error(path, str(error)) from error
    except DamagedMcapError as error:
        raise damaged_log_error(path, str(error), error.remedy) from error
    except OSError as error:
        raise unusable_log_error(path, reason(error)) from error
    except Exception as error:
        raise damaged_log_error(path, words_of_damage(error)) from error


def _require_mcap(path: Path, file: BinaryIO) -> None:
    if file.read(len(MAGIC)) != MAGIC:
        raise wrong_format_error(path, "MCAP")
    file.seek(0)


class _McapReading:
    def __init__(self, wanted: dict[str, Wanted], facts: FileFacts) -> None:
        self.wanted, self.facts = wanted, facts
        self.decoders: dict[int, Callable[[bytes], Any]] = {}
        self.writers = Writers()

    def messages(self, records: McapRecords) -> Iterator[Arrived]:
        """Gives log time, channel and content of each message."""
        self.facts.size = records.size
        for channel, schema, message in records.messages():
            self.facts.at_byte = records.file.tell()
            self.facts.there[channel.topic] = self.facts.there.get(channel.topic, 0) + 1
            content = None
            if channel.topic in self.wanted:
                decode = self.decoders.get(channel.id)
                if decode is None:
                    make = partial(self._channel_decoder, channel, schema)
                    decode = tolerant_decoder(make, self.wanted[channel.topic], self.facts)
                    self.decoders[channel.id] = decode
                    offered = channel.metadata.get("offered_qos_profiles", "")
                    self.writers.note_publishers(channel.topic, len(PROFILE.findall(offered)))
                node = channel.metadata.get("callerid") or f"channel {channel.id}"
                self.writers.note_message(channel.topic, node)
                content = decode(message.data)
            yield message.log_time, message.publish_time, channel.topic, content
        self.facts.notes += self.writers.notes
        self.facts.unchecked |= records.unchecked
        if records.private:
            text = f"{records.private:,} records of kinds that only its writer knows"
            self.facts.notes.append(f"{text} were stepped over")

    def _channel_decoder(self, channel: Any, schema: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - records
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
                default_definitions(wanted, 2 if encoding == "cdr" else 1),
            )
        elif schema is None or schema.encoding not in ROS_SCHEMAS:
            why = "no schema" if schema is None else f"a schema in `{schema.encoding[:40]}`"
            raise UndecodableError(f"messages of `{channel.topic}` are `{encoding}` with {why}")
        else:
            name, form = schema.name, ROS_SCHEMAS[schema.encoding][0]
            require_type(channel.topic, name, wanted)
            definitions = find_definitions(schema.data.decode("utf-8"), name, form)
        return message_decoder(name, definitions, encoding)


def _protobuf_decoder(channel: Any, schema: Any) -> Callable[[bytes], Any]:  # noqa: ANN401 - records
    if find_spec("mcap_protobuf") is None:
        text = (
            f"messages of `{channel.topic}` are protobuf, which the package "
            "`mcap-protobuf-support` reads; it is not installed"
        )
        help_ = f"install it: {pip_command('logs')}"
        raise SoterError((Diagnostic("D007", text, helps=(help_,)),))
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - an extra

    try:
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
    except Exception as error:
        raise UndecodableError(f"the schema of `{channel.topic}` cannot be used") from error
    if decode is None:
        raise UndecodableError(f"messages of `{channel.topic}` are protobuf without a schema of it")

    def decode_message(data: bytes) -> Any:  # noqa: ANN401 - a class made of a schema
        try:
            return decode(data)
        except Exception as error:
            raise UndecodableError(
                f"a message of `{channel.topic}` is no `{schema.name}`"
            ) from error

    return decode_message
