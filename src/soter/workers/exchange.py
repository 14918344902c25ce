"""The bytes that are exchanged with the process of an extern node, and the worker's channel.

Purpose: `Exchange` says where each topic lies in a request and in an answer; by its `number` one
recognizes a process that was built for another layout. `Channel` is `runtime/posix/soter_channel.h`
for the process that answers: it reads a complete request, writes an answer with its checksum, and
sleeps in between.
Non-goals: the driver's side, which trusts no answer (`runtime/posix/`).
"""

from __future__ import annotations

import ctypes
import hashlib
import mmap
import os
import platform
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from soter.codegen.externs import answer_fields, request_fields
from soter.core.layout import LayoutMember, Struct, align_of, lay_out, size_of
from soter.language.model.types import ArrayType, EnumType, ListType, RecordType

if TYPE_CHECKING:
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type


@dataclass(frozen=True)
class Exchange:
    """The layouts of an extern node's requests and answers; `number`: 64 bits of their SHA-256."""

    request: Struct
    answer: Struct
    number: int

    @property
    def sizes(self) -> tuple[int, int]:
        """The sizes of a request and of an answer, in bytes."""
        return self.request.size, self.answer.size


def make_exchange(system: System, component: Component) -> Exchange:
    """The layouts of the requests to an extern node and of its answers."""
    request = _layout_as_declared(request_fields(system, component))
    fields = answer_fields(component)
    answer = lay_out(fields)
    if not answer.members:
        answer = Struct((), 8, 1, 8)
    text = f"{component.name} in {_layout_text(request)} out {_layout_text(answer)}"
    number = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
    return Exchange(request, answer, number)


def _layout_as_declared(fields: tuple[tuple[str, Type], ...]) -> Struct:
    """The layout that C gives to a struct of these members, in this order."""
    offset, members = 0, []
    for index, (name, t) in enumerate(fields):
        offset = -(-offset // align_of(t)) * align_of(t)
        members.append(LayoutMember(name, t, offset, index))
        offset += size_of(t)
    align = max([1, *(align_of(t) for _, t in fields)])
    size = max(-(-offset // align) * align, 1)
    return Struct(tuple(members), size, align, size - offset)


def _layout_text(struct: Struct) -> str:
    parts = [f"{m.name}@{m.offset}:{_type_text(m.type)}" for m in struct.members]
    return f"[{' '.join(parts)}] {struct.size}"


def _type_text(t: Type) -> str:
    """A text that describes the bytes of a type, without the names of records."""
    if isinstance(t, RecordType):
        return "{" + " ".join(f"{n}:{_type_text(f)}" for n, f in t.fields) + "}"
    if isinstance(t, ArrayType):
        return f"{_type_text(t.element)}[{t.size}]"
    if isinstance(t, ListType):
        return f"{_type_text(t.element)}[<={t.capacity}]"
    if isinstance(t, EnumType):
        return f"enum({' '.join(t.members)})"
    return f"{type(t).__name__}:{size_of(t)}"


Words = npt.NDArray[np.uint64]
REQUEST_FD, ANSWER_FD = 3, 4
HEAD_WORDS = 8
PRIME, BASIS, MASK = 0x100000001B3, 0xCBF29CE484222325, 2**64 - 1
FUTEX = {"x86_64": 202, "aarch64": 98, "riscv64": 98}
FUTEX_WAIT = 0
NAP_NS = 200_000
"""How long to sleep, in ns, between two looks on systems without a futex."""


@dataclass(frozen=True)
class Request:
    """A complete request, with its number, the node's release time in ns, and its bytes."""

    number: int
    time_ns: int
    data: bytes


class LayoutError(Exception):
    """Raised if the process that sends requests was built for another layout."""


class Channel:
    """A worker's two shared segments, for requests and for answers; `sizes` are in bytes."""

    def __init__(self, number: int, sizes: tuple[int, int]) -> None:
        self._number = number
        self._sizes = sizes
        self._request_words = _map_segment(REQUEST_FD, sizes[0], write=False)
        self._answer_words = _map_segment(ANSWER_FD, sizes[1], write=True)
        self._last = 0
        self._futex = _Futex(self._request_words)

    def announce_ready(self) -> None:
        """Tells the driver that this side waits for requests."""
        self._write_answer(0, 0, 0, bytes(self._sizes[1]))

    def next_request(self) -> Request:
        """Waits for the next request and gives it; raises LayoutError if its layout is another."""
        while True:
            seen = int(self._request_words[0])
            words = self._request_words.copy()
            whole = seen % 2 == 0 and seen == int(self._request_words[0]) == int(words[0])
            if seen and whole and _checksum(words) == int(words[6]):
                if (int(words[1]), int(words[2])) != (self._number, self._sizes[0]):
                    raise LayoutError
                if int(words[3]) != self._last:
                    self._last = int(words[3])
                    data = words[HEAD_WORDS:].tobytes()[: self._sizes[0]]
                    return Request(self._last, int(words[4]), data)
            self._futex.wait(seen)

    def answer(self, request: Request, data: bytes | None) -> None:
        """Answers a request; if `data` is None, the answer says that the step failed."""
        fault = int(data is None)
        self._write_answer(request.number, request.time_ns, fault, data or bytes(self._sizes[1]))

    def _write_answer(self, number: int, time_ns: int, fault: int, data: bytes) -> None:
        words = self._answer_words
        new = np.zeros_like(words)
        new[1:6] = [self._number, self._sizes[1], number, time_ns, fault]
        padded = data.ljust(8 * (len(words) - HEAD_WORDS), b"\0")
        new[HEAD_WORDS:] = np.frombuffer(padded, dtype=np.uint64)
        new[6] = _checksum(new)
        odd = int(words[0]) | 1
        words[0] = odd
        words[1:] = new[1:]
        words[0] = (odd + 1) & MASK


def _map_segment(fd: int, size: int, *, write: bool) -> Words:
    """Maps the file `fd`; gives the shared segment as an array (8 + ceil(size / 8),) of words."""
    count = HEAD_WORDS + -(-size // 8)
    prot = mmap.PROT_READ | (mmap.PROT_WRITE if write else 0)
    return np.frombuffer(mmap.mmap(fd, 8 * count, prot=prot), dtype=np.uint64)


def _checksum(words: Words) -> int:
    """The FNV-1a hash of a segment's words, except the sequence number and the checksum."""
    total = BASIS
    listed = words.tolist()
    for word in (*listed[1:6], *listed[7:]):
        total = ((total ^ word) * PRIME) & MASK
    return total


class _Futex:
    """Lets this process sleep until the first word of a segment changes."""

    def __init__(self, words: Words) -> None:
        self._at = ctypes.c_void_p(words.ctypes.data)
        self._number = FUTEX.get(platform.machine())
        self._call = ctypes.CDLL(None, use_errno=True).syscall

    def wait(self, seen: int) -> None:
        """Waits until the word is not `seen`; may return early, so the caller must check again."""
        if self._number is None or os.name != "posix":
            ctypes.CDLL(None).usleep(NAP_NS // 1000)
            return
        low = ctypes.c_uint32(seen & 0xFFFFFFFF)
        self._call(ctypes.c_long(self._number), self._at, FUTEX_WAIT, low, None, None, 0)
