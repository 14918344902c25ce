"""A program that meets the world, and a mapping of it to messages of ROS 2: for the tests of dds.

Purpose: one of each kind of field, in and out. Non-goals: what is tested of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.api import load

if TYPE_CHECKING:
    from pathlib import Path

    from soter.targets.package import Package

PROGRAM = """soter 1;
type Child = enum { base_link, body };
type Seen = { child: Child, x: float, yaw: float, cov: float[2] };
input topic seen: Seen;
input topic near: float;
input topic level: int in [-100, 100];
topic push: float in [-1.0, 1.0] = 0.0;
node N period 20ms {
  subscribes seen, near, level;
  publishes push;
  step { publish push = clamp(seen.x + near + seen.cov[0], -1.0, 1.0); }
}
system Robot {
  external topic seen;
  external topic near;
  external topic level;
  external topic push;
  n: N;
}
"""
SEEN_FIELDS: dict[str, Any] = {
    "child": "child_frame_id",
    "x": {"from": "pose.pose.position.x", "scale": 0.1, "offset": 0.3},
    "yaw": "twist.twist.angular.z",
    "cov.[0]": "pose.covariance.0",
    "cov.[1]": "pose.covariance.35",
}


def mapping(**changes: dict[str, Any]) -> dict[str, Any]:
    """A mapping that fits; `seen={...}` changes the table of that topic, None takes a key away."""
    topics: dict[str, dict[str, Any]] = {
        "seen": {
            "channel": "/odom",
            "type": "nav_msgs/Odometry",
            "frame_id": "odom",
            "fields": SEEN_FIELDS,
        },
        "near": {
            "channel": "/scan",
            "type": "sensor_msgs/LaserScan",
            "fields": {"value": "ranges.2"},
        },
        "level": {"channel": "/level", "type": "std_msgs/Byte", "fields": {"value": "data"}},
        "push": {
            "channel": "/cmd_vel",
            "type": "geometry_msgs/TwistStamped",
            "fields": {"value": {"from": "twist.linear.x", "scale": 2.0}},
            "set": {"header.frame_id": "base"},
        },
    }
    for name, change in changes.items():
        for key, value in change.items():
            topics[name][key] = value
            if value is None:
                del topics[name][key]
    return {"system": "Robot", "topics": topics}


def package(folder: Path, given: dict[str, Any], program: str = PROGRAM) -> Package:
    """What `soter build --target dds` writes into `folder`/out."""
    path = folder / "robot.soter"
    path.write_text(program, encoding="utf-8")
    loaded = load(path)
    assert loaded.ok, loaded.diagnostics
    return loaded.build("dds", folder / "out", "Robot", mapping=given)
