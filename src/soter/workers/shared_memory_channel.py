"""The worker's side of the exchange, in Python.

Purpose: `runtime/posix/soter_channel.h` for a process that answers: read a request whole, write an
answer with its sum, sleep in between.
Non-goals: the driver's side, which believes nothing that comes from here.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Words = npt.NDArray[np.uint64]
REQUEST_FD, ANSWER_FD = 3, 4
HEAD_WORDS = 8
PRIME, BASIS, MASK = 0x100000001B3, 0xCBF29CE484222325, 2**64 - 1
FUTEX = {"x86_64": 202, "aarch64": 98, "riscv64": 98}
FUTEX_WAIT = 0
NAP_NS = 200_000
"""Where there is no futex: how long to sleep between looks."""


@dataclass(frozen=True)
class Request:
    """A whole request: its number, the ct of the release in ns, the bytes."""

    number: int
    time_ns: int
    data: bytes


class LayoutError(Exception):
    """Whoever asks was built for another layout."""


class Channel:
    """Both segments of a worker; `sizes` of request and answer, `number` of their layout."""

    def __init__(self, number: int, sizes: tuple[int, int]) -> None:
        self._number = number
        self._sizes = sizes
        self._asked = _words(REQUEST_FD, sizes[0], write=False)
        self._given = _words(ANSWER_FD, sizes[1], write=True)
        self._last = 0
        self._futex = _Futex(self._asked)

    def ready(self) -> None:
        """Say that requests are waited for."""
        self._write(0, 0, 0, bytes(self._sizes[1]))

    def next(self) -> Request:
        """The next request; waits. LayoutError where it is not ours."""
        while True:
            seen = int(self._asked[0])
            words = self._asked.copy()
            whole = seen % 2 == 0 and seen == int(self._asked[0]) == int(words[0])
            if seen and whole and _sum(words) == int(words[6]):
                if (int(words[1]), int(words[2])) != (self._number, self._sizes[0]):
                    raise LayoutError
                if int(words[3]) != self._last:
                    self._last = int(words[3])
                    data = words[HEAD_WORDS:].tobytes()[: self._sizes[0]]
                    return Request(self._last, int(words[4]), data)
            self._futex.wait(seen)

    def answer(self, request: Request, data: bytes | None) -> None:
        """Answer; None: the step failed."""
        fault = int(data is None)
        self._write(request.number, request.time_ns, fault, data or bytes(self._sizes[1]))

    def _write(self, number: int, time_ns: int, fault: int, data: bytes) -> None:
        there = self._given
        new = np.zeros_like(there)
        new[1:6] = [self._number, self._sizes[1], number, time_ns, fault]
        padded = data.ljust(8 * (len(there) - HEAD_WORDS), b"\0")
        new[HEAD_WORDS:] = np.frombuffer(padded, dtype=np.uint64)
        new[6] = _sum(new)
        odd = int(there[0]) | 1
        there[0] = odd
        there[1:] = new[1:]
        there[0] = (odd + 1) & MASK


def _words(fd: int, size: int, *, write: bool) -> Words:
    """A segment as words: (8 + ceil(size / 8),)."""
    count = HEAD_WORDS + -(-size // 8)
    prot = mmap.PROT_READ | (mmap.PROT_WRITE if write else 0)
    return np.frombuffer(mmap.mmap(fd, 8 * count, prot=prot), dtype=np.uint64)


def _sum(words: Words) -> int:
    """FNV-1a over the head, without sequence and sum, and the value."""
    told = BASIS
    listed = words.tolist()
    for word in (*listed[1:6], *listed[7:]):
        told = ((told ^ word) * PRIME) & MASK
    return told


class _Futex:
    """Sleeps while a word of a segment is what it was."""

    def __init__(self, words: Words) -> None:
        self._at = ctypes.c_void_p(words.ctypes.data)
        self._number = FUTEX.get(platform.machine())
        self._call = ctypes.CDLL(None, use_errno=True).syscall

    def wait(self, seen: int) -> None:
        """Until it is another, or for nothing: callers look again."""
        if self._number is None or os.name != "posix":
            ctypes.CDLL(None).usleep(NAP_NS // 1000)
            return
        low = ctypes.c_uint32(seen & 0xFFFFFFFF)
        self._call(ctypes.c_long(self._number), self._at, FUTEX_WAIT, low, None, None, 0)
