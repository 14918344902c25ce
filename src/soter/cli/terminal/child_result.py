"""What a child leaves for the process that waits for it: its words and its exit code.

Purpose: a file without a name holds the result, whole or not at all; externs that the child ran
reach it by no accident.
Non-goals: an extern that means to: it runs in the child, with all its rights.
"""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import NoReturn

THREADS_S = 1.0
"""How long the threads that externs leave behind may take to end."""
HIGH = 200
"""Descriptors that an extern closes or writes to by mistake are lower."""


class ChildResult(Exception):  # noqa: N818 - no error: the command was done, in the child
    """The verdict of a child: what it had to say on standard output, and its exit code."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(exit_code)
        self.text = text
        self.exit = exit_code


class ResultPipe:
    """Where a child leaves its result. `mark` and a hash tell it from what is there by accident."""

    def __init__(self) -> None:
        self._file = _nameless()
        self._mark = os.urandom(16)
        self._process = 0

    def begin(self) -> None:
        """This is the process that may leave one."""
        self._process = os.getpid()

    def leave(self, text: str, exit_code: int) -> NoReturn:
        """Leave a result and end the process; a copy of it that an extern made only ends."""
        if os.getpid() != self._process:
            os._exit(1)
        body = bytes([exit_code]) + text.encode("utf-8", "surrogateescape")
        whole = memoryview(self._mark + self._hash(body) + body)
        at = 0
        with suppress(OSError):
            while at < len(whole):
                at += os.pwrite(self._file, whole[at:], at)
        with suppress(OSError):  # an extern may have stopped who is to tell it
            os.kill(os.getppid(), signal.SIGCONT)
        _end(exit_code)

    def found(self) -> ChildResult | None:
        """What was left; None where nothing whole was."""
        size = os.fstat(self._file).st_size
        whole = bytearray()
        while len(whole) < size and (part := os.pread(self._file, size - len(whole), len(whole))):
            whole += part
        mark, digest, body = bytes(whole[:16]), bytes(whole[16:48]), bytes(whole[48:])
        if not body or mark != self._mark or digest != self._hash(body):
            return None
        return ChildResult(body[1:].decode("utf-8", "surrogateescape"), body[0])

    def _hash(self, body: bytes) -> bytes:
        return hashlib.sha256(self._mark + body).digest()


def _nameless() -> int:
    """A file without a name that no program started by an extern inherits."""
    if sys.platform == "linux":
        made = os.memfd_create("soter verdict")
    else:
        import tempfile  # noqa: PLC0415 - only here

        with tempfile.TemporaryFile() as file:
            made = os.dup(file.fileno())
    import fcntl  # noqa: PLC0415 - not everywhere

    with suppress(OSError):
        high = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, HIGH)
        os.close(made)
        return high
    return made


def _end(exit_code: int) -> NoReturn:
    """End, whatever externs have left running: what they asked for at the end is done first."""
    import atexit  # noqa: PLC0415 - only here

    until_s = time.monotonic() + THREADS_S
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join(max(until_s - time.monotonic(), 0.0))
            if thread.is_alive():
                os.write(2, b"soter: an extern left a thread running, which ends here\n")
                break
    with suppress(BaseException):
        atexit._run_exitfuncs()  # noqa: SLF001 - Python's own order
    for stream in (sys.stdout, sys.stderr):
        with suppress(BaseException):
            stream.flush()
    os._exit(exit_code)
