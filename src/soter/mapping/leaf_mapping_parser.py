"""Reads from a mapping where the values of a topic's leaves come from.

Purpose: a `LeafReader` makes a source for each leaf. It turns vectors, frames and units into a
name, a scale and an offset. `{ nearest = "distance", most = 0.45, unseen = 2 }` is a leaf with the
distance of the nearest thing in a scan. It is the one reduction of a mapping: no topic can hold a
LaserScan, which has any number of rays, and gives NaN, infinity and 0 a meaning each.
Non-goals: the messages of the topic (`topic_mapping_parser.py`); the reduction itself
(`runtime/bridge/soter_scan.hpp`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.language.model.types import (
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    leaves,
)
from soter.language.model.values import ValueShapeError, from_json
from soter.mapping.frames import SAME
from soter.mapping.mapping_errors import is_number, unknown_name_message
from soter.mapping.message_types import INTEGERS, NUMBERS, NoSuchFieldError
from soter.mapping.topic_mapping import ConstantSource, NearestSource, SignalSource, SlopeSource
from soter.mapping.units import DIMENSIONS, RATES, UNITS, factor_between, full_turn, standard_unit

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import TypeGuard

    from soter.language.model.system import Topic
    from soter.language.model.types import Type
    from soter.mapping.frames import Turn
    from soter.mapping.mapping_errors import MappingProblems
    from soter.mapping.message_types import MessageType
    from soter.mapping.topic_mapping import Leaf, LeafPath


NEAREST_KEYS = ("nearest", "most", "unseen")
SCAN = "sensor_msgs/LaserScan"
UNSEEN_MAX = 1000


def nearest_source(
    name: str,
    t: Type,
    row: Mapping[str, Any],
    message: MessageType | None,
    problems: MappingProblems,
) -> NearestSource | None:
    """Gives the source of a leaf with `nearest`; None if the row is wrong, with mistakes noted."""
    before = len(problems.mistakes)
    problems.note_unknown_keys(row, NEAREST_KEYS, f"`{name}`")
    kind, most, unseen = row["nearest"], row.get("most", 0), row.get("unseen", 0)
    if kind not in ("distance", "bearing"):
        problems.add(f"`nearest` of `{name}` is distance or bearing, not {kind!r}")
    if not is_number(most) or most <= 0:
        problems.add(f"`{name}` needs `most`, in m: what is farther counts as so far")
    if not isinstance(unseen, int) or isinstance(unseen, bool) or not 0 <= unseen <= UNSEEN_MAX:
        problems.add(
            f"`unseen` of `{name}` is no number of rays from 0 to {UNSEEN_MAX}: {unseen!r}"
        )
    if not isinstance(t, FloatType):
        problems.add(f"`{name}` is `{t}`, and what is nearest in a scan a float")
    if message is None or message.ros1 != SCAN:
        problems.add(f"`{name}` is what is nearest in a scan, so its `type` is {SCAN}")
    if len(problems.mistakes) > before:
        return None
    return NearestSource(kind, float(most), unseen)


LEAF_KEYS = ("from", "scale", "offset", "unit", "constant", "slope", "window", *NEAREST_KEYS)
VECTOR_KEYS = ("from", "scale", "unit")
VALUE = "value"
"""The key of the one field of a topic without fields."""
SCALE_MIN = 1e-60
"""The least scale; 1 / SCALE_MIN is the greatest. Beyond them results may be 0 or infinite."""
SMALL = ("bool", "byte", "char", "int8", "uint8")
"""Types of fields in which messages hold Booleans."""


def _is_list_of_three_names(value: object) -> TypeGuard[list[str]]:
    return isinstance(value, list) and len(value) == 3 and all(isinstance(n, str) for n in value)


class LeafReader:
    """Reads `fields` of a topic. `turn`: into the program's frame; `vectors`: their field names."""

    def __init__(
        self,
        topic: Topic,
        problems: MappingProblems,
        message: MessageType | None,
        turn: Turn | None,
    ) -> None:
        self.topic, self.problems, self.message = topic, problems, message
        self.turn = turn or SAME
        self.vectors: dict[str, list[str]] = {}
        self.types = dict(leaves(topic.type))
        self.keys = {".".join(path) or VALUE: path for path in self.types}
        self.prefixes = _leaves_by_name(self.types, self.keys)

    def read_leaves(self, table: Mapping[str, Any]) -> dict[LeafPath, Leaf]:
        """Gives the source of each leaf, in declared order."""
        name = self.topic.name
        if any("[]" in path for path in self.types) or isinstance(self.topic.type, ListType):
            self.problems.add(f"`{name}` is or has a list, which no mapping can fill")
            return {}
        leaf_by_path: dict[LeafPath, Leaf] = {}
        given_paths: set[LeafPath] = set()
        for key, row in table.items():
            for path, leaf in self._row_leaves(key, row).items():
                if path in given_paths:
                    self.problems.add(f"`{'.'.join((name, *path))}` is given twice")
                given_paths.add(path)
                if leaf is not None:
                    leaf_by_path[path] = leaf
        missing_keys = [f"`{key}`" for key, path in self.keys.items() if path not in given_paths]
        if missing_keys:
            names = ", ".join(missing_keys)
            self.problems.add(f"`{name}` is to be given whole, or not at all: {names} missing")
        self._check_slopes(leaf_by_path)
        return {path: leaf_by_path[path] for path in self.types if path in leaf_by_path}

    def _row_leaves(self, key: str, row: object) -> dict[LeafPath, Leaf | None]:
        """Gives the source of each leaf that a row fills; None for a leaf whose source is wrong."""
        if key in self.keys:
            path = self.keys[key]
            return {path: self._leaf_source(f"{self.topic.name}.{key}", self.types[path], row)}
        if key in self.prefixes:
            return self._vector_leaves(f"{self.topic.name}.{key}", self.prefixes[key], row)
        self.problems.add(unknown_name_message(f"`{self.topic.name}` has no", key, self.keys))
        return {}

    # ---------------------------------------------------------------- vectors

    def _vector_leaves(
        self, name: str, paths: list[LeafPath], entry: object
    ) -> dict[LeafPath, Leaf | None]:
        self.vectors[name] = []
        nothing: dict[LeafPath, Leaf | None] = dict.fromkeys(paths)
        if len(paths) != 3 or not all(
            isinstance(self.types[leaf_path], FloatType) for leaf_path in paths
        ):
            shown = [f"`{'.'.join((self.topic.name, *leaf_path))}`" for leaf_path in paths]
            self.problems.add(
                f"`{name}` is no vector, which has three floats here: name each of its fields, "
                f"{', '.join(shown)}"
            )
            return nothing
        row = entry if isinstance(entry, dict) else {"from": entry}
        self.problems.note_unknown_keys(row, VECTOR_KEYS, f"`{name}`")
        names = row.get("from")
        if not _is_list_of_three_names(names):
            self.problems.add(f"`{name}` needs the names of three fields, x, y, z, not {names!r}")
            return nothing
        if len(set(names)) != 3:
            self.problems.add(f"`{name}` names a field twice: {', '.join(names)}")
            return nothing
        self.vectors[name] = names
        rest = {key: row[key] for key in ("scale", "unit") if key in row}
        leaf_of_path: dict[LeafPath, Leaf | None] = {}
        for path, (component, sign) in zip(paths, self.turn, strict=True):
            named = {"from": names[component], **rest}
            leaf = self._signal_source(".".join((self.topic.name, *path)), self.types[path], named)
            if leaf is not None and sign < 0.0:
                leaf = replace(leaf, scale=-leaf.scale)
            leaf_of_path[path] = leaf
        return leaf_of_path

    # ---------------------------------------------------------------- leaves

    def _leaf_source(self, name: str, t: Type, row: object) -> Leaf | None:
        if isinstance(row, str):
            return self._signal_source(name, t, {"from": row})
        if not isinstance(row, dict):
            self.problems.add(f"`{name}` is neither the name of a column nor a table: {row!r}")
            return None
        self.problems.note_unknown_keys(row, LEAF_KEYS, f"`{name}`")
        kinds = [k for k in ("from", "constant", "slope", "nearest") if k in row]
        if len(kinds) != 1:
            self.problems.add(f"`{name}` needs one of `from`, `constant`, `slope`, `nearest`")
            return None
        if "nearest" in row:
            return nearest_source(name, t, row, self.message, self.problems)
        if "constant" in row:
            return self._constant_source(name, t, row["constant"])
        if "slope" in row:
            return self._slope_source(name, row)
        return self._signal_source(name, t, row)

    def _slope_source(self, name: str, row: Mapping[str, Any]) -> Leaf | None:
        measured = self.keys.get(str(row["slope"]))
        window = self.problems.positive_ns(row, "window", name)
        if measured is None:
            self.problems.add(f"`{name}` is the slope of `{row['slope']}`, no field of it")
            return None
        return SlopeSource(measured, window)

    def _constant_source(self, name: str, t: Type, json: object) -> Leaf | None:
        try:
            value = from_json(t, json, name)
        except ValueShapeError as error:
            self.problems.add(f"`constant`: {error}")
            return None
        if isinstance(t, FloatType) and not math.isfinite(value):
            self.problems.add(f"`constant` of `{name}` is not finite")
            return None
        return ConstantSource(value)

    def _signal_source(self, name: str, t: Type, row: Mapping[str, Any]) -> SignalSource | None:
        problems, before = self.problems, len(self.problems.mistakes)
        field = row["from"]
        unit = self._checked_unit(name, t, row)
        if len(problems.mistakes) > before:
            return None
        standard = self._field_unit(name, t, field)
        if standard not in UNITS and unit is not None and "scale" in row:
            standard = None  # the mapping gives the factor itself
        factor = self._unit_factor(name, t, field, unit, standard)
        scale = float(row.get("scale", 1)) * factor
        if not SCALE_MIN <= abs(scale) <= 1.0 / SCALE_MIN:
            problems.add(f"`scale` of `{name}`, times its unit, is {scale!r}, which nobody means")
        if len(problems.mistakes) > before:
            return None
        says_unit = unit is not None or standard is not None or "scale" in row
        assumed = t.unit if isinstance(t, (FloatType, IntType)) and not says_unit else ""
        turn = full_turn(unit or standard, t.unit) if isinstance(t, FloatType) else math.inf
        turn *= abs(float(row.get("scale", 1))) if unit or standard else 1.0
        return SignalSource(field, scale, float(row.get("offset", 0)), assumed, turn)

    def _checked_unit(self, name: str, t: Type, row: Mapping[str, Any]) -> str | None:
        """Gives the unit in a row; None if the row has no known unit. Notes every mistake."""
        problems, unit = self.problems, row.get("unit")
        if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
            problems.add(f"`{name}` is in `{unit}`: there are {', '.join(UNITS)}")
            unit = None
        for key in ("scale", "offset"):
            if not is_number(row.get(key, 0)):
                problems.add(f"`{key}` of `{name}` is no finite number: {row[key]!r}")
        if row.get("scale", 1) == 0:
            problems.add(f"`scale` of `{name}` is 0: say `constant`")
        if not isinstance(row["from"], str):
            problems.add(f"`from` of `{name}` is no name: {row['from']!r}")
        changed = {"unit", "scale", "offset"} & set(row)
        if changed and not isinstance(t, FloatType):
            problems.add(f"`{name}` is `{t}` and takes no {', '.join(sorted(changed))}")
        return unit

    def _field_unit(self, name: str, t: Type, field: str) -> str | None:
        """Gives the standard unit of a field, None without one; notes a missing or unfit field."""
        if self.message is None:
            return None
        try:
            kind = self.message.primitive_type(field)
        except NoSuchFieldError as error:
            self.problems.add(f"`{name}`: {error}")
            return None
        if not _can_fill(t, kind):
            text = f"`{field}` of {self.message.ros1} is `{kind}`"
            self.problems.add(f"`{name}` is `{t}`, and {text}")
            return None
        return standard_unit(self.message, field)

    def _unit_factor(
        self, name: str, t: Type, field: str, unit: str | None, standard: str | None
    ) -> float:
        """Gives the factor from the field's unit to the program's; 1 if one is missing or wrong."""
        if unit is not None and standard is not None and unit != standard:
            assert self.message is not None
            text = f"`{field}` of {self.message.ros1} is in `{standard}`"
            self.problems.add(f"`{name}` is read in `{unit}`, and {text}")
            return 1.0
        own_unit = unit or standard
        if own_unit is None or not isinstance(t, (FloatType, IntType)):
            return 1.0
        factor = factor_between(own_unit, t.unit)
        if isinstance(t, IntType):
            if factor != 1.0 and t.unit:
                self.problems.add(f"`{name}` counts `{t.unit}`, and `{field}` is in `{own_unit}`")
            return 1.0
        if factor is None:
            self.problems.add(
                f"`{name}` is in {_unit_text(t.unit)}, and `{field}` is in {_unit_text(own_unit)}"
            )
            return 1.0
        return factor

    def _check_slopes(self, leaf_by_path: Mapping[LeafPath, Leaf]) -> None:
        for path, leaf in leaf_by_path.items():
            if not isinstance(leaf, SlopeSource):
                continue
            measured = ".".join((self.topic.name, *leaf.of))
            name = ".".join((self.topic.name, *path))
            if not isinstance(leaf_by_path.get(leaf.of, SignalSource("")), SignalSource):
                self.problems.add(f"`{name}` is a slope of `{measured}`, which no column gives")
                continue
            rate, base = _unit_of(self.types[path]), _unit_of(self.types[leaf.of])
            if rate not in UNITS or base not in UNITS:
                continue
            if RATES.get(DIMENSIONS[base]) != DIMENSIONS[rate] or UNITS[base] != UNITS[rate]:
                self.problems.add(f"`{name}` is in `{rate}`, no slope of `{measured}`, in `{base}`")


def _unit_of(t: Type) -> str:
    return t.unit if isinstance(t, FloatType) else ""


def _unit_text(unit: str) -> str:
    """Gives a unit with the quantity that it measures, if that is known."""
    dimension = DIMENSIONS.get(unit)
    return f"`{unit}`, {dimension}" if dimension else f"`{unit}`"


def _leaves_by_name(
    types: Mapping[LeafPath, Type], keys: Mapping[str, LeafPath]
) -> dict[str, list[LeafPath]]:
    """Maps the dotted name of each record or array to its leaves; the full topic is `value`."""
    below: dict[str, list[LeafPath]] = {}
    for path in types:
        for depth in range(len(path)):
            below.setdefault(".".join(path[:depth]) or VALUE, []).append(path)
    return {key: paths for key, paths in below.items() if key not in keys}


def _can_fill(t: Type, kind: str) -> bool:
    """Whether a message field of primitive type `kind` may fill a leaf of type `t`."""
    if isinstance(t, FloatType):
        return kind in NUMBERS
    if isinstance(t, (IntType, DurationType)):
        return kind in INTEGERS
    if isinstance(t, BoolType):
        return kind in SMALL
    return isinstance(t, EnumType) and kind in ("string", "wstring")
