"""The messages of a DataFlash log of ArduPilot, binary (`.bin`) or text (`.log`).

Purpose: messages with their fields by the formats (`FMT`) in the file, in its order; a file that is
cut or contradicts itself ends with the place. `IMU#1` is the instance 1 of `IMU`, where the file
says which field that is. Times are `TimeUS`, us since the autopilot began, `TimeMS` or `T` of old
logs in ms; a message that has none came with the one before it.
Non-goals: looking for the next message behind a damaged one; GPS time.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import reason
from soter.language.load.named_files import opened
from soter.monitor.logs.files.log_columns import damaged, is_plain, remedies, unusable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from soter.monitor.logs.files.log_columns import Arrived, FileFacts, Wanted

MAGIC = b"\xa3\x95"
FMT, HEAD_BYTES = 128, 3
TEXT_HEAD, LINE_MAX = 1 << 16, 1 << 16
"""Bytes in which a text has to say its first format, and of a line."""
CODES = {
    "a": "64s", "b": "b", "B": "B", "g": "e", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f",
    "d": "d", "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i",
    "M": "b", "q": "q", "Q": "Q",
}  # fmt: skip
"""What `struct` calls each letter of a format."""
DIVISORS = {"c": 1e2, "C": 1e2, "e": 1e2, "E": 1e2, "L": 1e7}
TEXTS, FLOATS = "nNZ", "gfdcCeEL"
TIMES_NS = {"TimeUS": 1000, "T": 10**6, "TimeMS": 10**6}
"""The first of these counts: `TimeMS` beside a `T` is the time of GPS."""
PADDING = (b"\0", b"\xff")
NO_END = "the autopilot lost power while it wrote, or the file was cut"


@dataclass
class _Format:
    """What `FMT` says of a kind of messages. `instance`: the field that tells its sensors apart."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]
    instance: str = ""
    layout: struct.Struct = field(init=False)

    def __post_init__(self) -> None:
        self.layout = struct.Struct("<" + "".join(CODES[letter] for letter in self.letters))

    def content(self, raw: Sequence[Any]) -> dict[str, Any]:
        """A binary message, of what `layout` reads of it."""
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
        """A message of a text, of what `typed` reads of it."""
        return dict(zip(self.columns, raw, strict=True))

    def channel(self, raw: Sequence[Any]) -> str:
        """Its name, and the instance where that is not the first."""
        if not self.instance:
            return self.name
        number = raw[self.columns.index(self.instance)]
        number = _text(number) if isinstance(number, bytes) else number
        return f"{self.name}#{number}" if number not in (0, "", "0") else self.name

    def time_ns(self, raw: Sequence[Any]) -> int | None:
        """When it was written, where it says so."""
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
            reading = _Reading(path, wanted, facts)
            if head.startswith(MAGIC):
                yield from reading.of_binary(file)
            elif b"FMT," in head:
                yield from reading.of_text(file)
            else:
                raise unusable(path, "it is no log of ArduPilot", *remedies(path))
    except OSError as error:
        raise unusable(path, reason(error)) from error


class _Reading:
    """Formats so far, and the time of the last message that had one."""

    def __init__(self, path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> None:
        self.path, self.wanted, self.facts = path, wanted, facts
        first = _Format("FMT", 89, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
        self.formats = {FMT: first}
        self.now_ns = 0

    def of_binary(self, file: BinaryIO) -> Iterator[Arrived]:
        while head := file.read(HEAD_BYTES):
            at = self.facts.at_byte = file.tell() - len(head)
            if head[:2] != MAGIC:
                self._require_padding(head, file, at)
                return
            form = self.formats.get(head[2]) if len(head) == HEAD_BYTES else None
            if form is None and len(head) == HEAD_BYTES:
                told = f"the message at byte {at:,} is of kind {head[2]}, which no `FMT` says"
                raise damaged(self.path, told)
            body = b"" if form is None else file.read(form.length - HEAD_BYTES)
            if form is None or len(body) < form.length - HEAD_BYTES:
                told = f"its last message, at byte {at:,}, has no end: {NO_END}"
                raise damaged(self.path, told)
            try:
                raw = form.layout.unpack(body)
                yield from self._arrived(form, raw, form.content, f"at byte {at:,}")
            except (struct.error, ValueError) as error:
                told = (
                    f"the `{form.name}` at byte {at:,} is as long as its `FMT` says, which is not"
                )
                raise damaged(self.path, f"{told} what its fields need") from error

    def _require_padding(self, head: bytes, file: BinaryIO, at: int) -> None:
        """D016 where something else than erased flash stands behind the last message."""
        fill, count = head[:1], len(head)
        while fill in PADDING and head == fill * len(head):
            head = file.read(1 << 16)
            count += len(head)
            if not head:
                self.facts.notes.append(f"{count:,} bytes of `{fill.hex()}` stand behind its end")
                return
        raise damaged(self.path, f"at byte {at:,} stands no message")

    def of_text(self, file: BinaryIO) -> Iterator[Arrived]:
        by_name = {"FMT": self.formats[FMT]}
        unknown, first, number, line = 0, "", 0, b"\n"
        while raw := file.readline(LINE_MAX + 1):
            number, line = number + 1, raw
            self.facts.at_byte = file.tell() - len(raw)
            where = f"line {number}"
            if len(raw) > LINE_MAX or b"\0" in raw:
                raise damaged(self.path, f"{where} is longer than any is, or no text")
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
                raise damaged(self.path, told) from error
            yield from self._arrived(form, values, form.of_text, f"in {where}")
            if name == "FMT":
                by_name[values[2]] = self.formats[values[0]]
        if unknown:
            told = f"{unknown:,} lines of no known kind were stepped over"
            self.facts.notes.append(f"{told}, the first is {first}")
        if not line.endswith(b"\n"):
            self.facts.notes.append("its last line has no end: the file may be cut there")

    def _arrived(
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
            raise damaged(self.path, f"{told}, which are none") from error
        if len(columns) != len(form.letters) or form.length < HEAD_BYTES:
            raise damaged(self.path, f"{told}, for {len(columns)} fields")
        self.formats[said["Type"]] = form

    def _say_instance(self, said: dict[str, Any]) -> None:
        form = self.formats.get(said.get("FmtType", -1))
        place = str(said.get("UnitIds", "")).find("#")
        if form is not None and 0 <= place < len(form.columns):
            form.instance = form.columns[place]
