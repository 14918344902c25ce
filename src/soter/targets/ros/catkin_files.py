"""What catkin, roslaunch and people want of a package: manifest, CMake, launch file, page.

Purpose: the text around the nodes. It builds with catkin, and with plain CMake where ROS comes from
the distribution (pkg-config), as on Debian.
Non-goals: the nodes (`node_sources.py`), the trusted part (`targets/posix.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from soter.native.compiler import MEANING
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.mapping.topic_mapping import TopicMap

NEEDED = ("roscpp", "diagnostic_msgs", "rosgraph_msgs", "std_msgs")
TRUSTED, SIMULATED = "trusted", "simulated"
"""Folders of what knows nothing of ROS: in real time, and under /clock."""


@dataclass(frozen=True)
class RosPackage:
    """What the files are about: `programs` of the trusted folder with their sources, by name."""

    system: System
    name: str
    command: str
    programs: dict[str, list[str]]
    simulated: list[str]
    """Sources of the simulation, beside its node."""
    mapped: list[TopicMap]
    actuated: bool

    @property
    def message_packages(self) -> list[str]:
        """Whose messages are used."""
        return sorted({m.message.package for m in self.mapped if m.message})


def package_name(prefix: str) -> str:
    """A name that catkin takes: letters, digits and underscores, in lower case, a letter first."""
    name = re.sub(r"[^a-z0-9_]", "_", prefix.lower())
    return name if name[:1].isalpha() else f"soter_{name}"


def catkin_files(p: RosPackage) -> list[PackageFile]:
    """All of them."""
    files = [
        PackageFile("package.xml", _manifest(p)),
        PackageFile("CMakeLists.txt", _cmake(p)),
        PackageFile("config/parameters.yaml", PARAMETERS, yours=True),
        PackageFile(f"launch/{p.name}_simulation.launch", _simulation(p)),
    ]
    if p.programs:
        files.append(PackageFile(f"launch/{p.name}.launch", _launch(p)))
        files += script_files(p)
    return files


def described(p: RosPackage) -> str:
    """The package in a line, as XML has it."""
    return escape(f"System {p.system.name}: a trusted part, its actuators and their bridge to ROS")


def bridge_sources(p: RosPackage) -> str:
    """What of the trusted folder is linked into the bridge."""
    linked = ["soter_outside.c", "soter_channel.c", "soter_posix_check.c"]
    linked += [f"{p.command}_lease.c"] * p.actuated
    return " ".join(f"{TRUSTED}/{n}" for n in linked)


def _packages(p: RosPackage) -> list[str]:
    """Of ROS: whose messages are used, and what every bridge needs."""
    return sorted({*NEEDED, *p.message_packages})


def _manifest(p: RosPackage) -> str:
    depends = "\n".join(f"  <depend>{name}</depend>" for name in _packages(p))
    return f"""\
<?xml version="1.0"?>
<package format="2">
  <name>{p.name}</name>
  <version>0.0.1</version>
  <description>{described(p)}. Written by soter.</description>
  <maintainer email="you@example.org">you</maintainer>
  <license>yours</license>
  <buildtool_depend>catkin</buildtool_depend>
{depends}
  <test_depend>rostest</test_depend>
</package>
"""


def _cmake(p: RosPackage) -> str:
    packages = " ".join(_packages(p))
    bridge = _bridge(p) if p.programs else ""
    names = [*p.programs, *([f"{p.name}_bridge"] if p.programs else []), f"{p.name}_simulation"]
    scripts = _scripts(p) if p.programs else ""
    return f"""\
# Written by soter. In a catkin workspace, or by itself where ROS comes from the distribution:
#   cmake -S . -B build && cmake --build build
cmake_minimum_required(VERSION 3.10)
project({p.name} C CXX)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_C_STANDARD 99)
set(CMAKE_CXX_STANDARD 17)
# these belong to the meaning of the program: one rounding an operation, on every compiler
add_compile_options({" ".join(MEANING)})
set(CMAKE_C_FLAGS_RELEASE "-O2")
set(CMAKE_CXX_FLAGS_RELEASE "-O2")

if(CATKIN_TOPLEVEL OR DEFINED CATKIN_DEVEL_PREFIX) # in a workspace
  find_package(catkin REQUIRED COMPONENTS {packages})
  catkin_package()
  set(PROGRAMS ${{CATKIN_DEVEL_PREFIX}}/${{CATKIN_PACKAGE_BIN_DESTINATION}})
  set(ROS_INCLUDES ${{catkin_INCLUDE_DIRS}})
  set(ROS_LIBRARIES ${{catkin_LIBRARIES}})
else()
  find_package(PkgConfig REQUIRED)
  pkg_check_modules(ROS1 REQUIRED {packages})
  set(ROS_INCLUDES ${{ROS1_INCLUDE_DIRS}})
  set(ROS_LIBRARIES ${{ROS1_LINK_LIBRARIES}} ${{ROS1_LDFLAGS_OTHER}})
  set(CATKIN_PACKAGE_BIN_DESTINATION bin)
  set(PROGRAMS ${{CMAKE_BINARY_DIR}})
  set(CATKIN_PACKAGE_SHARE_DESTINATION share/{p.name})
endif()

{bridge}# the same program under /clock
add_executable({p.name}_simulation src/{p.name}_simulation.cpp
  {" ".join(p.simulated)})
target_include_directories({p.name}_simulation PRIVATE {SIMULATED} src SYSTEM ${{ROS_INCLUDES}})
target_link_libraries({p.name}_simulation PRIVATE ${{ROS_LIBRARIES}} m pthread)

install(TARGETS {" ".join(names)} RUNTIME DESTINATION ${{CATKIN_PACKAGE_BIN_DESTINATION}})
{scripts}install(DIRECTORY launch config DESTINATION ${{CATKIN_PACKAGE_SHARE_DESTINATION}})
"""


def _bridge(p: RosPackage) -> str:
    """The rules of the trusted part, the actuators and the bridge."""
    programs = "".join(
        f"""
add_executable({name} {" ".join(sources)})
target_include_directories({name} PRIVATE {TRUSTED})
target_link_libraries({name} PRIVATE m pthread)
"""
        for name, sources in p.programs.items()
    )
    return f"""\
# the trusted part and its actuators: C, and nothing of ROS
{programs}
# between ROS and their channels
add_executable({p.name}_bridge src/{p.name}_bridge.cpp {bridge_sources(p)})
target_include_directories({p.name}_bridge PRIVATE {TRUSTED} src SYSTEM ${{ROS_INCLUDES}})
target_link_libraries({p.name}_bridge PRIVATE ${{ROS_LIBRARIES}} pthread)

"""


def _launch(p: RosPackage) -> str:
    actuators = ending = ""
    if p.actuated:
        ending = " --end-with-leases"
        actuators = f"""
  <!-- obeys leases, and holds the fail-safe law without one, until somebody arms it again:
       rosrun {p.name} arm -->
  <node pkg="{p.name}" type="in_channels" name="{p.name}_actuator" required="true"
        args="{p.command}_actuator $(arg channels)"/>
"""
    return f"""\
<launch>
  <!-- the folder of the channels; give it a user of its own -->
  <arg name="channels" default="/dev/shm/{p.name}"/>
  <!-- how many late releases are no failure of the run; a lease ends with the first one -->
  <arg name="misses" default="0"/>
{actuators}
  <node pkg="{p.name}" type="{p.name}_bridge" name="{p.name}_bridge" respawn="true" output="screen">
    <param name="channels" value="$(arg channels)"/>
    <rosparam command="load" file="$(find {p.name})/config/parameters.yaml"/>
  </node>

  <!-- waits until its sensors speak; ends when it gives no lease any more, and is started anew: in
       SC, and not obeyed before somebody arms the actuators -->
  <node pkg="{p.name}" type="in_channels" name="{p.name}" respawn="true" output="screen"
        args="{p.command} $(arg channels) --wait {FOR_EVER_S} --misses $(arg misses){ending}"/>
</launch>
"""


def _simulation(p: RosPackage) -> str:
    return f"""\
<launch>
  <!-- the same program under /clock: Gazebo, or a bag that is played -->
  <arg name="seed" default="1"/>
  <param name="use_sim_time" value="true"/>
  <node pkg="{p.name}" type="{p.name}_simulation" name="{p.name}" output="screen">
    <param name="seed" value="$(arg seed)"/>
  </node>
</launch>
"""


def _scripts(p: RosPackage) -> str:
    names = " ".join(f.path for f in script_files(p))
    return f"""\
file(COPY {names} DESTINATION ${{PROGRAMS}} FILE_PERMISSIONS {SCRIPTS_MODE})
install(PROGRAMS {names} DESTINATION ${{CATKIN_PACKAGE_BIN_DESTINATION}})
"""


PARAMETERS = """\
# How far the clocks of who stamps messages and of this machine may be apart, s: 0 on one machine.
# Messages count as so much older, and as from the future only beyond it.
clock_error: 0.0
"""


def script_files(p: RosPackage) -> list[PackageFile]:
    """What starts the programs of the trusted folder, and what arms the actuators."""
    files = [PackageFile("scripts/in_channels", START)]
    if p.actuated:
        files.append(PackageFile("scripts/arm", ARM.format(name=p.name, command=p.command)))
    return files


FOR_EVER_S = 1_000_000_000
SCRIPTS_MODE = "OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE"
ARM = """\
#!/bin/sh
# arm [FOLDER]: arms the actuators of this package again, those whose channels are in FOLDER.
set -eu
folder=${{1:-/dev/shm/{name}}}
pids=$(pgrep -f -- "/{command}_actuator --channels $folder( |\\$)") || {{
  echo "arm: no {command}_actuator runs with its channels in $folder" >&2
  exit 1
}}
for pid in $pids; do
  if [ "$(readlink "/proc/$pid/exe" | sed 's|.*/||')" = "{command}_actuator" ]; then
    kill -USR1 "$pid"
    echo "armed: process $pid, channels in $folder"
  fi
done
"""

START = """\
#!/bin/sh
# in_channels PROGRAM FOLDER [WORDS]: what roslaunch starts. Makes the folder of the channels, and
# takes away the words that ROS adds (NAME:=VALUE), of which the program knows nothing.
set -eu
program=$1 folder=$2
shift 2
mkdir -p -m 0770 "$folder"
for word in "$@"; do
  shift
  case $word in
  *:=*) ;;
  *) set -- "$@" "$word" ;;
  esac
done
here=$(dirname "$(readlink -f "$0")")
exec "$here/$program" --channels "$folder" "$@"
"""
