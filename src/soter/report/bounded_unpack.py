"""Unpacks bz2, lz4 and zstd within bounds.

Purpose: keeps one chunk of a log, and all of them together, from filling the reader's memory.
Non-goals: files of gzip (`monitor/log_files/csv_log.py`).
"""

from __future__ import annotations

import bz2
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import BinaryIO

CHUNK_MAX = 256 << 20
"""Most bytes of one chunk, or message, of a log."""
UNPACKED_MIN, UNPACKED_RATIO = 4 << 30, 32
"""All chunks may unpack to this many bytes, or to this many times the file if that is more."""
PART = 1 << 20


class TooLargeError(ValueError):
    """Raised for a file that unpacks to more bytes than any log has."""


class BoundedUnpacking:
    """Unpacks chunks of a file of `size` bytes; TooLargeError, or errors of the packages."""

    def __init__(self, size: int) -> None:
        self.left = max(UNPACKED_MIN, UNPACKED_RATIO * size)

    def unpack_bz2(self, packed: bytes) -> bytes:
        """The content of a chunk packed by bz2."""
        return self.count_plain(_joined_pieces(_unpacked_pieces(bz2.BZ2Decompressor(), packed)))

    def unpack_lz4(self, packed: bytes) -> bytes:
        """The content of a frame packed by lz4."""
        from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415 - comes with an extra

        return self.count_plain(_joined_pieces(_unpacked_pieces(LZ4FrameDecompressor(), packed)))

    def unpack_zstd(self, packed: bytes) -> bytes:
        """The content of frames packed by zstd."""
        from zstandard import ZstdDecompressor  # noqa: PLC0415 - comes with an extra

        with ZstdDecompressor().stream_reader(packed, read_across_frames=True) as reader:
            return self.count_plain(_joined_pieces(iter(lambda: reader.read(PART), b"")))

    def count_plain(self, data: bytes) -> bytes:
        """Counts bytes towards the limit and gives them; raises TooLargeError beyond the limit."""
        self.left -= len(data)
        if self.left < 0:
            raise TooLargeError("it unpacks to more than any log has")
        return data


def _unpacked_pieces(unpacker: Any, packed: bytes) -> Iterator[bytes]:  # noqa: ANN401 - two packages, one shape
    """Yields the content of one packed stream in pieces; raises EOFError if its end is missing."""
    rest = packed
    while not unpacker.eof:
        part = unpacker.decompress(rest, max_length=PART)
        rest = b""
        if not part and (unpacker.needs_input or unpacker.eof):
            break
        yield part
    if not unpacker.eof:
        raise EOFError("the end of a part of it is missing")


def _joined_pieces(unpacked: Iterable[bytes]) -> bytes:
    """The pieces of a chunk as one; TooLargeError as soon as they exceed `CHUNK_MAX` bytes."""
    parts, size = [], 0
    for part in unpacked:
        size += len(part)
        if size > CHUNK_MAX:
            raise TooLargeError(f"a part of it unpacks to more than {CHUNK_MAX >> 20} MiB")
        parts.append(part)
    return b"".join(parts)


def unpack_file(packed: BinaryIO, into: BinaryIO, size: int) -> None:
    """Unpacks a complete zstd file into another file; raises TooLargeError if it is too large."""
    from zstandard import ZstdDecompressor  # noqa: PLC0415 - comes with an extra

    unpacking = BoundedUnpacking(size)
    with ZstdDecompressor().stream_reader(packed, read_across_frames=True) as reader:
        while part := reader.read(PART):
            into.write(unpacking.count_plain(part))
