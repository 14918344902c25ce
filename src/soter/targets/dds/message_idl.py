"""The types of messages as IDL, by the conventions of ROS 2's middleware.

Purpose: `nav_msgs/Odometry` is `nav_msgs::msg::dds_::Odometry_`, its members end in `_`, an empty
message has one byte, and every record is final. The names of C that `idlc` makes of them.
Non-goals: constants of messages, services, wide strings (D015).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.mapping.message_types import ARRAY, BASE, SEQUENCE
from soter.targets.message_conversion import unmappable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.mapping.message_types import MessageType

ROS = 2
PRIMITIVES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    **{f"{u}int{n}": f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)},
}
KEYWORDS = frozenset(
    """abstract alias any attribute bitfield bitmask bitset boolean case char component connector
    const consumes context custom default double eventtype emits enum exception factory false
    finder fixed float getraises home import in inout int8 int16 int32 int64 interface local long
    manages map mirrorport module multiple native object octet oneway out port porttype primarykey
    private provides public publishes raises readonly sequence setraises short string struct
    supports switch true truncatable typedef typeid typename typeprefix uint8 uint16 uint32 uint64
    union unsigned uses valuebase valuetype void wchar wstring""".split()
)
"""Of IDL, in any case: no module is called so."""


def dds_type(message: MessageType) -> str:
    """The name of the type on the wire."""
    return "::".join(_modules(message.ros2)) + "_"


def c_type(message: MessageType) -> str:
    """What idlc calls it in C."""
    return dds_type(message).replace("::", "_")


def _modules(name: str) -> tuple[str, str, str, str]:
    package, _, last = name.split("/")
    return package, "msg", "dds_", last


def message_idl(messages: Iterable[MessageType]) -> str:
    """One file: every type that the messages are made of, parts first."""
    done: dict[str, str] = {}
    for message in messages:
        _add(message, message.ros2, done, ())
    return "\n".join(done.values())


def _add(message: MessageType, name: str, done: dict[str, str], inside: tuple[str, ...]) -> None:
    if name in done:
        return
    definitions = message.definitions[ROS]
    if name in inside:
        raise unmappable(f"`{name}` of {message.ros2} holds itself, which no IDL says")
    if name not in definitions:
        raise unmappable(
            f"`{name}` of {message.ros2} is not known: wide strings have no IDL, and types of one's "
            "own are named under `[messages]`"
        )
    members = definitions[name][1]
    for _, kind in members:
        inner = kind[1][0] if kind[0] in (ARRAY, SEQUENCE) else kind
        if inner[0] != BASE:
            _add(message, inner[1], done, (*inside, name))
    done[name] = _struct(name, [_member(name, n, kind) for n, kind in members])


def _struct(name: str, members: list[str]) -> str:
    package, *middle, last = _modules(name)
    if package.lower() in KEYWORDS:
        raise unmappable(f"`{package}` is a word of IDL: no package of messages can be called so")
    opened = " ".join(f"module {m} {{" for m in (package, *middle))
    body = "".join(f"  {m}\n" for m in members)
    return f"{opened}\n@final struct {last}_ {{\n{body}}};\n}}; }}; }};\n"


def _member(owner: str, name: str, kind: Any) -> str:  # noqa: ANN401 - see MessageType
    if kind[0] == ARRAY:
        return f"{_type(owner, kind[1][0])} {name}_[{kind[1][1]}];"
    if kind[0] == SEQUENCE:
        element, bound = kind[1]
        return f"sequence<{_type(owner, element)}{f', {bound}' if bound else ' '}> {name}_;"
    return f"{_type(owner, kind)} {name}_;"


def _type(owner: str, kind: Any) -> str:  # noqa: ANN401 - see MessageType
    if kind[0] != BASE:
        return "::".join(_modules(kind[1])) + "_"
    name, bound = kind[1]
    if name == "string":
        return f"string<{bound}>" if bound else "string"
    if name not in PRIMITIVES:
        raise unmappable(f"`{owner}` has a `{name}`, which has no IDL here")
    return PRIMITIVES[name]
