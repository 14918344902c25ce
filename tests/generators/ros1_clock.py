"""Systems with their plants inside as nodes of ROS 1, under a /clock that ticks unevenly.

Purpose: `PROGRAMS`; what the simulation node of one says of its trace at its end beside a node that
ticks (`bench/ros/ros1_clock.cpp`), and what `soter run` says.
Non-goals: building them (`ros1_packages.py`); systems in the world, whose messages come when they
come.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from bench.ros.ros1_nodes import nodes

import soter

if TYPE_CHECKING:
    from pathlib import Path

PROGRAMS: dict[str, tuple[str, str, str, str, dict[str, str], str]] = {
    "cart": (
        *("examples/wall/cart.soter", "Protected", "motion", "nav_msgs/Odometry"),
        {"x": "pose.pose.position.x", "v": "twist.twist.linear.x"},
        "2.0",
    ),
    "mountain car": (
        *("examples/mountain_car/cliff.soter", "Protected", "car", "geometry_msgs/Point"),
        {"x": "x", "v": "y"},
        "20.0",
    ),
    "drone": (
        *("examples/drone/motion_primitive.soter", "Protected", "control"),
        *("geometry_msgs/Vector3", {"x": "x", "y": "y", "z": "z"}, "2.0"),
    ),
}
"""Program, system, a topic that goes out, its messages and fields, step of /clock in ms."""
HASH = re.compile(r"trace_sha256 ([0-9a-f]{64})")


def run_hash(path: Path, system: str) -> str:
    """Of `soter run`."""
    return str(soter.load(path).simulate(system, trace=False).trace_sha256)


def under_clock(build: Path, name: str, clock: Path, *words: str) -> str:
    """What the node says at its end."""
    with nodes() as all_:
        node = all_.start("simulation", build / f"{name}_simulation")
        all_.start("clock", clock, *words)
        node.wait(600)
        told = HASH.search("".join(all_.heard["simulation"]))
        return told[1] if told else "no hash: " + "".join(all_.heard["simulation"])[-200:]
