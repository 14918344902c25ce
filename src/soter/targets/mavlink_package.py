"""Target `mavlink`: the package, the C of the dialect, and which message is which topic.

Purpose: `mavlink_package` puts beside the package of target `posix`, which has a folder of its own,
the bridge to MAVLink, the headers of the messages that are used, and one of our own with the
checksums of the whole dialect. The bridge is a table of what comes in, one of what goes out, and
the functions that they name. A set-point must say `type_mask` and `coordinate_frame`, and its mask
ignores exactly what the mapping does not fill: any other field would be a command of 0.
Non-goals: what is done with them (`runtime/mavlink/soter_mavlink_bridge.h`), what a mapping may say
(`soter.mapping`), compiling, which masks an autopilot supports.
"""

from __future__ import annotations

import io
import re
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns
from soter.mapping.mapping_errors import wrong_mapping_error
from soter.mapping.mavlink_dialects import (
    MAVLINK,
    MavlinkLink,
    MavlinkMessage,
    comment_text,
    parse_source,
)
from soter.mapping.mavlink_dialects import Dialect as MavlinkDialect
from soter.mapping.message_types import path_steps
from soter.native.shared_library import RUNTIME
from soter.report.templates import filled
from soter.targets.bridge_base import (
    COMMON,
    BridgedSystem,
    bridged_topics,
    maps_by_topic,
    require_world,
    unmapped_notes,
)
from soter.targets.leases import lease_times
from soter.targets.message_conversion import (
    FLOATS,
    INTEGERS,
    Dialect,
    MessageConverter,
    refusal_code,
    unmappable,
)
from soter.targets.message_conversion import text_literal as text
from soter.targets.package import Package, PackageFile, filled_file, shipped_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap, TopicMap


MAVLINK_C = Dialect(
    *("", "", "strncmp({0}, {1}, sizeof {0}) == 0", "(void)strncpy({0}, {1}, sizeof {0})"),
    set_bounded="(void)strncpy({0}, {1}, sizeof {0})",
)
"""How pymavlink's C is written: it has no sequences, and a text that fills its array has no NUL."""
STAMPED = {"time_boot_ms": 1_000_000, "time_usec": 1_000}
"""The fields that say when a message goes out, with their units in ns."""
_LIMIT = re.compile(r"(U?)INT(8|16|32|64)_MAX")


class BridgeSource:
    """Writes the MAVLink bridge of one system; `mapped` has the mapping of each topic."""

    def __init__(
        self, bridged: BridgedSystem, name: str, mapped: dict[int, TopicMap], link: MavlinkLink
    ) -> None:
        self.bridged = bridged
        self.world = bridged.world
        self.name = name
        self.link = link
        self.inward = {i: m for i, m in mapped.items() if bridged.is_inward(i)}
        self.outward = {i: m for i, m in mapped.items() if i not in self.inward}
        publishers = (parse_source(m.publisher) for m in self.inward.values() if m.publisher)
        self.sources = list(dict.fromkeys([link.autopilot, *(p for p in publishers if p)]))

    def bridge_text(self) -> str:
        """The text of `NAME_bridge.c`."""
        return filled(
            "targets/mavlink/bridge.c.j2",
            name=self.name,
            system=self.bridged.system,
            bridged=self.bridged,
            link=self.link,
            urls=[text(u) for u in self.link.urls],
            sources=self.sources,
            inward=[self._inward_values(i, m) for i, m in self.inward.items()],
            outward=[self._outward_values(i, m) for i, m in self.outward.items()],
        )

    def _topic_values(self, index: int, mapped: TopicMap) -> dict[str, object]:
        message = _message_type(mapped)
        return {
            "topic": mapped.topic.name,
            "c_name": self.world.names[index],
            "hash": self.bridged.channel_hash(index),
            "value": self.bridged.value_type(index),
            "message": message,
            "low": message.name.lower(),
            "text": text(message.name),
        }

    def _inward_values(self, index: int, mapped: TopicMap) -> dict[str, object]:
        converter = MessageConverter(mapped, MAVLINK, MAVLINK_C, "m")
        message, constants = _message_type(mapped), mapped.constants
        source = parse_source(mapped.publisher) if mapped.publisher else None
        inward = converter.inward_statements()
        return {
            **self._topic_values(index, mapped),
            "lines": [
                *_version_1_refusal(mapped),
                *_unknown_value_refusals(mapped, converter),
                *inward,
            ],
            "tests": [
                _equality_test(message, path, value, converter) for path, value in constants.items()
            ],
            "stamp": converter.number_stamp_code(mapped.stamp) if mapped.stamp else "-1",
            "stamped": "true" if mapped.stamp else "false",
            "whose": self.sources.index(source or self.link.autopilot),
        }

    def _outward_values(self, index: int, mapped: TopicMap) -> dict[str, object]:
        converter = MessageConverter(mapped, MAVLINK, MAVLINK_C, "m")
        return {
            **self._topic_values(index, mapped),
            "lines": [*_address_statements(mapped), *converter.outward_statements()],
            "law": self.bridged.law_statements(index),
            "silent_ns": self.bridged.silent_ns(index),
        }


def _message_type(mapped: TopicMap) -> MavlinkMessage:
    assert isinstance(mapped.message, MavlinkMessage), mapped
    return mapped.message


def _equality_test(
    message: MavlinkMessage, path: str, value: object, converter: MessageConverter
) -> str:
    """The C condition that a field has the value that the mapping prescribes in `set`."""
    field, kind = converter.field_code(path), message.primitive_type(path)
    if isinstance(value, str):
        return f"({MAVLINK_C.same_text.format(field, text(value))})"
    if kind in FLOATS:
        return f"{field} == {f'(float){float(str(value))!r}' if kind == 'float32' else value}"
    return f"(int64_t){field} == INT64_C({value})"


def _version_1_refusal(mapped: TopicMap) -> Iterator[str]:
    """C statements that refuse MAVLink 1 frames if the mapping reads extension fields."""
    stamp = [mapped.stamp.path] if mapped.stamp is not None else []
    read = {path.partition(".")[0] for path in (*mapped.names, *mapped.constants, *stamp)}
    if read & _message_type(mapped).extensions:
        yield from refusal_code("raw->magic != MAVLINK_STX")


def _unknown_value_refusals(mapped: TopicMap, converter: MessageConverter) -> Iterator[str]:
    """C statements that refuse a message if a field holds MAVLink's number for "not known"."""
    message = _message_type(mapped)
    for name in mapped.names:
        (field, _), *inside = path_steps(message, name, MAVLINK)
        unknown = message.invalid.get(field, "").strip("[]").partition(",")[0].rstrip(":")
        kind = message.primitive_type(name)
        names = dict.fromkeys([name, *([f"{field}.0"] if inside else [])])
        tests = [_unknown_value_test(converter.field_code(n), kind, unknown) for n in names]
        if unknown and all(tests):
            yield from refusal_code(" || ".join(tests))


def _unknown_value_test(at: str, kind: str, none: str) -> str:
    """The C condition that a field holds `none`, MAVLink's number for "not known"; or ""."""
    if kind in FLOATS:
        if none.upper() == "NAN":
            return f"{at} != {at}"
        return f"{at} == {float(none)!r}" if re.fullmatch(r"-?\d+(\.\d+)?", none) else ""
    if kind in INTEGERS and (_LIMIT.fullmatch(none) or re.fullmatch(r"-?\d+|0x[0-9A-F]+", none)):
        return f"(int64_t){at} == (int64_t){none}"
    return ""


def _address_statements(mapped: TopicMap) -> Iterator[str]:
    """C statements that set receiver and time of a message, unless the mapping sets them."""
    message = _message_type(mapped)
    filled = {*mapped.names, *mapped.constants}
    stamped = {"target_system": "e->to.system", "target_component": "e->to.component"}
    stamped |= {n: f"(uint64_t)(e->written_ns / {unit})" for n, unit in STAMPED.items()}
    for name in message.fields_in_order:
        if name in stamped and name not in filled:
            cast = "(uint32_t)" if message.primitive_type(name) == "uint32" else ""
            yield f"m.{name} = {cast}{stamped[name]};"


FOLDER = "mavlink"
PROTOCOL = (
    *("protocol.h", "mavlink_types.h", "mavlink_helpers.h", "mavlink_conversions.h"),
    *("mavlink_get_info.h", "mavlink_sha256.h", "checksum.h"),
)
OF_EVERY_BRIDGE = ("HEARTBEAT", "TIMESYNC")


def dialect_headers(dialect: MavlinkDialect, used: Iterable[str]) -> list[PackageFile]:
    """The headers of a dialect that a bridge with these messages needs."""
    names = sorted({*OF_EVERY_BRIDGE, *used})
    generated = _generated_headers(dialect.xml, {*PROTOCOL, *map(_header_name, names)})
    files = [PackageFile(f"{FOLDER}/{name}", text) for name, text in sorted(generated.items())]
    header = filled_file(
        f"{FOLDER}/soter_mavlink_dialect.h",
        "mavlink/soter_mavlink_dialect.h",
        title=comment_text(dialect.name),
        checksums=dialect.checksums,
        headers=[_header_name(name) for name in names],
    )
    return [*files, header]


def _header_name(message: str) -> str:
    return f"mavlink_msg_{message.lower()}.h"


def _generated_headers(document: bytes, wanted: set[str]) -> dict[str, str]:
    """Maps the name of each `wanted` header that pymavlink generates to its text."""
    from pymavlink.generator import mavgen  # noqa: PLC0415 - an extra

    with tempfile.TemporaryDirectory() as place:
        at = Path(place) / "dialect.xml"
        at.write_bytes(document)
        options = mavgen.Opts(place, wire_protocol="2.0", language="C", validate=False)
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            mavgen.mavgen(options, [str(at)])
        found = {p.name: p for p in sorted(Path(place).rglob("*.h")) if p.name in wanted}
        assert set(found) == wanted, wanted - set(found)
        return {name: p.read_text("utf-8") for name, p in found.items()}


_POSITION: dict[int, tuple[str, ...]] = {
    **{1 << k: (name,) for k, name in enumerate(("x", "y", "z", "vx", "vy", "vz"))},
    **{64 << k: (name,) for k, name in enumerate(("afx", "afy", "afz"))},
    1024: ("yaw",),
    2048: ("yaw_rate",),
}
_GLOBAL = {**_POSITION, 1: ("lat_int",), 2: ("lon_int",), 4: ("alt",)}
IGNORED: dict[str, dict[int, tuple[str, ...]]] = {
    "SET_POSITION_TARGET_LOCAL_NED": _POSITION,
    "SET_POSITION_TARGET_GLOBAL_INT": _GLOBAL,
    "SET_ATTITUDE_TARGET": {
        1: ("body_roll_rate",),
        2: ("body_pitch_rate",),
        4: ("body_yaw_rate",),
        64: ("thrust",),
        128: ("q.0", "q.1", "q.2", "q.3"),
    },
}
"""The fields that an autopilot ignores by a bit of `type_mask`, by message and bit."""


def set_point_problems(mapped: TopicMap) -> list[str]:
    """The mistakes in `set` and `type_mask` of an outgoing set-point."""
    message = mapped.message
    bits = IGNORED.get(message.name if message else "")
    if message is None or bits is None:
        return []
    named = f"`{mapped.topic.name}`, {message.ros1}:"
    needed = ["type_mask"]
    needed += ["coordinate_frame"] * (message.name != "SET_ATTITUDE_TARGET")
    missing = [k for k in needed if k not in mapped.constants and k not in mapped.names]
    if missing:
        names = ", ".join(f"`{k}`" for k in missing)
        return [f"{named} `set` has to say {names}: 0 would be a command"]
    mask = mapped.constants.get("type_mask")
    if not isinstance(mask, int):
        return [f"{named} `type_mask` is a constant of the mapping: say it in `set`"]
    filled = {*mapped.names, *mapped.constants}
    bits_set = [(name, bool(mask & bit)) for bit, fields in bits.items() for name in fields]
    return [
        f"{named} `type_mask` {mask} ignores `{name}`, which is filled"
        if ignored
        else f"{named} `type_mask` {mask} commands `{name}`, which nobody fills"
        for name, ignored in bits_set
        if ignored == (name in filled)
    ]


SOURCES = (
    *("soter_mavlink_bridge.c", "soter_mavlink_topics.c", "soter_mavlink_link.c"),
    *("soter_mavlink_clock.c", "soter_mavlink_report.c", "soter_mavlink_shared.c"),
)
HEADERS = (
    *("soter_mavlink_bridge.h", "soter_mavlink_topics.h", "soter_mavlink_link.h"),
    "soter_mavlink_clock.h",
)
SOURCES_MAX, TOPICS_MAX = 16, 64


def mavlink_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """Makes the MAVLink package; SoterError D015 for a bad mapping, U001 for plants inside."""
    require_world(system)
    mapped = maps_by_topic(bridged_topics(system, mapping, "MAVLink", None), "MAVLink")
    link = mapping.mavlink
    if link is None:
        raise unmappable("no topic of the mapping is a message of MAVLink")
    bridged = BridgedSystem(system, core, folder)
    name = bridged.unit.prefix
    source = BridgeSource(bridged, name, mapped, link)
    _require_sendable(source)
    used = {m.message.name for m in mapped.values() if m.message is not None}
    files = [
        PackageFile(f"src/{name}_bridge.c", source.bridge_text()),
        *(shipped_file(RUNTIME / "mavlink" / n, "src/") for n in (*HEADERS, *SOURCES)),
        *(shipped_file(RUNTIME / "bridge" / n, "src/") for n in COMMON),
        *dialect_headers(link.dialect, used),
        filled_file(
            *("Makefile", "mavlink/Makefile"),
            name=name,
            bridged=bridged,
            sources=[f"src/{n}" for n in SOURCES],
            headers=[f"src/{n}" for n in (*HEADERS, *COMMON)],
        ),
    ]
    notes = [*unmapped_notes(system, mapped.values(), "in MAVLink"), *_offboard_loss_notes(source)]
    return bridged.bridge_package(files, notes)


def _require_sendable(source: BridgeSource) -> None:
    """Raises SoterError D015 for a mapping that an autopilot must not get or cannot answer."""
    problems: list[str] = []
    for m in (*source.inward.values(), *source.outward.values()):
        problems += _middleware_mistakes(m)
    for m in source.inward.values():
        problems += _source_mistakes(m)
    out: dict[str, str] = {}
    for m in source.outward.values():
        if m.publisher is not None:
            problems.append(f"`{m.topic.name}` goes out: `publisher` is who sends what comes in")
        problems += set_point_problems(m)
        message = m.message.name if m.message else ""
        other = out.setdefault(message, m.topic.name)
        if other != m.topic.name:
            problems.append(f"`{m.topic.name}` and `{other}` are both {message}: one a system")
        if message in ("HEARTBEAT", "TIMESYNC"):
            problems.append(f"`{m.topic.name}`: {message} is the bridge's own")
    if len(source.sources) > SOURCES_MAX:
        problems.append(f"the mapping names more than {SOURCES_MAX} publishers")
    if len(source.inward) + len(source.outward) > TOPICS_MAX:
        problems.append(f"the mapping names more than {TOPICS_MAX} topics")
    problems += _late_law_mistakes(source)
    dialect = source.link.dialect
    problems += [
        f"the dialect `{dialect.name}` has no message {name}, which every bridge sends: include "
        "`minimal.xml` and `common.xml` of MAVLink"
        for name in OF_EVERY_BRIDGE
        if name not in dialect.messages
    ]
    if problems:
        raise wrong_mapping_error(problems)


def _middleware_mistakes(m: TopicMap) -> Iterator[str]:
    """Yields a mistake for each entry of a topic's mapping that MAVLink does not support."""
    named = f"`{m.topic.name}`"
    if m.channel is not None:
        yield (
            f"{named}: MAVLink has no channels: its links are `url` of `mavlink`, and whose "
            "messages it takes says `publisher`"
        )
    if not isinstance(m.message, MavlinkMessage):
        yield f"{named} is `{m.message.ros1 if m.message else 'no type'}`, no message of MAVLink"
    if m.frame_id is not None:
        yield f"{named}: MAVLink has no `frame_id`: say the field in `set`"


def _source_mistakes(m: TopicMap) -> list[str]:
    named = f"`{m.topic.name}`"
    if m.publisher is None:
        return []
    if parse_source(m.publisher) is None:
        return [f"`publisher` of {named} is a system and a component, as 1/191: {m.publisher!r}"]
    if m.stamp is not None:
        problem = f"`publisher` {m.publisher} has a clock of its own, which nobody synchronises"
        return [f'{named}: {problem}: `stamp` is "arrival"']
    return []


def _late_law_mistakes(source: BridgeSource) -> list[str]:
    """The mistakes that the law of a silent trusted part would come after `offboard_loss`."""
    link = source.link
    problems = []
    for index, m in source.outward.items():
        latest = source.bridged.silent_ns(index) + 2 * link.resend_ns
        if index in source.bridged.leased and latest > link.offboard_loss_ns:
            problems.append(
                f"`{m.topic.name}`: `offboard_loss` is {show_ns(link.offboard_loss_ns)}, and the "
                f"law may come {show_ns(latest)} after the last set-point"
            )
    return problems


def _offboard_loss_notes(source: BridgeSource) -> list[str]:
    link, system = source.link, source.bridged.system
    loss = show_ns(link.offboard_loss_ns)
    notes = [
        (
            f"set COM_OF_LOSS_T to {loss}: where this computer or the bridge ends, the autopilot "
            "keeps the last set-point for so long, and then does what COM_OBL_RC_ACT says: no "
            "proof of this program is about that"
        )
    ]
    for index, m in source.outward.items():
        lease = source.bridged.leased.get(index)
        if lease is None:
            silent = show_ns(source.bridged.silent_ns(index))
            notes.append(
                f"{m.topic.name}: no fail-safe law: where the trusted part is silent for "
                f"{silent}, set-points end, and the autopilot leaves "
                f"OFFBOARD {loss} after the last one"
            )
            continue
        longest = lease_times(system, lease.module).longest
        if link.offboard_loss_ns > longest:
            notes.append(
                f"{m.topic.name}: a lease of {lease.module.name} ends after {show_ns(longest)} at "
                f"most, COM_OF_LOSS_T after {loss}: the last set-point outlives its lease where "
                "the bridge ends"
            )
    if link.delay_ns is None and any(m.stamp is None for m in source.inward.values()):
        names = ", ".join(m.topic.name for m in source.inward.values() if m.stamp is None)
        notes.append(f"no `delay` in `mavlink`: {names} count as measured when they come")
    return notes
