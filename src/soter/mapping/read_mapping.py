"""Which topic of a program is what in a log that Soter did not write.

Purpose: read a mapping (TOML or JSON) and check it against a system: every mistake in it is D015,
all of them at once.
Non-goals: the log (`log_columns.py`), its values (`samples.py`).
"""

from __future__ import annotations

import importlib
import json
import math
from fractions import Fraction
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.near import nearest_or_all
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import read_json_text
from soter.language.model.durations import WrongTextError, duration_ns
from soter.language.model.python_values import ValueShapeError, from_json
from soter.language.model.types import FloatType, ListType, Type, leaves
from soter.mapping.topic_mapping import (
    GAP_NS,
    ConstantSource,
    Leaf,
    LeafPath,
    LogMap,
    SignalSource,
    SlopeSource,
    TopicMap,
)
from soter.mapping.units import TIME_UNITS, UNITS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from soter.language.model.system import System, Topic

TIME_MIN, TIME_MAX = 1e-12, 1e12
NUMBER_MAX = 1e30
"""Scales and offsets beyond are none."""
LEAF_KEYS = ("from", "scale", "offset", "unit", "constant", "slope", "window")
TOPIC_KEYS = ("channel", "between", "gap", "fields")
KEYS = ("system", "time", "where", "topics")


def read_mapping(path: Path) -> dict[str, Any]:
    """What a file of TOML or JSON says; SoterError D015."""
    try:
        text = read_json_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = reason(error) if isinstance(error, OSError) else "it is not UTF-8"
        raise _wrong([f"the mapping `{path}` cannot be read: {why}"]) from error
    try:
        given = _toml(text) if path.suffix == ".toml" else json.loads(text)
    except ImportError as error:
        raise _wrong(["TOML needs Python 3.11 or the package tomli: or write JSON"]) from error
    except (ValueError, RecursionError) as error:
        kind = "TOML" if path.suffix == ".toml" else "JSON"
        raise _wrong([f"the mapping `{path}` is no {kind}: {str(error)[:200]}"]) from error
    if not isinstance(given, dict):
        raise _wrong([f"the mapping `{path}` is no table"])
    return given


def system_named(given: Mapping[str, Any]) -> str | None:
    """The system that a mapping is for, if it says."""
    name = given.get("system")
    return name if isinstance(name, str) else None


def mapping_of(
    given: Mapping[str, Any], system: System, where: Mapping[str, str] | None = None
) -> LogMap:
    """The mapping, checked against a system; `where` adds to its own. SoterError D015."""
    reading = _MappingReader(system)
    log_map = reading.mapping(given)
    if reading.problems:
        raise _wrong(reading.problems)
    return LogMap(log_map.topics, log_map.time, log_map.time_ns, {**log_map.where, **(where or {})})


def _toml(text: str) -> Any:  # noqa: ANN401 - what a file says
    there = find_spec("tomllib") is not None
    return importlib.import_module("tomllib" if there else "tomli").loads(text)


def _wrong(problems: Iterable[str]) -> SoterError:
    return SoterError(tuple(Diagnostic("D015", p) for p in problems))


class _MappingReader:
    """Reads on after a mistake, so that all of them are told."""

    def __init__(self, system: System) -> None:
        self.known = {t.name: t for t in system.topics if t.queue_of is None and not t.held}
        self.problems: list[str] = []

    def mapping(self, given: Mapping[str, Any]) -> LogMap:
        self._only(given, KEYS, "the mapping")
        if not isinstance(given.get("system", ""), str):
            self.problems.append("`system` is no name")
        time, unit = self._time(self._table(given, "time", "the mapping"))
        where = {k: str(v) for k, v in self._table(given, "where", "the mapping").items()}
        topics = self._table(given, "topics", "the mapping")
        if not topics and not self.problems:
            self.problems.append("the mapping names no topics: `[topics.NAME]`")
        topic_maps = [self._topic(name, given_) for name, given_ in topics.items()]
        return LogMap(tuple(t for t in topic_maps if t is not None), time, unit, where)

    def _time(self, given: Mapping[str, Any]) -> tuple[str | None, Fraction]:
        self._only(given, ("from", "unit", "scale"), "`time`")
        unit, scale = given.get("unit", "s"), given.get("scale", 1)
        if not isinstance(unit, str) or unit not in TIME_UNITS:
            self.problems.append(f"`time` is in `{unit}`: there are {', '.join(TIME_UNITS)}")
            unit = "s"
        if not _is_number(scale) or not TIME_MIN <= scale <= TIME_MAX:
            self.problems.append(
                f"`scale` of `time` is no number from 1e-12 to 1e12: {str(scale)[:40]}"
            )
            scale = 1
        name = given.get("from")
        if name is not None and not isinstance(name, str):
            self.problems.append(f"`from` of `time` is no name: {name!r}")
            name = None
        return name, Fraction(repr(scale)) * TIME_UNITS[unit]

    def _topic(self, name: str, given: object) -> TopicMap | None:
        topic = self.known.get(name)
        if topic is None:
            self.problems.append(_unknown("the system has no topic", name, self.known))
            return None
        if not isinstance(given, dict):
            self.problems.append(f"`{name}` is no table")
            return None
        self._only(given, TOPIC_KEYS, f"`{name}`")
        channel, between = given.get("channel"), given.get("between", "hold")
        if channel is not None and not isinstance(channel, str):
            self.problems.append(f"`channel` of `{name}` is no name: {channel!r}")
        if between not in ("hold", "linear"):
            self.problems.append(f"`between` of `{name}` is hold or linear, not {between!r}")
        gap = self._duration(given, "gap", name) if "gap" in given else GAP_NS
        leaf_by_path = self._leaves(topic, self._table(given, "fields", f"`{name}`"))
        return TopicMap(topic, leaf_by_path, channel, between == "linear", gap)

    def _leaves(self, topic: Topic, given: Mapping[str, Any]) -> dict[LeafPath, Leaf]:
        """A leaf each; of a topic without fields the one called `value`."""
        types = dict(leaves(topic.type))
        keys = {".".join(path) or "value": path for path in types}
        if any("[]" in path for path in types) or isinstance(topic.type, ListType):
            self.problems.append(f"`{topic.name}` is or has a list, which no mapping can fill")
            return {}
        leaf_by_path: dict[LeafPath, Leaf] = {}
        for key, what in given.items():
            if key not in keys:
                self.problems.append(_unknown(f"`{topic.name}` has no", key, keys))
                continue
            leaf = self._leaf(f"{topic.name}.{key}", types[keys[key]], what, keys)
            if leaf is not None:
                leaf_by_path[keys[key]] = leaf
        left = [k for k in keys if k not in given]
        if left:
            names = ", ".join(f"`{k}`" for k in left)
            self.problems.append(
                f"`{topic.name}` is to be given whole, or not at all: {names} missing"
            )
        self._slopes(topic, leaf_by_path)
        return {path: leaf_by_path[path] for path in types if path in leaf_by_path}

    def _leaf(self, name: str, t: Type, what: object, keys: Mapping[str, LeafPath]) -> Leaf | None:
        if isinstance(what, str):
            return SignalSource(what)
        if not isinstance(what, dict):
            self.problems.append(f"`{name}` is neither the name of a column nor a table: {what!r}")
            return None
        self._only(what, LEAF_KEYS, f"`{name}`")
        kinds = [k for k in ("from", "constant", "slope") if k in what]
        if len(kinds) != 1:
            self.problems.append(f"`{name}` needs one of `from`, `constant`, `slope`")
            return None
        if "constant" in what:
            return self._constant(name, t, what["constant"])
        if "slope" in what:
            of = keys.get(str(what["slope"]))
            window = self._duration(what, "window", name)
            if of is None:
                self.problems.append(f"`{name}` is the slope of `{what['slope']}`, no field of it")
            return None if of is None or window is None else SlopeSource(of, window)
        return self._from(name, t, what)

    def _from(self, name: str, t: Type, what: Mapping[str, Any]) -> Leaf | None:
        unit, before = what.get("unit", "1"), len(self.problems)
        if not isinstance(unit, str) or unit not in UNITS:
            self.problems.append(f"`{name}` is in `{unit}`: there are {', '.join(UNITS)}")
        for key in ("scale", "offset"):
            if not _is_number(what.get(key, 0)):
                self.problems.append(f"`{key}` of `{name}` is no finite number: {what[key]!r}")
        if what.get("scale", 1) == 0:
            self.problems.append(f"`scale` of `{name}` is 0: say `constant`")
        if not isinstance(what["from"], str):
            self.problems.append(f"`from` of `{name}` is no name: {what['from']!r}")
        changed = {"unit", "scale", "offset"} & set(what)
        if changed and not isinstance(t, FloatType):
            self.problems.append(f"`{name}` is `{t}` and takes no {', '.join(sorted(changed))}")
        if len(self.problems) > before:
            return None
        return SignalSource(
            what["from"], float(what.get("scale", 1)) * UNITS[unit], float(what.get("offset", 0))
        )

    def _constant(self, name: str, t: Type, given: object) -> Leaf | None:
        try:
            value = from_json(t, given, name)
        except ValueShapeError as error:
            self.problems.append(f"`constant`: {error}")
            return None
        if isinstance(t, FloatType) and not math.isfinite(value):
            self.problems.append(f"`constant` of `{name}` is not finite")
            return None
        return ConstantSource(value)

    def _slopes(self, topic: Topic, leaf_by_path: Mapping[LeafPath, Leaf]) -> None:
        for path, leaf in leaf_by_path.items():
            if isinstance(leaf, SlopeSource) and not isinstance(
                leaf_by_path.get(leaf.of, SignalSource("")), SignalSource
            ):
                of = ".".join((topic.name, *leaf.of))
                name = ".".join((topic.name, *path))
                self.problems.append(f"`{name}` is a slope of `{of}`, which no column gives")

    def _duration(self, given: Mapping[str, Any], key: str, name: str) -> int:
        if key not in given:
            self.problems.append(f'`{name}` needs a `{key}`, such as "0.5s"')
            return 1
        try:
            duration = duration_ns(given[key])
        except WrongTextError as error:
            self.problems.append(f"`{key}` of `{name}`: {error}")
            return 1
        if duration <= 0:
            self.problems.append(f"`{key}` of `{name}` is no time above 0")
        return duration

    def _table(self, given: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        table = given.get(key, {})
        if not isinstance(table, dict):
            self.problems.append(f"`{key}` of {where} is no table")
            return {}
        return table

    def _only(self, given: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
        for key in given:
            if key not in known:
                self.problems.append(f"{where} says `{key}`: there are {', '.join(known)}")


def _unknown(what: str, name: str, known: Iterable[str]) -> str:
    hint = nearest_or_all(name, known)
    return f"{what} `{name}`: {hint}" if hint else f"{what} `{name}`"


def _is_number(given: object) -> bool:
    if not isinstance(given, (int, float)) or isinstance(given, bool):
        return False
    return -NUMBER_MAX <= given <= NUMBER_MAX  # NaN, too, is none
