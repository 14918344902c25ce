"""Reads a mapping, in TOML or JSON, into records that are checked against a system.

Purpose: `read_mapping` reads the file, `make_log_map` its content; one D015 has all mistakes.
Non-goals: the tables of topics (`topic_mapping_parser.py`), messages and logs.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import parse_json, read_bytes, read_json_text
from soter.mapping.frames import WORLD
from soter.mapping.mapping_errors import (
    MappingProblems,
    is_number,
    unknown_name_message,
    wrong_mapping_error,
)
from soter.mapping.mavlink_dialects import MavlinkMessage, is_mavlink, read_link
from soter.mapping.message_types import MessageTypes, UnknownMessageError
from soter.mapping.topic_mapping import LogMap
from soter.mapping.topic_mapping_parser import TopicReader
from soter.mapping.units import TIME_UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import System
    from soter.mapping.mavlink_dialects import MavlinkLink
    from soter.mapping.message_types import KnownTypes, MessageType
    from soter.mapping.topic_mapping import TopicMap

TIME_MIN, TIME_MAX = 1e-12, 1e12
SECONDS_MAX, DIGITS_MAX = 10**12, 40
DEFINITION_MAX = 1 << 20
"""Bytes of a `.msg` file."""
KEYS = ("system", "frame", "time", "where", "messages", "mavlink", "topics")
TIME_KEYS = ("from", "unit", "scale", "since", "until")


def parse_toml(text: str) -> dict[str, Any]:
    """Gives the content of a text in TOML, which Python 3.10 cannot read by itself."""
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    read: dict[str, Any] = toml.loads(text)
    return read


def read_mapping(path: Path) -> dict[str, Any]:
    """Gives the table in a file of TOML or JSON; raises SoterError D015 if there is none."""
    try:
        text = read_json_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = reason(error) if isinstance(error, OSError) else "it is not UTF-8"
        raise wrong_mapping_error([f"the mapping `{path}` cannot be read: {why}"]) from error
    try:
        table = parse_toml(text) if path.suffix == ".toml" else parse_json(text)
    except (ValueError, RecursionError) as error:
        kind = "TOML" if path.suffix == ".toml" else "JSON"
        why = f"the mapping `{path}` is no {kind}: {str(error)[:200]}"
        raise wrong_mapping_error([why]) from error
    if not isinstance(table, dict):
        raise wrong_mapping_error([f"the mapping `{path}` is no table"])
    return table


def system_name(table: Mapping[str, Any]) -> str | None:
    """Gives the system that a mapping names; None if it names no system."""
    name = table.get("system")
    return name if isinstance(name, str) else None


def make_log_map(
    table: Mapping[str, Any],
    system: System,
    where: Mapping[str, str] | None = None,
    file: Path | None = None,
) -> LogMap:
    """Gives the checked records of a mapping for a system, with the conditions `where` added.

    `file` is the mapping's file, from whose folder it finds its `messages`. Raises SoterError D015
    for mistakes, D007 if it names ROS types and the package that knows them is missing.
    """
    reading = _MappingReader(system, Path() if file is None else file.parent)
    log_map = reading.read_log_map(table)
    if reading.problems.mistakes:
        raise wrong_mapping_error(reading.problems.mistakes, file)
    return replace(log_map, where={**log_map.where, **(where or {})})


def _type_names(topics: Mapping[str, Any]) -> list[object]:
    tables = [t for t in topics.values() if isinstance(t, dict)]
    for t in [*tables]:
        sources = t.get("sources")
        tables += [s for s in sources if isinstance(s, dict)] if isinstance(sources, list) else []
    return [t["type"] for t in tables if "type" in t]


def _with_link_delay(topic_map: TopicMap, link: MavlinkLink | None) -> TopicMap:
    """Gives a topic with the link's delay if its messages are of MAVLink and have no stamp."""
    if (
        link is None
        or topic_map.stamp is not None
        or not isinstance(topic_map.message, MavlinkMessage)
    ):
        return topic_map
    return replace(topic_map, delay_ns=link.delay_ns or 0)


class _TypesByFamily:
    """Finds message types of ROS and MAVLink by name; a family that is not used is None."""

    def __init__(self, ros: MessageTypes | None, link: MavlinkLink | None) -> None:
        self.ros, self.link = ros, link

    def type_named(self, name: str) -> MessageType:
        """Gives the type with this name; raises UnknownMessageError if it is unknown."""
        if self.link is not None and is_mavlink(name):
            return self.link.dialect.message_named(name)
        if self.ros is None:
            raise UnknownMessageError("a type is written as `nav_msgs/Odometry`")
        return self.ros.type_named(name)


class _MappingReader:
    """Reads a mapping; it goes on after a mistake, so that one error can report all of them."""

    def __init__(self, system: System, folder: Path) -> None:
        self.known = {t.name: t for t in system.topics if t.queue_of is None and not t.held}
        self.unused = set(system.program.topics) - set(self.known)
        """Topics of the program that the system lacks: the reader skips their tables."""
        self.delays_ns = {system.topics[e.topic].name: e.delay_ns or 0 for e in system.externals}
        self.folder = folder
        self.problems = MappingProblems()

    def read_log_map(self, table: Mapping[str, Any]) -> LogMap:
        problems = self.problems
        problems.note_unknown_keys(table, KEYS, "the mapping")
        if not isinstance(table.get("system", ""), str):
            problems.add("`system` is no name")
        frame = table.get("frame", "ENU")
        if frame not in WORLD:
            problems.add(f"`frame` of the mapping is {' or '.join(WORLD)}, not {frame!r}")
            frame = "ENU"
        time_table = problems.table(table, "time", "the mapping")
        time_name, unit = self._time_scale(time_table)
        since, until = (self._read_seconds(time_table, key) for key in ("since", "until"))
        if since is not None and until is not None and since > until:
            problems.add("`since` of `time` lies after `until`")
        where = problems.text_table(table, "where", "the mapping")
        topics = problems.table(table, "topics", "the mapping")
        if not set(topics) - self.unused and not problems.mistakes:
            problems.add("the mapping names no topics: `[topics.NAME]`")
        link = self._read_link(table, topics)
        types = self._message_types(problems.table(table, "messages", "the mapping"), topics, link)
        maps = [self._read_topic(name, row, frame, types) for name, row in topics.items()]
        mapped = tuple(
            _with_link_delay(topic_map, link) for sources in maps for topic_map in sources
        )
        return LogMap(mapped, time_name, unit, where, link, since, until)

    def _read_topic(
        self, name: str, row: object, frame: str, types: KnownTypes | None
    ) -> tuple[TopicMap, ...]:
        topic = self.known.get(name)
        if topic is None and name in self.unused:
            return ()
        if topic is None:
            self.problems.add(unknown_name_message("the system has no topic", name, self.known))
            return ()
        if not isinstance(row, dict):
            self.problems.add(f"`{name}` is no table")
            return ()
        delay_ns = self.delays_ns.get(name, 0)
        reader = TopicReader(topic, self.problems, types, frame=frame, delay_ns=delay_ns)
        return reader.read_maps(row)

    def _read_link(
        self, table_: Mapping[str, Any], topics: Mapping[str, Any]
    ) -> MavlinkLink | None:
        """Reads the table `mavlink`; None if it is missing and no topic has a MAVLink type."""
        table = self.problems.table(table_, "mavlink", "the mapping")
        if not table and not any(is_mavlink(name) for name in _type_names(topics)):
            return None
        return read_link(table, self.folder, self.problems)

    def _message_types(
        self, messages: Mapping[str, Any], topics: Mapping[str, Any], link: MavlinkLink | None
    ) -> KnownTypes | None:
        """Gives the message types that topics may name; None if the mapping names none."""
        names = _type_names(topics)
        needs_ros = bool(messages) or any(not is_mavlink(name) for name in names)
        if not needs_ros:
            return _TypesByFamily(None, link) if names else None
        texts = {name: self._definition_text(name, path) for name, path in messages.items()}
        types = MessageTypes()
        for name, text in texts.items():
            if text is not None:
                try:
                    types.add(name, text)
                except UnknownMessageError as error:
                    self.problems.add(str(error))
        return _TypesByFamily(types, link)

    def _definition_text(self, name: str, path: object) -> str | None:
        if not isinstance(path, str) or not path:
            self.problems.add(f"`{name}` of `messages` is no name of a file: {path!r}")
            return None
        try:
            return read_bytes(self.folder / path, DEFINITION_MAX).decode("utf-8")
        except (OSError, ValueError) as error:
            why = reason(error) if isinstance(error, OSError) else "it is not UTF-8"
            self.problems.add(f"the file `{path}` of `{name}` cannot be read: {why}")
            return None

    def _time_scale(self, row: Mapping[str, Any]) -> tuple[str | None, Fraction]:
        self.problems.note_unknown_keys(row, TIME_KEYS, "`time`")
        unit, scale = row.get("unit", "s"), row.get("scale", 1)
        if not isinstance(unit, str) or unit not in TIME_UNITS:
            self.problems.add(f"`time` is in `{unit}`: there are {', '.join(TIME_UNITS)}")
            unit = "s"
        if not is_number(scale) or not TIME_MIN <= scale <= TIME_MAX:
            shown = str(scale)[:40]
            self.problems.add(f"`scale` of `time` is no number from 1e-12 to 1e12: {shown}")
            scale = 1
        return self.problems.text(row, "from", "`time`"), Fraction(repr(scale)) * TIME_UNITS[unit]

    def _read_seconds(self, row: Mapping[str, Any], key: str) -> int | None:
        """Gives the time under a key in ns, from a number or a text in s; None without the key."""
        if key not in row:
            return None
        try:
            seconds = Decimal(str(row[key]))
            far = not seconds.is_finite() or abs(seconds.adjusted()) > DIGITS_MAX
            if isinstance(row[key], bool) or far or abs(seconds) >= SECONDS_MAX:
                raise InvalidOperation  # noqa: TRY301 - NaN, too, is none
        except InvalidOperation:
            shown = str(row[key])[:40]
            self.problems.add(f"`{key}` of `time` is no number of seconds: {shown}")
            return None
        return round(Fraction(seconds) * 10**9)
