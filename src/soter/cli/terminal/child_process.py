"""Runs a command that calls externs in a child process, so that a crash in them is no verdict.

Purpose: the child runs the command, and leaves its output and exit code in a file without a name
(`ResultFile`); the parent, in which no extern runs, passes signals on, waits, and
prints what it finds there. Where it finds nothing it says X011, never success, however the child
ended. Processes that externs started end with the run, and the child with its parent.
Non-goals: isolation (`workers/`). An extern has all rights of the child: one that wants to harm may
find the file, write a verdict of its own, or change the engine's memory.
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

from soter.cli.terminal.console import ChildResult, Console
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.workers.child_process import adopt_orphans, end_children, end_with_parent, resume_child

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import NoReturn

    Rescue = Callable[[int], tuple[str, ...]]

PATIENCE_S = 5
"""Seconds until a child that was told to end is killed: its C code may ignore the signal."""
AGAIN_S = 1.0
"""A second signal after more seconds than these kills the child: a person will not wait."""


def fork_into_child(console: Console, rescue: Rescue) -> None:
    """Forks if this process is the command itself; only the child returns from here.

    The parent raises `ChildResult` with the child's result. If the child left none, it raises
    `SoterError` X011, or `KeyboardInterrupt` if the child had been told to end. Before these two
    `rescue(pid)` saves files that the child was writing, and returns a sentence for each.
    """
    if not console.own_process or not hasattr(os, "fork"):
        return
    verdict = ResultFile()
    console.flush()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    ending = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    ending = {s for s in ending if signal.getsignal(s) is not signal.SIG_IGN}
    parent = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*ending, signal.SIGCHLD, signal.SIGALRM})
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        end_with_parent(parent)
        verdict.note_child()
        console.keep_output_for(verdict.leave_result)
        return
    adopt_orphans()
    status, was_told = _wait_for_child(child, {*ending, signal.SIGCHLD, signal.SIGALRM})
    end_children()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if (exception := verdict.child_result()) is not None:
        raise exception
    saved = rescue(child)
    if was_told:
        for text in saved:
            console.note(text)
        raise KeyboardInterrupt
    raise SoterError((_no_verdict_diagnostic(status, saved),))


def _wait_for_child(child: int, signals: set[signal.Signals]) -> tuple[int, bool]:
    """Waits for the child; gives the wait status, and whether a signal asked the child to end."""
    told_s: float | None = None
    while True:
        number, passed_on = _next_signal(signals)
        if number == signal.SIGCHLD:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                signal.alarm(0)
                return status, told_s is not None
            resume_child(child)
        elif number == signal.SIGALRM or (told_s and time.monotonic() - told_s > AGAIN_S):
            os.kill(child, signal.SIGKILL)
        else:
            told_s = told_s or time.monotonic()
            if not passed_on:
                os.kill(child, number)
            if number != signal.SIGINT:
                signal.alarm(PATIENCE_S)


def _next_signal(signals: set[signal.Signals]) -> tuple[int, bool]:
    """Waits for a signal; gives its number, and whether the terminal also sent it to the child."""
    if sys.platform == "linux":
        info = signal.sigwaitinfo(signals)
        return info.si_signo, info.si_code > 0
    return signal.sigwait(signals), False


def _no_verdict_diagnostic(status: int, saved: tuple[str, ...]) -> Diagnostic:
    code = os.waitstatus_to_exitcode(status)
    how = f"it ended by itself, with exit status {code}"
    if code < 0:
        how = f"it was ended by {signal.Signals(-code).name}"
    return Diagnostic(
        "X011",
        "the process in which the externs ran is gone, without a verdict",
        notes=(how, *saved),
        helps=("an extern ends it by `os._exit`, `os.exec*`, a crash in linked C, or a signal",),
    )


THREADS_S = 1.0
"""Seconds that threads which externs left behind have to end."""


HIGH = 200
"""The result's file gets at least this descriptor: an extern misuses lower ones by mistake."""


class ResultFile:
    """The file in which a child leaves its result; a mark and a hash show that it is complete."""

    def __init__(self) -> None:
        self._file = _open_unnamed_file()
        self._mark = os.urandom(16)
        self._process = 0

    def note_child(self) -> None:
        """Notes that this process is the child, which may leave a result."""
        self._process = os.getpid()

    def leave_result(self, text: str, exit_code: int) -> NoReturn:
        """Writes a result and ends the process; a fork made by an extern only ends."""
        if os.getpid() != self._process:
            os._exit(1)
        body = bytes([exit_code]) + text.encode("utf-8", "surrogateescape")
        whole = memoryview(self._mark + self._hash_with_mark(body) + body)
        at = 0
        with suppress(OSError):
            while at < len(whole):
                at += os.pwrite(self._file, whole[at:], at)
        with suppress(OSError):  # an extern may have stopped the parent, which prints the result
            os.kill(os.getppid(), signal.SIGCONT)
        _end_process(exit_code)

    def child_result(self) -> ChildResult | None:
        """The result that the child left; None if it left no complete result."""
        size = os.fstat(self._file).st_size
        whole = bytearray()
        while len(whole) < size and (part := os.pread(self._file, size - len(whole), len(whole))):
            whole += part
        mark, digest, body = bytes(whole[:16]), bytes(whole[16:48]), bytes(whole[48:])
        if not body or mark != self._mark or digest != self._hash_with_mark(body):
            return None
        return ChildResult(body[1:].decode("utf-8", "surrogateescape"), body[0])

    def _hash_with_mark(self, body: bytes) -> bytes:
        return hashlib.sha256(self._mark + body).digest()


def _open_unnamed_file() -> int:
    """The descriptor of a new file without a name; programs started later do not inherit it."""
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


def _end_process(exit_code: int) -> NoReturn:
    """Ends the process after its `atexit` functions, even if externs have left threads running."""
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
