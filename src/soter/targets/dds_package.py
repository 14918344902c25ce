"""Target `dds`: the package, how it is compiled, and which message is which topic.

Purpose: `dds_package` puts beside the package of target `posix`, which has a folder of its own, the
bridge to DDS, the IDL that `idlc` compiles, a Makefile, and the same for CMake. The bridge is a
table of what comes in, one of what goes out, and the functions that they name. Types of messages
follow ROS 2's middleware: `nav_msgs/Odometry` is `nav_msgs::msg::dds_::Odometry_`, its members end
in `_`, an empty message has one byte, and every record is final.
Non-goals: what is done with them (`runtime/dds/soter_dds_bridge.h`); constants of messages,
services, wide strings (D015).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from soter.mapping.mapping_errors import wrong_mapping_error
from soter.mapping.message_types import ARRAY, BASE, SEQUENCE, MessageType, MessageTypes
from soter.native.shared_library import RUNTIME
from soter.report.templates import filled
from soter.targets.bridge_base import (
    COMMON,
    BridgedSystem,
    bridged_topics,
    maps_by_topic,
    qos_problems,
    require_world,
    unmapped_notes,
)
from soter.targets.message_conversion import CYCLONE, MessageConverter, text_literal, unmappable
from soter.targets.package import Package, PackageFile, filled_file, shipped_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap, TopicMap


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
"""Words of IDL, in any case, which no module may have as its name."""


def dds_type_name(message: MessageType) -> str:
    """The name of a message's type in DDS messages on the network."""
    return "::".join(_name_parts(message.ros2)) + "_"


def c_type_name(message: MessageType) -> str:
    """The name that the tool idlc gives a message's type in C."""
    return dds_type_name(message).replace("::", "_")


def _name_parts(name: str) -> tuple[str, str, str, str]:
    package, _, last = name.split("/")
    return package, "msg", "dds_", last


def message_idl(messages: Iterable[MessageType]) -> str:
    """The text of an IDL file with all types of the messages, each type after its parts."""
    done: dict[str, str] = {}
    for message in messages:
        _add_type_idl(message, message.ros2, done, ())
    return "\n".join(done.values())


def _add_type_idl(
    message: MessageType, name: str, done: dict[str, str], inside: tuple[str, ...]
) -> None:
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
            _add_type_idl(message, inner[1], done, (*inside, name))
    done[name] = _struct_idl(name, [_member_idl(name, n, kind) for n, kind in members])


def _struct_idl(name: str, members: list[str]) -> str:
    package, *middle, last = _name_parts(name)
    if package.lower() in KEYWORDS:
        raise unmappable(f"`{package}` is a word of IDL: no package of messages can be called so")
    opened = " ".join(f"module {m} {{" for m in (package, *middle))
    body = "".join(f"  {m}\n" for m in members)
    return f"{opened}\n@final struct {last}_ {{\n{body}}};\n}}; }}; }};\n"


def _member_idl(owner: str, name: str, kind: Any) -> str:  # noqa: ANN401 - see MessageType
    if kind[0] == ARRAY:
        return f"{_type_idl(owner, kind[1][0])} {name}_[{kind[1][1]}];"
    if kind[0] == SEQUENCE:
        element, bound = kind[1]
        return f"sequence<{_type_idl(owner, element)}{f', {bound}' if bound else ' '}> {name}_;"
    return f"{_type_idl(owner, kind)} {name}_;"


def _type_idl(owner: str, kind: Any) -> str:  # noqa: ANN401 - see MessageType
    if kind[0] != BASE:
        return "::".join(_name_parts(kind[1])) + "_"
    name, bound = kind[1]
    if name == "string":
        return f"string<{bound}>" if bound else "string"
    if name not in PRIMITIVES:
        raise unmappable(f"`{owner}` has a `{name}`, which has no IDL here")
    return PRIMITIVES[name]


SENSOR_DEPTH, DEFAULT_DEPTH = 5, 10
"""The queue depths of ROS 2's profile for sensors, used inward, and its default, used outward."""


def bridge_text(bridged: BridgedSystem, name: str, mapped: dict[int, TopicMap]) -> str:
    """The text of `NAME_bridge.c`; `mapped` has the mapping of each topic, by index."""
    world, modules = bridged.world, bridged.system.modules
    lease = {g.module.index: k for k, g in enumerate(world.granted)}
    by_direction: dict[bool, list[dict[str, object]]] = {True: [], False: []}
    for index, m in mapped.items():
        inward = bridged.is_inward(index)
        way = _inward_values(m) if inward else _outward_values(bridged, m)
        by_direction[inward].append({**_topic_values(bridged, m), **way})
    return filled(
        "targets/dds/bridge.c.j2",
        name=name,
        bridged=bridged,
        inward=by_direction[True],
        outward=by_direction[False],
        modules=[text_literal(m.name) for m in modules],
        lease_of=[lease.get(m.index, -1) for m in modules],
        topics=[text_literal(world.names[t.index]) for t in world.topics],
    )


def _topic_values(bridged: BridgedSystem, mapped: TopicMap) -> dict[str, object]:
    """The template's values for a topic, whether it comes in or goes out."""
    index, message, qos = mapped.topic.index, _message_type(mapped), mapped.qos
    inward = bridged.is_inward(index)
    reliable = (qos.reliability or ("best_effort" if inward else "reliable")) == "reliable"
    depth = (SENSOR_DEPTH if inward else DEFAULT_DEPTH) if qos.depth is None else qos.depth
    return {
        "topic": mapped.topic.name,
        "c_name": bridged.world.names[index],
        "hash": bridged.channel_hash(index),
        "value": bridged.value_type(index),
        "channel": mapped.channel,
        "on_wire": text_literal(f"rt{mapped.channel}"),
        "type": dds_type_name(message),
        "c_type": c_type_name(message),
        "reliable": _bool_word(reliable),
        "latched": _bool_word(qos.durability == "transient_local"),
        "depth": depth,
    }


def _inward_values(mapped: TopicMap) -> dict[str, object]:
    converter = MessageConverter(mapped, ROS, CYCLONE, "(*m)")
    frame = "true"
    if mapped.frame_id is not None:
        frame_id = converter.field_code("header.frame_id")
        frame = CYCLONE.same_text.format(frame_id, text_literal(mapped.frame_id))
    return {
        "frame": frame,
        "stamp": _stamp_code(mapped, converter),
        "stamped": _bool_word(mapped.stamp is not None),
        "delay_ns": mapped.delay_ns,
        "publisher": text_literal(mapped.publisher or ""),
        "lines": converter.inward_statements(),
    }


def _outward_values(bridged: BridgedSystem, mapped: TopicMap) -> dict[str, object]:
    index, converter = mapped.topic.index, MessageConverter(mapped, ROS, CYCLONE, "(*m)")
    lines = converter.outward_statements()
    if _message_type(mapped).has_header:
        sec, nanosec = (converter.field_code(f"header.stamp.{p}") for p in ("sec", "nanosec"))
        lines.append(f"{sec} = (int32_t)(stamp / 1000000000);")
        lines.append(f"{nanosec} = (uint32_t)(stamp % 1000000000);")
    return {
        "lines": lines,
        "law": bridged.law_statements(index),
        "silent_ns": bridged.silent_ns(index),
    }


def _bool_word(holds: bool) -> str:
    return "true" if holds else "false"


def _message_type(mapped: TopicMap) -> MessageType:
    assert mapped.message is not None, mapped
    return mapped.message


def _stamp_code(mapped: TopicMap, converter: MessageConverter) -> str:
    """The C expression for a message's time of measurement in ns."""
    stamp = mapped.stamp
    if stamp is None:
        return "0"
    if stamp.kind == "time":
        parts = (converter.field_code(f"{stamp.path}.{p}") for p in ("sec", "nanosec"))
        return f"soter_dds_stamp({', '.join(parts)})"
    return converter.number_stamp_code(stamp)


SOURCES = (
    *("soter_dds_common.c", "soter_dds_bridge.c", "soter_dds_samples.c"),
    *("soter_dds_peers.c", "soter_dds_report.c", "soter_dds_diagnostics.c"),
)
HEADERS = ("soter_dds_bridge.h", "soter_dds_topics.h")


TOPIC = re.compile(r"(/(?!\w*__)[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)
"""The full names of ROS 2 topics; a DDS topic has `rt` before that."""
LONGEST = 240
"""The most bytes of such a name: some implementations of DDS take no more than 255."""


DIAGNOSTICS = "/diagnostics"
"""The topic of ROS on which the bridge itself reports: no topic of a mapping may be on it."""


def dds_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """Makes the DDS package; SoterError D015 for a bad mapping, U001 for plants in the system."""
    require_world(system)
    mapped = maps_by_topic(bridged_topics(system, mapping, "ROS 2, such as `/odom`", TOPIC), "DDS")
    _require_bridgeable(system, mapped)
    bridged = BridgedSystem(system, core, folder)
    name = bridged.unit.prefix
    sources = [f"src/{n}" for n in (f"{name}_bridge.c", *SOURCES)]
    context = {"name": name, "bridged": bridged, "sources": [*sources, *bridged.linked_sources]}
    files = [
        PackageFile(f"idl/{name}_messages.idl", _idl_text(system, mapped)),
        PackageFile("src/soter_dds_messages.h", f'#include "{name}_messages.h"\n'),
        PackageFile(f"src/{name}_bridge.c", bridge_text(bridged, name, mapped)),
        *(shipped_file(RUNTIME / "dds" / n, "src/") for n in (*HEADERS, *SOURCES)),
        *(shipped_file(RUNTIME / "bridge" / n, "src/") for n in COMMON),
        *(filled_file(n, f"dds/{n}", **context) for n in ("Makefile", "CMakeLists.txt")),
    ]
    return bridged.bridge_package(files, unmapped_notes(system, mapped.values(), "in DDS"))


def _require_bridgeable(system: System, mapped: dict[int, TopicMap]) -> None:
    problems = []
    channels: dict[str, str] = {}
    for m in mapped.values():
        assert m.message is not None
        assert m.channel is not None
        named = f"`{m.topic.name}`"
        if not m.message.exists_in(ROS):
            problems.append(f"{named} has `{m.message.ros1}`, which ROS 2 does not know")
        if m.channel == DIAGNOSTICS:
            problems.append(f"{named}: on `{m.channel}` the bridge says how things are")
        if len(m.channel) > LONGEST:
            problems.append(f"{named}: `{m.channel[:40]}...` is longer than {LONGEST} bytes")
        other = channels.setdefault(m.channel, m.topic.name)
        if other != m.topic.name:
            problems.append(
                f"{named} and `{other}` are both on `{m.channel}`: a topic has one type"
            )
        inward = system.topics[m.topic.index].driver == "input"
        problems += qos_problems(m, inward=inward)
    if problems:
        raise wrong_mapping_error(problems)


def _idl_text(system: System, mapped: dict[int, TopicMap]) -> str:
    messages = [m.message for m in mapped.values() if m.message is not None]
    messages.append(MessageTypes().type_named("diagnostic_msgs/DiagnosticArray"))
    return f"""\
/* The messages of system {system.name} as ROS 2 puts them on the wire, generated by soter. */

{message_idl(messages)}"""
