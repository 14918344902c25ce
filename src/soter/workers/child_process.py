"""Runs a child process that answers questions, and ends processes that it leaves behind.

Purpose: `Child` forks, asks, and waits for a limited time; an answer is bytes of a limited length,
whose meaning is the caller's business. A child that hangs, crashes, exits or sends too much is
ended, and `DeadError` says how. No process that its code started outlives the command: on Linux all
become children of one process here, which ends them (prctl(2), PR_SET_CHILD_SUBREAPER).
Non-goals: what is asked (`simulate/externs/extern_process.py`); being on time (`exchange.py`); a
child that means harm: it has this process's user, and so may send signals.
"""

from __future__ import annotations

import ctypes
import os
import resource
import select
import signal
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
CLOSED_TO = 65_536
PATIENCE_S = 5.0
"""How long a process may take to end once it is told to, in s."""


def resume_child(child: int) -> None:
    """Resumes a child that was stopped, because an extern's code may stop its parents by signals.

    If a user stops the command with Ctrl-Z, the caller of this function is stopped as well.
    """
    if sys.platform != "win32":
        with suppress(ChildProcessError, ProcessLookupError):
            if os.waitid(os.P_PID, child, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None:
                os.kill(child, signal.SIGCONT)


def adopt_orphans() -> None:
    """Makes this process the parent of descendants whose own parents have ended (Linux)."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def end_children() -> None:
    """Kills the children of this process, and then the orphans that it has adopted."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end and (left := child_processes(os.getpid())):
        for process in left:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(process, 0)


def child_processes(parent: int) -> list[int]:
    """The process numbers of the children of `parent`, from the files of proc(5)."""
    children = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(stat.read_bytes().rpartition(b")")[2].split()[1]) == parent:
                children.append(int(stat.parent.name))
    return children


def fork_under_supervisor(parent: int) -> int:
    """Forks and returns only in the child; gives the process number of the supervising parent.

    The supervisor leads a session and adopts processes that the child leaves behind. It ends all of
    them when the child has ended, when `parent` is gone, or on SIGTERM; then it ends as the child.
    """
    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, (signal.SIGTERM, signal.SIGCHLD))
    adopt_orphans()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os._exit(1)
    pid = os.getpid()
    child = os.fork()
    if child == 0:
        return pid
    os.closerange(3, CLOSED_TO)
    code = _awaited_exit_code(child)
    end_children()
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with suppress(OSError):  # SIGKILL has no handler
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        os.kill(pid, -code)
    os._exit(code if code >= 0 else 1)


def _awaited_exit_code(child: int) -> int:
    """Waits for a child and gives its exit code as `subprocess` does; gives -9 after a SIGTERM."""
    while signal.sigwait((signal.SIGTERM, signal.SIGCHLD)) == signal.SIGCHLD:
        with suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                if ended[0] == child:
                    return os.waitstatus_to_exitcode(ended[1])
    return -signal.SIGKILL


HEAD = struct.Struct("<Q")
LONGEST = 64 * 2**20
"""The most bytes of an answer; an answer that announces more is not read."""
LOOK_S = 0.5
SLEEPY_S = 5.0
MEMORY = 64 * 2**30
"""Bytes of memory that a child may map."""


class DeadError(Exception):
    """Raised if the child can give no more answers; the text says why."""


class Child:
    """A child process that answers questions by the function that `serve` returns in it."""

    def __init__(self, serve: Callable[[], Callable[[bytes], bytes]]) -> None:
        """Forks the child, which calls `serve()` once; an exception in `serve` ends the child."""
        ours, theirs = socket.socketpair()
        sys.stdout.flush()
        sys.stderr.flush()
        parent = os.getpid()
        self.process = os.fork()
        if self.process == 0:
            ours.close()
            if sys.platform == "linux":
                parent = fork_under_supervisor(parent)
            _serve(theirs, parent, serve)
        theirs.close()
        ours.setblocking(False)
        self._socket = ours

    def answer_to(self, question: bytes, patience_s: float | None) -> bytes:
        """The child's answer to a question; if it is late, ends the child and raises DeadError."""
        end = None if patience_s is None else time.monotonic() + patience_s
        try:
            self._send(HEAD.pack(len(question)) + question, end)
            (length,) = HEAD.unpack(self._receive(HEAD.size, end))
            if length > LONGEST:
                raise DeadError(self.end("it answered with too much"))
            return self._receive(length, end)
        except TimeoutError:
            raise DeadError(self.end(f"it did not answer for {patience_s:g} s: ended")) from None
        except OSError:
            raise DeadError(self.end("")) from None

    def end(self, why: str = "") -> str:
        """Ends the child if it still runs; gives the reason for its end in words."""
        self._socket.close()
        if self.process == 0:
            return why
        if why:
            self._kill_child()
        status = self._reap_child()
        self.process = 0
        code = os.waitstatus_to_exitcode(status)
        if why:
            return why
        if code < 0:
            return f"its process was ended by {signal.Signals(-code).name}"
        return f"its process ended by itself, with exit status {code}"

    def _reap_child(self) -> int:
        """Waits for the child's end, kills it if it takes too long, and gives its wait status.

        The processes that the child has started end, too: on Linux all (`fork_under_supervisor`),
        elsewhere only those that are still in the child's session.
        """
        self._wait_for_end(LOOK_S)
        self._kill_child()  # before `waitpid`, which frees the group's number
        _, status = os.waitpid(self.process, 0)
        return status

    def _wait_for_end(self, at_most_s: float) -> None:
        """Waits until the child has ended, but at most `at_most_s` seconds."""
        end = time.monotonic() + at_most_s
        while not _has_ended(self.process) and time.monotonic() < end:
            time.sleep(0.001)

    def _kill_child(self) -> None:
        if sys.platform == "linux":
            with suppress(ProcessLookupError):
                os.kill(self.process, signal.SIGTERM)
            self._wait_for_end(PATIENCE_S + LOOK_S)  # the supervisor ends others meanwhile
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process, signal.SIGKILL)
        with suppress(ProcessLookupError):
            os.kill(self.process, signal.SIGKILL)

    def _send(self, data: bytes, end: float | None) -> None:
        left = memoryview(data)
        while left:
            _wait_until_ready(self._socket, end, write=True)
            left = left[self._socket.send(left) :]

    def _receive(self, count: int, end: float | None) -> bytes:
        data = bytearray()
        while len(data) < count:
            _wait_until_ready(self._socket, end, write=False)
            part = self._socket.recv(min(count - len(data), 2**20))
            if not part:
                raise ConnectionResetError
            data += part
        return bytes(data)


def _has_ended(process: int) -> bool:
    """Whether a child has ended; False if the system cannot say. The wait status stays unread."""
    if not hasattr(os, "waitid"):
        return False
    status = os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    return status is not None


def _wait_until_ready(side: socket.socket, end: float | None, *, write: bool) -> None:
    """Waits until a socket can be read or written; raises TimeoutError at the time `end`."""
    while True:
        left = SLEEPY_S if end is None else end - time.monotonic()
        if left <= 0:
            raise TimeoutError
        able = select.select([] if write else [side], [side] if write else [], [], left)
        if able[0] or able[1]:
            return


# ---------------------------------------------------------------- the child


def _serve(side: socket.socket, parent: int, serve: Callable[[], Callable[[bytes], bytes]]) -> None:
    """Closes the parent's files in the child, then answers questions; it never returns."""
    status = 1
    try:
        _leave_parent(side, parent)
        answer = serve()
        while True:
            (length,) = HEAD.unpack(_receive_exactly(side, HEAD.size))
            reply = answer(_receive_exactly(side, length))
            side.sendall(HEAD.pack(len(reply)) + reply)
    except (EOFError, OSError):
        status = 0
    finally:
        with suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


def _leave_parent(side: socket.socket, parent: int) -> None:
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    end_with_parent(parent)
    with suppress(OSError, ValueError):
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        wanted = MEMORY if most == resource.RLIM_INFINITY else min(MEMORY, most)
        resource.setrlimit(resource.RLIMIT_AS, (wanted, wanted))
    kept = side.fileno()
    os.closerange(3, kept)
    os.closerange(kept + 1, CLOSED_TO)


def end_with_parent(parent: int) -> None:
    """Makes sure that this process is killed when its parent is gone.

    On Linux the system kills it; elsewhere a thread watches the parent and ends the process.
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        threading.Thread(target=_watch_parent, args=(parent,), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGKILL)


def _receive_exactly(side: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = side.recv(count - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)
