"""Target `dds`: the package, and how it is compiled.

Purpose: the package of target `posix` in a folder of its own, and beside it the bridge to DDS with
what `idlc` makes of the IDL; a Makefile, and the same for CMake.
Non-goals: what a mapping may say (`soter.mapping`), the sources (`bridge_source.py`), compiling.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.mapping.message_types import MessageTypes
from soter.native.compiler import MEANING
from soter.native.shared_library import RUNTIME
from soter.targets.bridge_base import (
    COMMON,
    TRUSTED,
    BridgedSystem,
    bridged_topics,
    by_topic,
    cmake_programs,
    require_world,
    shipped,
    unsaid,
)
from soter.targets.dds.bridge_source import ROS, BridgeSource, message_idl
from soter.targets.package import Package, PackageFile

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap, TopicMap


SOURCES = (
    *(
        "soter_dds_common.c",
        "soter_dds_bridge.c",
        "soter_dds_samples.c",
        "soter_dds_peers.c",
        "soter_dds_report.c",
        "soter_dds_diagnostics.c",
    ),
)
HEADERS = ("soter_dds_bridge.h", "soter_dds_topics.h")


@dataclass(frozen=True)
class DdsPackage:
    """What the files are about: a bridge, and the system that it is around."""

    name: str
    bridged: BridgedSystem

    @property
    def bridge_sources(self) -> list[str]:
        """Of the bridge, but for what is made of the IDL."""
        own = [f"{self.name}_bridge.c", *SOURCES]
        return [*(f"src/{n}" for n in own), *self.bridged.linked]


def build_files(p: DdsPackage) -> list[PackageFile]:
    """Both."""
    return [PackageFile("Makefile", _makefile(p)), PackageFile("CMakeLists.txt", _cmake(p))]


def _makefile(p: DdsPackage) -> str:
    sources = " ".join(p.bridge_sources)
    return f"""\
# Written by soter. Needs Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools) and pkg-config.
CC ?= cc
IDLC ?= idlc
# -std=gnu99: headers of Cyclone DDS have assembler; the rest belongs to the meaning of the program
CFLAGS ?= -O2
FLAGS = -std=gnu99 {" ".join(MEANING)} -Wall -Wextra -D_GNU_SOURCE -I{TRUSTED} -Isrc -Ibuild
DDS_FLAGS := $(shell pkg-config --cflags CycloneDDS)
DDS_LIBS := $(shell pkg-config --libs CycloneDDS)
MESSAGES = build/{p.name}_messages

.PHONY: all trusted clean
all: trusted build/{p.name}_bridge

# the trusted part and its actuators: C, and nothing of DDS
trusted:
	$(MAKE) -C {TRUSTED}

$(MESSAGES).c: idl/{p.name}_messages.idl
	mkdir -p build
	$(IDLC) -f case-sensitive -o build $<

build/{p.name}_bridge: {sources} $(MESSAGES).c
	$(CC) $(CFLAGS) $(FLAGS) $(DDS_FLAGS) -o $@ $^ $(DDS_LIBS) -pthread

clean:
	rm -rf build
	$(MAKE) -C {TRUSTED} clean
"""


def _cmake(p: DdsPackage) -> str:
    names = " ".join([*p.bridged.sources, f"{p.name}_bridge"])
    return f"""\
# Written by soter. Needs Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools):
#   cmake -S . -B build && cmake --build build
cmake_minimum_required(VERSION 3.16)
project({p.name} C)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_C_STANDARD 99) # with extensions: headers of Cyclone DDS have assembler
set(CMAKE_C_FLAGS_RELEASE "-O2")
# these belong to the meaning of the program: one rounding an operation, on every compiler
add_compile_options({" ".join(MEANING)})

find_package(CycloneDDS REQUIRED)

# the trusted part and its actuators: C, and nothing of DDS
{cmake_programs(p.bridged.sources)}
# the bridge between DDS and their channels; the types are those of ROS 2
set(MESSAGES ${{CMAKE_CURRENT_BINARY_DIR}}/{p.name}_messages)
add_custom_command(OUTPUT ${{MESSAGES}}.c ${{MESSAGES}}.h
  COMMAND CycloneDDS::idlc -f case-sensitive -o ${{CMAKE_CURRENT_BINARY_DIR}}
    ${{CMAKE_CURRENT_SOURCE_DIR}}/idl/{p.name}_messages.idl
  DEPENDS idl/{p.name}_messages.idl)
add_executable({p.name}_bridge {" ".join(p.bridge_sources)}
  ${{MESSAGES}}.c)
target_compile_definitions({p.name}_bridge PRIVATE _GNU_SOURCE)
target_include_directories({p.name}_bridge PRIVATE {TRUSTED} src ${{CMAKE_CURRENT_BINARY_DIR}})
target_link_libraries({p.name}_bridge PRIVATE CycloneDDS::ddsc pthread)

install(TARGETS {names} RUNTIME DESTINATION bin)
"""


TOPIC = re.compile(r"(/(?!\w*__)[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)
"""What a topic of ROS 2 may be called, in full: of its DDS topic `rt` stands before it."""
LONGEST = 240
"""Bytes of such a name: some implementations of DDS take no more than 255."""


DIAGNOSTICS = "/diagnostics"
"""Where everybody looks who knows ROS."""


def dds_package(system: System, core: CoreSystem, folder: Path, mapping: LogMap) -> Package:
    """The package; SoterError D015 where the mapping does not fit, U001 with plants inside."""
    require_world(system)
    mapped = by_topic(bridged_topics(system, mapping, "ROS 2, such as `/odom`", TOPIC), "DDS")
    _refuse(system, mapped)
    bridged = BridgedSystem(system, core, folder)
    name = bridged.unit.prefix
    source = BridgeSource(bridged, name, mapped)
    package = Package(folder)
    package.files = bridged.files()
    package.files += [
        PackageFile(f"idl/{name}_messages.idl", _idl(system, mapped)),
        PackageFile("src/soter_dds_messages.h", f'#include "{name}_messages.h"\n'),
        PackageFile(f"src/{name}_bridge.c", source.text()),
        *(shipped(RUNTIME / "dds", n) for n in (*HEADERS, *SOURCES)),
        *(shipped(RUNTIME / "bridge", n) for n in COMMON),
        *build_files(DdsPackage(name, bridged)),
    ]
    package.trusted = TRUSTED
    package.programs = bridged.programs
    package.notes = [*bridged.trusted.notes, *unsaid(system, mapped.values(), "in DDS")]
    channels = f"/dev/shm/{name}"  # noqa: S108 - where channels belong
    package.commands = [
        f"make -C {folder}",
        f"{folder}/build/{name}_bridge --channels {channels}",
    ]
    return package


def _refuse(system: System, mapped: dict[int, TopicMap]) -> None:
    problems = []
    channels: dict[str, str] = {}
    for m in mapped.values():
        assert m.message is not None
        assert m.channel is not None
        named = f"`{m.topic.name}`"
        if not m.message.known_in(ROS):
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
        if inward and m.stamp is None and m.qos.durability == "transient_local":
            problems.append(
                f"{named} has no stamp and is `transient_local`: what somebody published long ago "
                "would count as measured when it comes"
            )
        if not inward and m.qos.depth == 0:
            problems.append(
                f"{named} goes out with all of its history: a reader that stopped would hold up "
                "what the others read"
            )
    if problems:
        raise SoterError(tuple(Diagnostic("D015", p) for p in problems))


def _idl(system: System, mapped: dict[int, TopicMap]) -> str:
    messages = [m.message for m in mapped.values() if m.message is not None]
    messages.append(MessageTypes().named("diagnostic_msgs/DiagnosticArray"))
    return f"""\
/* The messages of system {system.name} as ROS 2 puts them on the wire, generated by soter. */

{message_idl(messages)}"""
