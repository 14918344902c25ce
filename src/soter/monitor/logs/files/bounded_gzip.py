"""What gzip has packed, unpacked within bounds.

Purpose: a file that says what Python's `gzip` reads of it, but neither unpacks without an end nor
steps over gigabytes of zeros, byte by byte, behind its end.
Non-goals: what stands there.
"""

from __future__ import annotations

import io
import zlib
from typing import BinaryIO

GZIP = 31
"""What zlib calls the format."""
PART = 1 << 16
PADDING_MAX = 1 << 20
"""Bytes of zeros that may stand behind what is packed."""
UNPACKED_MAX = 4 << 30
"""Bytes that are unpacked: a log has no more."""


class BoundedGzip(io.RawIOBase):
    """Reading raises zlib.error (no gzip, or too much) and EOFError (its end is missing)."""

    def __init__(self, packed: BinaryIO) -> None:
        self._packed = packed
        self._member = zlib.decompressobj(GZIP)
        self._left = b""
        self._read = self._said = 0

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, into: memoryview) -> int:  # type: ignore[override]
        """The next bytes; 0 at the end."""
        found = self._next(len(into))
        into[: len(found)] = found
        return len(found)

    def _next(self, most: int) -> bytes:
        while True:
            if self._member.eof and not self._another():
                return b""
            part = self._left or self._packed.read(PART)
            self._read += len(part)
            found = self._member.decompress(part, most)
            self._left = self._member.unconsumed_tail
            self._said += len(found)
            if self._said > UNPACKED_MAX:
                raise zlib.error(f"it unpacks to more than {UNPACKED_MAX >> 30} GiB")
            if found:
                return found
            if not part and not self._member.eof:
                if not self._read:
                    return b""
                raise EOFError("its end is missing")

    def _another(self) -> bool:
        """Whether another member follows."""
        rest = self._member.unused_data.lstrip(b"\0")
        rest = rest or self._packed.read(PADDING_MAX).lstrip(b"\0")
        if not rest and self._packed.read(1):
            raise zlib.error("much else stands behind its end")
        if rest:
            self._member, self._left = zlib.decompressobj(GZIP), rest
        return bool(rest)
