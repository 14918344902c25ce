"""Connects a policy, in its own process, to the topics of a robot.

    with soter.remote.connect("robot.soter", system="Vehicle", channels="/dev/shm/robot") as robot:
        for observation in robot.every("position"):
            robot.publish("wish", policy(observation), measured=observation.measured)

Purpose: Python on the other side of the channels of target `posix` (docs/remote.md). Values are
checked here to report mistakes early; the gate on the robot checks all of them again.
Non-goals: other machines; learning; anything that has to be on time.

`robot.py` has what a policy calls; `channels_json.py` finds the topics of a robot, `topics.py`
turns their values into bytes, `channel.py` writes and reads these in shared memory.
"""

from __future__ import annotations

from soter.remote.robot import Observation, Reading, Robot, connect

__all__ = ["Observation", "Reading", "Robot", "connect"]
