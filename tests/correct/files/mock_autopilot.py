"""A process at the other end of quad.c's pipe that flies nothing: an attitude law with faults.

    mock_autopilot.py FAULT

FAULT: none, sources, protocol, gone, unarmed, or what has a wrong sign: roll, pitch, rate, stick,
quaternion.
`none` answers every test on the stand with the right sign; it is not made to hover. Non-goals:
being an autopilot.
"""

import os
import struct
import sys
from typing import Any

REQUEST = struct.Struct("=II3d3d4d3d3dd6H2H")
ANSWER = struct.Struct("=IIII4d")
HELLO = struct.Struct("=II32s72s")
MAGIC = 0x50414C31
BEGIN, STEP = 1, 2
SOURCES = "d5fb207c627e8465b89b96bfd3ed42b79ee4dc2d1fab6f1019fe33c3b238d267"


def moment(fault: str, axis: int, request: tuple[Any, ...]) -> float:
    """What the mock wants about an axis: against its tilt and rate, after its stick."""
    tilt: float
    law: float
    gyro, attitude, sticks = request[2:5], request[8:12], request[19:25]
    tilt = 2.0 * attitude[1 + axis] * (-1.0 if fault == "quaternion" else 1.0)
    wanted = (sticks[axis] - 1500) / 500.0
    law = 0.3 * (wanted * (-1.0 if fault == "stick" else 1.0) - tilt)
    law -= 0.1 * gyro[axis] * (-1.0 if fault == "rate" else 1.0)
    return -law if fault == ("roll", "pitch")[axis] else law


def answer(fault: str, request: tuple[Any, ...]) -> bytes:
    """Motors rear right, front right, rear left, front left."""
    roll, pitch = (moment(fault, axis, request) for axis in range(2))
    armed = int(request[23] > 1700 and fault != "unarmed")
    base = 0.4
    motors = (base - roll + pitch, base - roll - pitch, base + roll + pitch, base + roll - pitch)
    return ANSWER.pack(MAGIC, armed, 0, 1, *motors)


def main() -> None:
    """Serve until the other end is gone."""
    fault = sys.argv[1]
    magic = 7 if fault == "protocol" else MAGIC
    sources = "0" * 64 if fault == "sources" else SOURCES
    os.write(1, HELLO.pack(magic, REQUEST.size, b"9.9.9", sources.encode()))
    while len(got := os.read(0, REQUEST.size)) == REQUEST.size:
        request = REQUEST.unpack(got)
        if request[1] == STEP and fault == "gone":
            return
        if request[1] in (BEGIN, STEP):
            os.write(1, answer(fault, request))


if __name__ == "__main__":
    main()
