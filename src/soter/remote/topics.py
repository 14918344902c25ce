"""Encodes values of a robot's topics as bytes.

Purpose: a `Topic` converts values, and checks a value to publish as the gate of the robot would,
before it is written. `Topics` finds a topic by its name.
Non-goals: where the topics are declared (`channels_json.py`); shared memory (`channel.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from soter.core.layout import decode_from, encode_into, size_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import likely_name
from soter.language.model.system import Bound
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    ListType,
    RecordType,
    leaves,
)
from soter.language.model.values import ValueShapeError, from_python, to_python, without_ranges

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.types import Type, Value

    Ends = tuple[float, float] | None


@dataclass(frozen=True)
class Topic:
    """A topic with a channel. `number`: of its layout; `writable`: others than the robot write it.

    `ends`: the least and the greatest value of each leaf, in order; None for a leaf without bounds.
    """

    name: str
    channel: str
    number: int
    writable: bool
    type: Type
    ends: tuple[Ends, ...]

    @property
    def size(self) -> int:
        """How many bytes a value has."""
        return size_of(self.type)

    def image(self, value: object, *, clip: bool, path: str = "") -> bytes:
        """The bytes of a value; raises SoterError U012 if the topic cannot take the value."""
        where = path or self.name
        if not isinstance(self.type, (RecordType, ArrayType, ListType)):
            value = _only_element(value)
        try:
            value = from_python(without_ranges(self.type), value, where)
        except ValueShapeError as error:
            raise _refusal(str(error)) from error
        fitting = _Fitting(self.ends, clip=clip).fitted_value(self.type, value, where)
        buffer = bytearray(self.size)
        encode_into(buffer, 0, self.type, fitting)
        return bytes(buffer)

    def value(self, image: bytes) -> Any:  # noqa: ANN401 - any type of Soter
        """The value in these bytes, with records as dicts; raises X013 if they hold no value."""
        try:
            return to_python(self.type, decode_from(image, 0, self.type), record=dict)
        except (ValueError, IndexError) as error:
            message = f"what stands in the channel `{self.channel}` is no `{self.type}`"
            raise SoterError((Diagnostic("X013", message),)) from error


class Topics:
    """The topics of a robot, found by the name in the program or the name of the channel."""

    def __init__(self, system: str, topics: Sequence[Topic]) -> None:
        self.system = system
        self.all = tuple(topics)
        self._known = {n: t for t in topics for n in (t.channel, t.name)}

    def topic_named(self, name: str) -> Topic:
        """The topic with this name; raises SoterError U001 if no topic has the name."""
        found = self._known.get(name)
        if found is None:
            near = likely_name(name, self._known)
            listed = f"did you mean `{near}`?" if near else f"it has {_topic_list(self.all)}"
            message = f"system `{self.system}` has no channel `{name}`: {listed}"
            raise SoterError((Diagnostic("U001", message),))
        return found

    def writable_topic(self, name: str) -> Topic:
        """The topic of this name that others may write; SoterError U001 if there is none."""
        topic = self.topic_named(name)
        if not topic.writable:
            open_ = _topic_list([t for t in self.all if t.writable])
            message = f"`{name}` is published by the robot itself; open to others: {open_}"
            raise SoterError((Diagnostic("U001", message),))
        return topic


def _topic_list(topics: Sequence[Topic]) -> str:
    return ", ".join(f"`{t.name}`" for t in topics) or "none"


def _only_element(value: object) -> object:
    """The only element of a list or array of one, as networks answer; other values unchanged."""
    if hasattr(value, "tolist") and hasattr(value, "ndim"):
        value = cast("Any", value).tolist()
    return value[0] if isinstance(value, (list, tuple)) and len(value) == 1 else value


class _Fitting:
    """Checks that values are in a topic's set, else U012. `clip`: moves numbers to its ends."""

    def __init__(self, ends: Sequence[Ends], *, clip: bool) -> None:
        self._ends = iter(ends)
        self._clip = clip

    def fitted_value(self, t: Type, value: Value, path: str) -> Value:
        """The checked value, clipped if `clip` is set; consumes the next ends for each leaf."""
        if isinstance(t, RecordType):
            parts = zip(t.fields, value, strict=True)
            return tuple([self.fitted_value(f, v, f"{path}.{n}") for (n, f), v in parts])
        if isinstance(t, ArrayType):
            return tuple(
                [self.fitted_value(t.element, v, f"{path}[{i}]") for i, v in enumerate(value)]
            )
        if isinstance(t, ListType):
            element_ends = [next(self._ends) for _ in leaves(t.element)]
            each = [(_Fitting(element_ends, clip=self._clip), v) for v in value]
            return tuple(
                [f.fitted_value(t.element, v, f"{path}[{i}]") for i, (f, v) in enumerate(each)]
            )
        return self._fitted_leaf(t, value, next(self._ends), path)

    def _fitted_leaf(self, t: Type, value: Value, ends: Ends, path: str) -> Value:
        if isinstance(t, (BoolType, EnumType)):
            return value
        if isinstance(t, FloatType) and not math.isfinite(value):
            raise _refusal(f"{path}: {value} is no finite number")
        if ends is None or ends[0] <= value <= ends[1]:
            return value
        low, high = Bound(*ends).float32_ends if isinstance(t, FloatType) else ends
        if self._clip or low <= value <= high:
            return type(value)(min(max(value, ends[0]), ends[1]))
        raise _refusal(f"{path}: {value} is not in [{ends[0]}, {ends[1]}] (clip=True clips it)")


def _refusal(message: str) -> SoterError:
    return SoterError((Diagnostic("U012", message),))
