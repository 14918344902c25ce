"""How the package of target `dds` is compiled: a Makefile, and the same for CMake.

Purpose: the trusted part and the actuators as target `posix` builds them, and the bridge with what
`idlc` makes of the IDL.
Non-goals: the sources (`bridge_source.py`, `targets/posix.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.native.compiler import MEANING
from soter.targets.bridge_base_package import TRUSTED, cmake_programs
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from soter.targets.bridge_base_package import BridgedSystem

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
