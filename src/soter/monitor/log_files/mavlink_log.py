"""Reads the messages of a telemetry log of MAVLink (`.tlog`), as ground stations write it.

Purpose: `mavlink_messages` reads frames of MAVLink 1 and 2, each with its checksum, decoded by
`pymavlink` in its dialect `all`; D016 says where a file is cut or damaged. Channels are names of
messages, whose `header.srcSystem` and `header.srcComponent` say whose they are. Times are those at
which the ground station had them, which no checksum covers; `[time] from = "time_boot_ms"` takes
the autopilot's own. Frames of another dialect are counted, if their checksums are those of one.
Non-goals: what these frames say; signatures; the raw stream (`.rlog`), which has no times.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, BinaryIO

from soter.mapping.mavlink_dialects import require_mavlink_package
from soter.monitor.log_files.log_columns import (
    Writers,
    damaged_log_error,
    opened_log,
    unusable_log_error,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted


TIME_BYTES = 8
NEW = 0xFD
AROUND = {0xFE: 8, NEW: 12}
"""By the first byte of a frame: its bytes around the payload."""
SIGNED, SIGNATURE_BYTES = 1, 13
RAW = "an `.rlog` is a raw stream, in which nothing says when", "give the `.tlog` beside it"
OLD = 0x55
"""The first byte of a frame of MAVLink 0.9."""


def mavlink_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives each message: time, name, content (None: unwanted); counts all; raises D016, D007."""
    if path.suffix.lower() == ".rlog":
        raise unusable_log_error(path, *RAW)
    require_mavlink_package()
    from pymavlink.dialects.v20 import all as dialect  # noqa: PLC0415 - an extra

    decoder, writers, odd = dialect.MAVLink(None), Writers(), _OddFrames(path, facts)
    facts.unchecked = True
    with opened_log(path) as file:
        facts.note_size(file)
        for time_us, frame in _read_frames(path, file, facts):
            try:
                message = decoder.decode(frame)
                name = message.get_type()
            except dialect.MAVError as error:
                number = frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")
                known = dialect.mavlink_map.get(number)
                name = getattr(known, "msgname", f"message {number}")
                asked = name in wanted and not wanted[name].unnamed
                odd.count_wrong(name, frame, str(error), asked)
                continue
            if isinstance(message, dialect.MAVLink_unknown):
                name = f"message {message.get_msgId()}"
                odd.count_wrong(name, frame, "its checksum is none of its dialect's", asked=False)
            else:
                odd.count_right(name)
            facts.there[name] = facts.there.get(name, 0) + 1
            content = None
            if name in wanted:
                system, component = message.get_srcSystem(), message.get_srcComponent()
                writers.note_message(name, f"{system}/{component}")
                head = {"srcSystem": system, "srcComponent": component}
                content = {**message.to_dict(), "header": head}
            yield time_us * 1000, None, name, content
    facts.notes += [*writers.notes, *odd.notes]


class _OddFrames:
    """Counts frames whose number or checksum is not in the dialect `all`.

    If all messages of a name have the checksum of the same other dialect, they belong to it.
    Otherwise they are damaged. A wanted message counts as damaged in any case.
    """

    def __init__(self, path: Path, facts: FileFacts) -> None:
        self.path, self.facts = path, facts
        self._right: set[str] = set()
        self._seeds: dict[str, int] = {}
        self._counts: Counter[str] = Counter()

    def count_right(self, name: str) -> None:
        """Counts a message whose checksum is right."""
        if name in self._seeds:
            text = f"of the messages of `{name}` before byte {self.facts.at_byte:,} each is damaged"
            raise damaged_log_error(self.path, text)
        self._right.add(name)

    def count_wrong(self, name: str, frame: bytearray, why: str, asked: bool) -> None:
        """Counts a message with a wrong checksum; raises DamagedLogError if wanted or damaged."""
        seeds = range(256) if name not in self._seeds else (self._seeds[name],)
        seed = next((s for s in seeds if _has_checksum(frame, s)), None)
        if asked or name in self._right or seed is None:
            message = f"the `{name}` at byte {self.facts.at_byte:,} is damaged: {why[:100]}"
            raise damaged_log_error(self.path, message)
        self._seeds[name] = seed
        self._counts[name] += 1

    @property
    def notes(self) -> list[str]:
        """Notes for people on frames with wrong checksums, which were stepped over."""
        return [
            f"{n:,} messages have the number of `{name}` and the checksum of another dialect: they "
            "were stepped over"
            for name, n in self._counts.items()
        ]


def _has_checksum(frame: bytearray, seed: int) -> bool:
    """Whether a frame has the checksum of a dialect that chose `seed` for the message."""
    from pymavlink.generator.mavcrc import x25crc  # noqa: PLC0415 - an extra

    end = len(frame) - 2 - (SIGNATURE_BYTES if frame[0] == NEW and frame[2] & SIGNED else 0)
    computed = x25crc([*frame[1:end], seed]).crc
    return bool(computed == int.from_bytes(frame[end : end + 2], "little"))


def _read_frames(path: Path, file: BinaryIO, facts: FileFacts) -> Iterator[tuple[int, bytearray]]:
    """Gives time and bytes of each frame; raises D016 if a frame is cut, or no frame follows."""
    while stamp := file.read(TIME_BYTES):
        at = facts.at_byte = file.tell() - len(stamp)
        head = file.read(3)
        if len(stamp) == TIME_BYTES and head and head[0] not in AROUND:
            old = "a frame of MAVLink 0.9" if head[0] == OLD else "no frame of MAVLink"
            raise damaged_log_error(path, f"at byte {at + TIME_BYTES:,} stands {old}")
        length = 0
        if len(head) == 3:
            signed = head[0] == NEW and head[2] & SIGNED
            length = AROUND[head[0]] + head[1] + (SIGNATURE_BYTES if signed else 0)
        frame = head + file.read(max(0, length - len(head)))
        if not length or len(frame) < length:
            message = f"its last message, at byte {at:,}, has no end"
            raise damaged_log_error(path, f"{message}: the recorder died, or the file was cut")
        yield int.from_bytes(stamp, "big"), bytearray(frame)
