"""A policy in a process of its own, for remote.soter: it hurries to a wall, and SC brings it back.

    python examples/wall/remote_policy.py vehicle /dev/shm/robot
    python examples/wall/remote_policy.py vehicle /dev/shm/robot --chunks

Purpose: the whole of what a policy has to do with Soter; kill it, stop it, let it wish nonsense.
Non-goals: learning. `policy` is where the network stands.
"""

from __future__ import annotations

import argparse

import soter.remote


def policy(observation: soter.remote.Observation) -> float:
    """Towards the nearer wall, as fast as allowed: nobody would let it drive alone."""
    return 1.0 if observation["position"] >= 0.0 else -1.0


def main() -> None:
    """Until it is ended, or nobody has measured anything for 10 s."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "package", help="folder that `soter build --target posix` wrote, or a program"
    )
    parser.add_argument("channels", help="folder of the robot's --channels")
    parser.add_argument(
        "--chunks", action="store_true", help="five actions at once, as VLAs answer"
    )
    arguments = parser.parse_args()
    with soter.remote.connect(arguments.package, channels=arguments.channels) as robot:
        for observation in robot.every("position", timeout="10s"):
            action = policy(observation)
            if arguments.chunks:
                robot.publish_chunk("wish", [action] * 5, every="20ms")
            else:
                robot.publish("wish", action, measured=observation.measured)


if __name__ == "__main__":
    main()
