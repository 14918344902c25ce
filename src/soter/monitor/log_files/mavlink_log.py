"""The messages of a telemetry log of MAVLink (`.tlog`), as ground stations write it.

Purpose: `mavlink_messages` reads frames of MAVLink 1 and 2, each with its checksum, decoded by
`pymavlink` in its dialect `all`; D016 says where a file is cut or damaged. Channels are names of
messages, whose `header.srcSystem` and `header.srcComponent` say whose they are. Times are those at
which the ground station had them; `[time] from = "time_boot_ms"` takes the autopilot's own.
Non-goals: frames of a dialect of one's own, which are counted; signatures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO

from soter.diagnostics.diagnostic import reason
from soter.language.load.named_files import opened
from soter.mapping.mavlink_dialects import require_mavlink_package
from soter.monitor.log_files.log_columns import Writers, damaged_log, unusable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.monitor.log_files.log_columns import Arrived, DamagedLogError, FileFacts, Wanted


TIME_BYTES = 8
AROUND = {0xFE: 8, 0xFD: 12}
"""Bytes of a frame around its payload, by the one that it begins with."""
SIGNED, SIGNATURE_BYTES = 1, 13
OLD = 0x55
"""The first byte of a frame of MAVLink 0.9."""


def mavlink_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Time of arrival, name and content of each message; None for that of one nobody wants.

    `facts` counts the messages of every name. SoterError D016, D007.
    """
    require_mavlink_package()
    from pymavlink.dialects.v20 import all as dialect  # noqa: PLC0415 - an extra

    decoder, writers, odd = dialect.MAVLink(None), Writers(), _OddFrames(path, facts)
    try:
        with opened(path) as file:
            facts.size_of(file)
            for time_us, frame in _frames(path, file, facts):
                try:
                    message = decoder.decode(frame)
                    name = message.get_type()
                except dialect.MAVError as error:
                    number = frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")
                    known = dialect.mavlink_map.get(number)
                    name = getattr(known, "msgname", f"message {number}")
                    odd.wrong(name, name in wanted and not wanted[name].unnamed, str(error))
                    continue
                if isinstance(message, dialect.MAVLink_unknown):
                    name = f"message {message.get_msgId()}"
                    odd.unknown += 1
                else:
                    odd.right(name)
                facts.there[name] = facts.there.get(name, 0) + 1
                content = None
                if name in wanted:
                    system, component = message.get_srcSystem(), message.get_srcComponent()
                    writers.note(name, f"{system}/{component}")
                    head = {"srcSystem": system, "srcComponent": component}
                    content = {**message.to_dict(), "header": head}
                yield time_us * 1000, None, name, content
    except OSError as error:
        raise unusable(path, reason(error)) from error
    facts.notes += [*writers.notes, *odd.notes]


class _OddFrames:
    """Frames that no dialect knows, or whose checksum is another than its dialect says.

    Messages of which all have another checksum are of another dialect; where some have, those are
    damaged, as is one that the mapping asks for.
    """

    def __init__(self, path: Path, facts: FileFacts) -> None:
        self.path, self.facts = path, facts
        self.unknown = 0
        self._right: set[str] = set()
        self._wrong: dict[str, tuple[int, DamagedLogError]] = {}

    def right(self, name: str) -> None:
        """Count a message whose checksum is right."""
        if name in self._wrong:
            raise self._wrong[name][1]
        self._right.add(name)

    def wrong(self, name: str, wanted: bool, why: str) -> None:
        """Count a message whose checksum is wrong; DamagedLogError where that is a damage."""
        told = f"the `{name}` at byte {self.facts.at_byte:,} is damaged: {why[:100]}"
        count, first = self._wrong.get(name, (0, damaged_log(self.path, told)))
        if wanted or name in self._right:
            raise first
        self._wrong[name] = count + 1, first

    @property
    def notes(self) -> list[str]:
        """Notes on such frames, which were stepped over."""
        told = [
            f"{n:,} messages have the number of `{name}` and another checksum: of another dialect, "
            "or damaged; they were stepped over"
            for name, (n, _) in self._wrong.items()
        ]
        if self.unknown:
            count = f"{self.unknown:,} messages are of no dialect that the package `pymavlink` has"
            told.append(f"{count}, and were stepped over without a look at their checksum")
        return told


def _frames(path: Path, file: BinaryIO, facts: FileFacts) -> Iterator[tuple[int, bytearray]]:
    """Time and bytes of each frame; D016 where one is cut, or where none stands."""
    while stamp := file.read(TIME_BYTES):
        at = facts.at_byte = file.tell() - len(stamp)
        head = file.read(3)
        if len(stamp) == TIME_BYTES and head and head[0] not in AROUND:
            old = "a frame of MAVLink 0.9" if head[0] == OLD else "no frame of MAVLink"
            raise damaged_log(path, f"at byte {at + TIME_BYTES:,} stands {old}")
        length = 0
        if len(head) == 3:
            signed = head[0] == 0xFD and head[2] & SIGNED
            length = AROUND[head[0]] + head[1] + (SIGNATURE_BYTES if signed else 0)
        frame = head + file.read(max(0, length - len(head)))
        if not length or len(frame) < length:
            told = f"its last message, at byte {at:,}, has no end"
            raise damaged_log(path, f"{told}: the recorder died, or the file was cut")
        yield int.from_bytes(stamp, "big"), bytearray(frame)
