"""The columns of a log of messages: an MCAP, or a bag of ROS 1 or 2.

Purpose: of each message of a channel that counts, the parts that a mapping names, in the order of
their times of arrival.
Non-goals: the files (`mcap_messages.py`, `ros_bags.py`), what is in a message (`message_parts.py`).
"""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any

from soter.diagnostics.similar_names import nearest_or_all
from soter.monitor.logs.files.log_columns import add_row, moment, unusable
from soter.monitor.logs.files.mcap_messages import mcap_messages
from soter.monitor.logs.files.message_parts import NoPartError, NoTimeError, part_of, time_ns_of
from soter.monitor.logs.files.ros_bags import bag_messages, is_bag

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.mapping.stamp_source import StampSource
    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.logs.files.log_columns import Columns, Wanted

    Row = tuple[int, int, int, dict[str, Any], dict[StampSource, int | None]]


def read_messages(
    path: Path, mapping: LogMap, wanted: dict[str | None, Wanted]
) -> dict[str | None, Columns]:
    """What each channel holds; SoterError D016."""
    if None in wanted:
        lost = next(t.topic.name for t in mapping.topics if t.names and t.channel is None)
        raise unusable(path, f"the mapping of `{lost}` names no `channel`")
    by_channel: dict[str, Wanted] = {str(k): w for k, w in wanted.items()}
    rows_by_channel: dict[str, list[Row]] = {key: [] for key in by_channel}
    there: dict[str, int] = {}
    others: list[int] = []
    for log_time_ns, channel, message in _messages(path, by_channel, there):
        if channel not in by_channel:
            others = [min([log_time_ns, *others]), max([log_time_ns, *others])]
            continue
        at = there[channel]
        where = f"message {at} of `{channel}`"
        if any(str(_part(path, message, k, where)) != v for k, v in mapping.where.items()):
            continue
        now = log_time_ns
        if mapping.time is not None:
            now = moment(path, _part(path, message, mapping.time, where), mapping.time_ns, where)
        asked = by_channel[channel]
        cells = {n: _part(path, message, n, where, n in asked.optional) for n in asked.names}
        stamps = {source: _stamp(path, message, source, where) for source in asked.stamps}
        rows_by_channel[channel].append((log_time_ns, now, at, cells, stamps))
    columns_by_channel: dict[str | None, Columns] = {}
    for key, rows in rows_by_channel.items():
        if not rows:
            help_ = nearest_or_all(key, there)
            raise unusable(path, f"no message that counts stands on `{key}`", help_)
        columns_by_channel[key] = _in_order(path, key, by_channel[key], rows)
    counted = [(log_ns, now) for rows in rows_by_channel.values() for log_ns, now, *_ in rows]
    ends = _ends(counted, [] if mapping.where else others)
    for columns in columns_by_channel.values():
        columns.ends_ns = ends
    return columns_by_channel


def _ends(counted: list[tuple[int, int]], others: list[int]) -> tuple[int, int]:
    """When the log begins and ends, in the clock of the messages that count.

    counted: log time and time of each; others: log times of what stands on other channels, in
    whose clock a message that counts is as far off as the one next to the end is.
    """
    times = [now for _, now in counted]
    (first, begin), (last, end) = min(counted), max(counted)
    times += [ns - first + begin for ns in others if ns < first]
    times += [ns - last + end for ns in others if ns > last]
    return min(times), max(times)


def _messages(
    path: Path, wanted: dict[str, Wanted], there: dict[str, int]
) -> Iterator[tuple[int, str, Any]]:
    """Time of arrival, channel and content; `there` counts the messages of every channel."""
    return (bag_messages if is_bag(path) else mcap_messages)(path, wanted, there)


def _in_order(path: Path, channel: str, wanted: Wanted, rows: list[Row]) -> Columns:
    """The rows as they arrived: a file may have them in any order."""
    rows.sort(key=itemgetter(0))
    into = wanted.columns()

    def where(at: int) -> str:
        return f"message {at} of `{channel}`"

    for _, now, at, cells, stamps in rows:
        add_row(path, into, now, cells, stamps, where, at)
    return into


def _part(path: Path, message: Any, name: str, where: str, optional: bool = False) -> Any:  # noqa: ANN401 - what a message has
    """A field of a message: `position.x`, `q.0`; None where it is too far into a list."""
    try:
        return part_of(message, name)
    except NoPartError as error:
        if optional and error.beyond:
            return None
        help_ = nearest_or_all(error.part, error.known)
        raise unusable(path, f"{where} has no `{name}`", help_) from error


def _stamp(path: Path, message: Any, source: StampSource, where: str) -> int | None:  # noqa: ANN401 - the same
    given = _part(path, message, source.path, where)
    if given is None:
        return None
    if source.kind == "number":
        return moment(path, given, source.unit_ns, where)
    try:
        return time_ns_of(given)
    except NoTimeError as error:
        shown = f"`{source.path}` in {where}"
        help_ = f'of a number the mapping says the unit: {{ from = "{source.path}", unit = "us" }}'
        raise unusable(path, f"{shown} is no time of seconds and nanoseconds", help_) from error
