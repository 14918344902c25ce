"""Target `mavlink`: the package, with the C of the dialect and the mask of set-points.

Purpose: the package of target `posix` in a folder of its own, and beside it the bridge to MAVLink,
the headers of the messages that are used, and one of our own with the checksums of the whole
dialect. A set-point must say `type_mask` and `coordinate_frame`, and its mask ignores exactly what
the mapping does not fill: any other field would be a command of 0.
Non-goals: what a mapping may say (`soter.mapping`), compiling, which masks an autopilot supports.
"""

from __future__ import annotations

import io
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model.durations import show_ns
from soter.mapping.mavlink import MavlinkMessage, comment_text, source_of
from soter.native.shared_library import RUNTIME
from soter.targets.bridge_base import (
    COMMON,
    TRUSTED,
    BridgedSystem,
    bridged_topics,
    by_topic,
    require_world,
    shipped,
    unsaid,
)
from soter.targets.leases_and_lateness import lease_times
from soter.targets.mavlink.bridge_source import BridgeSource
from soter.targets.package import Package, PackageFile, filled_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.mavlink import Dialect
    from soter.mapping.topic_mapping import LogMap, TopicMap


FOLDER = "mavlink"
PROTOCOL = (
    *("protocol.h", "mavlink_types.h", "mavlink_helpers.h", "mavlink_conversions.h"),
    *("mavlink_get_info.h", "mavlink_sha256.h", "checksum.h"),
)
OF_EVERY_BRIDGE = ("HEARTBEAT", "TIMESYNC")


def dialect_headers(dialect: Dialect, used: Iterable[str]) -> list[PackageFile]:
    """The headers, `used` by name."""
    names = sorted({*OF_EVERY_BRIDGE, *used})
    generated = _generated(dialect.xml, {*PROTOCOL, *map(_file, names)})
    files = [PackageFile(f"{FOLDER}/{name}", text) for name, text in sorted(generated.items())]
    own = filled_file(
        f"{FOLDER}/soter_mavlink_dialect.h",
        "mavlink/soter_mavlink_dialect.h",
        title=comment_text(dialect.name),
        checksums=dialect.checksums,
        headers=[_file(name) for name in names],
    )
    return [*files, own]


def _file(message: str) -> str:
    return f"mavlink_msg_{message.lower()}.h"


def _generated(document: bytes, wanted: set[str]) -> dict[str, str]:
    """The files by their names; the generator makes a folder of hundreds, in a moment."""
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
"""Message: bit of its `type_mask`, and the fields that an autopilot then ignores."""


def set_point_problems(mapped: TopicMap) -> list[str]:
    """What is wrong with a topic that goes out."""
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
    said = [(name, bool(mask & bit)) for bit, fields in bits.items() for name in fields]
    return [
        f"{named} `type_mask` {mask} ignores `{name}`, which is filled"
        if ignored
        else f"{named} `type_mask` {mask} commands `{name}`, which nobody fills"
        for name, ignored in said
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
    """The package; SoterError D015 where the mapping does not fit, U001 with plants inside."""
    require_world(system)
    mapped = by_topic(bridged_topics(system, mapping, "MAVLink", None), "MAVLink")
    link = mapping.mavlink
    if link is None:
        raise SoterError((Diagnostic("D015", "no topic of the mapping is a message of MAVLink"),))
    bridged = BridgedSystem(system, core, folder)
    name = bridged.unit.prefix
    source = BridgeSource(bridged, name, mapped, link)
    _refuse(source)
    used = {m.message.name for m in mapped.values() if m.message is not None}
    package = Package(folder)
    package.files = bridged.files()
    package.files += [
        PackageFile(f"src/{name}_bridge.c", source.text()),
        *(shipped(RUNTIME / "mavlink", n) for n in (*HEADERS, *SOURCES)),
        *(shipped(RUNTIME / "bridge", n) for n in COMMON),
        *dialect_headers(link.dialect, used),
        filled_file(
            *("Makefile", "mavlink/Makefile"),
            name=name,
            bridged=bridged,
            sources=[f"src/{n}" for n in SOURCES],
            headers=[f"src/{n}" for n in (*HEADERS, *COMMON)],
        ),
    ]
    package.trusted = TRUSTED
    package.programs = bridged.programs
    package.notes = [
        *bridged.trusted.notes,
        *unsaid(system, mapped.values(), "in MAVLink"),
        *_notes(source),
    ]
    channels = f"/dev/shm/{name}"  # noqa: S108 - where channels belong
    package.commands = [
        f"make -C {folder}",
        f"{folder}/build/{name}_bridge --channels {channels}",
    ]
    return package


def _refuse(source: BridgeSource) -> None:
    """SoterError D015 for what no autopilot should be sent, or can be asked."""
    problems: list[str] = []
    for m in (*source.inward.values(), *source.outward.values()):
        problems += _of_other_middleware(m)
    for m in source.inward.values():
        problems += _wrong_source(m)
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
    problems += _too_late(source)
    dialect = source.link.dialect
    problems += [
        f"the dialect `{dialect.name}` has no message {name}, which every bridge sends: include "
        "`minimal.xml` and `common.xml` of MAVLink"
        for name in OF_EVERY_BRIDGE
        if name not in dialect.messages
    ]
    if problems:
        raise SoterError(tuple(Diagnostic("D015", p) for p in problems))


def _of_other_middleware(m: TopicMap) -> Iterator[str]:
    """What a mapping says of a topic that MAVLink does not know."""
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


def _wrong_source(m: TopicMap) -> list[str]:
    named = f"`{m.topic.name}`"
    if m.publisher is None:
        return []
    if source_of(m.publisher) is None:
        return [f"`publisher` of {named} is a system and a component, as 1/191: {m.publisher!r}"]
    if m.stamp is not None:
        what = f"`publisher` {m.publisher} has a clock of its own, which nobody synchronises"
        return [f'{named}: {what}: `stamp` is "arrival"']
    return []


def _too_late(source: BridgeSource) -> list[str]:
    """Where the law of a silent trusted part would come after the autopilot's patience."""
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


def _notes(source: BridgeSource) -> list[str]:
    link, system = source.link, source.bridged.system
    loss = show_ns(link.offboard_loss_ns)
    text = (
        f"set COM_OF_LOSS_T to {loss}: where this computer or the bridge ends, the autopilot keeps "
        "the last set-point for so long, and then does what COM_OBL_RC_ACT says: no proof of this "
        "program is about that"
    )
    notes = [text]
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
