"""A channel from Python: `runtime/posix/soter_outside.c`, compiled for this machine.

Purpose: open, write, read, wait, in words what is wrong; one handle may be used by many threads.
The C is that of the robot: the order of its stores and loads is what makes a value whole, and
Python says nothing about that.
Non-goals: what the bytes mean (`topics.py`); who may write: whoever may write into the folder.
"""

from __future__ import annotations

import os
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.cache import cached, digest
from soter.native.compiler import DEFECT, STRICT, compile_with, find
from soter.native.shared_library import (
    CHECK_FAILED,
    OWN_SYMBOLS,
    RUNTIME,
    declarations,
    include_flags,
    interface,
    texts,
)

if TYPE_CHECKING:
    from pathlib import Path

POSIX = RUNTIME / "posix"
SOURCES = (POSIX / "soter_outside.c", POSIX / "soter_channel.c", CHECK_FAILED)
LIBRARY = "channels.so"
ANEW = "stop everything that uses the folder, empty it, start anew"


@lru_cache(maxsize=1)
def compiled() -> tuple[Any, Any]:
    """(ffi, library); SoterError X004, X005 where nothing compiles here."""
    compiler = find()
    flags = (*STRICT, "-O2", "-fPIC", "-shared", *OWN_SYMBOLS)

    def make(work: Path) -> None:
        sources = [*include_flags(*SOURCES), *map(str, SOURCES), "-o", LIBRARY]
        command = [*compiler.command, *flags, *sources]
        compile_with(command, work, "channels do not compile: they need Linux", (DEFECT,))

    content = digest((compiler.identity, *flags, *texts(*SOURCES)))
    built = cached("channels", content, (LIBRARY,), make) / LIBRARY
    headers = [declarations(POSIX / n) for n in ("soter_channel.h", "soter_outside.h")]
    ffi = interface(*headers)
    return ffi, ffi.dlopen(str(built))


class Channel:
    """One topic's file; `writes`: as its only writer. A forked process is none."""

    def __init__(self, folder: Path, name: str, number: int, size: int, *, writes: bool) -> None:
        self._c: Any = None
        self._ffi, self._lib = compiled()
        self._name, self._size = name, size
        self._lock = Lock()
        self._c = self._ffi.new("soter_outside *")
        self._value = self._ffi.new("uint8_t[]", max(size, 1))
        self._time = self._ffi.new("int64_t *")
        self._head = self._ffi.new("soter_channel_head *")
        if writes:
            WRITERS.add(self)
        where = (str(folder).encode(), name.encode())
        wrong = self._lib.soter_outside_open(self._c, *where, number, size, writes)
        if wrong != self._ffi.NULL:
            raise self._unusable(self._ffi.string(wrong).decode(errors="replace"))
        if self._is_foreign():
            self.close()
            raise self._foreign()

    def write(self, stamp_ns: int, image: bytes) -> None:
        """The next value; `image` of the topic's size."""
        assert len(image) == self._size
        with self._lock:
            self._require_open()
            self._lib.soter_outside_write(self._c, stamp_ns, self._ffi.from_buffer(image))

    def read(self) -> tuple[int, bytes] | None:
        """Stamp and bytes of a value that was not read before; None where there is none.

        SoterError X013 where somebody writes here who was built for another program.
        """
        with self._lock:
            self._require_open()
            value, null = self._value, self._ffi.NULL
            if self._lib.soter_outside_read(self._c, self._time, value, null):
                return int(self._time[0]), bytes(self._ffi.buffer(value, self._size))
            if self._is_foreign():
                raise self._foreign()
        return None

    def wait(self, most_ns: int) -> None:
        """Until something was written since, or so long; nobody else uses the handle meanwhile."""
        with self._lock:
            self._require_open()
            self._lib.soter_outside_wait(self._c, most_ns)

    def close(self) -> None:
        """Gives its memory back; the file stays."""
        with self._lock:
            self._lib.soter_outside_close(self._c)

    def close_in_child(self) -> None:
        """In a forked process, where no other thread has the handle, whoever had its lock."""
        self._lock = Lock()
        self.close()

    def __del__(self) -> None:
        if self._c is not None:
            self.close()

    def _require_open(self) -> None:
        if self._c.place[0] == self._ffi.NULL:
            raise ValueError(
                f"the connection is closed: `{self._name}` is neither read nor written"
            )

    def _is_foreign(self) -> bool:
        """Whether a value of another layout stands here, and none of ours."""
        own, other = self._lib.SOTER_CHANNEL_OTHER, self._lib.SOTER_CHANNEL_LAYOUT
        c = self._c
        found = [
            self._lib.soter_channel_read(place, c.hash, self._size, 0, self._head, c.room)
            for place in c.place
        ]
        return other in found and own not in found

    def _foreign(self) -> SoterError:
        why = "it holds values of another type: who wrote them was built from another program"
        return self._unusable(f"{why}. Connect with the robot's own package, or {ANEW}")

    def _unusable(self, why: str) -> SoterError:
        return SoterError(
            (Diagnostic("X013", f"the channel `{self._name}` cannot be used: {why}"),)
        )


def _close_in_child() -> None:
    for channel in tuple(WRITERS):
        channel.close_in_child()


WRITERS: WeakSet[Channel] = WeakSet()
"""A forked process has their locks, too, and would keep them when the writer has ended."""
os.register_at_fork(after_in_child=_close_in_child)
