"""Reads messages of a DataFlash log, as ArduPilot writes it: binary (`.bin`) or text (`.log`).

Purpose: `dataflash_messages` reads messages by the formats in the file, in its order; where a file
is cut or contradicts itself it raises D016 with the place. What `FMT` and `FMTU` say holds for the
whole file, wherever they stand: a first pass looks at them alone. `IMU#1` is the instance 1 of
`IMU`, where the file says which field that is; times are `TimeUS`, us since the autopilot began,
`TimeMS` or `T` of old logs in ms; a message that has none came with the one before it.
Non-goals: looking for the next message behind a damaged one; GPS time; units (`UNIT`, `MULT`).
"""

from __future__ import annotations

import struct
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO

from soter.monitor.log_files.log_columns import (
    NO_END,
    DamagedLogError,
    FileFacts,
    damaged_log_error,
    is_plain_number,
    opened_log,
    wrong_format_error,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, Wanted


DATAFLASH_MAGIC = b"\xa3\x95"
FMT, HEAD_BYTES = 128, 3
TEXT_HEAD, LINE_MAX = 1 << 16, 1 << 16
"""Bytes within which a text has to say its first format; bytes of a line."""
CODES = {
    "a": "64s", "b": "b", "B": "B", "g": "e", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f",
    "d": "d", "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i",
    "M": "b", "q": "q", "Q": "Q",
}  # fmt: skip
"""By letter of a format: its code of `struct`."""
DIVISORS = {"c": 1e2, "C": 1e2, "e": 1e2, "E": 1e2, "L": 1e7}
TEXTS, FLOATS = {"n": 4, "N": 16, "Z": 64}, "gfdcCeEL"
TIMES_NS = {"TimeUS": 1000, "T": 10**6, "TimeMS": 10**6}
"""The columns with times, and their units; the first counts: `TimeMS` beside `T` is of GPS."""
PADDING = (b"\0", b"\xff")


@dataclass
class _Format:
    """A kind of messages; `instance`: the field that tells sensors apart, "" or None: unknown."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]
    instance: str | None = None
    layout: struct.Struct = field(init=False, compare=False)

    def __post_init__(self) -> None:
        self.layout = struct.Struct("<" + "".join(CODES[letter] for letter in self.letters))

    def binary_content(self, raw: Sequence[Any]) -> dict[str, Any]:
        """The content of a binary message, from the values that `layout` reads of it."""
        made: dict[str, Any] = {}
        for letter, name, value in zip(self.letters, self.columns, raw, strict=True):
            if letter in TEXTS:
                made[name] = _decoded_text(value)
            elif letter == "a":
                made[name] = list(struct.unpack("<32h", value))
            else:
                made[name] = value / DIVISORS[letter] if letter in DIVISORS else value
        return made

    def typed_cells(self, cells: Sequence[str]) -> list[Any]:
        """The values of a text line's cells, a mode also by name; raises ValueError if unfit."""
        return [_typed_cell(letter, cell) for letter, cell in zip(self.letters, cells, strict=True)]

    def cells_of_line(self, line: str) -> list[str]:
        """The cells of a line after its name; a text in the last cell may have commas."""
        text_last = self.letters[-1:] in TEXTS
        return [c.strip() for c in line.split(",", len(self.letters) - 1 if text_last else -1)]

    def text_content(self, raw: Sequence[Any]) -> dict[str, Any]:
        """The content of a message in a text, from the values of `typed_cells`."""
        return dict(zip(self.columns, raw, strict=True))

    def channel_name(self, raw: Sequence[Any]) -> str:
        """The channel of a message: its name, and its instance unless it is the first."""
        if not self.instance:
            return self.name
        number = raw[self.columns.index(self.instance)]
        number = _decoded_text(number) if isinstance(number, bytes) else number
        return f"{self.name}#{number}" if number not in (0, "", "0") else self.name

    def time_ns(self, raw: Sequence[Any]) -> int | None:
        """The time at which a message was written; None if the message has no time."""
        for name, unit_ns in TIMES_NS.items():
            if name in self.columns:
                value = raw[self.columns.index(name)]
                return value * unit_ns if isinstance(value, int) else None
        return None


def _decoded_text(raw: bytes) -> str:
    ended = raw.partition(b"\0")[0]
    try:
        return ended.decode("utf-8")
    except UnicodeDecodeError:
        return ended.decode("latin-1")


def _typed_cell(letter: str, cell: str) -> float | int | str:
    """The value of a text cell; raises ValueError if the cell does not fit the type `letter`."""
    is_text = letter in TEXTS or letter in "aM"
    if len(cell.encode("utf-8")) > TEXTS.get(letter, LINE_MAX) or not (
        is_text or is_plain_number(cell)
    ):
        raise ValueError
    if is_text or letter in FLOATS:
        return cell if is_text else float(cell)
    number = int(cell)
    struct.pack(CODES[letter], number)
    return number


def dataflash_messages(
    path: Path, wanted: dict[str, Wanted], facts: FileFacts
) -> Iterator[Arrived]:
    """Gives each message: time, kind, content (None: unwanted); counts all; raises D016."""
    facts.unchecked = True
    with opened_log(path) as file:
        head = file.read(TEXT_HEAD)
        facts.note_size(file)
        file.seek(0)
        binary = head.startswith(DATAFLASH_MAGIC)
        if not binary and b"FMT," not in head:
            raise wrong_format_error(path, "log of ArduPilot")
        first = _DataflashReading(path, None, FileFacts())
        with suppress(DamagedLogError):  # the second pass raises it again
            deque(first.binary_messages(file) if binary else first.text_messages(file), maxlen=0)
        file.seek(0)
        reading = _DataflashReading(path, wanted, facts)
        reading.formats = first.formats
        reading.has_units = any(form.name == "FMTU" for form in first.formats.values())
        yield from reading.binary_messages(file) if binary else reading.text_messages(file)


class _DataflashReading:
    """Reads a log by the formats seen so far; reads only formats if `wanted` is None."""

    def __init__(self, path: Path, wanted: dict[str, Wanted] | None, facts: FileFacts) -> None:
        self.path, self.wanted, self.facts = path, wanted, facts
        first = _Format("FMT", 89, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
        self.formats = {FMT: first}
        self.now_ns, self.has_units = 0, False

    def binary_messages(self, file: BinaryIO) -> Iterator[Arrived]:
        while head := file.read(HEAD_BYTES):
            at = self.facts.at_byte = file.tell() - len(head)
            if head[:2] != DATAFLASH_MAGIC:
                self._require_padding(head, file, at)
                return
            form = self.formats.get(head[2]) if len(head) == HEAD_BYTES else None
            if form is None and len(head) == HEAD_BYTES:
                message = f"the message at byte {at:,} is of kind {head[2]}, which no `FMT` says"
                raise damaged_log_error(self.path, message)
            body = b"" if form is None else file.read(form.length - HEAD_BYTES)
            if form is None or len(body) < form.length - HEAD_BYTES:
                message = f"its last message, at byte {at:,}, has no end: {NO_END}"
                raise damaged_log_error(self.path, message)
            if self._is_skipped(form):
                continue
            try:
                raw = form.layout.unpack(body)
                yield from self._take_message(form, raw, form.binary_content, f"at byte {at:,}")
            except (struct.error, ValueError) as error:
                message = (
                    f"the `{form.name}` at byte {at:,} is as long as its `FMT` says, which is not"
                )
                raise damaged_log_error(self.path, f"{message} what its fields need") from error

    def _require_padding(self, head: bytes, file: BinaryIO, at: int) -> None:
        """Raises D016 if the bytes after the last message are not those of erased flash memory."""
        fill, count = head[:1], len(head)
        while fill in PADDING and head == fill * len(head):
            head = file.read(1 << 16)
            count += len(head)
            if not head:
                file.seek(at - 1)
                torn = ", and its last message may be torn" if file.read(1) == fill else ""
                note = f"{count:,} bytes of `{fill.hex()}` stand behind its end{torn}"
                self.facts.notes.append(note)
                return
        raise damaged_log_error(self.path, f"at byte {at:,} stands no message")

    def text_messages(self, file: BinaryIO) -> Iterator[Arrived]:
        by_name = {form.name: form for form in self.formats.values()}
        begun = False
        for number, raw in enumerate(iter(partial(file.readline, LINE_MAX + 1), b""), 1):
            self.facts.at_byte = file.tell() - len(raw)
            where = f"line {number}"
            if len(raw) > LINE_MAX or b"\0" in raw:
                raise damaged_log_error(self.path, f"{where} is longer than any is, or no text")
            if not raw.endswith(b"\n"):
                raise damaged_log_error(self.path, f"its last line, {where}, has no end: {NO_END}")
            line = _decoded_text(raw).strip()
            name, _, rest = line.partition(",")
            form = by_name.get(name.rstrip())
            if form is None and begun and line and self.wanted is not None:
                raise damaged_log_error(self.path, f"{where} is of no kind that a `FMT` says")
            if form is None or self._is_skipped(form):
                continue
            try:
                values = form.typed_cells(form.cells_of_line(rest))
            except (ValueError, struct.error):  # the latter of a number that is too large
                values = []
            if not values or self._has_line_inside(values[-1], by_name):
                text = f"{where} is no `{name}`: {line[:60]}"
                raise damaged_log_error(self.path, text)
            yield from self._take_message(form, values, form.text_content, f"in {where}")
            if name == "FMT":
                begun, fmt = True, self.formats[values[0]]
                if by_name.setdefault(fmt.name, fmt).columns != fmt.columns:
                    text = f"the `FMT` in {where} says of `{fmt.name}` what one before it does not"
                    raise damaged_log_error(self.path, text)

    def _has_line_inside(self, cell: Any, by_name: Mapping[str, _Format]) -> bool:  # noqa: ANN401 - as typed
        """Whether a last text of a line contains another line, whose beginning was lost."""
        for name in by_name if isinstance(cell, str) and "," in cell else ():
            _, found, rest = cell.rpartition(f"{name},")
            with suppress(ValueError, struct.error):
                if found and by_name[name].typed_cells(by_name[name].cells_of_line(rest)):
                    return True
        return False

    def _is_skipped(self, form: _Format) -> bool:
        """Whether messages of this format are skipped, in a pass that reads only formats."""
        return self.wanted is None and form.name not in ("FMT", "FMTU")

    def _take_message(
        self,
        form: _Format,
        raw: Sequence[Any],
        content: Callable[[Sequence[Any]], dict[str, Any]],
        where: str,
    ) -> Iterator[Arrived]:
        """Gives a message, unless it is unwanted and has no time."""
        if form.name == "FMT":
            self._define_format(content(raw), where)
        elif form.name == "FMTU":
            self._note_instance_field(content(raw), where)
        time_ns = form.time_ns(raw)
        self.now_ns = self.now_ns if time_ns is None else time_ns
        channel = form.channel_name(raw)
        self.facts.there[channel] = self.facts.there.get(channel, 0) + 1
        if self.wanted is not None and channel in self.wanted:
            notes = []
            if time_ns is None:
                notes.append(f"`{form.name}` says no time: that of the message before it counts")
            if self.has_units and form.instance is None:
                notes.append(f"no `FMTU` says which of its sensors a `{form.name}` is of")
            if not self.wanted[channel].unnamed:
                self.facts.notes += [text for text in notes if text not in self.facts.notes]
            yield self.now_ns, None, channel, content(raw)
        elif time_ns is not None:
            yield self.now_ns, None, channel, None

    def _define_format(self, row: dict[str, Any], where: str) -> None:
        columns = tuple(filter(None, row["Columns"].split(",")))
        if (row["Type"], row["Name"]) == (FMT, "FMT"):
            return  # `FMT` describes itself
        text = f"the `FMT` {where} says that `{row['Name']}` has the formats `{row['Format']}`"
        before = self.formats.get(row["Type"])
        try:
            form = _Format(row["Name"], row["Length"], row["Format"], columns)
        except KeyError as error:
            raise damaged_log_error(self.path, f"{text}, which are none") from error
        if len(columns) != len(form.letters) or form.length < HEAD_BYTES:
            raise damaged_log_error(self.path, f"{text}, for {len(columns)} fields")
        form.instance = None if before is None else before.instance
        if before not in (None, form) or form.name == "FMT":
            text = f"{text}, and one before it something else of its number, or name"
            raise damaged_log_error(self.path, text)
        self.formats[row["Type"]] = form

    def _note_instance_field(self, fields: dict[str, Any], where: str) -> None:
        form, units = self.formats.get(fields.get("FmtType", -1)), str(fields.get("UnitIds", ""))
        if self.wanted is not None and (form is None or len(units) != len(form.columns)):
            raise damaged_log_error(self.path, f"the `FMTU` {where} fits no kind that a `FMT` says")
        if form is not None and len(units) == len(form.columns):
            place = units.find("#")
            instance = form.columns[place] if place >= 0 else ""
            if form.instance not in (None, instance):
                raise damaged_log_error(
                    self.path, f"two `FMTU` of `{form.name}` contradict each other"
                )
            form.instance = instance
