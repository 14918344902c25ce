"""The types of ROS messages: the type of the field at a path such as `pose.pose.position.x`.

Purpose: `MessageTypes` knows the standard types of ROS 1 (noetic) and ROS 2, by the package
`rosbags`, and those that a mapping adds as `.msg` files. `path_steps` gives the steps of a path for
languages that write a member, an element of an array and one of a sequence differently.
`text_bound` gives how many bytes a text may have. A `StampSource` is the field of a message that
says when it was measured.
Non-goals: messages themselves (`monitor/log_files/`), code for them (targets); clocks.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal, Protocol

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import closest, nearest_or_all
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


@dataclass(frozen=True)
class StampSource:
    """The field with the time at which a message was measured, in the clock of its arrival.

    `kind` is "time" for a ROS time (in JSON and protobuf with members `sec` and `nanosec` or
    `nanos`), or "number" for a number in units of `unit_ns`.
    """

    path: str
    kind: Literal["time", "number"] = "time"
    unit_ns: Fraction = Fraction(1)


BASE, NAMED, ARRAY, SEQUENCE = 1, 2, 3, 4
"""The kinds of fields, as rosbags numbers them."""
TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}
"""Types that are primitive in ROS 1 and records in ROS 2."""
INTEGERS: dict[str, tuple[int, int]] = {
    "byte": (0, 2**8 - 1),
    "char": (0, 2**8 - 1),
    **{f"int{n}": (-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
    **{f"uint{n}": (0, 2**n - 1) for n in (8, 16, 32, 64)},
}
"""Each primitive type of whole numbers, with its least and greatest number."""
NUMBERS = (*INTEGERS, "float32", "float64")
HEADER = "std_msgs/msg/Header"
HEADER_STAMP, HEADER_FRAME = "header.stamp", "header.frame_id"
EMPTY_MEMBER = "structure_needs_at_least_one_member"
NAME = re.compile(r"([A-Za-z]\w*)/(?:msg/)?([A-Za-z]\w*)", re.ASCII)

Definitions = dict[str, tuple[list[Any], list[tuple[str, Any]]]]
"""Type name in the form of ROS 2 -> (constants, fields in declared order)."""


class UnknownMessageError(Exception):
    """Reports an unknown message type; the text names a similar known type."""


class NoSuchFieldError(Exception):
    """A message type has no field at a path; the text of the error names fields that it has."""


@dataclass(frozen=True)
class MessageField:
    """A primitive field of a message; `type`: float64, bool, int32, string, ..., time, duration.

    `through` is "sequence" if the field is inside a list of any length, and so may be absent;
    "array" if it is only inside arrays of fixed length; else "".
    """

    path: str
    type: str
    through: Literal["", "array", "sequence"] = ""


@dataclass(frozen=True)
class MessageType:
    """A message type such as `nav_msgs/Odometry`, under its names in ROS 1 and ROS 2."""

    package: str
    name: str
    definitions: Mapping[int, Definitions] = field(compare=False, repr=False)

    @property
    def ros1(self) -> str:
        """Gives the type's name in ROS 1, such as nav_msgs/Odometry."""
        return f"{self.package}/{self.name}"

    @property
    def ros2(self) -> str:
        """Gives the type's name in ROS 2, such as nav_msgs/msg/Odometry."""
        return f"{self.package}/msg/{self.name}"

    def exists_in(self, ros: int) -> bool:
        """Whether this type exists in ROS 1 or ROS 2; `ros` is 1 or 2."""
        return self.ros2 in self.definitions.get(ros, {})

    def field_at(self, path: str, ros: int | None = None) -> MessageField:
        """Gives the field at a path as `a.b.0`, in any ROS by default; raises NoSuchFieldError."""
        families = [ros] if ros else sorted(self.definitions, reverse=True)
        versions = [v for v in families if self.exists_in(v)]
        if not versions:
            raise NoSuchFieldError(f"ROS {ros} has no `{self.ros1}`")
        problem = NoSuchFieldError()
        for version in versions:
            try:
                return self._field_in(path, self.definitions[version])
            except NoSuchFieldError as error:
                problem = error
        raise problem

    def primitive_type(self, path: str, ros: int | None = None) -> str:
        """Gives the primitive type at a path: float64, ..., time. Raises NoSuchFieldError."""
        return self.field_at(path, ros).type

    def fields_by_path(self, ros: int | None = None) -> dict[str, MessageField]:
        """Maps each path, with `*` for list indices, to its primitive field, in declared order."""
        definitions = self.definitions[ros] if ros else self._newest_definitions
        found = self._fields_below((self.ros2,), "", "", definitions)
        return {f.path: f for f in found}

    def owning_types(self, path: str) -> Iterator[tuple[str, str]]:
        """Yields each type that contains a field, outermost first, and the field's path inside it.

        Types are written as in ROS 1. `path` must be a path that `field_at` accepts.
        """
        definitions = self._newest_definitions
        found: Any = (NAMED, self.ros2)
        parts = path.split(".")
        for depth, part in enumerate(parts):
            if found[0] == NAMED:
                yield found[1].replace("/msg/", "/"), ".".join(parts[depth:])
                found = _members_of(definitions, found[1]).get(part)
            elif found[0] in (ARRAY, SEQUENCE):
                found = found[1][0]
            if found is None:
                return

    @property
    def has_header(self) -> bool:
        """Whether its field `header` is a std_msgs/Header."""
        return dict(self._newest_definitions[self.ros2][1]).get("header") == (NAMED, HEADER)

    @property
    def default_stamp(self) -> StampSource | None:
        """Gives the field `header.stamp`, the time of measurement; None without a header."""
        return StampSource(HEADER_STAMP) if self.has_header else None

    def unit(self, _path: str) -> str | None:
        """Gives None: definitions of ROS declare no units. `MavlinkMessage` overrides this."""
        return None

    @property
    def _newest_definitions(self) -> Definitions:
        """Gives the definitions of the newest ROS version that has the type."""
        return self.definitions[max(v for v in self.definitions if self.exists_in(v))]

    def _field_in(self, path: str, definitions: Definitions) -> MessageField:
        kind: Any = (NAMED, self.ros2)
        through: Literal["", "array", "sequence"] = ""
        done: list[str] = []
        for part in path.split("."):
            at = f"`{'.'.join(done)}` of {self.ros1}" if done else f"`{self.ros1}`"
            if kind[0] in (ARRAY, SEQUENCE):
                _require_index(kind, part, at)
                through = "sequence" if kind[0] == SEQUENCE or through == "sequence" else "array"
                kind = kind[1][0]
            elif kind[0] == BASE:
                raise NoSuchFieldError(f"{at} is `{kind[1][0]}` and has no `{part}`")
            else:
                if kind[1] not in definitions:
                    remedy = "its `.msg` is to be named under `[messages]`"
                    raise NoSuchFieldError(f"{at} is `{kind[1]}`, which is not known: {remedy}")
                members = _members_of(definitions, kind[1])
                if part not in members:
                    hint = nearest_or_all(part, members)
                    raise NoSuchFieldError(f"{at} has no `{part}`" + (f": {hint}" if hint else ""))
                kind = members[part]
            done.append(part)
        return MessageField(path, self._primitive_type(path, kind, definitions), through)

    def _primitive_type(self, path: str, kind: Any, definitions: Definitions) -> str:  # noqa: ANN401 - see BASE
        if kind[0] in (ARRAY, SEQUENCE):
            raise NoSuchFieldError(f"`{path}` of {self.ros1} is a list: `.0` is its first element")
        if kind[0] == BASE:
            return str(kind[1][0])
        if kind[1] in TIMES:
            return TIMES[kind[1]]
        members = nearest_or_all("", _members_of(definitions, kind[1]))
        raise NoSuchFieldError(f"`{path}` of {self.ros1} is a whole `{kind[1]}`: {members}")

    def _fields_below(
        self,
        inside: tuple[str, ...],
        path: str,
        through: Literal["", "array", "sequence"],
        definitions: Definitions,
    ) -> Iterator[MessageField]:
        for member, kind in _members_of(definitions, inside[-1]).items():
            at, passes, inner = f"{path}{member}", through, kind
            if kind[0] in (ARRAY, SEQUENCE):
                inner, at = kind[1][0], f"{at}.*"
                passes = "sequence" if "sequence" in (through, _PASSES[kind[0]]) else "array"
            if inner[0] == BASE:
                yield MessageField(at, str(inner[1][0]), passes)
            elif inner[1] in TIMES:
                yield MessageField(at, TIMES[inner[1]], passes)
            elif inner[1] not in inside:  # a type that contains itself would never end
                yield from self._fields_below((*inside, inner[1]), f"{at}.", passes, definitions)


_PASSES: dict[int, Literal["array", "sequence"]] = {ARRAY: "array", SEQUENCE: "sequence"}


def _require_index(kind: Any, part: str, at: str) -> None:  # noqa: ANN401 - as rosbags has it
    if not (part.isascii() and part.isdigit() and len(part) < 10):
        raise NoSuchFieldError(f"{at} is a list: `.0` is its first element")
    if part != str(int(part)):  # C would read `010` as 8
        raise NoSuchFieldError(f"{at}: `{part}` is written as `{int(part)}`")
    if kind[0] == ARRAY and int(part) >= kind[1][1]:
        raise NoSuchFieldError(f"{at} has {kind[1][1]} elements, no `{part}`")


def _members_of(definitions: Definitions, name: str) -> dict[str, Any]:
    members = dict(definitions.get(name, ([], []))[1])
    members.pop(EMPTY_MEMBER, None)
    return members


class KnownTypes(Protocol):
    """An object that finds message types by their names."""

    def type_named(self, name: str) -> MessageType:
        """Gives the type with this name; raises UnknownMessageError if it is unknown."""


class MessageTypes:
    """The standard message types of ROS, and those that `add` reads from `.msg` files."""

    def __init__(self) -> None:
        """Raises SoterError D007 if rosbags is not installed."""
        require_ros_package()
        self.definitions = {v: dict(standard) for v, standard in _standard_definitions().items()}

    def add(self, name: str, text: str) -> None:
        """Adds the types of a `.msg` file; raises UnknownMessageError if the file defines none."""
        for definitions in self.definitions.values():
            definitions.update(_parse_definition(name, text))

    def type_named(self, name: str) -> MessageType:
        """Gives the type with this name; raises UnknownMessageError if it is unknown."""
        match = NAME.fullmatch(name)
        if match is None:
            raise UnknownMessageError("a type is written as `nav_msgs/Odometry`")
        found = MessageType(match[1], match[2], self.definitions)
        if not any(found.exists_in(v) for v in self.definitions):
            known = {n.replace("/msg/", "/") for d in self.definitions.values() for n in d}
            near = closest(found.ros1, sorted(known), 0.8)
            remedy = "types of one's own are read from `.msg` files, named under `[messages]`"
            raise UnknownMessageError(f"did you mean `{near[0]}`?" if near else remedy)
        return found


def require_ros_package() -> None:
    """Raises SoterError D007 if the package that reads ROS messages is missing."""
    if find_spec("rosbags") is None:
        text = "ROS messages and bags are read with the package `rosbags`, which is not installed"
        help_ = f"install it: {pip_command('logs')}"
        raise SoterError((Diagnostic("D007", text, helps=(help_,)),))


@cache
def _standard_definitions() -> dict[int, Definitions]:
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra

    stores = {1: Stores.ROS1_NOETIC, 2: Stores.ROS2_JAZZY}
    return {v: dict(get_typestore(store).fielddefs) for v, store in stores.items()}


def _parse_definition(name: str, text: str) -> Definitions:
    """Gives the definitions in the text of a `.msg` file; `name` is its type in the mapping."""
    from rosbags.typesys import TypesysError, get_types_from_msg  # noqa: PLC0415 - an extra

    match = NAME.fullmatch(name)
    if match is None:
        raise UnknownMessageError(f"`{name}` is no name of a type: write it as `my_msgs/Foo`")
    try:
        return dict(get_types_from_msg(text, f"{match[1]}/msg/{match[2]}"))
    except (TypesysError, ValueError, RecursionError) as error:
        why = "a line of it is no `TYPE NAME`, as in `float64 x`"  # its text may be anybody's
        raise UnknownMessageError(f"the file of `{name}` is no `.msg`: {why}") from error


Step = Literal["member", "array", "sequence"]


def path_steps(message: MessageType, path: str, ros: int) -> list[tuple[str, Step]]:
    """Gives each part of a path, and whether it is a member or an index of an array or sequence."""
    return [(part, step) for part, step, _ in _steps_to_field(message, path, ros)]


def text_bound(message: MessageType, path: str, ros: int) -> int:
    """Gives the greatest number of bytes of the text at a path; 0 if it has no bound."""
    *_, (_, _, kind) = _steps_to_field(message, path, ros)
    return int(kind[1][1]) if kind[0] == BASE else 0


def _steps_to_field(message: MessageType, path: str, ros: int) -> Iterator[tuple[str, Step, Any]]:
    definitions = message.definitions[ros]
    found: Any = (NAMED, message.ros2)
    for part in path.split("."):
        step: Step = "member"
        if found[0] in (ARRAY, SEQUENCE):
            step = "array" if found[0] == ARRAY else "sequence"
            found = found[1][0]
        else:
            found = dict(definitions[found[1]][1])[part]
        yield part, step, found
