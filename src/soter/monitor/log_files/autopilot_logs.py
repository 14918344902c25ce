"""The messages of what autopilots log on board: ULog of PX4, DataFlash of ArduPilot.

Purpose: `ulog_messages` and `dataflash_messages` read messages by the formats in the file, in its
order; where a file is cut or contradicts itself they raise D016 with the place. ULog:
`vehicle_gps_position#1` is the topic's second instance; times are the topics' own `timestamp`, us
since the autopilot began. DataFlash, binary (`.bin`) or text (`.log`): `IMU#1` is the instance 1 of
`IMU`, where the file says which field that is; times are `TimeUS`, us since the autopilot began,
`TimeMS` or `T` of old logs in ms; a message that has none came with the one before it.
Non-goals: parameters and texts of a ULog; looking for the next message behind a damaged one; GPS
time; telemetry (`mavlink_log.py`).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import reason
from soter.language.load.named_files import opened
from soter.monitor.log_files.log_columns import damaged_log, is_plain, remedies, unusable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted


DATAFLASH_MAGIC = b"\xa3\x95"
FMT, HEAD_BYTES = 128, 3
TEXT_HEAD, LINE_MAX = 1 << 16, 1 << 16
"""Bytes in which a text has to say its first format, and of a line."""
CODES = {
    "a": "64s", "b": "b", "B": "B", "g": "e", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f",
    "d": "d", "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i",
    "M": "b", "q": "q", "Q": "Q",
}  # fmt: skip
"""Letter of a format -> its code of `struct`."""
DIVISORS = {"c": 1e2, "C": 1e2, "e": 1e2, "E": 1e2, "L": 1e7}
TEXTS, FLOATS = "nNZ", "gfdcCeEL"
TIMES_NS = {"TimeUS": 1000, "T": 10**6, "TimeMS": 10**6}
"""The first of these counts: `TimeMS` beside a `T` is the time of GPS."""
PADDING = (b"\0", b"\xff")
NO_END = "the autopilot lost power while it wrote, or the file was cut"


@dataclass
class _Format:
    """A kind of messages, from its `FMT`. `instance`: the field that tells its sensors apart."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]
    instance: str = ""
    layout: struct.Struct = field(init=False)

    def __post_init__(self) -> None:
        self.layout = struct.Struct("<" + "".join(CODES[letter] for letter in self.letters))

    def content(self, raw: Sequence[Any]) -> dict[str, Any]:
        """The content of a binary message, from what `layout` reads of it."""
        made: dict[str, Any] = {}
        for letter, name, value in zip(self.letters, self.columns, raw, strict=True):
            if letter in TEXTS:
                made[name] = _text(value)
            elif letter == "a":
                made[name] = list(struct.unpack("<32h", value))
            else:
                made[name] = value / DIVISORS[letter] if letter in DIVISORS else value
        return made

    def typed(self, cells: Sequence[str]) -> list[Any]:
        """A line of a text; ValueError where it is none. A mode may stand there by name."""
        if len(cells) < len(self.columns):
            raise ValueError
        return [
            cell if letter in TEXTS or letter in "aM" else _number(letter, cell)
            for letter, cell in zip(self.letters, cells, strict=False)
        ]

    def of_text(self, raw: Sequence[Any]) -> dict[str, Any]:
        """The content of a message of a text, from what `typed` reads of it."""
        return dict(zip(self.columns, raw, strict=True))

    def channel(self, raw: Sequence[Any]) -> str:
        """The channel of a message: its name, and the instance where that is not the first."""
        if not self.instance:
            return self.name
        number = raw[self.columns.index(self.instance)]
        number = _text(number) if isinstance(number, bytes) else number
        return f"{self.name}#{number}" if number not in (0, "", "0") else self.name

    def time_ns(self, raw: Sequence[Any]) -> int | None:
        """The time at which a message was written; None where it does not say so."""
        for name, unit_ns in TIMES_NS.items():
            if name in self.columns:
                given = raw[self.columns.index(name)]
                return given * unit_ns if isinstance(given, int) else None
        return None


def _text(raw: bytes) -> str:
    ended = raw.partition(b"\0")[0]
    try:
        return ended.decode("utf-8")
    except UnicodeDecodeError:
        return ended.decode("latin-1")


def _number(letter: str, cell: str) -> float | int:
    if not is_plain(cell):
        raise ValueError
    return float(cell) if letter in FLOATS else int(cell)


def dataflash_messages(
    path: Path, wanted: dict[str, Wanted], facts: FileFacts
) -> Iterator[Arrived]:
    """Time, kind and content of each message; None for that of a kind nobody wants.

    `facts` counts the messages of every kind. SoterError D016.
    """
    facts.unchecked = True
    try:
        with opened(path) as file:
            head = file.read(TEXT_HEAD)
            facts.size_of(file)
            file.seek(0)
            reading = _DataflashReading(path, wanted, facts)
            if head.startswith(DATAFLASH_MAGIC):
                yield from reading.of_binary(file)
            elif b"FMT," in head:
                yield from reading.of_text(file)
            else:
                raise unusable(path, "it is no log of ArduPilot", *remedies(path))
    except OSError as error:
        raise unusable(path, reason(error)) from error


class _DataflashReading:
    """Reads a log by the formats met so far; `now_ns`: the time of the last message with one."""

    def __init__(self, path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> None:
        self.path, self.wanted, self.facts = path, wanted, facts
        first = _Format("FMT", 89, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
        self.formats = {FMT: first}
        self.now_ns = 0

    def of_binary(self, file: BinaryIO) -> Iterator[Arrived]:
        while head := file.read(HEAD_BYTES):
            at = self.facts.at_byte = file.tell() - len(head)
            if head[:2] != DATAFLASH_MAGIC:
                self._require_padding(head, file, at)
                return
            form = self.formats.get(head[2]) if len(head) == HEAD_BYTES else None
            if form is None and len(head) == HEAD_BYTES:
                told = f"the message at byte {at:,} is of kind {head[2]}, which no `FMT` says"
                raise damaged_log(self.path, told)
            body = b"" if form is None else file.read(form.length - HEAD_BYTES)
            if form is None or len(body) < form.length - HEAD_BYTES:
                told = f"its last message, at byte {at:,}, has no end: {NO_END}"
                raise damaged_log(self.path, told)
            try:
                raw = form.layout.unpack(body)
                yield from self._take_message(form, raw, form.content, f"at byte {at:,}")
            except (struct.error, ValueError) as error:
                told = (
                    f"the `{form.name}` at byte {at:,} is as long as its `FMT` says, which is not"
                )
                raise damaged_log(self.path, f"{told} what its fields need") from error

    def _require_padding(self, head: bytes, file: BinaryIO, at: int) -> None:
        """D016 where something else than erased flash stands behind the last message."""
        fill, count = head[:1], len(head)
        while fill in PADDING and head == fill * len(head):
            head = file.read(1 << 16)
            count += len(head)
            if not head:
                self.facts.notes.append(f"{count:,} bytes of `{fill.hex()}` stand behind its end")
                return
        raise damaged_log(self.path, f"at byte {at:,} stands no message")

    def of_text(self, file: BinaryIO) -> Iterator[Arrived]:
        by_name = {"FMT": self.formats[FMT]}
        unknown, first, number, line = 0, "", 0, b"\n"
        while raw := file.readline(LINE_MAX + 1):
            number, line = number + 1, raw
            self.facts.at_byte = file.tell() - len(raw)
            where = f"line {number}"
            if len(raw) > LINE_MAX or b"\0" in raw:
                raise damaged_log(self.path, f"{where} is longer than any is, or no text")
            name, *cells = (c.strip() for c in _text(raw).rstrip().split(","))
            if name not in by_name:
                begun = len(by_name) > 1 and name
                unknown, first = (unknown + 1, first or where) if begun else (unknown, first)
                continue
            if name == "FMT":
                cells = [*cells[:4], ",".join(cells[4:])]
            form = by_name[name]
            try:
                values = form.typed(cells)
            except ValueError as error:
                told = f"{where} is no `{name}`: {_text(raw).strip()[:60]}"
                raise damaged_log(self.path, told) from error
            yield from self._take_message(form, values, form.of_text, f"in {where}")
            if name == "FMT":
                by_name[values[2]] = self.formats[values[0]]
        if unknown:
            told = f"{unknown:,} lines of no known kind were stepped over"
            self.facts.notes.append(f"{told}, the first is {first}")
        if not line.endswith(b"\n"):
            self.facts.notes.append("its last line has no end: the file may be cut there")

    def _take_message(
        self,
        form: _Format,
        raw: Sequence[Any],
        content: Callable[[Sequence[Any]], dict[str, Any]],
        where: str,
    ) -> Iterator[Arrived]:
        """A message, unless nobody wants it and it does not say when it was."""
        if form.name == "FMT":
            self._define(content(raw), where)
        elif form.name == "FMTU":
            self._say_instance(content(raw))
        time_ns = form.time_ns(raw)
        self.now_ns = self.now_ns if time_ns is None else time_ns
        channel = form.channel(raw)
        self.facts.there[channel] = self.facts.there.get(channel, 0) + 1
        if channel in self.wanted:
            yield self.now_ns, None, channel, content(raw)
        elif time_ns is not None:
            yield self.now_ns, None, channel, None

    def _define(self, said: dict[str, Any], where: str) -> None:
        columns = tuple(filter(None, said["Columns"].split(",")))
        if said["Name"] == "FMT":
            return  # it is the one that reads this
        told = f"the `FMT` {where} says that `{said['Name']}` has the formats `{said['Format']}`"
        before = self.formats.get(said["Type"])
        instance = before.instance if before is not None else ""
        try:
            form = _Format(said["Name"], said["Length"], said["Format"], columns, instance)
        except KeyError as error:
            raise damaged_log(self.path, f"{told}, which are none") from error
        if len(columns) != len(form.letters) or form.length < HEAD_BYTES:
            raise damaged_log(self.path, f"{told}, for {len(columns)} fields")
        self.formats[said["Type"]] = form

    def _say_instance(self, said: dict[str, Any]) -> None:
        form = self.formats.get(said.get("FmtType", -1))
        place = str(said.get("UnitIds", "")).find("#")
        if form is not None and 0 <= place < len(form.columns):
            form.instance = form.columns[place]


ULOG_MAGIC = b"ULog\x01\x12\x35"
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
        """The codes of `struct` for the field."""
        if self.inner is not None:
            return "".join(f.codes for f in self.inner) * max(1, self.count)
        return f"{self.count or 1}s" if self.code == "s" else self.code * max(1, self.count)

    def read(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - a number, text, list or table
        """The value of the field, taken from the numbers that follow."""
        if self.code == "s":
            return next(values).partition(b"\0")[0].decode("utf-8", "replace")
        if self.count:
            return [self._read_one(values) for _ in range(self.count)]
        return self._read_one(values)

    def _read_one(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - the same
        return next(values) if self.inner is None else _content(self.inner, values)


def _content(fields: tuple[_Field, ...], values: Iterator[Any]) -> dict[str, Any]:
    """The fields of a message by name, without those that only fill room."""
    read = {f.name: f.read(values) for f in fields}
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
    def of(cls, name: str, fields: tuple[_Field, ...]) -> _Topic:
        """The topic of these fields; ValueError where no `timestamp` is among them."""
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
            if file.read(len(ULOG_MAGIC)) != ULOG_MAGIC:
                raise unusable(path, "it is no ULog", *remedies(path))
            yield from _UlogReading(path, file, wanted, facts).messages()
    except OSError as error:
        raise unusable(path, reason(error)) from error


class _UlogReading:
    """Reads a log by the formats and topics met so far."""

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
            raise damaged_log(self.path, f"its head has no end: {NO_END}")
        while (found := self._next()) is not None:
            kind, body = found
            try:
                if kind == ord("D"):
                    yield from self._data(body)
                else:
                    self._other(kind, body)
            except (ValueError, KeyError, IndexError, struct.error) as error:
                shown = f"the message of kind `{chr(kind)}` at byte {self.facts.at_byte:,}"
                raise damaged_log(self.path, f"{shown} is none that its formats allow") from error
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
            raise damaged_log(self.path, f"its last message, at byte {at:,}, has no end: {NO_END}")
        if not (kind and length):
            raise damaged_log(self.path, f"at byte {at:,} stands no message")
        return kind, body

    def _data(self, body: bytes) -> Iterator[Arrived]:
        """A message of a wanted topic; of any other its time alone, if that is later than before.

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
        """Note which topic an id stands for; ValueError where it stands for another already."""
        instance, number = struct.unpack_from("<BH", body)
        name = body[3:].decode("ascii")
        channel = f"{name}#{instance}" if instance else name
        topic = replace(self._topic(name), name=channel)
        if self.topics.setdefault(number, topic) != topic:
            raise ValueError
        self.facts.there.setdefault(channel, 0)

    def _flags(self, body: bytes) -> None:
        """Take note of where data were appended; SoterError for a newer kind of ULog."""
        ahead, *offsets = struct.unpack("<8x8s3Q", body[:40])
        if ahead[0] & ~1 or any(ahead[1:]):
            raise unusable(self.path, "it is a ULog of a kind that is newer than its readers")
        self.appended = [n for n in offsets if n] if ahead[0] else []
        if self.appended != sorted(self.appended) or max(self.appended, default=0) > self.size:
            raise ValueError

    def _topic(self, name: str) -> _Topic:
        """The topic of a format, made once; its instances share it."""
        if name not in self.known:
            self.known[name] = _Topic.of(name, self._fields(name, DEPTH_MAX))
        return self.known[name]

    def _fields(self, name: str, depth: int) -> tuple[_Field, ...]:
        """The fields of a format; ValueError where it is longer than a message, or in itself."""
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
