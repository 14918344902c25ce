"""`NAME_bridge.c`: which message is which topic, and how it is converted.

Purpose: a table of what comes in and one of what goes out, and the functions that they name.
Non-goals: what is done with them (`runtime/mavlink/soter_mavlink_bridge.h`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.mapping.mavlink import MAVLINK, MavlinkMessage, source_of
from soter.mapping.message_types import steps_of
from soter.report.templates import filled
from soter.targets.message_conversion import FLOATS, INTEGERS, Dialect, MessageConverter
from soter.targets.message_conversion import text_literal as text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.mapping.mavlink import MavlinkLink
    from soter.mapping.topic_mapping import TopicMap
    from soter.targets.bridge_base import BridgedSystem

MAVLINK_C = Dialect(
    *("", "", "strncmp({0}, {1}, sizeof {0}) == 0", "(void)strncpy({0}, {1}, sizeof {0})"),
    set_bounded="(void)strncpy({0}, {1}, sizeof {0})",
)
"""What pymavlink generates: no sequences, and texts that fill their arrays need no end."""
STAMPED = {"time_boot_ms": 1_000_000, "time_usec": 1_000}
"""Of what goes out: the fields that say when, and their unit in ns."""
_LIMIT = re.compile(r"(U?)INT(8|16|32|64)_MAX")


class BridgeSource:
    """The bridge of one system; `mapped`: its mapping by topic."""

    def __init__(
        self, bridged: BridgedSystem, name: str, mapped: dict[int, TopicMap], link: MavlinkLink
    ) -> None:
        self.bridged = bridged
        self.world = bridged.world
        self.name = name
        self.link = link
        self.inward = {i: m for i, m in mapped.items() if bridged.is_inward(i)}
        self.outward = {i: m for i, m in mapped.items() if i not in self.inward}
        publishers = (source_of(m.publisher) for m in self.inward.values() if m.publisher)
        self.sources = list(dict.fromkeys([link.autopilot, *(p for p in publishers if p)]))

    def text(self) -> str:
        """The file."""
        return filled(
            "targets/mavlink/bridge.c.j2",
            name=self.name,
            system=self.bridged.system,
            bridged=self.bridged,
            link=self.link,
            urls=[text(u) for u in self.link.urls],
            sources=self.sources,
            inward=[self._in(i, m) for i, m in self.inward.items()],
            outward=[self._out(i, m) for i, m in self.outward.items()],
        )

    def _topic(self, index: int, mapped: TopicMap) -> dict[str, object]:
        message = _message(mapped)
        return {
            "topic": mapped.topic.name,
            "c_name": self.world.names[index],
            "hash": self.bridged.channel_hash(index),
            "value": self.bridged.value_type(index),
            "message": message,
            "low": message.name.lower(),
            "text": text(message.name),
        }

    def _in(self, index: int, mapped: TopicMap) -> dict[str, object]:
        converter = MessageConverter(mapped, MAVLINK, MAVLINK_C, "m")
        message, constants, stamp = _message(mapped), mapped.constants, "-1"
        if mapped.stamp is not None:
            unit, what = mapped.stamp.unit_ns, converter.path(mapped.stamp.path)
            numbers = f"{unit.numerator}, {unit.denominator}"
            stamp = f"soter_ns_of_number((long double){what}, {numbers})"
        source = source_of(mapped.publisher) if mapped.publisher else None
        inward = converter.inward("(*to)")
        return {
            **self._topic(index, mapped),
            "lines": [*_extended(mapped), *_unknown(mapped, converter), *inward],
            "tests": [_same(message, path, value, converter) for path, value in constants.items()],
            "stamp": stamp,
            "stamped": "true" if mapped.stamp else "false",
            "whose": self.sources.index(source or self.link.autopilot),
        }

    def _out(self, index: int, mapped: TopicMap) -> dict[str, object]:
        converter = MessageConverter(mapped, MAVLINK, MAVLINK_C, "m")
        return {
            **self._topic(index, mapped),
            "lines": [*_addressed(mapped), *converter.outward("(*from)")],
            "law": self.bridged.law_statements(index),
            "silent_ns": self.bridged.silent_ns(index),
        }


def _message(mapped: TopicMap) -> MavlinkMessage:
    assert isinstance(mapped.message, MavlinkMessage), mapped
    return mapped.message


def _same(message: MavlinkMessage, path: str, value: object, converter: MessageConverter) -> str:
    """Whether a field is what the mapping says in `set`."""
    what, kind = converter.path(path), message.leaf(path)
    if isinstance(value, str):
        return f"({MAVLINK_C.same_text.format(what, text(value))})"
    if kind in FLOATS:
        return f"{what} == {f'(float){float(str(value))!r}' if kind == 'float32' else value}"
    return f"(int64_t){what} == INT64_C({value})"


def _extended(mapped: TopicMap) -> Iterator[str]:
    """What is not taken, as a frame of MAVLink 1 has no extensions: a zero there nobody sent."""
    stamp = [mapped.stamp.path] if mapped.stamp is not None else []
    read = {path.partition(".")[0] for path in (*mapped.names, *mapped.constants, *stamp)}
    if read & _message(mapped).extensions:
        yield "if (raw->magic != MAVLINK_STX) {"
        yield "  return false;"
        yield "}"


def _unknown(mapped: TopicMap, converter: MessageConverter) -> Iterator[str]:
    """What is not taken, as MAVLink says that such a number means that it is not known."""
    message = _message(mapped)
    for name in mapped.names:
        (field, _), *inside = steps_of(message, name, MAVLINK)
        said = message.invalid.get(field, "").strip("[]").partition(",")[0].rstrip(":")
        kind = message.leaf(name)
        names = dict.fromkeys([name, *([f"{field}.0"] if inside else [])])
        tests = [_is(converter.path(n), kind, said) for n in names]
        if said and all(tests):
            yield f"if ({' || '.join(tests)}) {{"
            yield "  return false;"
            yield "}"


def _is(what: str, kind: str, said: str) -> str:
    """Whether a field is the number that MAVLink names; "" where it names none."""
    if kind in FLOATS:
        if said.upper() == "NAN":
            return f"{what} != {what}"
        return f"{what} == {float(said)!r}" if re.fullmatch(r"-?\d+(\.\d+)?", said) else ""
    if kind in INTEGERS and (_LIMIT.fullmatch(said) or re.fullmatch(r"-?\d+|0x[0-9A-F]+", said)):
        return f"(int64_t){what} == (int64_t){said}"
    return ""


def _addressed(mapped: TopicMap) -> Iterator[str]:
    """To whom, and when, unless the mapping says it."""
    message = _message(mapped)
    filled = {*mapped.names, *mapped.constants}
    own = {"target_system": "e->to.system", "target_component": "e->to.component"}
    own |= {n: f"(uint64_t)(e->written_ns / {unit})" for n, unit in STAMPED.items()}
    for name in message.fields_in_order:
        if name in own and name not in filled:
            cast = "(uint32_t)" if message.leaf(name) == "uint32" else ""
            yield f"m.{name} = {cast}{own[name]};"
