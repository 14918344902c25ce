"""Holds the columns of a log, and what the readers of all kinds of files share.

Purpose: `Columns` holds times in ns and cells, row by row, of what a mapping asks for (`Wanted`).
`unusable_log_error` and `damaged_log_error` make a D016 that says where a file cannot be read.
`RowChoice` decides whether a cell is what a `where` says, however its file writes it, and keeps the
values that stood there otherwise. `remedies_for_file` gives help for a file of MATLAB, or one under
a wrong name. `FileFacts.readable_rows` gives the rows before a damage. `Writers` counts how many
values each of several nodes, or channels of one name, gave a topic: they are read as one stream.
Non-goals: the files (`csv_log.py`, `read_columns.py`), what the cells mean
(`monitor/typed_samples.py`), a choice by time (`LogMap.covers`), sources of a mapping, of which
each has a channel.
"""

from __future__ import annotations

import re
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import open_finite_file
from soter.mapping.message_types import HEADER_FRAME

Row = TypeVar("Row")

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from soter.mapping.message_types import MessageType, StampSource
    from soter.mapping.topic_mapping import LogMap


Arrived = tuple[int, "int | None", str, Any]
"""The log time, the time of publishing where a file has it, channel and content of a message."""
FIGURES_NS = 10**15
"""The longest time, in ns, whose seconds are shown with nine figures."""

READABLE = "with `--partial` what stands before it is read, which is no verdict (exit 4)"
REINDEX = "`ros2 bag reindex FOLDER` writes `metadata.yaml` anew"
"""The advice where a bag of ROS 2 and its metadata differ."""


@dataclass
class Columns:
    """Rows of a CSV, or messages of a channel: `cells[name][i]` belongs to `times_ns[i]`.

    A cell is a text or a message's value, None if missing. `stamps_ns[source][i]`: when the row was
    measured, or None. `where[i]`: the row's place in the file, in words. `ends_ns`: the times of
    the log's first and last record on any channel; None if these rows are all of the log. `equal`:
    how many rows have the time of the row before. `notes`: other findings. `beyond_ns`: for how
    long the file continues after the last chosen row. `unchecked`: some part has no checksum.
    `damage`: the damage, if only a part could be read.
    """

    times_ns: list[int] = field(default_factory=list)
    cells: dict[str, list[Any]] = field(default_factory=dict)
    stamps_ns: dict[StampSource, list[int | None]] = field(default_factory=dict)
    where: list[str] = field(default_factory=list)
    ends_ns: tuple[int, int] | None = None
    beyond_ns: int = 0
    equal: int = 0
    first_equal: str = ""
    notes: list[str] = field(default_factory=list)
    unchecked: bool = False
    damage: Damage | None = None

    @property
    def log_ns(self) -> tuple[int, int]:
        """The times at which the log begins and ends."""
        return self.ends_ns or (self.times_ns[0], self.times_ns[-1])

    @property
    def remarks(self) -> list[str]:
        """Notes on findings that are no errors."""
        if not self.equal:
            return self.notes
        text = f"{self.equal:,} of {len(self.times_ns):,} have the time of the one before them"
        return [
            *self.notes,
            f"{text} and count in the order of the file; the first: {self.first_equal}",
        ]


@dataclass(frozen=True)
class FarStamps:
    """Stamps further from the log's clock than its length; `offset_s`: the furthest, signed."""

    samples: int
    offset_s: float
    length_s: float

    def __str__(self) -> str:
        side = "before" if self.offset_s < 0 else "after"
        return (
            f"are further from the log's clock than the log is long ({self.length_s:.3f} s): up to "
            f"{abs(self.offset_s):,.3f} s {side} it; another clock, or another unit?"
        )


@dataclass
class FileFacts:
    """The findings on a file, complete once its messages were read.

    `there`: the number of messages of each channel. `unchecked`: some messages have no checksum.
    `notes`: findings that are no errors. `at_byte` of `size`: the current place in the file.
    `damage`: the damage at which reading ended.
    """

    there: dict[str, int] = field(default_factory=dict)
    unchecked: bool = False
    notes: list[str] = field(default_factory=list)
    at_byte: int = 0
    size: int = 0
    damage: Damage | None = None

    def note_size(self, file: BinaryIO) -> int:
        """Notes the length of a file, goes back to its beginning, and gives the length."""
        self.size = file.seek(0, 2)
        file.seek(0)
        return self.size

    def readable_rows(self, path: Path, rows: Iterable[Row], *, partial: bool) -> Iterator[Row]:
        """Gives the rows; with `partial` up to the first damage, which it notes.

        Raises DamagedLogError if no row comes before the damage, or without `partial`.
        """
        any_given = False
        try:
            for row in rows:
                any_given = True
                yield row
        except DamagedLogError as error:
            if any_given and not partial:
                (problem,) = error.diagnostics
                helped = replace(problem, helps=(*problem.helps, READABLE))
                raise DamagedLogError((helped,)) from error
            if not any_given:
                raise
            share = min(0.999, self.at_byte / self.size) if self.size else None
            message = error.diagnostics[0].message.partition("cannot be used: ")[2]
            self.damage = Damage(f"`{path}`: {message}", share)


@dataclass(frozen=True)
class Damage:
    """A damage of a file in words (`told`), and the share of bytes before it (None: unknown)."""

    told: str
    share: float | None

    def __str__(self) -> str:
        before = (
            "what stands before that" if self.share is None else f"{self.share:.1%} of its bytes"
        )
        return f"no verdict: the log is damaged, and {before} could be read"


@dataclass(frozen=True)
class Wanted:
    """The parts of one channel that a mapping needs.

    `optional`: the `names` inside a list that may be too short. `message`: the type that its
    messages must have, None for any. `unnamed`: the mapping does not name this channel, so messages
    that cannot be decoded are left out, with a note.
    """

    names: tuple[str, ...] = ()
    stamps: tuple[StampSource, ...] = ()
    optional: frozenset[str] = frozenset()
    message: MessageType | None = None
    unnamed: bool = False

    def empty_columns(self) -> Columns:
        """Makes columns for the wanted names and stamps, without rows."""
        return Columns(
            cells={n: [] for n in self.names}, stamps_ns={source: [] for source in self.stamps}
        )


def unusable_log_error(path: Path, why: str, *helps: str) -> SoterError:
    """The SoterError D016 for a log that cannot be used."""
    text = f"the log `{path}` cannot be used: {why}"
    return SoterError((Diagnostic("D016", text, helps=tuple(h for h in helps if h)),))


NO_END = "the autopilot lost power while it wrote, or the file was cut"


@contextmanager
def opened_log(path: Path) -> Iterator[BinaryIO]:
    """Opens the file of a log; raises SoterError D016 if it cannot be read."""
    try:
        with open_finite_file(path) as file:
            yield file
    except OSError as error:
        raise unusable_log_error(path, reason(error)) from error


def wrong_format_error(path: Path, format_name: str) -> SoterError:
    """The SoterError D016 for a file that does not begin as its name says."""
    return unusable_log_error(path, f"it is no {format_name}", *remedies_for_file(path))


class DamagedLogError(SoterError):
    """D016 for a file that is cut or contradicts itself; its rows before the damage were read."""


def damaged_log_error(path: Path, why: str, *helps: str) -> DamagedLogError:
    """The SoterError D016 for a file that is cut, or contradicts itself."""
    return DamagedLogError(unusable_log_error(path, why, *helps))


def wanted_columns(path: Path, mapping: LogMap, *, table: bool) -> dict[str | None, Wanted]:
    """What a mapping needs of each channel; a table is the channel None. SoterError D016."""
    by_channel: dict[str | None, Wanted] = {}
    for t in mapping.topics:
        if not t.names:
            continue
        key = None if table else t.channel
        before = by_channel.get(key, Wanted())
        names = [*before.names, *t.names, *t.where, *([] if t.frame_id is None else [HEADER_FRAME])]
        if None not in (before.message, t.message) and before.message != t.message and not table:
            raise unusable_log_error(path, f"the mapping gives messages of `{key}` two types")
        by_channel[key] = Wanted(
            tuple(dict.fromkeys(names)),
            tuple(dict.fromkeys([*before.stamps, *([] if t.stamp is None else [t.stamp])])),
            before.optional | t.optional,
            before.message or t.message,
        )
    if not by_channel:
        raise unusable_log_error(
            path, "its mapping asks for no column of it: everything is constant"
        )
    return by_channel


def add_row(
    path: Path,
    into: Columns,
    time_ns: int,
    cells: Mapping[str, Any],
    stamps: Mapping[StampSource, int | None],
    *,
    where: str,
    remedies: tuple[str, ...] = (),
) -> None:
    """Adds a row in the order of the file; raises D016 if its time is before the last time."""
    last = into.times_ns[-1] if into.times_ns else time_ns
    if time_ns < last:
        between = f"from {seconds_text(last)} s to {seconds_text(time_ns)} s"
        by = f"by {seconds_text(last - time_ns)} s"
        step = last - into.times_ns[-2] if len(into.times_ns) > 1 else 0
        if step:
            by += (
                f" ({seconds_text(last - time_ns + step)} s, had it come as soon as the one before)"
            )
        raise unusable_log_error(path, f"time goes back in {where}, {between}, {by}", *remedies)
    if into.times_ns and time_ns == last:
        into.equal += 1
        into.first_equal = into.first_equal or where
    into.times_ns.append(time_ns)
    into.where.append(where)
    for name, column in into.cells.items():
        column.append(cells[name])
    for source, stamp_column in into.stamps_ns.items():
        stamp_column.append(stamps[source])


def seconds_text(time_ns: int) -> str:
    """A time in s as text; a time since 1970 has all digits."""
    if abs(time_ns) < FIGURES_NS:
        return f"{time_ns / 1e9:.9g}"
    return f"{time_ns // 10**9}.{time_ns % 10**9:09d}"


def is_plain_number(number: str) -> bool:
    """Whether a number is written as in logs; Python would also read `0_1` and other digits."""
    return number.isascii() and "_" not in number


def parse_decimal(cell: object) -> Decimal | None:
    """The finite number of a cell, exactly as it is written; None for anything else."""
    text = str(cell).strip()
    try:
        number = Decimal(text if is_plain_number(text) else "")
    except InvalidOperation:
        return None
    return None if isinstance(cell, bool) or not number.is_finite() else number


DIGITS_MAX = 40
"""The most digits of a whole number: no type has more."""


def whole_number(cell: object) -> int:
    """The whole number of a cell, written `1`, `1.0` or `1e3`; raises ValueError for others."""
    number = parse_decimal(cell)
    if number is None or number.adjusted() > DIGITS_MAX or number != number.to_integral_value():
        raise ValueError
    return int(number)


COMMAS = "numbers have a point, and cells are parted by commas"
DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")
DATES = (
    "a time is a number: of a date `(pandas.to_datetime(table[T], utc=True) - "
    'pandas.Timestamp(0, tz="UTC")).dt.total_seconds()` in Python makes seconds since 1970'
)


def no_time_error(path: Path, cell: object, where: str) -> SoterError:
    """The SoterError D016 for a value that should be a time."""
    text = str(cell).strip()
    help_ = DATES if DATE.match(text) else COMMAS if "," in text else ""
    return unusable_log_error(path, f"`{str(cell)[:40]}` in {where} is no time", help_)


def parsed_time_ns(path: Path, cell: object, unit_ns: Fraction, where: str) -> int:
    """The time of a cell in ns, exactly as it is written; raises SoterError D016."""
    number = parse_decimal(cell)
    if number is None or abs(number.adjusted()) > 40:
        raise no_time_error(path, cell, where)
    return round(Fraction(number) * unit_ns)


TRUTHS = {"true": True, "false": False}
CODE = re.compile(r"[+-]?0[0-9]")
"""The beginning of a text of digits that is a name, such as `007`, and no number."""
SHOWN = 5


class RowChoice:
    """Chooses the rows that have the demanded text in each column of `where`."""

    def __init__(self, where: Mapping[str, str]) -> None:
        self.where = where
        self._seen: dict[str, dict[str, int]] = {name: {} for name in where}

    def chooses(self, cell_of: Callable[[str], Any]) -> bool:
        """Whether a row is chosen; `cell_of` maps a column to the row's cell."""
        for name, wanted in self.where.items():
            cell = cell_of(name)
            if not _is_same_value(cell, wanted):
                seen = self._seen[name]
                shown = _cell_text(cell)
                if shown in seen or len(seen) <= SHOWN:
                    seen[shown] = seen.get(shown, 0) + 1
                return False
        return True

    def __str__(self) -> str:
        return " and ".join(f"{k} = {v}" for k, v in self.where.items())

    @property
    def seen_values(self) -> list[str]:
        """Says, for each column that excluded rows, which values the excluded rows had."""
        texts = []
        for name, seen in self._seen.items():
            values = [f"{value} ({n:,} times)" for value, n in [*seen.items()][:SHOWN]]
            more = ["others"] if len(seen) > SHOWN else []
            if seen:
                texts.append(
                    f"`{name}` is not `{self.where[name][:40]}` but {', '.join(values + more)}: "
                    "say it in `where` as it stands there"
                )
        return texts


def _is_same_value(cell: object, wanted: str) -> bool:
    """Whether a cell is the same text, truth (`true`, `True`) or number (`1`, `1.0`) as wanted."""
    text, wanted = "" if cell is None else str(cell).strip(), wanted.strip()
    if text == wanted:
        return True
    if text.lower() in TRUTHS:
        return text.lower() == wanted.lower()
    if CODE.match(text) or CODE.match(wanted):
        return False
    number = parse_decimal(text)
    return number is not None and number == parse_decimal(wanted)


def _cell_text(cell: object) -> str:
    if cell is None or cell == "":
        return "empty"
    kind = "a text" if isinstance(cell, str) else "a number"
    kind = "a truth" if isinstance(cell, bool) else kind
    text = str(cell).lower() if isinstance(cell, bool) else str(cell).strip()
    return f"`{text[:40]}`, {kind if isinstance(cell, (str, bool, int, float)) else 'no text'}"


READ = (
    "read are `.csv`, `.csv.gz`, `.mcap`, `.bag` of ROS 1, folders or `.db3` of ROS 2, `.ulg`, "
    "`.bin`, `.log` and `.tlog`, by what they are called: docs/real-logs.md"
)
IN_UTF_8 = "`iconv -f UTF-16 -t UTF-8 FILE` writes it in UTF-8, as a CSV is here"
BY_MAGIC = (
    (b"ULog\x01\x12\x35", "a ULog of PX4: its name ends in `.ulg`"),
    (b"\xa3\x95", "a DataFlash log of ArduPilot: its name ends in `.bin`"),
    (b"FMT,", "a DataFlash log of ArduPilot as text: its name ends in `.log`"),
    (b"\x89MCAP0\r\n", "an MCAP: its name ends in `.mcap`"),
    (b"#ROSBAG V2.0", "a bag of ROS 1: its name ends in `.bag`"),
    (b"SQLite format 3\0", "a database: that of a bag of ROS 2 ends in `.db3`"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd: unpack it, or give the folder of the bag it is of"),
    (b"\x1f\x8b", "packed by gzip: a CSV so packed ends in `.csv.gz`; unpack anything else"),
    (b"PAR1", "Parquet: `pandas.read_parquet(FILE).to_csv(NEW)` in Python writes a CSV"),
    (b"\x89HDF\r\n", "HDF5, as MATLAB writes it, too: its `writetable` writes a CSV"),
    (b"MATLAB 5.0", "a MAT-file: MATLAB's `writetable` writes a CSV"),
    (b"\xff\xfe", f"a text in UTF-16: {IN_UTF_8}"),
    (b"\xfe\xff", f"a text in UTF-16: {IN_UTF_8}"),
    (b"PK\x03\x04", "a ZIP, or a table of Excel: unpack it, or save the table as a CSV"),
)


def remedies_for_file(path: Path) -> tuple[str, ...]:
    """Says what kind of file it seems to be, if known, and which kinds of files can be read."""
    try:
        with open_finite_file(path, pipes=False) as file:
            head = file.read(64)
    except OSError:
        return (READ,)
    likely_format = next((text for magic, text in BY_MAGIC if head.startswith(magic)), None)
    if likely_format is None and b"," in head and head.isascii() and path.suffix.lower() != ".csv":
        likely_format = "a CSV, perhaps: its name ends in `.csv`"
    return (READ,) if likely_format is None else (f"it looks like {likely_format}", READ)


WRITERS_SHOWN = 8
"""How many writers of a channel are named at most."""


class Writers:
    """Counts the writers of each channel."""

    def __init__(self) -> None:
        self._messages: dict[str, Counter[str]] = {}
        self._last: dict[str, str] = {}
        self._changes: Counter[str] = Counter()
        self._offered: dict[str, int] = {}

    def note_message(self, channel: str, writer: str) -> None:
        """Counts a message; `writer` is its node, or another identifier of the writer."""
        self._messages.setdefault(channel, Counter())[writer] += 1
        self._changes[channel] += self._last.setdefault(channel, writer) != writer
        self._last[channel] = writer

    def note_publishers(self, channel: str, publishers: int) -> None:
        """Notes how many publishers a bag of ROS 2 lists for a channel, without their names."""
        self._offered[channel] = max(publishers, self._offered.get(channel, 0))

    @property
    def notes(self) -> list[str]:
        """Notes for people on channels with several writers."""
        texts = []
        for channel, messages in self._messages.items():
            if len(messages) < 2:
                continue
            first = [f"{name[:80]} ({n:,})" for name, n in messages.most_common(WRITERS_SHOWN)]
            more = (
                f" and {len(messages) - WRITERS_SHOWN:,} more"
                if len(messages) > WRITERS_SHOWN
                else ""
            )
            changes = self._changes[channel]
            turns = f"{changes:,} change{'s'[: changes > 1]} from one to another"
            texts.append(
                f"`{channel}` has {len(messages):,} writers, which are read as one stream: "
                f"{', '.join(first)}{more}, {turns}; a `where` of the topic chooses messages"
            )
        texts += [
            f"{n:,} publishers offered `{channel}`, which are read as one stream: the bag does not "
            "say whose each message is"
            for channel, n in self._offered.items()
            if n > 1 and len(self._messages.get(channel, ())) < 2
        ]
        return texts
