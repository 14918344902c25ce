"""A node that prints what is said on /diagnostics: each message a line, {name: {key: value}}.

`message` and `level` are keys as well. Non-goals: judging.
"""

from __future__ import annotations

import json
import time

from diagnostic_msgs.msg import DiagnosticArray
from either_ros import VERSION, Node


def say(message: DiagnosticArray) -> None:
    """A line."""
    told = {}
    for status in message.status:
        level = int.from_bytes(status.level, "big") if VERSION == 2 else status.level
        own = {v.key: v.value for v in status.values}
        told[status.name] = {**own, "message": status.message, "level": str(level)}
    print(json.dumps(told), flush=True)


if __name__ == "__main__":
    node = Node("listener")
    node.hear("/diagnostics", DiagnosticArray, say, 10)
    while node.ok():
        time.sleep(0.05)
