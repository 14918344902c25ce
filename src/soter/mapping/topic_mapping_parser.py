"""Reads the table of one topic in a mapping.

Purpose: a `TopicReader` reads the channel and the facts of its messages: their type, their time of
measurement, their sender, their constant fields. `read_qos` reads the three policies of DDS that
decide whether reader and writer connect, and how much is kept. `read_promise` reads the promise of
one source, and `problems_of_early_turns` finds sources that take over too early.
Non-goals: the leaves (`leaf_mapping_parser.py`); whether a log or a middleware has such messages;
the meaning of the policies (`targets/dds_package.py`), and the other policies of DDS.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from soter.language.model.types import FloatType, leaves, show_ns
from soter.mapping.frames import FRAMES, SAME, likely_frame, turn_between
from soter.mapping.leaf_mapping_parser import LeafReader
from soter.mapping.mapping_errors import is_number, unknown_name_message
from soter.mapping.message_types import (
    INTEGERS,
    NUMBERS,
    NoSuchFieldError,
    StampSource,
    UnknownMessageError,
)
from soter.mapping.topic_mapping import (
    GAP_NS,
    ConstantSource,
    QualityOfService,
    SignalSource,
    SlopeSource,
    SourcePromise,
    TopicMap,
)
from soter.mapping.units import TIME_UNITS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.language.model.system import Topic
    from soter.mapping.frames import Turn
    from soter.mapping.mapping_errors import MappingProblems
    from soter.mapping.message_types import KnownTypes, MessageType


KEYS = ("reliability", "durability", "depth")
RELIABILITY, DURABILITY = ("best_effort", "reliable"), ("volatile", "transient_local")
DEPTH_MAX = 1_000_000
ALL = "all"


def read_qos(row: Mapping[str, Any], problems: MappingProblems, where: str) -> QualityOfService:
    """Reads the DDS policies in a table; the result is unusable if `problems` were added."""
    problems.note_unknown_keys(row, KEYS, where)
    return QualityOfService(
        _read_policy(row, "reliability", RELIABILITY, problems, where),
        _read_policy(row, "durability", DURABILITY, problems, where),
        _read_depth(row.get("depth"), problems, where),
    )


def _read_policy(
    row: Mapping[str, Any], key: str, known: tuple[str, ...], problems: MappingProblems, where: str
) -> Any:  # noqa: ANN401 - mypy cannot see which literals
    word = row.get(key)
    if word is not None and word not in known:
        problems.add(f"`{key}` in {where} is {' or '.join(known)}, not {word!r}")
        return None
    return word


def _read_depth(depth: object, problems: MappingProblems, where: str) -> int | None:
    if depth is None:
        return None
    if depth == ALL:
        return 0
    if isinstance(depth, int) and not isinstance(depth, bool) and 1 <= depth <= DEPTH_MAX:
        return depth
    problems.add(f'`depth` in {where} is a number from 1 to {DEPTH_MAX}, or "{ALL}", not {depth!r}')
    return None


PROMISE_KEYS = ("every", "delayed", "measured", "after")
SOURCES_MAX = 8
WHOLE = "value"
"""The key of `measured` that stands for all leaves of a topic."""


def read_promise(
    table: Mapping[str, Any], rank: int, topic: Topic, problems: MappingProblems, name: str
) -> SourcePromise:
    """Reads the promise of a source from its table; unusable if `problems` were added."""
    delayed = problems.positive_ns(table, "delayed", name) if "delayed" in table else 0
    after = 0
    if rank > 0:
        after = problems.positive_ns(table, "after", name)
    elif "after" in table:
        problems.add(f"`after` of `{name}`: the first source takes over from nobody")
    errors = _errors_by_leaf(problems.table(table, "measured", f"`{name}`"), topic, problems, name)
    return SourcePromise(rank, problems.positive_ns(table, "every", name), delayed, errors, after)


def _errors_by_leaf(
    measured: Mapping[str, Any], topic: Topic, problems: MappingProblems, name: str
) -> dict[tuple[str, ...], float]:
    """Gives the error of each float leaf by path; a key for a part applies to all its leaves."""
    floats = [path for path, t in leaves(topic.type) if isinstance(t, FloatType)]
    errors: dict[tuple[str, ...], float] = {}
    for key, error in measured.items():
        parts = () if key == WHOLE else tuple(key.split("."))
        fitting = [path for path in floats if path[: len(parts)] == parts]
        if not fitting:
            known = [".".join(path) or WHOLE for path in floats]
            problems.add(
                unknown_name_message(
                    f"`measured` of `{name}`: no float of the topic is", key, known
                )
            )
        elif not is_number(error) or error < 0:
            problems.add(f"`{key}` in `measured` of `{name}` is no error, 0 or more: {error!r}")
        else:
            errors.update(dict.fromkeys(fitting, float(error)))
    return errors


def problems_of_early_turns(name: str, promises: Sequence[SourcePromise]) -> Iterator[str]:
    """Yields a problem for each source that may take over before an earlier one breaks its promise.

    While an earlier source works, the topic may be as old as that source's `age_max_ns`; a later
    source must wait for longer than that.
    """
    for promise in promises[1:]:
        patience = max(p.age_max_ns for p in promises[: promise.rank])
        if promise.after_ns < patience:
            yield (
                f"`after` of `{name}.sources.{promise.rank + 1}` is {show_ns(promise.after_ns)}: "
                f"with a source before it the topic may be {show_ns(patience)} old while it keeps "
                "its promise"
            )


TOPIC_KEYS = (
    "channel", "type", "stamp", "frame_id", "publisher", "frame", "between", "gap", "fields", "set",
    "qos", "where", "clip",
)  # fmt: skip
SOURCE_KEYS = (
    *(k for k in TOPIC_KEYS if k not in ("between", "gap", "set", "clip")), *PROMISE_KEYS,
)  # fmt: skip
STAMP_KEYS = ("from", "unit")
ARRIVAL = "arrival"
GREATEST = {"float32": 3.4028234663852886e38, "float64": sys.float_info.max}
"""The largest number of a type; a larger one would be sent as infinity."""


class TopicReader:
    """Reads the table of a topic, and notes mistakes in `problems`.

    `types` finds message types; it is None if the mapping names none. `frame` is the program's
    frame. `delay_ns` is the time from measurement to arrival that the system declares (`delayed`).
    """

    def __init__(
        self,
        topic: Topic,
        problems: MappingProblems,
        types: KnownTypes | None,
        frame: str,
        delay_ns: int,
    ) -> None:
        self.topic, self.problems, self.types, self.frame = topic, problems, types, frame
        self.name, self.delay_ns = topic.name, delay_ns

    def read_maps(self, table: Mapping[str, Any]) -> tuple[TopicMap, ...]:
        """Gives a record for each source; the records are unusable if `problems` were added."""
        if "sources" not in table:
            self.problems.note_unknown_keys(table, (*TOPIC_KEYS, "sources"), f"`{self.name}`")
            return (self._read_topic_map(table),)
        self.problems.note_unknown_keys(table, ("sources",), f"`{self.name}`, which has `sources`,")
        tables = table["sources"]
        if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
            self.problems.add(f"`sources` of `{self.name}` is no list of tables")
            return ()
        if not 2 <= len(tables) <= SOURCES_MAX:
            self.problems.add(
                f"`sources` of `{self.name}` are 2 to {SOURCES_MAX}, not {len(tables)}: one source "
                "is said at the topic itself"
            )
            return ()
        maps = tuple([self._read_source(rank, table) for rank, table in enumerate(tables)])
        self._check_sources(maps)
        return maps

    def _read_source(self, rank: int, table: Mapping[str, Any]) -> TopicMap:
        self.name = f"{self.topic.name}.sources.{rank + 1}"
        where = f"`{self.name}`"
        self.problems.note_unknown_keys(table, SOURCE_KEYS, where)
        topic_map = self._read_topic_map({k: v for k, v in table.items() if k in TOPIC_KEYS})
        if topic_map.stamp is None:
            self.problems.add(f"{where} has no stamp: sources take over by when they measured")
        if topic_map.leaves and all(
            isinstance(x, ConstantSource) for x in topic_map.leaves.values()
        ):
            self.problems.add(f"{where} is constant: it measures nothing")
        if any(isinstance(leaf, SlopeSource) for leaf in topic_map.leaves.values()):
            self.problems.add(f"{where} has a slope, which jumps where another source takes over")
        promise = read_promise(table, rank, self.topic, self.problems, self.name)
        return replace(topic_map, promise=promise)

    def _check_sources(self, maps: tuple[TopicMap, ...]) -> None:
        """Notes channels that two sources share, and sources that take over too early."""
        self.name = self.topic.name
        channels = [m.channel for m in maps if m.channel is not None]
        if len(set(channels)) != len(channels):
            self.problems.add(f"two `sources` of `{self.name}` are one channel: {channels}")
        promises = [m.promise for m in maps if m.promise is not None]
        for problem in problems_of_early_turns(self.name, promises):
            self.problems.add(problem)

    def _read_topic_map(self, table: Mapping[str, Any]) -> TopicMap:
        problems, where = self.problems, f"`{self.name}`"
        between = table.get("between", "hold")
        if between not in ("hold", "linear"):
            problems.add(f"`between` of {where} is hold or linear, not {between!r}")
        gap = problems.positive_ns(table, "gap", self.name) if "gap" in table else GAP_NS
        if not isinstance(table.get("clip", False), bool):
            problems.add(f"`clip` of {where} is true or false, not {table['clip']!r}")
        message = self._message_type(table)
        leaf_reader = LeafReader(self.topic, problems, message, self._frame_turn(table))
        leaf_by_path = leaf_reader.read_leaves(problems.table(table, "fields", where))
        stamp = self._read_stamp(table, message)
        topic_map = TopicMap(
            self.topic,
            leaf_by_path,
            problems.text(table, "channel", where),
            between == "linear",
            gap,
            message=message,
            stamp=stamp,
            delay_ns=self.delay_ns if stamp is None else 0,
            frame_id=self._read_frame_id(table, message),
            publisher=problems.text(table, "publisher", where),
            constants=self._read_constants(problems.table(table, "set", where), message),
            qos=read_qos(problems.table(table, "qos", where), problems, f"`qos` of {where}"),
            where=problems.text_table(table, "where", where),
            clip=table.get("clip") is True,
        )
        if "frame" in table and not leaf_reader.vectors:
            problems.add(
                f"`frame` of {where} turns nothing: a vector is three names, "
                'such as "p" = ["x", "y", "z"]'
            )
        texts = [t for key in ("channel", "frame_id") if isinstance(t := table.get(key), str)]
        for name, names in leaf_reader.vectors.items() if "frame" not in table else ():
            known = likely_frame(message, names, texts) if names else ""
            if turn_between(known or self.frame, self.frame) != SAME:
                problems.add(
                    f'`{name}` is in {known}, the program in {self.frame}: `frame = "{known}"` of '
                    f'{where} turns it, `frame = "{self.frame}"` takes it as it is'
                )
        filled = {leaf.name for leaf in leaf_by_path.values() if isinstance(leaf, SignalSource)}
        for path in topic_map.constants:
            if path in filled:
                problems.add(f"`set` of {where} has `{path}`, which its fields have, too")
        return topic_map

    def _message_type(self, table: Mapping[str, Any]) -> MessageType | None:
        name = self.problems.text(table, "type", f"`{self.name}`")
        if name is None or self.types is None:
            return None
        try:
            return self.types.type_named(name)
        except UnknownMessageError as error:
            self.problems.add(f"`type` of `{self.name}` is `{name}`, which is not known: {error}")
            return None

    def _frame_turn(self, table: Mapping[str, Any]) -> Turn | None:
        frame = table.get("frame")
        if frame is None:
            return None
        if not isinstance(frame, str) or frame not in FRAMES:
            self.problems.add(
                f"`frame` of `{self.name}` is {frame!r}: there are {', '.join(FRAMES)}"
            )
            return None
        return turn_between(frame, self.frame)

    def _read_frame_id(self, table: Mapping[str, Any], message: MessageType | None) -> str | None:
        frame = self.problems.text(table, "frame_id", f"`{self.name}`")
        if frame is not None and message is not None and not message.has_header:
            self.problems.add(
                f"`frame_id` of `{self.name}` needs a header, which {message.ros1} has not"
            )
        return frame

    # ---------------------------------------------------------------- when it was measured

    def _read_stamp(
        self, table: Mapping[str, Any], message: MessageType | None
    ) -> StampSource | None:
        stamp = table.get("stamp")
        if stamp is None:
            return message.default_stamp if message is not None else None
        if stamp == ARRIVAL:
            return None
        source = self._declared_stamp(stamp)
        if source is not None and message is not None:
            self._check_stamp(source, message)
        return source

    def _declared_stamp(self, stamp: object) -> StampSource | None:
        problems, where = self.problems, f"`stamp` of `{self.name}`"
        if isinstance(stamp, str) and stamp:
            return StampSource(stamp)
        if not isinstance(stamp, dict):
            problems.add(f'{where} is a field, a table or "{ARRIVAL}", not {stamp!r}')
            return None
        problems.note_unknown_keys(stamp, STAMP_KEYS, where)
        path, unit = stamp.get("from"), stamp.get("unit")
        if not isinstance(path, str) or not path:
            problems.add(f"{where} needs `from`, the name of a field")
            return None
        if not isinstance(unit, str) or unit not in TIME_UNITS:
            problems.add(f"{where} is in `{unit}`: there are {', '.join(TIME_UNITS)}")
            return None
        return StampSource(path, "number", Fraction(TIME_UNITS[unit]))

    def _check_stamp(self, source: StampSource, message: MessageType) -> None:
        where = f"`stamp` of `{self.name}`"
        try:
            kind = message.primitive_type(source.path)
        except NoSuchFieldError as error:
            self.problems.add(f"{where}: {error}")
            return
        shown = f"`{source.path}` of {message.ros1} is `{kind}`"
        if source.kind == "time" and kind in NUMBERS:
            help_ = f'{{ from = "{source.path}", unit = "us" }}'
            self.problems.add(f"{where}: {shown}, a number: say its unit, such as {help_}")
        elif source.kind == "time" and kind != "time":
            self.problems.add(f"{where}: {shown}, no time")
        elif source.kind == "number" and kind not in NUMBERS:
            self.problems.add(f"{where}: {shown}, no number that has a unit")

    # ---------------------------------------------------------------- what goes out

    def _read_constants(
        self, table: Mapping[str, Any], message: MessageType | None
    ) -> dict[str, object]:
        constants: dict[str, object] = {}
        for path, value in table.items():
            where = f"`{path}` in `set` of `{self.name}`"
            infinite = isinstance(value, float) and not math.isfinite(value)
            if infinite or not isinstance(value, (str, bool, int, float)):
                self.problems.add(f"{where} is a text, a truth or a finite number, not {value!r}")
                continue
            constants[path] = value
            if message is None:
                continue
            try:
                part = message.field_at(path)
            except NoSuchFieldError as error:
                self.problems.add(f"{where}: {error}")
                continue
            if part.through == "sequence":
                self.problems.add(f"{where} is an element of a list, which may not be there")
            elif not _fits_kind(value, part.type):
                shown = f"`{part.type}` in {message.ros1}"
                self.problems.add(f"{where} is {shown}, which takes no {value!r}")
        return constants


def _fits_kind(value: object, kind: str) -> bool:
    """Whether a constant fits a field of the primitive type `kind`."""
    if isinstance(value, bool):
        return kind == "bool"
    if isinstance(value, int) and kind in INTEGERS:
        low, high = INTEGERS[kind]
        return low <= value <= high
    if isinstance(value, (int, float)):
        return kind in NUMBERS and kind not in INTEGERS and abs(value) <= GREATEST[kind]
    return kind in ("string", "wstring")
