"""Which field of a message says when it was measured.

Purpose: one record, which types of messages and mappings share. Non-goals: clocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal


@dataclass(frozen=True)
class StampSource:
    """The field that says when a message was measured, in the clock of its arrival.

    `kind`: "time", a ROS time (of JSON and protobuf its members `sec` and `nanosec` or `nanos`), or
    "number", in units of `unit_ns`.
    """

    path: str
    kind: Literal["time", "number"] = "time"
    unit_ns: Fraction = Fraction(1)
