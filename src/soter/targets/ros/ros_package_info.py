"""What the files of a package of ROS are about, and what it may be called.

Purpose: one record. Non-goals: the files (`catkin_files.py`, `ament_files.py`, `rostest_files.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.mapping.topic_mapping import TopicMap
    from soter.targets.bridge_base import BridgedSystem


@dataclass(frozen=True)
class RosPackage:
    """What the files are about; `simulated`: sources of the simulation, beside its node."""

    name: str
    bridged: BridgedSystem
    simulated: list[str]
    mapped: list[TopicMap]

    def packages(self, needed: tuple[str, ...]) -> list[str]:
        """Of ROS: whose messages are used, and what every bridge needs."""
        return sorted({*needed, *(m.message.package for m in self.mapped if m.message)})


def package_name(prefix: str) -> str:
    """A name that catkin takes: letters, digits and underscores, in lower case, a letter first."""
    name = re.sub(r"[^a-z0-9_]", "_", prefix.lower())
    return name if name[:1].isalpha() else f"soter_{name}"
