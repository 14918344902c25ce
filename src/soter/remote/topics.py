"""Values of a robot's topics as bytes.

Purpose: a `Topic` turns values into bytes and back, and judges what is to be published as the gate
would, before anybody sees it. `Topics` finds one by its name.
Non-goals: where the topics are declared (`channels_json.py`); shared memory (`channel.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from soter.core.layout import decode_from, encode_into, size_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import likely
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

    `ends`: for each leaf of the type the least and the greatest value, None for a leaf without
    bounds.
    """

    name: str
    channel: str
    number: int
    writable: bool
    type: Type
    ends: tuple[Ends, ...]

    @property
    def size(self) -> int:
        """The bytes of a value."""
        return size_of(self.type)

    def image(self, given: object, *, clip: bool, path: str = "") -> bytes:
        """The bytes of a value; SoterError U012 where the topic cannot take it."""
        where = path or self.name
        if not isinstance(self.type, (RecordType, ArrayType, ListType)):
            given = _only_element(given)
        try:
            value = from_python(without_ranges(self.type), given, where)
        except ValueShapeError as error:
            raise _refusal(str(error)) from error
        fitting = _Fitting(self.ends, clip=clip).fitted_value(self.type, value, where)
        buffer = bytearray(self.size)
        encode_into(buffer, 0, self.type, fitting)
        return bytes(buffer)

    def value(self, image: bytes) -> Any:  # noqa: ANN401 - any type of Soter
        """The value in these bytes, records as dicts; SoterError X013 where they hold none."""
        try:
            return to_python(self.type, decode_from(image, 0, self.type), record=dict)
        except (ValueError, IndexError) as error:
            message = f"what stands in the channel `{self.channel}` is no `{self.type}`"
            raise SoterError((Diagnostic("X013", message),)) from error


class Topics:
    """The topics by the name that the program gives them, or that of their channel."""

    def __init__(self, system: str, topics: Sequence[Topic]) -> None:
        self.system = system
        self.all = tuple(topics)
        self._known = {n: t for t in topics for n in (t.channel, t.name)}

    def find(self, name: str) -> Topic:
        """The topic of this name; SoterError U001 where there is none."""
        found = self._known.get(name)
        if found is None:
            near = likely(name, self._known)
            listed = f"did you mean `{near}`?" if near else f"it has {_topic_list(self.all)}"
            message = f"system `{self.system}` has no channel `{name}`: {listed}"
            raise SoterError((Diagnostic("U001", message),))
        return found

    def to_publish(self, name: str) -> Topic:
        """The topic of this name; SoterError U001 also where the robot publishes it itself."""
        topic = self.find(name)
        if not topic.writable:
            open_ = _topic_list([t for t in self.all if t.writable])
            message = f"`{name}` is published by the robot itself; open to others: {open_}"
            raise SoterError((Diagnostic("U001", message),))
        return topic


def _topic_list(topics: Sequence[Topic]) -> str:
    return ", ".join(f"`{t.name}`" for t in topics) or "none"


def _only_element(given: object) -> object:
    """The number in an array of one, which networks answer; anything else as it is."""
    if hasattr(given, "tolist") and hasattr(given, "ndim"):
        given = cast("Any", given).tolist()
    return given[0] if isinstance(given, (list, tuple)) and len(given) == 1 else given


class _Fitting:
    """Checks that a value is in its topic's set, else U012; `clip`: puts numbers at its ends."""

    def __init__(self, ends: Sequence[Ends], *, clip: bool) -> None:
        self._ends = iter(ends)
        self._clip = clip

    def fitted_value(self, t: Type, given: Value, path: str) -> Value:
        """The value, checked; takes as many ends as the type has leaves."""
        if isinstance(t, RecordType):
            parts = zip(t.fields, given, strict=True)
            return tuple([self.fitted_value(f, v, f"{path}.{n}") for (n, f), v in parts])
        if isinstance(t, ArrayType):
            return tuple(
                [self.fitted_value(t.element, v, f"{path}[{i}]") for i, v in enumerate(given)]
            )
        if isinstance(t, ListType):
            own = [next(self._ends) for _ in leaves(t.element)]
            each = [(_Fitting(own, clip=self._clip), v) for v in given]
            return tuple(
                [f.fitted_value(t.element, v, f"{path}[{i}]") for i, (f, v) in enumerate(each)]
            )
        return self._leaf(t, given, next(self._ends), path)

    def _leaf(self, t: Type, given: Value, ends: Ends, path: str) -> Value:
        if isinstance(t, (BoolType, EnumType)):
            return given
        if isinstance(t, FloatType) and not math.isfinite(given):
            raise _refusal(f"{path}: {given} is no finite number")
        if ends is None or ends[0] <= given <= ends[1]:
            return given
        low, high = Bound(*ends).singles if isinstance(t, FloatType) else ends
        if self._clip or low <= given <= high:
            return type(given)(min(max(given, ends[0]), ends[1]))
        raise _refusal(f"{path}: {given} is not in [{ends[0]}, {ends[1]}] (clip=True clips it)")


def _refusal(message: str) -> SoterError:
    return SoterError((Diagnostic("U012", message),))
