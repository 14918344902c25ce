"""Reads the columns of a CSV file, packed by gzip or not.

Purpose: `read_csv` reads rows within bounds: of a cell, a line and all that is unpacked.
`BoundedGzip` gives what Python's `gzip` would, but neither unpacks without an end nor steps over
gigabytes of zeros, byte by byte, behind its end.
Non-goals: what the cells mean (`monitor/typed_samples.py`).
"""

from __future__ import annotations

import csv
import io
import zlib
from fractions import Fraction
from typing import IO, TYPE_CHECKING, BinaryIO

from soter.diagnostics.similar_names import nearest_or_all
from soter.monitor.log_files.log_columns import (
    COMMAS,
    FileFacts,
    RowChoice,
    add_row,
    damaged_log_error,
    no_time_error,
    opened_log,
    parsed_time_ns,
    remedies_for_file,
    unusable_log_error,
)

if TYPE_CHECKING:
    from _csv import Reader
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from soter.mapping.message_types import StampSource
    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.log_files.log_columns import Columns, Wanted


GZIP = 31
"""The `wbits` by which zlib unpacks a gzip."""
PART = 1 << 16
PADDING_MAX = 1 << 20
"""Bytes of zeros that may stand behind a packed file."""
UNPACKED_MAX = 4 << 30
"""Bytes that are unpacked: a log has no more."""


class BoundedGzip(io.RawIOBase):
    """An unpacked gzip; reading raises zlib.error (no gzip, or too large), EOFError (no end)."""

    def __init__(self, packed: BinaryIO) -> None:
        self._packed = packed
        self._member = zlib.decompressobj(GZIP)
        self._left = b""
        self._packed_bytes = self._unpacked_bytes = 0

    def readable(self) -> bool:
        """Always True."""
        return True

    def readinto(self, into: memoryview) -> int:  # type: ignore[override]
        """Reads the next bytes into a buffer, and gives the number of bytes, 0 at the end."""
        found = self._next_bytes(len(into))
        into[: len(found)] = found
        return len(found)

    def _next_bytes(self, most: int) -> bytes:
        while True:
            if self._member.eof and not self._begin_next_member():
                return b""
            part = self._left or self._packed.read(PART)
            self._packed_bytes += len(part)
            found = self._member.decompress(part, most)
            self._left = self._member.unconsumed_tail
            self._unpacked_bytes += len(found)
            if self._unpacked_bytes > UNPACKED_MAX:
                raise zlib.error(f"it unpacks to more than {UNPACKED_MAX >> 30} GiB")
            if found:
                return found
            if not part and not self._member.eof:
                if not self._packed_bytes:
                    return b""
                raise EOFError("its end is missing")

    def _begin_next_member(self) -> bool:
        """Begins the next member of the gzip; False if no member follows."""
        rest = self._member.unused_data.lstrip(b"\0")
        rest = rest or self._packed.read(PADDING_MAX).lstrip(b"\0")
        if not rest and self._packed.read(1):
            raise zlib.error("much else stands behind its end")
        if rest:
            self._member, self._left = zlib.decompressobj(GZIP), rest
        return bool(rest)


SECOND_NS = 10**9
OF_ROS = [Fraction(SECOND_NS), Fraction(1)]
"""Units of the two columns of a ROS time, in ns."""
SEVERAL = "`where` chooses the rows of one flight; `time` its column and unit"
QUOTES = "is a quote not closed there? a text of several lines is not read: leave its column out"
SEPARATED = (
    "; `pandas.read_csv(FILE, sep={0!r}).to_csv(NEW, index=False)` in Python writes such a CSV, "
    'with `decimal=","` beside `sep` where numbers have a comma'
)
COMMENTED = (
    "its first line begins with `#`: if that is a comment, `grep -v '^#' FILE > NEW` takes such "
    "lines off, so that the names of its columns come first"
)
CELL_MAX = 1 << 20
"""Characters of a cell; a log has no longer ones."""
LINE_MAX = 1 << 24
"""Characters of a line."""


def is_csv(path: Path) -> bool:
    """Whether a log is a CSV, by its name."""
    return path.name.lower().endswith((".csv", ".csv.gz"))


def read_csv(path: Path, mapping: LogMap, wanted: Wanted, *, partial: bool = False) -> Columns:
    """Reads the rows that count; with `partial`, the rows before a damage. Raises SoterError D016.

    A ROS time takes two columns: `header.stamp.sec` and `header.stamp.nanosec`.
    """
    if mapping.time is None:
        help_ = 'say it in the mapping: [time] from = "t", unit = "s"'
        raise unusable_log_error(path, "nobody says which column is the time", help_)
    columns = wanted.empty_columns()
    columns.unchecked = not path.name.lower().endswith(".gz")
    of_stamps = [name for source in wanted.stamps for name in _stamp_columns(source)]
    choice = RowChoice(mapping.where)
    needed = dict.fromkeys([*mapping.where, *wanted.names, *of_stamps])
    facts = FileFacts(notes=columns.notes)
    for line, clock, row in facts.readable_rows(
        path, csv_rows(path, list(needed), mapping.time, facts), partial=partial
    ):
        if not choice.chooses(row.__getitem__):
            continue
        where = f"line {line}"
        now = _row_time_ns(path, mapping, clock, where)
        if not mapping.covers(now):
            continue
        cells = {n: row[n] for n in wanted.names}
        stamps = {source: _row_stamp_ns(path, row, source, where) for source in wanted.stamps}
        add_row(path, columns, now, cells, stamps, where=where, remedies=(SEVERAL,))
    if not columns.times_ns:
        message = f"no row has {choice}" if mapping.where else "it has no rows"
        raise unusable_log_error(path, message, *choice.seen_values)
    columns.damage = facts.damage
    return columns


def _row_time_ns(path: Path, mapping: LogMap, clock: list[str], where: str) -> int:
    """The time of a row in ns, from one number with a unit, or from seconds and nanoseconds."""
    if len(clock) == 1:
        return parsed_time_ns(path, clock[0], mapping.time_ns, where)
    if mapping.time_ns != SECOND_NS:
        raise unusable_log_error(
            path, f"`{mapping.time}` is a time of two columns: it has no `unit`"
        )
    return _ros_time_ns(path, clock, where)


def _ros_time_ns(path: Path, cells: list[str], where: str) -> int:
    """The ns of two cells, full seconds and nanoseconds (< 10^9); raises SoterError D016."""
    seconds, rest = (parsed_time_ns(path, c, u, where) for c, u in zip(cells, OF_ROS, strict=True))
    if seconds % SECOND_NS or not 0 <= rest < SECOND_NS:
        raise no_time_error(path, " s and ".join(cells) + " ns", where)
    return seconds + rest


def _stamp_columns(source: StampSource) -> list[str]:
    if source.kind == "number":
        return [source.path]
    return [f"{source.path}.sec", f"{source.path}.nanosec"]


def _row_stamp_ns(
    path: Path, row: Mapping[str, str], source: StampSource, where: str
) -> int | None:
    """The time in ns at which a row was measured; None if the cells for it are empty."""
    names = _stamp_columns(source)
    if any(not row[n].strip() for n in names):
        return None
    if source.kind == "number":
        return parsed_time_ns(path, row[names[0]], source.unit_ns, where)
    return _ros_time_ns(path, [row[n] for n in names], where)


def csv_column_names(path: Path) -> list[str]:
    """The names of a CSV's columns; raises SoterError D016 if it cannot be read."""
    try:
        with opened_log(path) as data, _opened_text(path, data) as file:
            return [h.strip() for h in next(csv.reader(_bounded_lines(file, FileFacts())), [])]
    except (UnicodeDecodeError, csv.Error, EOFError, zlib.error) as error:
        raise damaged_log_error(path, f"it is no CSV: {error}", *remedies_for_file(path)) from error


def csv_rows(
    path: Path, needed: list[str], time: str, facts: FileFacts
) -> Iterator[tuple[int, list[str], dict[str, str]]]:
    """Gives each row: line number, the cells of its time, the cells `needed`; raises D016."""
    try:
        with opened_log(path) as data, _opened_text(path, data) as file:
            facts.size = 0 if path.suffix.lower() == ".gz" else path.stat().st_size
            reader = csv.reader(_bounded_lines(file, facts), strict=True)
            rows = _checked_rows(path, reader)
            head = [h.strip() for h in next(rows, [])]
            if not head:
                raise unusable_log_error(path, "it is empty")
            places = {name: _column_number(path, head, name) for name in needed}
            two = [f"{time}.sec", f"{time}.nanosec"]
            clock_columns = two if time not in head and set(two) <= set(head) else [time]
            clock = [_column_number(path, head, name) for name in clock_columns]
            for row in rows:
                if not row:
                    continue
                if len(row) != len(head):
                    text = f"line {reader.line_num} has {len(row)} cells, the head {len(head)}"
                    raise damaged_log_error(path, text)
                cells = {name: row[at] for name, at in places.items()}
                yield reader.line_num, [row[at] for at in clock], cells
    except (UnicodeDecodeError, csv.Error, EOFError, zlib.error) as error:
        raise damaged_log_error(path, f"it is no CSV: {error}", *remedies_for_file(path)) from error


def _checked_rows(path: Path, reader: Reader) -> Iterator[list[str]]:
    """Gives each row; raises D016 if a row spans lines, since an open quote may hide other rows."""
    before = 0
    try:
        for row in reader:
            if reader.line_num > before + 1:
                text = f"the row of line {before + 1} goes on to line {reader.line_num}"
                raise damaged_log_error(path, text, QUOTES)
            before = reader.line_num
            yield row
    except csv.Error as error:
        raise csv.Error(f"the row of line {before + 1}: {error}") from error


def _opened_text(path: Path, data: BinaryIO) -> IO[str]:
    """Opens the text of a CSV file, packed by gzip or not; closing it may leave `data` open."""
    csv.field_size_limit(CELL_MAX)
    if path.name.lower().endswith(".gz"):
        unpacked = io.BufferedReader(BoundedGzip(data))
        return io.TextIOWrapper(unpacked, encoding="utf-8-sig", newline="")
    return io.TextIOWrapper(data, encoding="utf-8-sig", newline="")


def _bounded_lines(file: IO[str], facts: FileFacts) -> Iterator[str]:
    """Gives the lines of a file; raises csv.Error for one that is longer than `LINE_MAX`."""
    line = "\n"
    while next_line := file.readline(LINE_MAX + 1):
        facts.at_byte += len(line)
        line = next_line
        if len(line) > LINE_MAX:
            raise csv.Error(f"a line has more than {LINE_MAX} letters")
        yield line
    if not line.endswith(("\n", "\r")):
        facts.notes.append("its last line has no end: the file may be cut there")


def _column_number(path: Path, head: list[str], name: str) -> int:
    if head.count(name) == 1:
        return head.index(name)
    if name in head:
        raise unusable_log_error(path, f"two columns are called `{name}`")
    raise unusable_log_error(
        path, f"it has no column `{name}`", *first_line_helps(head), nearest_or_all(name, head)
    )


def first_line_helps(head: list[str]) -> list[str]:
    """The reasons why the first line may not name the columns, each with a remedy."""
    helps = []
    other = next((c for c in (";", "\t", "|") if len(head) == 1 and c in head[0]), None)
    if other is not None:
        helps.append(f"{COMMAS}, not by {other!r}{SEPARATED.format(other)}")
    if head and head[0].startswith("#"):
        helps.append(COMMENTED)
    return helps
