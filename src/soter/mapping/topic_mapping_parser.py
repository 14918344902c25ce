"""Reads what a mapping says of one topic.

Purpose: a `TopicReader` reads the channel and the messages: their type, when they were measured,
whose they are, and what of them is constant. `read_qos` reads the three policies of DDS that decide
whether a reader and a writer meet, and what is kept.
Non-goals: the leaves (`leaf_mapping_parser.py`); whether a log or a middleware has such messages;
what the policies mean to it (`targets/dds_package.py`), and the other policies of DDS.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from soter.mapping.leaf_mapping_parser import LeafReader
from soter.mapping.message_types import (
    INTEGERS,
    NUMBERS,
    NoSuchFieldError,
    StampSource,
    UnknownMessageError,
)
from soter.mapping.topic_mapping import (
    GAP_NS,
    PROMISE_KEYS,
    SOURCES_MAX,
    ConstantSource,
    QualityOfService,
    SignalSource,
    SlopeSource,
    TopicMap,
    early_turns,
    read_promise,
)
from soter.mapping.units import FRAMES, TIME_UNITS, turn_between

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Topic
    from soter.mapping.mapping_errors import MappingProblems
    from soter.mapping.message_types import KnownTypes, MessageType
    from soter.mapping.units import Turn


KEYS = ("reliability", "durability", "depth")
RELIABILITY, DURABILITY = ("best_effort", "reliable"), ("volatile", "transient_local")
DEPTH_MAX = 1_000_000
ALL = "all"


def read_qos(given: Mapping[str, Any], problems: MappingProblems, where: str) -> QualityOfService:
    """Reads the table of policies; the record is not to be used if problems were added."""
    problems.only(given, KEYS, where)
    return QualityOfService(
        _one_of(given, "reliability", RELIABILITY, problems, where),
        _one_of(given, "durability", DURABILITY, problems, where),
        _queue_depth(given.get("depth"), problems, where),
    )


def _one_of(
    given: Mapping[str, Any],
    key: str,
    known: tuple[str, ...],
    problems: MappingProblems,
    where: str,
) -> Any:  # noqa: ANN401 - one of the words, which mypy cannot see
    said = given.get(key)
    if said is not None and said not in known:
        problems.add(f"`{key}` in {where} is {' or '.join(known)}, not {said!r}")
        return None
    return said


def _queue_depth(said: object, problems: MappingProblems, where: str) -> int | None:
    if said is None:
        return None
    if said == ALL:
        return 0
    if isinstance(said, int) and not isinstance(said, bool) and 1 <= said <= DEPTH_MAX:
        return said
    problems.add(f'`depth` in {where} is a number from 1 to {DEPTH_MAX}, or "{ALL}", not {said!r}')
    return None


TOPIC_KEYS = (
    "channel", "type", "stamp", "frame_id", "publisher", "frame", "between", "gap", "fields", "set",
    "qos", "where",
)  # fmt: skip
SOURCE_KEYS = (
    *(k for k in TOPIC_KEYS if k not in ("between", "gap", "set")), *PROMISE_KEYS,
)  # fmt: skip
STAMP_KEYS = ("from", "unit")
ARRIVAL = "arrival"
GREATEST = {"float32": 3.4028234663852886e38, "float64": sys.float_info.max}
"""The largest number of a field: beyond it infinity would go out."""


class TopicReader:
    """Reads the table of a topic; what is wrong goes to `problems`.

    `types`: those of messages, None where the mapping names none; `frame`: the program's;
    `delay_ns`: from a measurement to its arrival, as the system declares (`delayed`).
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

    def read(self, table: Mapping[str, Any]) -> tuple[TopicMap, ...]:
        """The topic as the mapping has it, once or a source each; useless where problems came."""
        if "sources" not in table:
            self.problems.only(table, (*TOPIC_KEYS, "sources"), f"`{self.name}`")
            return (self._topic_map(table),)
        self.problems.only(table, ("sources",), f"`{self.name}`, which has `sources`,")
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
        maps = tuple([self._source(rank, table) for rank, table in enumerate(tables)])
        self._check_sources(maps)
        return maps

    def _source(self, rank: int, table: Mapping[str, Any]) -> TopicMap:
        self.name = f"{self.topic.name}.sources.{rank + 1}"
        where = f"`{self.name}`"
        self.problems.only(table, SOURCE_KEYS, where)
        made = self._topic_map({k: v for k, v in table.items() if k in TOPIC_KEYS})
        if made.stamp is None:
            self.problems.add(f"{where} has no stamp: sources take over by when they measured")
        if made.leaves and all(isinstance(x, ConstantSource) for x in made.leaves.values()):
            self.problems.add(f"{where} is constant: it measures nothing")
        if any(isinstance(leaf, SlopeSource) for leaf in made.leaves.values()):
            self.problems.add(f"{where} has a slope, which jumps where another source takes over")
        promise = read_promise(table, rank, self.topic, self.problems, self.name)
        return replace(made, promise=promise)

    def _check_sources(self, maps: tuple[TopicMap, ...]) -> None:
        """Note where sources do not fit together, each of which is right by itself."""
        self.name = self.topic.name
        channels = [m.channel for m in maps if m.channel is not None]
        if len(set(channels)) != len(channels):
            self.problems.add(f"two `sources` of `{self.name}` are one channel: {channels}")
        promises = [m.promise for m in maps if m.promise is not None]
        for problem in early_turns(self.name, promises):
            self.problems.add(problem)

    def _topic_map(self, table: Mapping[str, Any]) -> TopicMap:
        problems, where = self.problems, f"`{self.name}`"
        between = table.get("between", "hold")
        if between not in ("hold", "linear"):
            problems.add(f"`between` of {where} is hold or linear, not {between!r}")
        gap = problems.duration(table, "gap", self.name) if "gap" in table else GAP_NS
        message = self._message_type(table)
        leaf_reader = LeafReader(self.topic, problems, message, self._frame_turn(table))
        leaf_by_path = leaf_reader.read(problems.table(table, "fields", where))
        stamp = self._stamp(table, message)
        made = TopicMap(
            self.topic,
            leaf_by_path,
            problems.name(table, "channel", where),
            between == "linear",
            gap,
            message=message,
            stamp=stamp,
            delay_ns=self.delay_ns if stamp is None else 0,
            frame_id=self._frame_id(table, message),
            publisher=problems.name(table, "publisher", where),
            constants=self._constant_fields(problems.table(table, "set", where), message),
            qos=read_qos(problems.table(table, "qos", where), problems, f"`qos` of {where}"),
            where=problems.texts(table, "where", where),
        )
        if "frame" in table and not leaf_reader.vectors:
            problems.add(
                f"`frame` of {where} turns nothing: a vector is three names, "
                'such as "p" = ["x", "y", "z"]'
            )
        filled = {x.name for x in leaf_by_path.values() if isinstance(x, SignalSource)}
        for path in made.constants:
            if path in filled:
                problems.add(f"`set` of {where} has `{path}`, which its fields have, too")
        return made

    def _message_type(self, table: Mapping[str, Any]) -> MessageType | None:
        name = self.problems.name(table, "type", f"`{self.name}`")
        if name is None or self.types is None:
            return None
        try:
            return self.types.named(name)
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

    def _frame_id(self, table: Mapping[str, Any], message: MessageType | None) -> str | None:
        frame = self.problems.name(table, "frame_id", f"`{self.name}`")
        if frame is not None and message is not None and not message.has_header:
            self.problems.add(
                f"`frame_id` of `{self.name}` needs a header, which {message.ros1} has not"
            )
        return frame

    # ---------------------------------------------------------------- when it was measured

    def _stamp(self, table: Mapping[str, Any], message: MessageType | None) -> StampSource | None:
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
        problems.only(stamp, STAMP_KEYS, where)
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
            kind = message.leaf(source.path)
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

    def _constant_fields(
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
                part = message.field(path)
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
    """Whether a constant is a value of a primitive."""
    if isinstance(value, bool):
        return kind == "bool"
    if isinstance(value, int) and kind in INTEGERS:
        low, high = INTEGERS[kind]
        return low <= value <= high
    if isinstance(value, (int, float)):
        return kind in NUMBERS and kind not in INTEGERS and abs(value) <= GREATEST[kind]
    return kind in ("string", "wstring")
