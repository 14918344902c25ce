"""`NAME_bridge.c` and the IDL: which message is which topic, and how it is converted.

Purpose: a table of what comes in and one of what goes out, and the functions that they name. Types
of messages follow ROS 2's middleware: `nav_msgs/Odometry` is `nav_msgs::msg::dds_::Odometry_`, its
members end in `_`, an empty message has one byte, and every record is final.
Non-goals: what is done with them (`runtime/dds/soter_dds_bridge.h`); constants of messages,
services, wide strings (D015).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.mapping.message_types import ARRAY, BASE, SEQUENCE
from soter.targets.bridge_base import c_table
from soter.targets.message_conversion import CYCLONE, MessageConverter, text_literal, unmappable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.mapping.message_types import MessageType
    from soter.mapping.topic_mapping import TopicMap
    from soter.targets.bridge_base import BridgedSystem


ROS = 2
PRIMITIVES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    **{f"{u}int{n}": f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)},
}
_WORDS = """
abstract alias any attribute bitfield bitmask bitset boolean case char component connector const
consumes context custom default double eventtype emits enum exception factory false finder fixed
float getraises home import in inout int8 int16 int32 int64 interface local long manages map
mirrorport module multiple native object octet oneway out port porttype primarykey private provides
public publishes raises readonly sequence setraises short string struct supports switch true
truncatable typedef typeid typename typeprefix uint8 uint16 uint32 uint64 union unsigned uses
valuebase valuetype void wchar wstring
"""
KEYWORDS = frozenset(_WORDS.split())
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
            f"`{name}` of {message.ros2} is not known: wide strings have no IDL here, and types of "
            "one's own are named under `[messages]`"
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


SENSOR_DEPTH, DEFAULT_DEPTH = 5, 10
"""ROS 2's profile for data of sensors, which comes in, and its default, for what goes out."""


class BridgeSource:
    """The bridge of one system; `mapped`: its mapping by topic."""

    def __init__(self, bridged: BridgedSystem, name: str, mapped: dict[int, TopicMap]) -> None:
        self.bridged = bridged
        self.world = bridged.world
        self.name = name
        self.mapped = mapped

    def text(self) -> str:
        """The file."""
        inward = {i: m for i, m in self.mapped.items() if self.bridged.is_inward(i)}
        outward = {i: m for i, m in self.mapped.items() if i not in inward}
        functions = [self._in(i, m) for i, m in inward.items()]
        functions += [self._out(i, m) for i, m in outward.items()]
        prefix, system = self.bridged.unit.prefix, self.bridged.system.name
        law = f'#include "{prefix}_lease.h"\n' if self.bridged.leased else ""
        return f"""\
/* {self.name}_bridge.c: system {system} between DDS and its channels, generated by
 * soter. soter_dds_bridge.h does the work.
 */
#include "{prefix}.h"
#include "{self.name}_messages.h"
{law}#include "soter_dds_bridge.h"

#include <stddef.h>
#include <string.h>

{"".join(f"{f}{chr(10)}" for f in functions)}\
{c_table("soter_dds_inward", "inward", [self._row_in(i, m) for i, m in inward.items()])}
{c_table("soter_dds_outward", "outward", [self._row_out(i, m) for i, m in outward.items()])}
{self._trusted()}
int main(int count, char** words) {{
  const soter_dds_system system = {{"{self.name}_bridge", inward, {len(inward)}, outward, \
{len(outward)}, &trusted}};
  return soter_dds_main(&system, count, words);
}}
"""

    def _trusted(self) -> str:
        """Who says how things are."""
        modules, granted = self.bridged.system.modules, self.world.granted
        names = [self.world.names[t.index] for t in self.world.topics]
        lease = {g.module.index: k for k, g in enumerate(granted)}
        leases = ", ".join(str(lease.get(m.index, -1)) for m in modules)
        return f"""\
static const char* const modules[] = {{{_texts([m.name for m in modules])}}};
static const int32_t lease_of[] = {{{leases or "-1"}}};
static const char* const topics[] = {{{_texts(names)}}};
static const soter_dds_trusted trusted = {{
    .hash = UINT64_C({self.world.status_number:#018x}),
    .actuators_hash = UINT64_C({self.world.actuators_number:#018x}),
    .modules = modules,
    .lease_of = lease_of,
    .topics = topics,
    .module_count = {len(modules)},
    .lease_count = {len(granted)},
    .topic_count = {len(names)},
    .actuator = "{self.bridged.command}_actuator",
}};
"""

    def _head(self, index: int, mapped: TopicMap) -> str:
        message = _message(mapped)
        return f"""\
"{self.world.names[index]}", {self.bridged.channel_hash(index)}, \
sizeof({self.bridged.value_type(index)}),
     {text_literal(f"rt{mapped.channel}")}, &{c_type(message)}_desc, {_qos(index, self, mapped)}"""

    # ------------------------------------------------------------ in

    def _in(self, index: int, mapped: TopicMap) -> str:
        name, message = self.world.names[index], _message(mapped)
        converter = MessageConverter(mapped, ROS, CYCLONE, "(*m)")
        frame = "true"
        if mapped.frame_id is not None:
            there = converter.path("header.frame_id")
            frame = CYCLONE.same_text.format(there, text_literal(mapped.frame_id))
        lines = "\n".join(f"  {line}" for line in converter.inward("(*to)"))
        opened = f"  const {c_type(message)}* const m = given;\n  (void)m;\n"
        return f"""\
/* {mapped.topic.name}: {dds_type(message)} on rt{mapped.channel} */
static bool {name}_frame(const void* given) {{
{opened}  return {frame};
}}

static int64_t {name}_stamp(const void* given) {{
{opened}  return {_stamp(mapped, converter)};
}}

static bool {name}_convert(const void* given, void* value) {{
{opened}  {self.bridged.value_type(index)}* const to = value;
{lines}
}}
"""

    def _row_in(self, index: int, mapped: TopicMap) -> str:
        name = self.world.names[index]
        stamped = "true" if mapped.stamp else "false"
        delay = f"INT64_C({mapped.delay_ns})"
        return f"""\
    {{{self._head(index, mapped)},
     {text_literal(mapped.publisher or "")}, {stamped}, {delay}, {name}_frame, {name}_stamp, \
{name}_convert}},
"""

    # ------------------------------------------------------------ out

    def _out(self, index: int, mapped: TopicMap) -> str:
        name, message = self.world.names[index], _message(mapped)
        converter = MessageConverter(mapped, ROS, CYCLONE, "(*m)")
        lines = [*converter.outward("(*from)")]
        if message.has_header:
            sec, nanosec = (converter.path(f"header.stamp.{p}") for p in ("sec", "nanosec"))
            lines.append(f"{sec} = (int32_t)(stamp / 1000000000);")
            lines.append(f"{nanosec} = (uint32_t)(stamp % 1000000000);")
        body = "\n".join(f"  {line}" for line in lines)
        law = "\n".join(f"  {line}" for line in self.bridged.law_statements(index))
        return f"""\
/* {mapped.topic.name}: {dds_type(message)} on rt{mapped.channel} */
static void {name}_convert(const void* value, int64_t stamp, void* given) {{
  const {self.bridged.value_type(index)}* const from = value;
  {c_type(message)}* const m = given;
  (void)stamp;
{body}
}}

static bool {name}_law(void* to) {{
{law}
}}
"""

    def _row_out(self, index: int, mapped: TopicMap) -> str:
        name = self.world.names[index]
        return f"""\
    {{{self._head(index, mapped)},
     {name}_convert, {name}_law, INT64_C({self.bridged.silent_ns(index)})}},
"""


def _texts(texts: list[str]) -> str:
    """Of a table; C has no empty ones."""
    return ", ".join(text_literal(t) for t in texts) or "NULL"


def _message(mapped: TopicMap) -> MessageType:
    assert mapped.message is not None, mapped
    return mapped.message


def _qos(index: int, source: BridgeSource, mapped: TopicMap) -> str:
    inward = source.bridged.is_inward(index)
    said = mapped.qos
    reliability = said.reliability or ("best_effort" if inward else "reliable")
    depth = (SENSOR_DEPTH if inward else DEFAULT_DEPTH) if said.depth is None else said.depth
    words = [reliability == "reliable", said.durability == "transient_local"]
    return f"{{{', '.join('true' if w else 'false' for w in words)}, {depth}}}"


def _stamp(mapped: TopicMap, converter: MessageConverter) -> str:
    """The C expression of the time at which a message says that it was measured, ns."""
    stamp = mapped.stamp
    if stamp is None:
        return "0"
    if stamp.kind == "time":
        parts = (converter.path(f"{stamp.path}.{p}") for p in ("sec", "nanosec"))
        return f"soter_dds_stamp({', '.join(parts)})"
    unit = stamp.unit_ns
    what = converter.path(stamp.path)
    return f"soter_ns_of_number((long double){what}, {unit.numerator}, {unit.denominator})"
