"""The messages of a ULog, as PX4 writes it, in the order in which they stand there.

Purpose: topics with their fields by the formats in the file, message by message; a file that is cut
or contradicts itself ends with the place. `vehicle_gps_position#1` is the topic's second instance.
Times are the topics' own `timestamp`, us since the autopilot began.
Non-goals: parameters and texts; looking for the next message behind a damaged one.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import reason
from soter.language.load.named_files import opened
from soter.monitor.logs.files.log_columns import damaged, remedies, unusable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.monitor.logs.files.log_columns import Arrived, FileFacts, Wanted

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
HEAD = struct.Struct("<HB")
TYPES = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i",
    "uint32_t": "I", "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "bool": "?",
    "char": "s",
}  # fmt: skip
FIELD = re.compile(r"(\w{1,99})(?:\[(\d{1,5})\])? (\w{1,99})", re.ASCII)
FORMAT_MAX, DEPTH_MAX = 1 << 16, 8
"""Bytes of a message, as their count has two bytes; formats in formats."""
STEPPED_OVER = b"IMPQLCS"
"""Kinds of messages that hold no values of a topic."""
NO_END = "the autopilot lost power while it wrote, or the file was cut"


@dataclass(frozen=True)
class _Field:
    """A field: `count` 0 is no array; `inner`: of another format, None: a number or a text."""

    name: str
    code: str
    count: int
    size: int
    inner: tuple[_Field, ...] | None = None

    @property
    def codes(self) -> str:
        """What `struct` calls it."""
        if self.inner is not None:
            return "".join(f.codes for f in self.inner) * max(1, self.count)
        return f"{self.count or 1}s" if self.code == "s" else self.code * max(1, self.count)

    def read(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - a number, text, list or table
        """What it holds, of the numbers that follow."""
        if self.code == "s":
            return next(values).partition(b"\0")[0].decode("utf-8", "replace")
        if self.count:
            return [self._one(values) for _ in range(self.count)]
        return self._one(values)

    def _one(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - the same
        return next(values) if self.inner is None else _content(self.inner, values)


def _content(fields: tuple[_Field, ...], values: Iterator[Any]) -> dict[str, Any]:
    """Its fields by name; those that only fill room are read over."""
    read = {f.name: f.read(values) for f in fields}
    return {name: value for name, value in read.items() if not name.startswith("_padding")}


@dataclass(frozen=True)
class _Topic:
    """What is logged under an id: `name` with its instance; padding at its end may be left out."""

    name: str
    fields: tuple[_Field, ...]
    layout: struct.Struct = field(compare=False)
    longest: int
    time_at: int

    @classmethod
    def of(cls, name: str, fields: tuple[_Field, ...]) -> _Topic:
        """ValueError where nothing of it says when."""
        longest = sum(f.size for f in fields)
        while fields and fields[-1].name.startswith("_padding"):
            fields = fields[:-1]
        before = [f.name for f in fields].index("timestamp")
        if fields[before].codes != "Q":
            raise ValueError
        time_at = sum(f.size for f in fields[:before])
        layout = struct.Struct("<" + "".join(f.codes for f in fields))
        return cls(name, fields, layout, longest, time_at)


def ulog_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Time, topic and content of each message; None for that of a topic nobody wants.

    `facts` counts the messages of every topic. SoterError D016.
    """
    facts.unchecked = True
    try:
        with opened(path) as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise unusable(path, "it is no ULog", *remedies(path))
            yield from _Reading(path, file, wanted, facts).messages()
    except OSError as error:
        raise unusable(path, reason(error)) from error


class _Reading:
    """Formats and topics so far."""

    def __init__(
        self, path: Path, file: BinaryIO, wanted: dict[str, Wanted], facts: FileFacts
    ) -> None:
        self.path, self.file, self.wanted, self.facts = path, file, wanted, facts
        self.size = facts.size_of(file)
        self.formats: dict[str, str] = {}
        self.known: dict[str, _Topic] = {}
        self.topics: dict[int, _Topic] = {}
        self.appended: list[int] = []
        self.times_us: dict[str, int] = {}
        self.lost, self.lost_ms, self.unknown = 0, 0, 0

    def messages(self) -> Iterator[Arrived]:
        if len(self.file.read(HEADER_BYTES)) < HEADER_BYTES:
            raise damaged(self.path, f"its head has no end: {NO_END}")
        while (found := self._next()) is not None:
            kind, body = found
            try:
                if kind == ord("D"):
                    yield from self._data(body)
                else:
                    self._other(kind, body)
            except (ValueError, KeyError, IndexError, struct.error) as error:
                shown = f"the message of kind `{chr(kind)}` at byte {self.facts.at_byte:,}"
                raise damaged(self.path, f"{shown} is none that its formats allow") from error
        if self.lost:
            told = f"the recorder could not keep up {self.lost:,} times, for {self.lost_ms:,} ms"
            self.facts.notes.append(f"{told} in all: messages are missing there")
        if self.unknown:
            told = f"{self.unknown:,} messages of kinds that are not known here"
            self.facts.notes.append(f"{told} were stepped over")

    def _next(self) -> tuple[int, bytes] | None:
        """Kind and body of the next message, None at the end; D016 where it is cut."""
        at = self.facts.at_byte = self.file.tell()
        head = self.file.read(HEAD.size)
        if not head:
            return None
        length, kind = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        if self.appended and at + HEAD.size + length > self.appended[0]:
            told = f"it was cut at byte {at:,} by a crash, and what was written after it is read"
            self.facts.notes.append(told)
            self.file.seek(self.appended.pop(0))
            return self._next()
        body = self.file.read(length)
        if len(head) < HEAD.size or len(body) < length:
            raise damaged(self.path, f"its last message, at byte {at:,}, has no end: {NO_END}")
        if not (kind and length):
            raise damaged(self.path, f"at byte {at:,} stands no message")
        return kind, body

    def _data(self, body: bytes) -> Iterator[Arrived]:
        """A message; of a topic nobody wants one that says no later time does not say when it was.

        Some say 0 all the time, or once a time of long ago or long after.
        """
        topic = self.topics[int.from_bytes(body[:2], "little")]
        if not topic.layout.size <= len(body) - 2 <= topic.longest:
            raise ValueError
        self.facts.there[topic.name] = self.facts.there.get(topic.name, 0) + 1
        (time_us,) = struct.unpack_from("<Q", body, 2 + topic.time_at)
        before = self.times_us.get(topic.name, time_us)
        self.times_us[topic.name] = time_us
        if topic.name in self.wanted:
            content = _content(topic.fields, iter(topic.layout.unpack_from(body, 2)))
            yield time_us * 1000, None, topic.name, content
        elif time_us > before:
            yield time_us * 1000, None, topic.name, None

    def _other(self, kind: int, body: bytes) -> None:
        if kind == ord("F"):
            name, _, fields = body.decode("ascii").partition(":")
            if self.formats.setdefault(name, fields) != fields:
                raise ValueError
        elif kind == ord("A"):
            self._subscribe(body)
        elif kind == ord("R"):
            self.topics.pop(int.from_bytes(body[:2], "little"), None)
        elif kind == ord("B"):
            self._flags(body)
        elif kind == ord("O"):
            self.lost, self.lost_ms = self.lost + 1, self.lost_ms + struct.unpack("<H", body)[0]
        elif kind not in STEPPED_OVER:
            self.unknown += 1

    def _subscribe(self, body: bytes) -> None:
        """What an id means; ValueError where it means something else already."""
        instance, number = struct.unpack_from("<BH", body)
        name = body[3:].decode("ascii")
        channel = f"{name}#{instance}" if instance else name
        topic = replace(self._topic(name), name=channel)
        if self.topics.setdefault(number, topic) != topic:
            raise ValueError
        self.facts.there.setdefault(channel, 0)

    def _flags(self, body: bytes) -> None:
        """Where data stand that were appended; SoterError of a kind that nobody here knows."""
        ahead, *offsets = struct.unpack("<8x8s3Q", body[:40])
        if ahead[0] & ~1 or any(ahead[1:]):
            raise unusable(self.path, "it is a ULog of a kind that is newer than its readers")
        self.appended = [n for n in offsets if n] if ahead[0] else []
        if self.appended != sorted(self.appended) or max(self.appended, default=0) > self.size:
            raise ValueError

    def _topic(self, name: str) -> _Topic:
        """What is logged by a format; its instances share it."""
        if name not in self.known:
            self.known[name] = _Topic.of(name, self._fields(name, DEPTH_MAX))
        return self.known[name]

    def _fields(self, name: str, depth: int) -> tuple[_Field, ...]:
        """What a format is made of; ValueError where it is longer than a message, or in itself."""
        made: list[_Field] = []
        for text in filter(None, self.formats[name].split(";")):
            match = FIELD.fullmatch(text)
            if match is None or not depth:
                raise ValueError
            code, count = TYPES.get(match[1], ""), int(match[2] or 0)
            inner = None if code else self._fields(match[1], depth - 1)
            one = struct.calcsize(f"<{code}") if inner is None else sum(f.size for f in inner)
            made.append(_Field(match[3], code, count, max(1, count) * one, inner))
            if not 0 < sum(f.size for f in made) <= FORMAT_MAX:
                raise ValueError
        return tuple(made)
