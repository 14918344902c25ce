"""The columns of a log, whatever file they come from.

Purpose: times in ns and cells, row by row, of what a mapping asks for; whatever cannot be read is
D016 and says where.
Non-goals: the files (`csv_log.py`, `message_log.py`), what the cells mean (`typed_samples.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.mapping.message_types import HEADER_FRAME

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.mapping.message_types import MessageType
    from soter.mapping.stamp_source import StampSource
    from soter.mapping.topic_mapping import LogMap


Arrived = tuple[int, "int | None", str, Any]
"""Log time, time of publishing where a file has it, channel and content of a message."""
FIGURES_NS = 10**15
"""Beyond, nine figures of a time in seconds are not all that matters of it."""

REINDEX = "`ros2 bag reindex FOLDER` writes `metadata.yaml` anew"
"""What helps where a bag of ROS 2 and its metadata differ."""


@dataclass
class Columns:
    """Rows of a CSV, or messages of a channel: `cells[name][i]` belongs to `times_ns[i]`.

    A cell is a text, or what a message has; None where it is not there. `stamps_ns[source][i]`:
    when it was measured, None where it does not say. `where[i]`: for people. `ends_ns`: when the
    first and the last record of the log came, of whatever channel; None: these rows are all of it.
    `equal`: how many have the time of the one before them. `notes`: what was found of the file
    besides; `beyond_ns`: how long the file goes on behind the end of a choice; `unchecked`: whether
    nothing in it tells that a value was changed.
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

    @property
    def log_ns(self) -> tuple[int, int]:
        """When the log begins and ends."""
        return self.ends_ns or (self.times_ns[0], self.times_ns[-1])

    @property
    def remarks(self) -> list[str]:
        """What was found that is no error."""
        if not self.equal:
            return self.notes
        told = f"{self.equal:,} of {len(self.times_ns):,} have the time of the one before them"
        return [
            *self.notes,
            f"{told} and count in the order of the file; the first: {self.first_equal}",
        ]


@dataclass
class FileFacts:
    """What is known of a file once its messages were read.

    `there`: messages by channel; `unchecked`: whether some stood where no checksum covers them;
    `notes`: what was found that is no error.
    """

    there: dict[str, int] = field(default_factory=dict)
    unchecked: bool = False
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Wanted:
    """What a mapping asks of a channel.

    `optional`: of `names`, those that go through a list that may be too short. `message`: the type
    that its messages have to be of, None for any.
    """

    names: tuple[str, ...] = ()
    stamps: tuple[StampSource, ...] = ()
    optional: frozenset[str] = frozenset()
    message: MessageType | None = None

    def columns(self) -> Columns:
        """None of its rows yet."""
        return Columns(
            cells={n: [] for n in self.names}, stamps_ns={source: [] for source in self.stamps}
        )


def unusable(path: Path, why: str, *helps: str) -> SoterError:
    """D016."""
    text = f"the log `{path}` cannot be used: {why}"
    return SoterError((Diagnostic("D016", text, helps=tuple(h for h in helps if h)),))


def wanted_columns(path: Path, mapping: LogMap, *, table: bool) -> dict[str | None, Wanted]:
    """What each channel of a mapping has to hold; a table is the channel None. SoterError D016."""
    by_channel: dict[str | None, Wanted] = {}
    for t in mapping.topics:
        if not t.names:
            continue
        key = None if table else t.channel
        before = by_channel.get(key, Wanted())
        names = [*before.names, *t.names, *t.where, *([] if t.frame_id is None else [HEADER_FRAME])]
        if None not in (before.message, t.message) and before.message != t.message and not table:
            raise unusable(path, f"the mapping gives messages of `{key}` two types")
        by_channel[key] = Wanted(
            tuple(dict.fromkeys(names)),
            tuple(dict.fromkeys([*before.stamps, *([] if t.stamp is None else [t.stamp])])),
            before.optional | t.optional,
            before.message or t.message,
        )
    if not by_channel:
        raise unusable(path, "its mapping asks for no column of it: everything is constant")
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
    """A row, in the order of the file; D016 where time goes back.

    A recorder's clock that does not move on between two rows is none that was set back.
    """
    last = into.times_ns[-1] if into.times_ns else time_ns
    if time_ns < last:
        told = f"from {seconds_text(last)} s to {seconds_text(time_ns)} s"
        by = f"by {seconds_text(last - time_ns)} s"
        step = last - into.times_ns[-2] if len(into.times_ns) > 1 else 0
        if step:
            by += (
                f" ({seconds_text(last - time_ns + step)} s, had it come as soon as the one before)"
            )
        raise unusable(path, f"time goes back in {where}, {told}, {by}", *remedies)
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
    """A time in s; of one since 1970 every digit."""
    if abs(time_ns) < FIGURES_NS:
        return f"{time_ns / 1e9:.9g}"
    return f"{time_ns // 10**9}.{time_ns % 10**9:09d}"


def is_plain(number: str) -> bool:
    """Whether a number is written as logs write it, not as Python reads it: `0_1`, other digits."""
    return number.isascii() and "_" not in number


def decimal_of(given: object) -> Decimal | None:
    """A finite number, exactly as it is written; None for anything else."""
    text = str(given).strip()
    try:
        number = Decimal(text if is_plain(text) else "")
    except InvalidOperation:
        return None
    return None if isinstance(given, bool) or not number.is_finite() else number


def moment(path: Path, given: object, unit_ns: Fraction, where: str) -> int:
    """A time in ns, exactly as it is written; SoterError D016."""
    number = decimal_of(given)
    if number is None or abs(number.adjusted()) > 40:
        raise unusable(path, f"`{str(given)[:40]}` in {where} is no time")
    return round(Fraction(number) * unit_ns)
