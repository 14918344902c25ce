"""What catkin, roslaunch and people want of a package: manifest, CMake, launch file, page.

Purpose: the text around the nodes. It builds with catkin, and with plain CMake where ROS comes from
the distribution (pkg-config), as on Debian.
Non-goals: the nodes (`node_sources.py`), the trusted part (`targets/posix.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from soter.native.compiler import MEANING
from soter.targets.bridge_base import TRUSTED, cmake_programs
from soter.targets.package import PackageFile
from soter.targets.ros.node_sources import MESSAGE
from soter.targets.ros.rostest_files import NODE, rostest_files

if TYPE_CHECKING:
    from soter.targets.ros.ros_package_info import RosPackage

NEEDED = ("roscpp", "diagnostic_msgs", "rosgraph_msgs", "std_msgs")
SIMULATED = "simulated"
"""The folder of the program under /clock."""


def catkin_files(p: RosPackage) -> list[PackageFile]:
    """All of them."""
    files = [
        PackageFile("package.xml", _manifest(p)),
        PackageFile("CMakeLists.txt", _cmake(p)),
        PackageFile("config/parameters.yaml", PARAMETERS, yours=True),
        PackageFile(f"launch/{p.name}_simulation.launch", _simulation(p)),
    ]
    if p.bridged.programs:
        files.append(PackageFile(f"launch/{p.name}.launch", _launch(p)))
        files += [*script_files(p), *rostest_files(p)]
    return files


def described(p: RosPackage) -> str:
    """The package in a line, as XML has it."""
    return escape(
        f"System {p.bridged.system.name}: a trusted part, its actuators and their bridge to ROS"
    )


def compiled_alike(p: RosPackage) -> str:
    """What CMake compiles with, whichever ROS it is."""
    return f"""\
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
"""


def programs_and_bridge(p: RosPackage) -> str:
    """CMake's rules of the trusted part and the actuators, and what the bridge is made of."""
    return f"""\
# the trusted part and its actuators: C, and nothing of ROS
{cmake_programs(p.bridged.sources)}
# between ROS and their channels
add_executable({p.name}_bridge src/{p.name}_bridge.cpp {" ".join(p.bridged.linked)})
"""


def simulation_node(p: RosPackage) -> str:
    """CMake's rule of the node under /clock: what it is made of."""
    return f"""\
# the same program under /clock
add_executable({p.name}_simulation src/{p.name}_simulation.cpp
  {" ".join(p.simulated)})
"""


def _manifest(p: RosPackage) -> str:
    depends = "\n".join(f"  <depend>{name}</depend>" for name in p.packages(NEEDED))
    return f"""\
<?xml version="1.0"?>
<package format="2">
  <name>{p.name}</name>
  <version>0.0.1</version>
  <description>{described(p)}. Written by soter.</description>
  <maintainer email="you@example.org">you</maintainer>
  <license>yours</license>
  <buildtool_depend>catkin</buildtool_depend>
  <build_depend>message_generation</build_depend>
{depends}
  <exec_depend>message_runtime</exec_depend>
  <test_depend>rospy</test_depend>
  <test_depend>rostest</test_depend>
</package>
"""


def _cmake(p: RosPackage) -> str:
    packages = " ".join(p.packages(NEEDED))
    bridge = _bridge(p) if p.bridged.programs else ""
    names = [
        *p.bridged.programs,
        *([f"{p.name}_bridge"] if p.bridged.programs else []),
        f"{p.name}_simulation",
    ]
    scripts = _scripts(p) if p.bridged.programs else ""
    return f"""\
# Written by soter. In a catkin workspace, or by itself where ROS comes from the distribution:
#   cmake -S . -B build && cmake --build build
cmake_minimum_required(VERSION 3.10)
{compiled_alike(p)}
if(CATKIN_TOPLEVEL OR DEFINED CATKIN_DEVEL_PREFIX) # in a workspace
  find_package(catkin REQUIRED COMPONENTS {packages})
{_message_rules(p)}  catkin_package()
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

{bridge}{simulation_node(p)}\
target_include_directories({p.name}_simulation PRIVATE {SIMULATED} src SYSTEM ${{ROS_INCLUDES}})
target_link_libraries({p.name}_simulation PRIVATE ${{ROS_LIBRARIES}} m pthread)

install(TARGETS {" ".join(names)} RUNTIME DESTINATION ${{CATKIN_PACKAGE_BIN_DESTINATION}})
{scripts}install(DIRECTORY launch config DESTINATION ${{CATKIN_PACKAGE_SHARE_DESTINATION}})
{_test_rules(p)}"""


def _test_rules(p: RosPackage) -> str:
    """The test, for `catkin_make run_tests` where CMake finds rostest, and for `rostest` itself."""
    if not rostest_files(p):
        return ""
    return f"""
if(CATKIN_ENABLE_TESTING)
  file(COPY test/{NODE} DESTINATION ${{PROGRAMS}} FILE_PERMISSIONS {SCRIPTS_MODE})
  find_package(rostest QUIET)
  if(rostest_FOUND)
    add_rostest(test/{p.name}.test)
  else()
    message(STATUS "no rostest for CMake: `rostest {p.name} {p.name}.test` runs the test")
  endif()
endif()
"""


def _message_rules(p: RosPackage) -> str:
    """Classes of `ModuleStatus` for others, where the workspace can make them.

    The bridge has its own (`node_sources.py`).
    """
    if not p.bridged.programs:
        return ""
    return f"""\
  find_package(genmsg QUIET) # with the generators that are installed
  if(genmsg_FOUND)
    add_message_files(FILES {MESSAGE}.msg)
    generate_messages()
  else()
    message(STATUS "{p.name}/{MESSAGE}: no genmsg, so no classes for other nodes")
  endif()
"""


def _bridge(p: RosPackage) -> str:
    """The rules of the trusted part, the actuators and the bridge."""
    return f"""\
{programs_and_bridge(p)}\
target_include_directories({p.name}_bridge PRIVATE {TRUSTED} src SYSTEM ${{ROS_INCLUDES}})
target_link_libraries({p.name}_bridge PRIVATE ${{ROS_LIBRARIES}} pthread)

"""


def _launch(p: RosPackage) -> str:
    actuators = ending = ""
    command = p.bridged.command
    if p.bridged.actuated:
        ending = " --end-with-leases"
        actuators = f"""
  <!-- obeys leases, and holds the fail-safe law without one, until somebody arms it again:
       rosrun {p.name} arm -->
  <node pkg="{p.name}" type="in_channels" name="{p.name}_actuator" required="true"
        args="{command}_actuator $(arg channels)"/>
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
        args="{command} $(arg channels) --wait {FOR_EVER_S} --misses $(arg misses){ending}"/>
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
    if p.bridged.actuated:
        files.append(PackageFile("scripts/arm", ARM.format(name=p.name, command=p.bridged.command)))
    return files


FOR_EVER_S = 1_000_000_000
SCRIPTS_MODE = "OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE"
ARM = """\
#!/bin/sh
# arm [--unchecked] [FOLDER]: arms the actuators of this package again, those whose channels are in
# FOLDER. They refuse where the state is none from which the proof speaks; --unchecked: whatever it
# is, and no proof is about what follows.
set -eu
unchecked=
if [ "${{1:-}}" = --unchecked ]; then
  unchecked=--unchecked
  shift
fi
here=$(dirname "$(readlink -f "$0")")
folder=${{1:-/dev/shm/{name}}}
exec "$here/{command}_actuator" --channels "$folder" --arm $unchecked
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
