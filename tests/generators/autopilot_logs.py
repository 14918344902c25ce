"""One flight of a cart as autopilots and ground stations log it: ULog, DataFlash, MAVLink, CSVs.

Purpose: bytes by the formats' own documents, so that no writer of a library is needed; the messages
are `motion` with x in m and v in m/s, and others beside them.
Non-goals: logs of ROS (`robot_logs.py`); what is asked of these logs.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

Row = tuple[int, float, float]
"""Time in us, x, v."""
FMT = (128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
POSE = (129, 3 + 8 + 1 + 8 + 4 + 2, "POSE", "QBdfc", "TimeUS,I,X,V,Tilt")
FMTU = (130, 3 + 8 + 1 + 16 + 16, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
MSG = (131, 3 + 8 + 64, "MSG", "QZ", "TimeUS,Message")
SAID = "Mode AUTO, by 255, at once"
"""A text with commas."""


def flight(n: int = 40) -> list[Row]:
    """A hundred rows a second, as fast as nothing."""
    return [(5_000_000 + 10_000 * k, 0.01 * k, 0.125) for k in range(n)]


def ulog(rows: Sequence[Row]) -> bytes:
    """`motion` with a nested format, an array and padding; a second instance; a dropout of 7 ms.

    Beside them what says nothing of topics: facts, a parameter, a text every ten rows.
    """

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 5_000_000)]
    parts.append(message("B", bytes(40)))
    parts.append(message("F", b"rate:float v;uint8_t[4] _padding0;"))
    fields = b"uint64_t timestamp;double x;rate r;int16_t[2] raw;char[4] name;uint8_t[2] _padding0;"
    parts.append(message("F", b"motion:" + fields))
    parts.append(message("I", b"\x10char[3] sys_name" + b"PX4"))
    parts.append(message("M", b"\0\x0cchar[2] perf" + b"ok"))
    parts.append(message("P", b"\x0ffloat MPC_XY_Z1" + struct.pack("<f", 12.5)))
    parts.append(message("Q", b"\1\x0dint32_t MAV_1" + struct.pack("<i", 7)))
    parts.append(message("S", bytes.fromhex("2f731320250cbb12")))
    parts += [message("A", struct.pack("<BH", i, 7 + i) + b"motion") for i in (0, 1)]
    parts.append(message("O", struct.pack("<H", 7)))
    for k, (now, x, v) in enumerate(rows):
        if k % 10 == 0:
            parts.append(message("L", b"6" + struct.pack("<Q", now) + b"[commander] armed\t"))
            parts.append(message("C", b"4" + struct.pack("<HQ", 1, now) + b"tagged"))
        bodies = [
            struct.pack("<HQdf4x2h4s", 7 + i, now, x + i, v, -3, now % 1000, b"ab") for i in (0, 1)
        ]
        parts += [message("D", body) for body in bodies]
    return b"".join(parts)


def dataflash(rows: Sequence[Row]) -> bytes:
    """`POSE`, whose field `I` tells two sensors apart, after a `FMTU` that says so."""

    def form(said: tuple[int, int, str, str, str]) -> bytes:
        number, length, *texts = said
        head = struct.pack("<3sBB", b"\xa3\x95\x80", number, length)
        return head + struct.pack("<4s16s64s", *(t.encode() for t in texts))

    units = struct.pack("<3sQB16s16s", b"\xa3\x95\x82", rows[0][0], 129, b"s#mnd", b"F----")
    parts = [form(FMT), form(POSE), form(FMTU), form(MSG), units]
    for k, (now, x, v) in enumerate(rows):
        if k % 10 == 0:
            parts.append(struct.pack("<3sQ64s", b"\xa3\x95\x83", now, SAID.encode()))
        parts += [struct.pack("<3sQBdfh", b"\xa3\x95\x81", now, i, x + i, v, -1234) for i in (0, 1)]
    return b"".join(parts)


def dataflash_text(rows: Sequence[Row]) -> bytes:
    """The same as text, as ground stations write it."""
    lines = [", ".join(map(str, ("FMT", *said))) for said in (FMT, POSE, FMTU, MSG)]
    lines.append(f"FMTU, {rows[0][0]}, 129, s#mnd, F----")
    for k, (now, x, v) in enumerate(rows):
        lines += [f"MSG, {now}, {SAID}"] * (k % 10 == 0)
        lines += [f"POSE, {now}, {i}, {x + i!r}, {v!r}, -12.34" for i in (0, 1)]
    return "\n".join([*lines, ""]).encode()


def tlog(rows: Sequence[Row]) -> bytes:
    """`LOCAL_POSITION_NED` and `HEARTBEAT` in frames of MAVLink 2; needs `pymavlink`."""
    from pymavlink.dialects.v20 import all as dialect

    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    parts: list[bytes] = []
    for now, x, v in rows:
        stamp = struct.pack(">Q", 1_700_000_000_000_000 + now)
        position = sender.local_position_ned_encode(now // 1000, x, 0.5, 0.0, v, 0.0, 0.0)
        heartbeat = sender.heartbeat_encode(2, 3, 0, 0, 4)
        for message in (position, heartbeat):
            sender.seq = len(parts) % 256
            parts.append(stamp + bytes(message.pack(sender)))
    return b"".join(parts)


def table(rows: Sequence[Row], columns: str = "t,x,v") -> bytes:
    """A CSV with some of its columns."""
    names = columns.split(",")
    cells = [{"t": now / 1e6, "x": x, "v": v} for now, x, v in rows]
    lines = [columns, *(",".join(repr(c[n]) for n in names) for c in cells)]
    return "\n".join([*lines, ""]).encode()


def written(path: Path, data: bytes) -> Path:
    """The path."""
    path.write_bytes(data)
    return path
