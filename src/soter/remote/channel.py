"""Gives Python access to the file of a topic in shared memory.

Purpose: a `Channel` writes, reads or waits for a topic; many threads may use one. It calls the same
C as the robot: the order of loads and stores there makes values consistent, and Python has no part
in that.
Non-goals: values (`topics.py`); permissions: every user who may write to the folder may write.
"""

from __future__ import annotations

import os
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.c_interface import declarations, interface
from soter.native.cache import cached_folder, digest
from soter.native.compiler import DEFECT, STRICT, compile_with, find_compiler
from soter.native.shared_library import CHECK_FAILED, OWN_SYMBOLS, RUNTIME, c_texts, include_flags

if TYPE_CHECKING:
    from pathlib import Path

POSIX = RUNTIME / "posix"
SOURCES = (POSIX / "soter_outside.c", POSIX / "soter_channel.c", CHECK_FAILED)
LIBRARY = "channels.so"
ANEW = "stop everything that uses the folder, empty it, start anew"

WRITERS: WeakSet[Channel] = WeakSet()
"""Channels that a forked process closes; else it keeps their locks after the writer's end."""


@lru_cache(maxsize=1)
def compiled_library() -> tuple[Any, Any]:
    """Gives the cffi object and the loaded library; raises X004, X005 if C cannot compile."""
    compiler = find_compiler()
    flags = (*STRICT, "-O2", "-fPIC", "-shared", *OWN_SYMBOLS)

    def compile_channels(work: Path) -> None:
        sources = [*include_flags(*SOURCES), *map(str, SOURCES), "-o", LIBRARY]
        command = [*compiler.command, *flags, *sources]
        compile_with(command, work, "channels do not compile: they need Linux", (DEFECT,))

    content = digest((compiler.identity, *flags, *c_texts(*SOURCES)))
    built = cached_folder("channels", content, (LIBRARY,), compile_channels) / LIBRARY
    headers = [declarations(POSIX / n) for n in ("soter_channel.h", "soter_outside.h")]
    ffi = interface(*headers)
    return ffi, ffi.dlopen(str(built))


class Channel:
    """The open file of a topic. `writes`: open it as its only writer; a forked child closes it."""

    def __init__(self, folder: Path, name: str, number: int, size: int, *, writes: bool) -> None:
        self._c: Any = None
        self._ffi, self._lib = compiled_library()
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
            raise self._channel_error(self._ffi.string(wrong).decode(errors="replace"))
        if self._is_foreign():
            self.close()
            raise self._foreign_error()

    def write(self, stamp_ns: int, image: bytes) -> None:
        """Writes the next value; `image` has the topic's size."""
        assert len(image) == self._size
        with self._lock:
            self._require_open()
            self._lib.soter_outside_write(self._c, stamp_ns, self._ffi.from_buffer(image))

    def read(self) -> tuple[int, bytes] | None:
        """Gives stamp and bytes of a new value, else None; raises X013 if the layout is another."""
        with self._lock:
            self._require_open()
            value, null = self._value, self._ffi.NULL
            if self._lib.soter_outside_read(self._c, self._time, value, null):
                return int(self._time[0]), bytes(self._ffi.buffer(value, self._size))
            if self._is_foreign():
                raise self._foreign_error()
        return None

    def wait(self, most_ns: int) -> None:
        """Waits up to `most_ns` for a new value, and keeps the channel locked meanwhile."""
        with self._lock:
            self._require_open()
            self._lib.soter_outside_wait(self._c, most_ns)

    def close(self) -> None:
        """Frees the memory of the channel, and keeps the file."""
        with self._lock:
            self._lib.soter_outside_close(self._c)

    def close_in_child(self) -> None:
        """Closes the channel in a forked process, in which no thread can hold the old lock."""
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
        """Whether the file holds a value of another layout, and no value of this topic's layout."""
        ours, other = self._lib.SOTER_CHANNEL_OTHER, self._lib.SOTER_CHANNEL_LAYOUT
        c = self._c
        found = [
            self._lib.soter_channel_read(place, c.hash, self._size, 0, self._head, c.room)
            for place in c.place
        ]
        return other in found and ours not in found

    def _foreign_error(self) -> SoterError:
        why = "it holds values of another type: who wrote them was built from another program"
        return self._channel_error(f"{why}. Connect with the robot's own package, or {ANEW}")

    def _channel_error(self, why: str) -> SoterError:
        return SoterError(
            (Diagnostic("X013", f"the channel `{self._name}` cannot be used: {why}"),)
        )


def _close_in_child() -> None:
    for channel in tuple(WRITERS):
        channel.close_in_child()


os.register_at_fork(after_in_child=_close_in_child)
