"""Target `mavlink`: the package.

Purpose: the package of target `posix` in a folder of its own, and beside it the bridge to MAVLink.
Non-goals: what a mapping may say (`soter.mapping`), compiling.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model.durations import show_ns
from soter.mapping.mavlink_link import source_of
from soter.mapping.mavlink_types import MavlinkMessage
from soter.native.build import RUNTIME
from soter.native.compiler import MEANING
from soter.targets.bridge_base_package import COMMON, TRUSTED, BridgedSystem, require_world, shipped
from soter.targets.bridged_topics import bridged_topics, by_topic, unsaid
from soter.targets.leases import lease_times
from soter.targets.mavlink.bridge_source import BridgeSource
from soter.targets.mavlink.dialect_headers import FOLDER, OF_EVERY_BRIDGE, dialect_headers
from soter.targets.mavlink.set_point_mask_check import set_point_problems
from soter.targets.package import Package, PackageFile

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap, TopicMap

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
        PackageFile("Makefile", _makefile(name, bridged.linked)),
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
        named = f"`{m.topic.name}`"
        if m.channel is not None:
            problems.append(
                f"{named}: MAVLink has no channels: its links are `url` of `mavlink`, and whose "
                "messages it takes says `publisher`"
            )
        if not isinstance(m.message, MavlinkMessage):
            shown = m.message.ros1 if m.message else "no type"
            problems.append(f"{named} is `{shown}`, no message of MAVLink")
        if m.frame_id is not None:
            problems.append(f"{named}: MAVLink has no `frame_id`: say the field in `set`")
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


def _makefile(name: str, linked: list[str]) -> str:
    sources = [*(f"src/{n}" for n in (f"{name}_bridge.c", *SOURCES)), *linked]
    headers = " ".join(f"src/{n}" for n in (*HEADERS, *COMMON))
    return f"""\
# Written by soter. Needs a C compiler for Linux.
CC ?= cc
CFLAGS ?= -O2
# these belong to the meaning of the program: one rounding an operation, on every compiler
FLAGS = -std=c99 {" ".join(MEANING)} -Wall -Wextra -D_GNU_SOURCE

.PHONY: all trusted clean
all: trusted build/{name}_bridge

# the trusted part and its actuators: C, and nothing of MAVLink
trusted:
	$(MAKE) -C {TRUSTED}

# the headers of MAVLink are generated: their warnings are not yours
build/{name}_bridge: {" ".join(sources)} {headers}
	mkdir -p build
	$(CC) $(CFLAGS) $(FLAGS) -I{TRUSTED} -Isrc -isystem {FOLDER} -o $@ $(filter %.c,$^) -pthread

clean:
	rm -rf build
	$(MAKE) -C {TRUSTED} clean
"""
