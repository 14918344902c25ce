"""Small random programs in which steps of some nodes take time.

Purpose: the programs of `small_test_programs.py`, with `takes [a, b];` where that is allowed.
Non-goals: running them (`explorer_configurations.py`, `brute_force.py`).
"""

from __future__ import annotations

import re
from random import Random

from generators.small_test_programs import TICK, small_program

NODE = re.compile(
    r"(?P<extern>extern )?node (?P<name>\w+) period \d+ms[^{]*\{\n"
    r"(?:  subscribes [^\n]*\n)?  publishes (?P<topics>[^;]*);"
)


def lasting_program(seed: int) -> str:
    """The text of program number `seed`."""
    random = Random(seed)  # noqa: S311 - the same programs every time are wanted
    text = small_program(seed)
    queued = set(re.findall(r"(\w+) queue \d", text))
    safe = set(re.findall(r"\bsc (\w+);", text))
    overrun = {path.rpartition(".")[2] for path in re.findall(r"overrun ([\w.]+) by", text)}

    def lasting(match: re.Match[str]) -> str:
        name, topics = match["name"], re.findall(r"\w+", match["topics"])
        barred = match["extern"] or "[" in match["topics"] or name in safe | overrun
        if barred or queued & set(topics) or random.random() < 0.35:
            return match[0]
        most = random.choice((0.5, 1, 1, 1.5, 2)) * TICK
        least = random.choice((most, TICK / 2, TICK / 2))
        return f"{match[0]} takes [{least:g}ms, {most:g}ms];"

    return NODE.sub(lasting, text)
