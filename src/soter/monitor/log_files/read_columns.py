"""Reads of a log what a mapping asks for, whatever kind of file it is.

Purpose: `read_columns` is the one way from a path, or several CSVs that are one log, to columns.
`read_messages` takes from each message of a channel that counts (of an MCAP, a bag of ROS, a log of
PX4, ArduPilot or MAVLink) the parts that a mapping names, in the order of the file; it tells where
times go back. `message_part`: what stands at `pose.position.x` or `ranges.3` of a message in JSON,
ROS or protobuf, as a plain number, truth or text; `read_time_ns`: a time in ns.
Non-goals: the files (`csv_log.py`, `READERS`), decoding (`message_decoding.py`, the package
`mcap-protobuf-support`).
"""

from __future__ import annotations

import re
from contextlib import suppress
from fnmatch import fnmatchcase
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.similar_names import nearest_or_all
from soter.mapping.topic_mapping import LOG_TIME, PUBLISH_TIME, NearestSource
from soter.monitor.log_files.csv_log import is_csv, read_csv
from soter.monitor.log_files.dataflash_log import dataflash_messages
from soter.monitor.log_files.log_columns import (
    FileFacts,
    RowChoice,
    add_row,
    parsed_time_ns,
    seconds_text,
    unusable_log_error,
    wanted_columns,
)
from soter.monitor.log_files.mavlink_log import mavlink_messages
from soter.monitor.log_files.message_decoding import mcap_messages
from soter.monitor.log_files.ros_bags import bag_messages, is_bag, require_no_split
from soter.monitor.log_files.ulog_log import ulog_messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.mapping.message_types import StampSource
    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.log_files.log_columns import Arrived, Columns, Wanted


SECONDS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
"""What the members of a time are called: in ROS 2, in ROS 1 (C++, Python) and in protobuf."""


class NoPartError(Exception):
    """A message has no part with this name; `beyond`: a list on the path is too short."""

    def __init__(self, part: str, known: Iterable[str], *, beyond: bool = False) -> None:
        super().__init__(part)
        self.part, self.known, self.beyond = part, tuple(known), beyond


class NoTimeError(Exception):
    """A value of a message is no time."""


def message_part(message: Any, name: str) -> Any:  # noqa: ANN401 - what a message has
    """The part of a message at a path; None if protobuf has not set it. Raises NoPartError."""
    current, is_set = message, True
    for part in name.split("."):
        is_set = is_set and _has_value(current, part)
        try:
            current = _member_value(current, part)
        except NoPartError as error:
            if error.beyond and not is_set:
                return None
            raise
    if not is_set:
        return None
    return current.tolist() if hasattr(current, "dtype") else current  # of numpy, also one number


def read_time_ns(stamp: Any) -> int:  # noqa: ANN401 - the same
    """Gives a time in ns from its seconds and nanoseconds; raises NoTimeError if it is none."""
    for names in SECONDS:
        try:
            seconds, rest = (message_part(stamp, n) for n in names)
        except NoPartError:
            continue
        are_ints = type(seconds) is int and type(rest) is int
        if are_ints and 0 <= rest < SECOND_NS and abs(seconds) < SECONDS_MAX:
            return int(seconds * SECOND_NS + rest)
    raise NoTimeError


def _member_value(current: Any, part: str) -> Any:  # noqa: ANN401 - the same
    if isinstance(current, dict):
        if part not in current:
            raise NoPartError(part, current)
        return current[part]
    if hasattr(current, "__msgtype__"):
        return _attribute_value(current, part, list(type(current).__dataclass_fields__))
    if hasattr(current, "DESCRIPTOR"):
        return _protobuf_value(current, part)
    if isinstance(current, (str, bytes)) or not hasattr(current, "__len__"):
        raise NoPartError(part, ())
    if not (part.isascii() and part.isdigit() and len(part) < 10):
        raise NoPartError(part, ())
    if int(part) >= len(current):
        raise NoPartError(part, (), beyond=True)
    return current[int(part)]


def _attribute_value(current: Any, part: str, known: list[str]) -> Any:  # noqa: ANN401 - the same
    name = f"{part}_" if iskeyword(part) else part
    if name not in known:
        raise NoPartError(part, known)
    return getattr(current, name)


def _has_value(current: Any, part: str) -> bool:  # noqa: ANN401 - the same
    """Whether a field has a value; protobuf would give its default for an unset one."""
    fields = current.DESCRIPTOR.fields_by_name if hasattr(current, "DESCRIPTOR") else {}
    return part not in fields or not fields[part].has_presence or current.HasField(part)


def _protobuf_value(current: Any, part: str) -> Any:  # noqa: ANN401 - the same
    """The value of a field of a protobuf message; of an enum the name of its member."""
    fields = current.DESCRIPTOR.fields_by_name
    if part not in fields:
        raise NoPartError(part, fields)
    value = getattr(current, part)
    enum = fields[part].enum_type
    if enum is not None and isinstance(value, int):
        member = enum.values_by_number.get(value)
        return value if member is None else member.name
    return value


SECOND_NS, SECONDS_MAX = 10**9, 10**12
HOUR_NS = 3600 * SECOND_NS
OF_ALL = (
    "`[time] from` is asked of the messages of every channel that is mapped; without it their log "
    "time counts"
)
CLOCK_SET = (
    'was the clock of the recorder set? `[time] from = "header.stamp"` takes the time of the '
    "messages; `since` and `until` choose what was recorded before or after"
)
UNSORTED = (
    "if only the file is out of order: `mcap sort`, `ros2 bag convert` or `rosbag filter` write it "
    "in order"
)


def read_messages(
    path: Path, mapping: LogMap, wanted: dict[str | None, Wanted], *, partial: bool = False
) -> dict[str | None, Columns]:
    """Reads each wanted channel; `partial`: reads a damaged file up to the damage. Raises D016."""
    by_channel = _wanted_channels(path, mapping, wanted)
    columns_by_channel: dict[str | None, Columns] = {
        k: w.empty_columns() for k, w in wanted.items()
    }
    facts, order = FileFacts(), _TimeOrder()
    choices = {k: RowChoice(mapping.where) for k in by_channel}
    counted: list[tuple[int, int]] = []
    others: list[tuple[int, str]] = []
    orders: dict[str, list[str]] = {}
    for arrived in facts.readable_rows(
        path, channel_messages(path, by_channel, facts), partial=partial
    ):
        log_ns, _, channel, message = arrived
        if channel not in by_channel:
            if mapping.covers(log_ns):
                others.append((log_ns, channel))
            continue
        where = f"message {facts.there[channel]} of `{channel}`"
        if not mapping.covers(log_ns) or not choices[channel].chooses(
            lambda name: _field_of_message(path, message, name, where)  # noqa: B023 - called before the next
        ):
            continue
        now = _message_time_ns(path, mapping, arrived, where)
        asked, into = by_channel[channel], columns_by_channel[channel]
        cells = {
            n: _field_of_message(path, message, n, where, n in asked.optional) for n in asked.names
        }
        stamps = {source: _stamp_ns(path, message, source, where) for source in asked.stamps}
        helps = (CLOCK_SET, UNSORTED)
        add_row(path, into, now, cells, stamps, where=where, remedies=helps)
        _note_order(message, asked, channel, orders)
        order.note_time(now, where)
        counted.append((log_ns, now))
    for name, choice in choices.items():
        if not columns_by_channel[name].times_ns:
            hints = (
                choice.seen_values if name in facts.there else [nearest_or_all(name, facts.there)]
            )
            raise unusable_log_error(path, f"no message that counts stands on `{name}`", *hints)
    ends, beyond_ns, notes = _ends_and_notes(mapping, counted, others)
    for columns in columns_by_channel.values():
        columns.ends_ns, columns.beyond_ns = ends, beyond_ns
        columns.unchecked, columns.damage = facts.unchecked, facts.damage
        columns.notes += [*facts.notes, *order.notes, *notes]
        columns.notes += [TWO_ORDERS.format(k, *seen) for k, seen in orders.items() if seen[1:]]
    return columns_by_channel


ELEMENT = re.compile(r"((?:.+\.)?)(?:position|velocity|effort)\.\d+")
TWO_ORDERS = "{} has two orders, {} and {}, and joints are taken by number: `where` chooses one"


def _note_order(message: Any, asked: Wanted, channel: str, orders: dict[str, list[str]]) -> None:  # noqa: ANN401 - what a message has
    """Notes the first two orders of joint names, unless the mapping chooses one."""
    for path in {f"{m[1]}name" for name in asked.names if (m := ELEMENT.fullmatch(name))}:
        with suppress(NoPartError, TypeError):
            seen = orders.setdefault(f"`{path}` of `{channel}`", [])
            names = ", ".join(map(str, message_part(message, path)))[:200]
            if names not in seen and len(seen) < 2 and f"{path}.0" not in asked.names:
                seen.append(names)


def _ends_and_notes(
    mapping: LogMap, counted: list[tuple[int, int]], others: list[tuple[int, str]]
) -> tuple[tuple[int, int], int, list[str]]:
    """The begin and end of the log, the ns that other channels go on after it, notes on these."""
    near, notes = _near_times(counted, others)
    file_ends = _begin_and_end(counted, near)
    ends = _begin_and_end(counted, []) if mapping.where else file_ends
    beyond_ns = file_ends[1] - ends[1]
    if beyond_ns > 0:
        text = f"other channels go on for {seconds_text(beyond_ns)} s"
        notes.append(f"{text}; of a choice by `where` the log ends with the last row that counts")
    return ends, beyond_ns, notes


def _wanted_channels(
    path: Path, mapping: LogMap, wanted: dict[str | None, Wanted]
) -> dict[str, Wanted]:
    """The wanted columns by channel; SoterError D016 where a mapped topic names no channel."""
    for t in mapping.topics:
        if None in wanted and t.names and t.channel is None:
            raise unusable_log_error(path, f"the mapping of `{t.topic.name}` names no `channel`")
    return {str(k): w for k, w in wanted.items()}


class _TimeOrder:
    """Notes where times go back from one channel to another, in the order of the file."""

    def __init__(self) -> None:
        self.latest_ns: int | None = None
        self.times, self.most_ns, self.place = 0, 0, ""

    def note_time(self, now: int, where: str) -> None:
        """Takes note of the time of a message that counts."""
        back = 0 if self.latest_ns is None else self.latest_ns - now
        self.latest_ns = now if back <= 0 else self.latest_ns
        self.times += back > 0
        if back > self.most_ns:
            self.most_ns, self.place = back, where

    @property
    def notes(self) -> list[str]:
        """A note for people that time goes back, if it does."""
        if not self.times:
            return []
        most = f"by at most {seconds_text(self.most_ns)} s, at {self.place}"
        return [
            f"in the order of the file time goes back {self.times:,} times between channels, {most}"
        ]


def _near_times(
    counted: list[tuple[int, int]], others: list[tuple[int, str]]
) -> tuple[list[int], list[str]]:
    """The log times of other channels in the log's clock, and notes on channels of other clocks.

    A channel has another clock if its times are further from the log than the log's length and than
    an hour. A sensor that fell silent does not end the log.
    """
    first, last = min(counted)[0], max(counted)[0]
    near: list[int] = []
    far: dict[str, list[int]] = {}
    early = sorted((o for o in others if o[0] < first), reverse=True)
    for ns, channel in [*sorted(o for o in others if o[0] >= first), *early]:
        apart = max(first - ns, ns - last)
        if apart > max(last - first, HOUR_NS):
            far.setdefault(channel, []).append(max(first - ns, last - ns, key=abs))
            continue
        first, last = min(first, ns), max(last, ns)
        near.append(ns)
    notes = []
    for channel, by in far.items():
        side = "before" if by[-1] > 0 else "after"
        text = f"{len(by):,} messages of `{channel}`, up to {max(map(abs, by)) / 1e9:,.0f} s {side}"
        notes.append(f"{text} the rest, have another clock and do not count as its end")
    return near, notes


def _begin_and_end(counted: list[tuple[int, int]], others: list[int]) -> tuple[int, int]:
    """The begin and end of the log, in the clock of the messages that count.

    counted: log time and time of each message; others: log times on other channels. The clock of a
    time in `others` is taken to be as far off as that of the next message that counts.
    """
    times = [now for _, now in counted]
    (first, begin), (last, end) = min(counted), max(counted)
    times += [ns - first + begin for ns in others if ns < first]
    times += [ns - last + end for ns in others if ns > last]
    return min(times), max(times)


READERS = {
    ".ulg": ulog_messages,
    ".ulog": ulog_messages,
    ".bin": dataflash_messages,
    ".log": dataflash_messages,
    ".tlog": mavlink_messages,
    ".rlog": mavlink_messages,
}
"""The function that reads a file's messages, by the file's suffix; others are bags or MCAPs."""


def channel_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives every message of the wanted channels; `facts` counts the messages of all channels."""
    if is_bag(path):
        return bag_messages(path, wanted, facts)
    require_no_split(path)
    return READERS.get(path.suffix.lower(), mcap_messages)(path, wanted, facts)


def _message_time_ns(path: Path, mapping: LogMap, arrived: Arrived, where: str) -> int:
    """The time of a message for the mapping: its log time, or the time that the mapping names."""
    log_ns, publish_ns, _, message = arrived
    name = mapping.time
    if name in (None, LOG_TIME):
        return log_ns
    if name == PUBLISH_TIME:
        if publish_ns is None:
            raise unusable_log_error(
                path, f"`time` is `{name}`, which a bag has not: an MCAP has", OF_ALL
            )
        return publish_ns
    stamp = _field_of_message(path, message, str(name), where, False, OF_ALL)
    if isinstance(stamp, (int, float, str)):
        return parsed_time_ns(path, stamp, mapping.time_ns, where)
    try:
        now = read_time_ns(stamp)
    except NoTimeError as error:
        raise unusable_log_error(path, f"`{name}` in {where} is no time", OF_ALL) from error
    if mapping.time_ns != SECOND_NS:
        raise unusable_log_error(path, f"`{name}` in {where} is a time by itself: it has no `unit`")
    return now


def _field_of_message(
    path: Path,
    message: Any,  # noqa: ANN401 - what a message has
    name: str,
    where: str,
    optional: bool = False,
    *helps: str,
) -> Any:  # noqa: ANN401 - the same
    """A field of a message, such as `position.x` or `q.0`; None if a list is too short for it."""
    try:
        return message_part(message, name)
    except NoPartError as error:
        if optional and error.beyond:
            return None
        help_ = nearest_or_all(error.part, error.known)
        raise unusable_log_error(path, f"{where} has no `{name}`", help_, *helps) from error


def _stamp_ns(path: Path, message: Any, source: StampSource, where: str) -> int | None:  # noqa: ANN401 - the same
    stamp = _field_of_message(path, message, source.path, where)
    if stamp is None:
        return None
    if source.kind == "number":
        return parsed_time_ns(path, stamp, source.unit_ns, where)
    try:
        return read_time_ns(stamp)
    except NoTimeError as error:
        shown = f"`{source.path}` in {where}"
        help_ = f'of a number the mapping says the unit: {{ from = "{source.path}", unit = "us" }}'
        raise unusable_log_error(
            path, f"{shown} is no time of seconds and nanoseconds", help_
        ) from error


CLOCKS = "several CSVs are one log where their times are of one clock: `[time]` of the mapping"


def read_columns(
    log: Path | Sequence[Path], mapping: LogMap, *, partial: bool = False
) -> dict[str | None, Columns]:
    """The columns of each channel of a mapping; a single CSV is channel None. Raises D016, D007.

    Of several CSVs, each is a channel, under its name in the mapping. `partial`: a damaged file is
    read up to the damage.
    """
    paths = [log] if isinstance(log, Path) else [*log]
    path = paths[0]
    for t in mapping.topics:
        for leaf_path, leaf in t.leaves.items():
            if isinstance(leaf, NearestSource):
                why = "is what is nearest in a scan, which a robot can take and a log cannot give"
                raise unusable_log_error(path, f"`{t.leaf_name(leaf_path)}` {why}")
    table = len(paths) == 1 and is_csv(path)
    wanted = wanted_columns(path, mapping, table=table)
    if table:
        columns: dict[str | None, Columns] = {
            None: read_csv(path, mapping, wanted[None], partial=partial)
        }
    elif len(paths) > 1:
        columns = _columns_of_files(paths, mapping, wanted, partial=partial)
    else:
        columns = read_messages(path, mapping, wanted, partial=partial)
    times = [t for c in columns.values() for t in (c.times_ns[0], c.times_ns[-1])]
    if min(times) == max(times) and any(c.equal for c in columns.values()):
        message = f"time stands still: all that counts is of {seconds_text(times[0])} s"
        raise unusable_log_error(
            path, message, "`[time] from` names another time: docs/mapping.md, Logs"
        )
    return columns


def _columns_of_files(
    paths: Sequence[Path], mapping: LogMap, wanted: dict[str | None, Wanted], *, partial: bool
) -> dict[str | None, Columns]:
    other = next((p for p in paths if not is_csv(p)), None)
    if other is not None:
        raise unusable_log_error(
            other, "of several files that are one log each is a CSV, and this is none"
        )
    columns: dict[str | None, Columns] = {}
    for channel, asked in wanted.items():
        meant = [p for p in paths if fnmatchcase(p.name, channel or "")]
        if len(meant) != 1:
            names = ", ".join(f"`{p.name}`" for p in paths)
            text = f"a topic has the `channel` {channel}" if channel else "a topic has no `channel`"
            help_ = "the `channel` of a topic is the name of one of them; `*` stands for any text; "
            help_ += "several CSVs are one log: of several runs give one at a time"
            raise unusable_log_error(
                paths[0], f"{text}, and {len(meant)} of {names} are called so", help_
            )
        columns[channel] = read_csv(meant[0], mapping, asked, partial=partial)
    begins, ends = zip(*(c.log_ns for c in columns.values()), strict=True)
    if max(begins) > min(ends):
        late = max(columns, key=lambda k: columns[k].log_ns[0])
        text = f"`{late}` begins at {seconds_text(max(begins))} s, when another one has ended"
        raise unusable_log_error(paths[0], f"{text}, at {seconds_text(min(ends))} s", CLOCKS)
    return columns
