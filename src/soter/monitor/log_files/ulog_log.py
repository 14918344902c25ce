"""Reads the messages of a ULog, as PX4 writes it.

Purpose: `ulog_messages` reads messages by the formats in the file, in its order; where a file is
cut or contradicts itself it raises D016 with the place. A ULog has no checksums: so the kind and
length of every message are checked, wanted or not. `gps#1` is a topic's second instance; times are
the topics' own `timestamp`, us since the autopilot began.
Non-goals: what parameters and texts say; looking for the next message behind a damaged one.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.monitor.log_files.log_columns import (
    NO_END,
    Writers,
    damaged_log_error,
    opened_log,
    wrong_format_error,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted


ULOG_MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
HEAD = struct.Struct("<HB")
TYPES = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i",
    "uint32_t": "I", "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "bool": "?",
    "char": "s",
}  # fmt: skip
FIELD = re.compile(r"([\w/-]{1,99})(?:\[(\d{1,5})\])? (\w{1,99})", re.ASCII)
FORMAT_MAX, DEPTH_MAX = 1 << 16, 8
"""The most bytes of a message, whose count has two bytes; how deep formats may be nested."""
KEY = re.compile(rb"(\w{1,9})(?:\[(\d{1,5})\])? [!-~]{1,255}")
CONTROLS = {*range(32)} - {*b"\t\n\r\x1b"}
"""Bytes that no text has."""
SYNC = bytes.fromhex("2f731320250cbb12")


def _is_valid_body(kind: int, body: bytes) -> bool:
    """Whether a message body is valid for its kind, which must be a kind without topic values."""
    if kind in b"LC":
        begin = 9 if kind == ord("L") else 11
        return len(body) >= begin and body[0] in b"01234567" and not {*body[begin:]} & CONTROLS
    flag, fact = (body[0], body[1:]) if kind in b"MQ" else (0, body)
    key = KEY.fullmatch(fact[1 : 1 + fact[0]])
    if kind not in b"IMPQ" or key is None or flag > {ord("M"): 1}.get(kind, 3):
        return body == SYNC and kind == ord("S")
    size = struct.calcsize(f"<{TYPES[key[1].decode('ascii')]}") * int(key[2] or 1)
    value = fact[1 + fact[0] :]
    if kind == ord("M") and len(value) != size:  # `pyulog` writes that of the first of several
        return len(value) < size or (key[1] == b"char" and not {*value} & CONTROLS)
    return len(value) == size


@dataclass(frozen=True)
class _Field:
    """A field; `count`: its elements, 0 if no array; `inner`: the fields inside a nested format."""

    name: str
    code: str
    count: int
    size: int
    inner: tuple[_Field, ...] | None = None

    @property
    def struct_codes(self) -> str:
        """The format codes of `struct` for the field."""
        if self.inner is not None:
            return "".join(f.struct_codes for f in self.inner) * max(1, self.count)
        return f"{self.count or 1}s" if self.code == "s" else self.code * max(1, self.count)

    def read_value(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - a number, text, list or table
        """The value of the field, taken from the numbers that follow."""
        if self.code == "s":
            return next(values).partition(b"\0")[0].decode("utf-8", "replace")
        if self.count:
            return [self._read_element(values) for _ in range(self.count)]
        return self._read_element(values)

    def _read_element(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - the same
        return next(values) if self.inner is None else _content_by_name(self.inner, values)


def _content_by_name(fields: tuple[_Field, ...], values: Iterator[Any]) -> dict[str, Any]:
    """The fields of a message by name, without padding."""
    read = {f.name: f.read_value(values) for f in fields}
    return {name: value for name, value in read.items() if not name.startswith("_padding")}


@dataclass(frozen=True)
class _Topic:
    """The topic logged under an id: `name` with its instance; end padding may be left out."""

    name: str
    fields: tuple[_Field, ...]
    layout: struct.Struct = field(compare=False)
    longest: int
    time_at: int

    @classmethod
    def from_fields(cls, name: str, fields: tuple[_Field, ...]) -> _Topic:
        """The topic with these fields; raises ValueError if no field is named `timestamp`."""
        longest = sum(f.size for f in fields)
        while fields and fields[-1].name.startswith("_padding"):
            fields = fields[:-1]
        before = [f.name for f in fields].index("timestamp")
        if fields[before].struct_codes != "Q":
            raise ValueError
        time_at = sum(f.size for f in fields[:before])
        layout = struct.Struct("<" + "".join(f.struct_codes for f in fields))
        return cls(name, fields, layout, longest, time_at)

    def may_have_length(self, length: int) -> bool:
        """Whether a message of the topic, with the two bytes of its id, may have `length` bytes."""
        return self.layout.size <= length - 2 <= self.longest


def ulog_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives each message: time, topic, content (None: unwanted); counts all; raises D016."""
    facts.unchecked = True
    with opened_log(path) as file:
        if file.read(len(ULOG_MAGIC)) != ULOG_MAGIC:
            raise wrong_format_error(path, "ULog")
        yield from _UlogReading(path, file, wanted, facts).messages()


class _UlogReading:
    def __init__(
        self, path: Path, file: BinaryIO, wanted: dict[str, Wanted], facts: FileFacts
    ) -> None:
        self.path, self.file, self.wanted, self.facts = path, file, wanted, facts
        self.size = facts.note_size(file)
        self.formats: dict[str, str] = {}
        self.known: dict[str, _Topic] = {}
        self.topics: dict[int, _Topic] = {}
        self.appended: list[int] = []
        self.times_us: dict[str, int] = {}
        self.lost, self.lost_ms = 0, 0
        self.writers = Writers()

    def messages(self) -> Iterator[Arrived]:
        if len(self.file.read(HEADER_BYTES)) < HEADER_BYTES:
            raise damaged_log_error(self.path, f"its head has no end: {NO_END}")
        while (found := self._next_message()) is not None:
            kind, body = found
            try:
                if kind == ord("D"):
                    yield from self._data_messages(body)
                else:
                    self._note_definition(kind, body)
            except (ValueError, KeyError, IndexError, struct.error) as error:
                shown = f"the message of kind `{chr(kind)}` at byte {self.facts.at_byte:,}"
                raise damaged_log_error(
                    self.path, f"{shown} is none that its formats allow"
                ) from error
        if self.lost:
            text = f"the recorder could not keep up {self.lost:,} times, for {self.lost_ms:,} ms"
            self.facts.notes.append(f"{text} in all: messages are missing there")
        self.facts.notes += self.writers.notes

    def _next_message(self) -> tuple[int, bytes] | None:
        """Gives kind and body of the next message, None at the end; raises D016 if it is cut."""
        at = self.facts.at_byte = self.file.tell()
        head = self.file.read(HEAD.size)
        if not head:
            return None
        length, kind = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        if self.appended and at + HEAD.size + length > self.appended[0]:
            begun = self.file.read(max(0, self.appended[0] - at - HEAD.size))
            if at + HEAD.size < self.appended[0] and not self._may_begin_message(
                length, kind, begun
            ):
                raise damaged_log_error(self.path, f"at byte {at:,} stands no message")
            note = f"it was cut at byte {at:,} by a crash, and what was written after it is read"
            self.facts.notes.append(note)
            self.file.seek(self.appended.pop(0))
            return self._next_message()
        body = self.file.read(length)
        if len(head) < HEAD.size or len(body) < length:
            raise damaged_log_error(
                self.path, f"its last message, at byte {at:,}, has no end: {NO_END}"
            )
        if not (kind and length):
            raise damaged_log_error(self.path, f"at byte {at:,} stands no message")
        return kind, body

    def _data_messages(self, body: bytes) -> Iterator[Arrived]:
        """Gives a wanted message; for an unwanted one, only its time, if it is the latest time."""
        number = int.from_bytes(body[:2], "little")
        topic = self.topics[number]
        if not topic.may_have_length(len(body)):
            raise ValueError
        self.facts.there[topic.name] = self.facts.there.get(topic.name, 0) + 1
        (time_us,) = struct.unpack_from("<Q", body, 2 + topic.time_at)
        before = self.times_us.get(topic.name, time_us)
        self.times_us[topic.name] = time_us
        if topic.name in self.wanted:
            self.writers.note_message(topic.name, f"id {number}")
            content = _content_by_name(topic.fields, iter(topic.layout.unpack_from(body, 2)))
            yield time_us * 1000, None, topic.name, content
        elif time_us > before:
            yield time_us * 1000, None, topic.name, None

    def _may_begin_message(self, length: int, kind: int, begun: bytes) -> bool:
        """Whether `begun` may be the start of a cut message of this kind and length."""
        if kind != ord("D") or len(begun) < 2:
            return kind in b"DFAROIMPQLCS"
        topic = self.topics.get(int.from_bytes(begun[:2], "little"))
        return topic is not None and topic.may_have_length(length)

    def _note_definition(self, kind: int, body: bytes) -> None:
        """Notes the content of a message without data; raises ValueError or similar if wrong."""
        if kind == ord("F"):
            name, _, fields = body.decode("ascii").partition(":")
            declarations = (f"{name} _", *fields.rstrip(";").split(";"))
            if not all(FIELD.fullmatch(text) for text in declarations):
                raise ValueError
            if self.formats.setdefault(name, fields) != fields:
                raise ValueError
        elif kind == ord("A"):
            self._note_topic_id(body)
        elif kind == ord("R"):
            del self.topics[struct.unpack("<H", body)[0]]
        elif kind == ord("B") and self.facts.at_byte == HEADER_BYTES:
            self._note_appended_data(body)
        elif kind == ord("O"):
            self.lost, self.lost_ms = self.lost + 1, self.lost_ms + struct.unpack("<H", body)[0]
        elif not _is_valid_body(kind, body):
            raise ValueError

    def _note_topic_id(self, body: bytes) -> None:
        """Notes the topic of an id; raises ValueError if the id is already another topic's."""
        instance, number = struct.unpack_from("<BH", body)
        name = body[3:].decode("ascii")
        channel = f"{name}#{instance}" if instance else name
        topic = replace(self._topic_of_format(name), name=channel)
        if self.topics.setdefault(number, topic) != topic:
            raise ValueError
        self.facts.there.setdefault(channel, 0)

    def _note_appended_data(self, body: bytes) -> None:
        """Notes the places of appended data; raises SoterError for a newer kind of ULog."""
        ahead, *offsets = struct.unpack("<8x8s3Q", body[:40])
        if ahead[0] & ~1 or any(ahead[1:]):
            raise wrong_format_error(
                self.path, "ULog of a kind that this version knows, but a newer one"
            )
        self.appended = [n for n in offsets if n] if ahead[0] else []
        if self.appended != sorted(self.appended) or max(self.appended, default=0) > self.size:
            raise ValueError

    def _topic_of_format(self, name: str) -> _Topic:
        """The topic of a format, made once and shared by all instances."""
        if name not in self.known:
            self.known[name] = _Topic.from_fields(name, self._fields_of_format(name, DEPTH_MAX))
        return self.known[name]

    def _fields_of_format(self, name: str, depth: int) -> tuple[_Field, ...]:
        """The fields of a format; ValueError if it is longer than a message or contains itself."""
        made: list[_Field] = []
        for text in filter(None, self.formats[name].split(";")):
            match = FIELD.fullmatch(text)
            if match is None or not depth:
                raise ValueError
            code, count = TYPES.get(match[1], ""), int(match[2] or 0)
            inner = None if code else self._fields_of_format(match[1], depth - 1)
            one = struct.calcsize(f"<{code}") if inner is None else sum(f.size for f in inner)
            made.append(_Field(match[3], code, count, max(1, count) * one, inner))
            if not 0 < sum(f.size for f in made) <= FORMAT_MAX:
                raise ValueError
        return tuple(made)
