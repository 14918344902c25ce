"""Surveys the channels of a log for the drafts of `soter new --from`.

Purpose: `survey_of_logs` reads every number of every channel in one pass, with little memory: how
often the channels speak, how old their samples get, and which numbers they have.
Non-goals: drafts made of that (`survey_drafts.py`); a judgement: what is said of rates and ages is
of this log and no promise of the robot's.
"""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import ceil, floor, inf, isfinite, log10
from statistics import median
from typing import TYPE_CHECKING, Any

from soter.mapping.message_types import EMPTY_MEMBER
from soter.monitor.log_files.csv_log import csv_column_names, csv_rows, first_line_helps, is_csv
from soter.monitor.log_files.log_columns import (
    FileFacts,
    Wanted,
    is_plain_number,
    no_time_error,
    parse_decimal,
    unusable_log_error,
)
from soter.monitor.log_files.read_columns import (
    READERS,
    NoPartError,
    NoTimeError,
    channel_messages,
    message_part,
    read_time_ns,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from decimal import Decimal
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived


ELEMENTS_MAX, LEAVES_MAX, DEPTH_MAX = 4, 200, 8
"""Longer lists, numbers of a channel beyond that count, and deeper nesting are left out."""
INT_END = 2**63
"""Whole numbers of Soter are smaller."""
INT_DIGITS, FLOAT_END = 19, 2**53
COUNTED = re.compile(r"(?i)(?<![a-z])(id|count|seq|index|mode|state|status|flag)s?$")
LATE_NS = 60 * 10**9
"""A stamp that is further from its arrival is of another clock."""
STAMP = "header.stamp"
TIME_COLUMN = re.compile(
    r"#? ?(time|timestamp|stamp|ts|t)[_ .]?[\[(]?(s|sec|ms|us|usec|ns)?[\])]?", re.IGNORECASE
)
TIME_NAMED = (
    "its first line names its columns, and that of the time `t`, `ts`, `time`, `stamp` or "
    "`timestamp`, with or without a unit: `time_ms`; call it so in a copy, for this draft: a "
    "mapping may have any name, `[time] from`"
)
TIME_UNITS = {"s": "s", "sec": "s", "ms": "ms", "us": "us", "usec": "us", "ns": "ns"}
UNITS = ((1e16, "ns", 1), (1e13, "us", 10**3), (1e10, "ms", 10**6), (-inf, "s", 10**9))
"""The unit of a time since 1970 above a number, and its ns: 2001 has ten digits in seconds."""


class _EveryChannel(dict[str, Wanted]):
    """A mapping in which every channel is wanted, with all of its parts."""

    def __contains__(self, channel: object) -> bool:
        return True

    def __missing__(self, channel: str) -> Wanted:
        return Wanted(unnamed=True)


EVERY = _EveryChannel()


@dataclass
class Numbers:
    """The least and greatest number of a field, count and kind; `place`: its bit in `masks`."""

    place: int
    low: float = inf
    high: float = -inf
    count: int = 0
    kind: str = "bool"

    def note_number(self, value: Any) -> None:  # noqa: ANN401 - a number or a truth
        """Counts one more number of the field."""
        if not isfinite(value):
            self.kind = "float"
            return
        if not isinstance(value, bool) and self.kind != "float":
            self.kind = "int" if isinstance(value, int) else "float"
        self.low, self.high, self.count = (
            min(self.low, value),
            max(self.high, value),
            self.count + 1,
        )


@dataclass
class Channel:
    """A summary of the messages of a channel.

    `late_ns`: how long after its stamp each message was logged; -1: no stamp in the log's clock.
    `masks`: an index for each set of fields (a bit a field) that had numbers in one message;
    `held`: the index of each message's set. `back`: how often time goes back; `first_back_ns`: to
    when at first. `typed`: whether the file gives types to its numbers; CSV and JSON do not.
    """

    times_ns: array[int] = field(default_factory=lambda: array("q"))
    late_ns: array[int] = field(default_factory=lambda: array("q"))
    masks: dict[int, int] = field(default_factory=dict)
    held: array[int] = field(default_factory=lambda: array("L"))
    fields: dict[str, Numbers] = field(default_factory=dict)
    left_out: set[str] = field(default_factory=set)
    back: int = 0
    first_back_ns: int = 0
    typed: bool = True

    def type_of_field(self, path: str) -> str:
        """The type of a field; an untyped int is a float unless its name or size shows an int."""
        n = self.fields[path]
        counts = self.typed or COUNTED.search(path) or max(-n.low, n.high) >= FLOAT_END
        return n.kind if counts or n.kind != "int" else "float"

    def note_message(self, now_ns: int, content: Any) -> None:  # noqa: ANN401 - what a message has
        """Counts a message."""
        if self.times_ns and now_ns < self.times_ns[-1]:
            self.first_back_ns = self.first_back_ns if self.back else now_ns
            self.back += 1
        self.times_ns.append(now_ns)
        mask = 0
        for path, value in _numbers_by_path(content, "", DEPTH_MAX):
            known = path in self.fields
            if value is None or (not known and len(self.fields) >= LEAVES_MAX):
                self.left_out |= {path} if known or len(self.left_out) < LEAVES_MAX else set()
            else:
                numbers = self.fields.setdefault(path, Numbers(len(self.fields)))
                numbers.note_number(value)
                mask |= isfinite(value) << numbers.place
        self.held.append(self.masks.setdefault(mask, len(self.masks)))
        try:
            late = now_ns - read_time_ns(message_part(content, STAMP))
        except (NoPartError, NoTimeError):
            late = -1
        self.late_ns.append(late if 0 <= late < LATE_NS else -1)

    @property
    def is_stamped(self) -> bool:
        """Whether every message has a stamp of its measurement, in the clock of the log."""
        return min(self.late_ns, default=-1) >= 0

    @property
    def kept_fields(self) -> list[str]:
        """The fields that the drafted mapping reads: those that hold only numbers."""
        return [
            p
            for p, n in self.fields.items()
            if n.count
            and p not in self.left_out
            and p != "header"
            and not p.startswith(f"{STAMP}.")
        ]

    @cached_property
    def taken_samples(self) -> list[tuple[int, int]]:
        """The arrival and age, in ns, of each sample with all numbers and a later stamp."""
        every = sum(1 << self.fields[p].place for p in self.kept_fields)
        whole = [mask & every == every for mask in self.masks]
        stamped, last, found = self.is_stamped, 0, list[tuple[int, int]]()
        for now, late, held in zip(self.times_ns, self.late_ns, self.held, strict=True):
            if whole[held] and not (stamped and now - late <= last):
                found.append((now, late if stamped else 0))
                last = now - late
        return found

    def sorted_gaps_ns(self) -> list[int]:
        """The times between one sample and the next, in ns, the shortest first."""
        return sorted(b - a for (a, _), (b, _) in pairwise(self.taken_samples) if b >= a)

    def sorted_ages_ns(self) -> list[int]:
        """The age of each sample when the next one came, in ns, the youngest first."""
        return sorted(b - a + late for (a, late), (b, _) in pairwise(self.taken_samples) if b >= a)

    def proposed_max_age_ns(self) -> int:
        """The drafted `max_age`: two periods or the age of 99 % of the samples; 0: no period."""
        ages, gaps = self.sorted_ages_ns(), self.sorted_gaps_ns()
        if not gaps or median(gaps) <= 0:
            return 0
        return rounded_up(max(2 * round(median(gaps)), ages[ceil(0.99 * len(ages)) - 1]))


@dataclass
class LogSurvey:
    """The findings on a log by channel; `time` is the name and unit of a CSV's time column."""

    channels: dict[str, Channel] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    time: tuple[str, str] | None = None


def survey_of_logs(paths: Sequence[Path], *, partial: bool = False) -> LogSurvey:
    """Surveys every channel of a log, or of several CSVs; raises SoterError D016, D007."""
    found = LogSurvey()
    for path in paths:
        facts = FileFacts()
        if len(paths) > 1 and not is_csv(path):
            raise unusable_log_error(
                path, "of several files that are one log each is a CSV, and this is none"
            )
        for now_ns, _, name, content in facts.readable_rows(
            path, _log_rows(path, facts, found), partial=partial
        ):
            if content is not None:
                typed = not isinstance(content, dict) or path.suffix.lower() in READERS
                found.channels.setdefault(name, Channel(typed=typed)).note_message(now_ns, content)
        found.notes += facts.notes
        if facts.damage is not None:
            found.notes.append(f"{facts.damage}; {facts.damage.told}")
    if not any(c.kept_fields for c in found.channels.values()):
        raise unusable_log_error(paths[0], "it holds no numbers")
    return found


def _log_rows(path: Path, facts: FileFacts, found: LogSurvey) -> Iterator[Arrived]:
    return _csv_rows(path, facts, found) if is_csv(path) else channel_messages(path, EVERY, facts)


def _csv_rows(path: Path, facts: FileFacts, found: LogSurvey) -> Iterator[Arrived]:
    """The rows of a CSV; its time is the first column with a name of times, in a unit that fits."""
    head = csv_column_names(path)
    called = next((m for name in head if (m := TIME_COLUMN.fullmatch(name))), None)
    if called is None:
        message = f"no column is called as a time is: {', '.join(head)[:200]}"
        raise unusable_log_error(path, message, *first_line_helps(head), TIME_NAMED)
    time, unit_ns = called[0], 0
    for line, (clock,), row in csv_rows(path, head, time, facts):
        now = parse_decimal(clock)
        if now is None or now.adjusted() >= INT_DIGITS:
            raise no_time_error(path, clock, f"line {line}")
        if not unit_ns:
            unit, unit_ns = _time_unit(TIME_UNITS.get(called[2] or ""), now)
            if found.time not in (None, (time, unit)):
                raise unusable_log_error(
                    path, f"its time is `{time}` in {unit}, that of another file is not"
                )
            found.time = time, unit
        cells = {k: _number_or_text(v) for k, v in row.items() if k != time and v.strip()}
        now_ns = round(now * unit_ns)
        if abs(now_ns) >= INT_END:
            raise no_time_error(path, clock, f"line {line}")
        yield now_ns, None, path.name, cells


def _time_unit(unit: str | None, first: Decimal) -> tuple[str, int]:
    """The unit of a time and its length in ns: the named unit, or a unit that fits `first`."""
    return next((u, ns) for at, u, ns in UNITS if (u == unit if unit else abs(first) > at))


def _number_or_text(cell: str) -> float | int | str:
    """A cell as the number that a mapping would read; any other text unchanged."""
    number = parse_decimal(cell)
    if number is not None and "." not in cell and number.adjusted() < INT_DIGITS:
        return int(number) if number == number.to_integral_value() else float(cell)
    try:
        return float(cell if is_plain_number(cell) else "")
    except ValueError:
        return cell


def _numbers_by_path(content: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """The path and number of each part of a message; None for texts, long lists and the like."""
    if content is None:
        return
    if isinstance(content, (bool, int, float)):
        yield path, None if isinstance(content, int) and abs(content) >= INT_END else content
        return
    if hasattr(content, "dtype"):
        content = content.tolist() if content.size <= ELEMENTS_MAX else None
    members = _named_members(content) if depth else None
    if members is None:
        yield path, None
        return
    for name, value in members:
        yield from _numbers_by_path(value, f"{path}.{name}" if path else name, depth - 1)


def _named_members(content: Any) -> list[tuple[str, Any]] | None:  # noqa: ANN401 - the same
    if isinstance(content, dict):
        return [(str(name), value) for name, value in content.items()]
    if isinstance(content, (list, tuple)) and len(content) <= ELEMENTS_MAX:
        return [(str(i), value) for i, value in enumerate(content)]
    if hasattr(content, "__msgtype__"):
        without = "__msgtype__", EMPTY_MEMBER
        names = [n for n in type(content).__dataclass_fields__ if n not in without]
        return [(n, getattr(content, n)) for n in names]
    if hasattr(content, "DESCRIPTOR"):
        return [(f.name, value) for f, value in content.ListFields()]
    return None


def rounded_up(ns: int) -> int:
    """A time in ns, rounded up to two figures."""
    step = 10 ** max(0, floor(log10(ns)) - 1) if ns > 0 else 1
    return ceil(ns / step) * step
