"""The parts of a message, however it was written: JSON, ROS or protobuf.

Purpose: what stands at `pose.position.x` or `ranges.3`, as a plain number, truth or text, and what
a time is in ns.
Non-goals: decoding (`ros_messages.py`, the package `mcap-protobuf-support`).
"""

from __future__ import annotations

from keyword import iskeyword
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

SECONDS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
"""What the members of a time are called: in ROS 2, in ROS 1 (C++, Python) and in protobuf."""


class NoPartError(Exception):
    """A message has no such part; `beyond`: a list on the way is too short."""

    def __init__(self, part: str, known: Iterable[str], *, beyond: bool = False) -> None:
        super().__init__(part)
        self.part, self.known, self.beyond = part, tuple(known), beyond


class NoTimeError(Exception):
    """Something is no time."""


def part_of(message: Any, name: str) -> Any:  # noqa: ANN401 - what a message has
    """What stands at a path, None where protobuf knows that nobody set it; raises NoPartError."""
    current, is_set = message, True
    for part in name.split("."):
        is_set = is_set and _is_set(current, part)
        try:
            current = _member(current, part)
        except NoPartError as error:
            if error.beyond and not is_set:
                return None
            raise
    if not is_set:
        return None
    return current.tolist() if hasattr(current, "dtype") else current  # of numpy, also one number


def time_ns_of(given: Any) -> int:  # noqa: ANN401 - the same
    """A time of seconds and nanoseconds, in ns; raises NoTimeError."""
    for names in SECONDS:
        try:
            seconds, rest = (part_of(given, n) for n in names)
        except NoPartError:
            continue
        if type(seconds) is int and type(rest) is int and 0 <= rest < 10**9:
            return seconds * 10**9 + rest
    raise NoTimeError


def _member(current: Any, part: str) -> Any:  # noqa: ANN401 - the same
    if isinstance(current, dict):
        if part not in current:
            raise NoPartError(part, current)
        return current[part]
    if hasattr(current, "__msgtype__"):
        return _attribute(current, part, list(type(current).__dataclass_fields__))
    if hasattr(current, "DESCRIPTOR"):
        return _of_protobuf(current, part)
    if isinstance(current, (str, bytes)) or not hasattr(current, "__len__"):
        raise NoPartError(part, ())
    if not (part.isascii() and part.isdigit() and len(part) < 10):
        raise NoPartError(part, ())
    if int(part) >= len(current):
        raise NoPartError(part, (), beyond=True)
    return current[int(part)]


def _attribute(current: Any, part: str, known: list[str]) -> Any:  # noqa: ANN401 - the same
    name = f"{part}_" if iskeyword(part) else part
    if name not in known:
        raise NoPartError(part, known)
    return getattr(current, name)


def _is_set(current: Any, part: str) -> bool:  # noqa: ANN401 - the same
    """False for a field of protobuf that has no value: it would be read as its default."""
    fields = current.DESCRIPTOR.fields_by_name if hasattr(current, "DESCRIPTOR") else {}
    return part not in fields or not fields[part].has_presence or current.HasField(part)


def _of_protobuf(current: Any, part: str) -> Any:  # noqa: ANN401 - the same
    """A field of a protobuf message; of an enum the name of its member."""
    fields = current.DESCRIPTOR.fields_by_name
    if part not in fields:
        raise NoPartError(part, fields)
    value = getattr(current, part)
    enum = fields[part].enum_type
    if enum is not None and isinstance(value, int):
        member = enum.values_by_number.get(value)
        return value if member is None else member.name
    return value
