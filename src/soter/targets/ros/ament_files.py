"""What ament, `ros2 launch` and people want of a package of ROS 2.

Purpose: the text around the bridge: manifest, CMake, launch file, parameters, a test that starts
it.
Non-goals: the bridge (`node_sources.py`), the trusted part (`targets/posix.py`); running it here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.targets.bridge_base import TRUSTED
from soter.targets.package import PackageFile
from soter.targets.ros.catkin_files import (
    FOR_EVER_S,
    SIMULATED,
    compiled_alike,
    described,
    programs_and_bridge,
    script_files,
    simulation_node,
)

if TYPE_CHECKING:
    from soter.targets.ros.ros_package_info import RosPackage

NEEDED = ("rclcpp", "diagnostic_msgs", "builtin_interfaces", "rosgraph_msgs", "std_msgs")


def ament_files(p: RosPackage) -> list[PackageFile]:
    """All of them."""
    packages = p.packages(NEEDED)
    files = [
        PackageFile("package.xml", _manifest(p, packages)),
        PackageFile("CMakeLists.txt", _cmake(p, packages)),
        PackageFile(f"launch/{p.name}_simulation.launch.py", _simulation(p)),
        PackageFile("config/parameters.yaml", _parameters(p), yours=True),
    ]
    if p.bridged.programs:
        files += [
            PackageFile(f"launch/{p.name}.launch.py", _launch(p)),
            *script_files(p),
            PackageFile(f"test/test_{p.name}.py", _test(p)),
        ]
    return files


def _manifest(p: RosPackage, packages: list[str]) -> str:
    depends = "\n".join(f"  <depend>{name}</depend>" for name in packages)
    return f"""\
<?xml version="1.0"?>
<package format="3">
  <name>{p.name}</name>
  <version>0.0.1</version>
  <description>{described(p)}. Written by soter.</description>
  <maintainer email="you@example.org">you</maintainer>
  <license>yours</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
{depends}
  <exec_depend>launch_ros</exec_depend>
  <test_depend>launch_testing_ament_cmake</test_depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""


def _cmake(p: RosPackage, packages: list[str]) -> str:
    finds = "\n".join(f"find_package({name} REQUIRED)" for name in packages)
    used = " ".join(packages)
    bridge = scripts = tests = ""
    names = [f"{p.name}_simulation"]
    if p.bridged.programs:
        names = [*p.bridged.programs, f"{p.name}_bridge", *names]
        bridge = f"""\
{programs_and_bridge(p)}\
target_include_directories({p.name}_bridge PRIVATE {TRUSTED} src)
ament_target_dependencies({p.name}_bridge {used})

"""
        listed = " ".join(f.path for f in script_files(p))
        scripts = f"install(PROGRAMS {listed} DESTINATION lib/{p.name})\n"
        tests = f"""
if(BUILD_TESTING)
  find_package(launch_testing_ament_cmake REQUIRED)
  add_launch_test(test/test_{p.name}.py)
endif()
"""
    return f"""\
# Written by soter: `colcon build` in a workspace of ROS 2.
cmake_minimum_required(VERSION 3.16)
{compiled_alike(p)}
find_package(ament_cmake REQUIRED)
{finds}

{bridge}{simulation_node(p)}\
target_include_directories({p.name}_simulation PRIVATE {SIMULATED} src)
ament_target_dependencies({p.name}_simulation {used})
target_link_libraries({p.name}_simulation m)

install(TARGETS {" ".join(names)} DESTINATION lib/{p.name})
{scripts}install(DIRECTORY launch config DESTINATION share/{p.name})
{tests}ament_package()
"""


def _simulation(p: RosPackage) -> str:
    return f'''\
"""The same program under /clock: a simulator, or a bag that is played; written by soter."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """What is started."""
    seed = ParameterValue(LaunchConfiguration("seed"), value_type=int)
    return LaunchDescription(
        [
            DeclareLaunchArgument("seed", default_value="1"),
            Node(
                package="{p.name}",
                executable="{p.name}_simulation",
                parameters=[{{"use_sim_time": True, "seed": seed}}],
                output="screen",
            ),
        ]
    )
'''


def _launch(p: RosPackage) -> str:
    actuators = ending = ""
    command = p.bridged.command
    if p.bridged.actuated:
        ending = ', "--end-with-leases"'
        actuators = f"""\
            # obeys leases, and holds the fail-safe law without one: `ros2 run {p.name} arm`
            ExecuteProcess(
                cmd=[start, "{command}_actuator", channels], on_exit=Shutdown(), output="screen"
            ),
"""
    return f'''\
"""The trusted part, its actuators and their bridge; written by soter."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackagePrefix, FindPackageShare


def generate_launch_description():
    """What is started."""
    channels = LaunchConfiguration("channels")
    start = PathJoinSubstitution([FindPackagePrefix("{p.name}"), "lib", "{p.name}", "in_channels"])
    parameters = PathJoinSubstitution([FindPackageShare("{p.name}"), "config", "parameters.yaml"])
    options = ["--misses", LaunchConfiguration("misses"){ending}]
    return LaunchDescription(
        [
            # the folder of the channels; give it a user of its own
            DeclareLaunchArgument("channels", default_value="/dev/shm/{p.name}"),
            # how many late releases are no failure of the run; a lease ends with the first one
            DeclareLaunchArgument("misses", default_value="0"),
{actuators}            Node(
                package="{p.name}",
                executable="{p.name}_bridge",
                parameters=[parameters, {{"channels": channels}}],
                respawn=True,
                output="screen",
            ),
            # waits for its sensors; ends when it gives no lease any more, and is started anew: in
            # SC, and not obeyed before somebody arms the actuators
            ExecuteProcess(
                cmd=[start, "{command}", channels, "--wait", "{FOR_EVER_S}", *options],
                respawn=True,
                output="screen",
            ),
        ]
    )
'''


def _parameters(p: RosPackage) -> str:
    return f"""\
{p.name}_bridge:
  ros__parameters:
    # How far the clocks of who stamps messages and of this machine may be apart, s. Messages count
    # as so much older, and as from the future only beyond it.
    clock_error: 0.0
"""


def _test(p: RosPackage) -> str:
    return f'''\
"""The package starts, and its trusted part is heard on /diagnostics; written by soter."""

import time
import unittest

import launch_testing.actions
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def generate_test_description():
    """The launch file of the package."""
    path = PathJoinSubstitution([FindPackageShare("{p.name}"), "launch", "{p.name}.launch.py"])
    return LaunchDescription(
        [
            IncludeLaunchDescription(PythonLaunchDescriptionSource([path])),
            launch_testing.actions.ReadyToTest(),
        ]
    )


class TestDiagnostics(unittest.TestCase):
    """What is said within ten seconds."""

    def test_the_bridge_says_how_its_modules_are(self):
        rclpy.init()
        node = rclpy.create_node("listener")
        heard = []
        node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
        end = time.monotonic() + 10.0
        while not heard and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
        node.destroy_node()
        rclpy.shutdown()
        self.assertTrue(any(s.name.startswith("soter: ") for m in heard for s in m.status))
'''
